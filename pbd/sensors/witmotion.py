"""WitMotion WT901, JY901, HWT905, WT61 and similar: packets of 11 bytes, several of which make a sample.

The Bluetooth models (WT901BLE, WT9011DCL), read over their USB cable, send packets of 20 bytes, each a sample.

Source: WIT Standard Communication Protocol. A packet is 0x55, a type, four little-endian int16, and the low byte of the
sum of the first ten bytes. Types and their full scales: 0x51 acceleration (16 g), 0x52 angular rate (2000 deg/s), 0x53
roll, pitch, yaw (180 deg), 0x54 magnetic field (raw counts, whose unit differs between models), 0x59 quaternion w, x,
y, z (1).

Axes are right-handed with z up, +1 g at rest. Attitude is rotations about z, y, x in east-north-up, as in this project.

The packets of one instant have no time. They come in the order of their types, so a lower type begins the next group.
After the first such change, the highest type seen so far completes a group at once. If that packet is lost, the group
is completed when the next one begins.

Source of the 20 bytes: Bluetooth 5.0 Communication Protocol. They are 0x55, 0x61, and nine little-endian int16:
acceleration, angular rate, angles, of the same scales. They have no checksum: such a packet counts once the next one
begins where it ends.
"""

import re
from math import pi
from struct import Struct

from pbd.data.units import DEG, GRAVITY
from pbd.sensors.attitude import rpy_from_quaternion
from pbd.sensors.decoding import PacketDecoder, Sample, Triple, scaled

UNITS = {0x51: 16.0 * GRAVITY / 32768.0, 0x52: 2000.0 / 32768.0 * DEG, 0x53: pi / 32768.0, 0x54: 1.0}
"""Type of a packet -> unit of its counts: m/s2, rad/s, rad, and the device's own for the field."""

QUATERNION = 0x59

_WORDS = Struct("<2x4hx")

WHOLE_SAMPLE = b"\x55\x61"
"""Start of a Bluetooth model's packet."""

_NINE_WORDS = Struct("<2x9h")


class WitMotionDecoder(PacketDecoder):
    """Learns from the stream which types a group has. The device sends no time."""

    START = re.compile(rb"\x55(?:[\x50-\x5a\x5f\x61]|\Z)")

    def __init__(self) -> None:
        super().__init__()
        self._parts: dict[int, Triple] = {}  # values of the present group, by type
        self._type = 0  # type of the group's latest packet
        self._highest = 0  # highest type seen so far
        self._in_step = False  # whether the start of a group has been seen

    def _read_packet(self, data: bytes, at: int, samples: list[Sample]) -> int:
        if data.startswith(WHOLE_SAMPLE, at):
            return _read_whole_sample(data, at, samples)
        packet = data[at : at + 11]
        if len(packet) < 11:
            return 0
        if sum(packet[:10]) & 0xFF != packet[10]:
            return -1
        kind, numbers = packet[1], _WORDS.unpack(packet)
        if kind in UNITS:
            self._add_part(kind, scaled(numbers[:3], UNITS[kind]), samples)
        elif kind == QUATERNION:
            if abs(sum(n * n for n in numbers) / 32768.0**2 - 1.0) > 0.04:  # zeros before its filter runs
                self.tally.bad_packets += 1
            else:
                self._add_part(kind, rpy_from_quaternion(*numbers), samples)
        return 11

    def _add_part(self, kind: int, part: Triple, samples: list[Sample]) -> None:
        if kind <= self._type:  # the next group begins
            self._emit(samples)
            self._in_step = True
        self._type = kind
        self._highest = max(self._highest, kind)
        self._parts[kind] = part
        if self._in_step and kind == self._highest:
            self._emit(samples)

    def _emit(self, samples: list[Sample]) -> None:
        parts = self._parts
        if parts:
            rpy = parts.get(0x53, parts.get(QUATERNION))
            samples.append(Sample(acc=parts.get(0x51), gyr=parts.get(0x52), mag=parts.get(0x54), rpy=rpy))
            self._parts = {}


def _read_whole_sample(data: bytes, at: int, samples: list[Sample]) -> int:
    """Read a Bluetooth model's packet; the arguments and the result are those of `_read_packet`."""
    end = at + _NINE_WORDS.size
    if not WHOLE_SAMPLE.startswith(next_start := data[end : end + len(WHOLE_SAMPLE)]):
        return -1
    if next_start != WHOLE_SAMPLE:
        return 0
    numbers = _NINE_WORDS.unpack_from(data, at)
    acc, gyr, rpy = (scaled(numbers[3 * k : 3 * k + 3], UNITS[kind]) for k, kind in enumerate((0x51, 0x52, 0x53)))
    samples.append(Sample(acc=acc, gyr=gyr, rpy=rpy))
    return _NINE_WORDS.size
