"""Xsens MTi: MTData2 messages.

Source: MT Low Level Communication Protocol, "MTData2" (MT0101P). A message is FA FF 36, the length (255: two more bytes
hold it), items, and a byte that makes the sum of all bytes after FA zero modulo 256. An item is a 16-bit identifier, a
byte of size and the data, big-endian. The lower two bits of an identifier are the precision (float32, fixed 12.20,
fixed 16.32, float64). For attitude the next two bits are the frame (east-north-up, north-east-down, north-west-up):

    1020 packet counter                        2010 quaternion w, x, y, z
    1060 sample time, 10 kHz                   2030 roll, pitch, yaw, deg
    4010 velocity since the last sample, m/s   8020 rate of turn, rad/s
    4020 acceleration, m/s2                    8030 rotation since the last sample, quaternion
                                               C020 magnetic field

Other items are skipped.

Acceleration is a specific force, and the axes are right-handed with z up. The field keeps the device's unit (1 is about
the earth's field). If acceleration or rate of turn is missing, velocity or rotation since the last sample is divided by
the sampling interval: the step of the sample time over the number of packets in it, lost ones included. The first
packet has no interval, so it gives no such sample. Field and attitude may come less often than the rest: each sample
has the latest ones, if they are at most 0.2 s old. The sample time wraps every five days, which is undone.
"""

import re
from math import atan2, hypot, isfinite, nan, pi
from struct import Struct
from typing import Any

from pbd.data.units import DEG
from pbd.sensors.attitude import from_north_east_down, from_north_west_up, rpy_from_quaternion, wrap_angle
from pbd.sensors.decoding import PacketDecoder, Sample, Triple, WrappingClock, scaled

TICKS_HZ = 10_000
"""Unit of the sample time, Hz."""

ENU, NED, NWU = 0x0, 0x4, 0x8
"""Bits of an identifier that name the frame of an attitude."""

_VALUES = {0x4010: ("dv", 3), 0x4020: ("acc", 3), 0x8020: ("gyr", 3), 0x8030: ("dq", 4), 0xC020: ("mag", 3)}
_VALUES |= {0x2010 | frame: ("rpy", 4) for frame in (ENU, NED, NWU)}
_VALUES |= {0x2030 | frame: ("rpy", 3) for frame in (ENU, NED, NWU)}
ITEMS = {0x1020: ("counter", Struct(">H")), 0x1060: ("ticks", Struct(">I"))} | {
    identifier | precision: (what, Struct(">" + count * code))
    for precision, code in enumerate(("f", "i", "Ih", "d"))
    for identifier, (what, count) in _VALUES.items()
}
"""Identifier -> the quantity, and its numbers on the wire."""


class XsensDecoder(PacketDecoder):
    """Decodes an MTi. The field is in the device's own unit; `t_device`: sample time, s."""

    START = re.compile(rb"\xfa(?:\xff(?:\x36|\Z)|\Z)")

    def __init__(self) -> None:
        super().__init__()
        self._clock = WrappingClock(2**32)
        self._ticks: float | None = None  # sample time of the last packet, without wrap-around
        self._counter: int | None = None
        self._interval: float | None = None  # between samples, s
        self._last: dict[str, tuple[float, Triple]] = {}  # latest field and attitude with their ticks
        self._has_inertial = False  # whether a packet with acceleration or angular rate has come

    def _read_packet(self, data: bytes, at: int, samples: list[Sample]) -> int:
        head = data[at : at + 6]
        if len(head) < 4 or (head[3] == 255 and len(head) < 6):
            return 0
        length, first = (head[3], at + 4) if head[3] < 255 else (int.from_bytes(head[4:6]), at + 6)
        end = first + length + 1
        if length > 2048:  # bytes
            return -1
        if end > len(data):
            return 0
        if sum(data[at + 1 : end]) & 0xFF:
            return -1
        sample = self._sample(data[first : end - 1])
        if sample is not None:
            samples.append(sample)
        return end - at

    def _sample(self, payload: bytes) -> Sample | None:
        """Make the sample of a packet; None if it has no data, or only field or attitude for later samples."""
        found = _read_items(payload)
        if found is None:
            self.tally.bad_packets += 1
            return None
        t = self._time(found)
        acc, gyr, mag, rpy = found.get("acc"), found.get("gyr"), found.get("mag"), found.get("rpy")
        if self._interval is not None:
            acc = scaled(found["dv"], 1.0 / self._interval) if acc is None and "dv" in found else acc
            gyr = _rate_of_turn(found["dq"], self._interval) if gyr is None and "dq" in found else gyr
        mag, rpy = self._recent("mag", mag), self._recent("rpy", rpy)
        if acc is not None or gyr is not None:
            self._has_inertial = True
        elif self._has_inertial or found.keys() & {"dv", "dq"} or not found.keys() & {"mag", "rpy"}:
            return None
        return Sample(acc, gyr, mag, rpy, t)

    def _time(self, found: dict[str, Any]) -> float | None:
        """Update the sample time and the interval between samples; return the packet's time, s."""
        if "ticks" not in found:
            return None
        ticks = self._clock.unwrap(found["ticks"][0])
        counter = found["counter"][0] if "counter" in found else None
        if self._ticks is not None:
            packets = 1 if counter is None or self._counter is None else (counter - self._counter) % 2**16
            if ticks > self._ticks and packets > 0:  # skipped if the time stepped back (device restart)
                self._interval = (ticks - self._ticks) / TICKS_HZ / packets
        self._ticks, self._counter = ticks, counter
        return ticks / TICKS_HZ

    def _recent(self, what: str, value: Triple | None) -> Triple | None:
        """Return the value, or without one the latest value if it is at most 0.2 s old."""
        if self._ticks is None:
            return value
        if value is not None:
            self._last[what] = (self._ticks, value)
        elif what in self._last:
            at, last = self._last[what]
            return last if 0 <= self._ticks - at <= TICKS_HZ // 5 else None
        return value


def _rate_of_turn(dq: tuple[float, float, float, float], interval: float) -> Triple:
    w, x, y, z = dq
    sine = hypot(x, y, z)
    # The smaller angle: a quaternion with w < 0 is the same rotation as its negative.
    scale = 2.0 * (atan2(sine, w) if w >= 0.0 else -atan2(sine, -w)) / sine / interval if sine else 0.0
    return x * scale, y * scale, z * scale


def _read_items(payload: bytes) -> dict[str, Any] | None:
    """Read the payload's items by the names in ITEMS; None if a size or a number is impossible."""
    found: dict[str, Any] = {}
    at, end, total = 0, len(payload), 0.0
    while at + 3 <= end:
        identifier, size = int.from_bytes(payload[at : at + 2]), payload[at + 2]
        at += 3
        if identifier in ITEMS:
            what, layout = ITEMS[identifier]
            if size != layout.size or at + size > end:
                return None
            numbers = layout.unpack_from(payload, at)
            if identifier & 3 == 1:  # fixed 12.20
                numbers = tuple(raw * 2.0**-20 for raw in numbers)
            elif identifier & 3 == 2:  # fixed 16.32: each a uint32 fraction, then an int16
                numbers = tuple(n + part * 2.0**-32 for part, n in zip(numbers[::2], numbers[1::2], strict=True))
            found[what] = numbers = _attitude(numbers, identifier & 0xC) if what == "rpy" else numbers
            total += sum(numbers)
        at += size
    return found if at == end and isfinite(total) else None


def _attitude(numbers: tuple[float, ...], frame: int) -> tuple[float, ...]:
    """Convert a quaternion, or angles in deg, in any of the three frames to roll, pitch, yaw in east-north-up, rad."""
    if len(numbers) == 4 and not any(n * n for n in numbers):
        return (nan,)  # a zero quaternion is no rotation
    rpy = scaled(numbers, DEG) if len(numbers) == 3 else rpy_from_quaternion(*numbers)
    if frame == NED:  # only the earth's frame is rotated, not the sensor's: undo half a turn of roll
        roll, pitch, yaw = from_north_east_down(rpy)
        return wrap_angle(roll + pi), pitch, yaw
    return from_north_west_up(rpy) if frame == NWU else rpy
