"""WitMotion WT901, JY901, HWT905, WT61 and their kin: packets of 11 bytes, a few of which make a sample.

Source: WIT Standard Communication Protocol. 0x55, type, four little-endian int16, the low byte of the sum of the first
ten. 0x51 acceleration (full scale 16 g), 0x52 turn rate (2000 deg/s), 0x53 roll, pitch, yaw (180 deg), 0x54 magnetic
field in raw counts (how much a count is differs between models), 0x59 quaternion w, x, y, z (1).

Axes: z up, right-handed, +1 g at rest; attitude as z, y, x turns in an east-north-up frame: as the project's.

The packets of one instant follow each other in the order of their types, without a time. So a group ends where the
type falls; once a first group has ended, the highest type seen ends each at once. Where its last packet is lost, the
group is given with what it has when the next begins.
"""

from __future__ import annotations

import re
from math import pi
from struct import Struct

from pbd.data import GRAVITY
from pbd.sensors.attitude import rpy_from_quaternion
from pbd.sensors.decoding import Sample, Tally, Triple

ACC = 16.0 * GRAVITY / 32768.0
GYR = 2000.0 / 32768.0 * pi / 180.0
ANGLE = pi / 32768.0

NORM_OFF = 0.02
"""A quaternion whose length is off one by more was not measured: the device sends zeros before its filter runs."""

_PACKET = re.compile(rb"\x55[\x50-\x5a\x5f].{9}", re.DOTALL)
_BEGUN = re.compile(rb"\x55(?:[\x50-\x5a\x5f].{0,8})?\Z", re.DOTALL)
_WORDS = Struct("<2x4hx")


class WitMotionDecoder:
    """The types that a group may hold are learnt from the stream; there is no device time."""

    def __init__(self) -> None:
        self.tally = Tally()
        self._rest = b""
        self._parts: dict[int, Triple] = {}  # of the group under way, by type
        self._type = 0  # of the group's latest packet
        self._highest = 0  # of all types seen
        self._in_step = False  # the start of a group has been seen

    def feed(self, data: bytes) -> list[Sample]:
        """See `Decoder`."""
        buffer = self._rest + data
        tally = self.tally
        samples: list[Sample] = []
        end = 0  # of what has been dealt with
        while match := _PACKET.search(buffer, end):
            start = match.start()
            packet = match[0]
            tally.skipped_bytes += start - end
            if sum(packet[:10]) & 0xFF != packet[10]:
                tally.bad_packets += 1
                tally.skipped_bytes += 1
                end = start + 1  # perhaps a false start, with a true packet within
                continue
            end = start + 11
            try:
                self._take(packet, samples)
            except ValueError:
                tally.bad_packets += 1
                continue
            tally.packets += 1
        begun = _BEGUN.search(buffer, end)
        keep = begun.start() if begun else len(buffer)
        tally.skipped_bytes += keep - end
        self._rest = buffer[keep:]
        return samples

    def _take(self, packet: bytes, samples: list[Sample]) -> None:
        kind = packet[1]
        if kind not in (0x51, 0x52, 0x53, 0x54, 0x59):
            return
        x, y, z, w = _WORDS.unpack(packet)
        if kind == 0x51:
            part = (x * ACC, y * ACC, z * ACC)
        elif kind == 0x52:
            part = (x * GYR, y * GYR, z * GYR)
        elif kind == 0x53:
            part = (x * ANGLE, y * ANGLE, z * ANGLE)
        elif kind == 0x54:
            part = (float(x), float(y), float(z))
        else:
            if abs((x * x + y * y + z * z + w * w) / 32768.0**2 - 1.0) > 2.0 * NORM_OFF:
                raise ValueError("not a unit quaternion")
            part = rpy_from_quaternion(x, y, z, w)
        if kind <= self._type:  # the next group
            self._give(samples)
            self._in_step = True
        self._type = kind
        self._highest = max(self._highest, kind)
        self._parts[kind] = part
        if self._in_step and kind == self._highest:
            self._give(samples)

    def _give(self, samples: list[Sample]) -> None:
        parts = self._parts
        if parts:
            rpy = parts.get(0x53, parts.get(0x59))
            samples.append(Sample(acc=parts.get(0x51), gyr=parts.get(0x52), mag=parts.get(0x54), rpy=rpy))
            self._parts = {}
