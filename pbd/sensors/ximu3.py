"""x-io Technologies x-IMU3: ASCII and binary messages, both in one stream.

Source: x-IMU3 User Manual, "Communication protocol" (github.com/xioTechnologies/x-IMU3-User-Manual). A message is a
letter, the device's time in microseconds and numbers, and ends with LF: `I,<us>,gx,gy,gz,ax,ay,az` (deg/s, g),
`M,<us>,x,y,z` (in the device's own unit), `Q,<us>,w,x,y,z`, `A,<us>,roll,pitch,yaw` (deg). A binary message begins with
the letter + 0x80, then uint64 and float32, little-endian. An LF inside is stuffed (0x0A -> DB DC, 0xDB -> DB DD), so
each LF ends a message.

Each I gives a sample. It gets the latest M and attitude (Q or A) that the device's clock puts at most 0.2 s before
it, and not after. So a magnetometer at 20 Hz repeats, and an attitude that the device sends after its I is one
message late. The attitude is taken as north-west-up, the device's default `ahrs_axes_convention`.

Messages have no checksum. One counts if its form is right and its numbers are finite and within 1.5 times the device's
measuring ranges.
"""

import re
from collections import deque
from operator import le
from struct import Struct

from pbd.data.units import DEG, GRAVITY
from pbd.sensors.attitude import from_north_west_up, rpy_from_quaternion
from pbd.sensors.decoding import Sample, Tally, Triple, scaled

LONGEST_LINE = 1024
"""Number of a line's last bytes that are read. Notes and answers to commands are shorter than 300 bytes."""

LIMITS = {
    "I": (3000.0, 3000.0, 3000.0, 24.0, 24.0, 24.0),
    "M": (100.0, 100.0, 100.0),
    "Q": (1.01, 1.01, 1.01, 1.01),
    "A": (180.01, 90.01, 180.01),
}
"""Largest plausible numbers of each message: 1.5 times 2000 deg/s and 16 g; 100 times about the earth's field; 1 and
some rounding; degrees and some rounding."""

STUFFED_LF, STUFFED_ESC = b"\xdb\xdc", b"\xdb\xdd"
"""What stands for the bytes 0x0A and 0xDB inside a binary message."""

_TEXT = re.compile(rb"([IMQA]),(\d{1,20})((?:,[+-]?\d{1,9}(?:\.\d{1,9})?){3,6})\r?")
_BINARY = {ord(letter) | 0x80: (letter, Struct(f"<xQ{len(n)}f")) for letter, n in LIMITS.items()}
_BEGIN = re.compile(b"[IMQA" + bytes(_BINARY) + b"]")


class XImu3Decoder:
    """Decodes an x-IMU3. The field is in the device's own unit; `t_device`: time since its start, s."""

    def __init__(self) -> None:
        self.tally = Tally()
        self._rest = b""
        self._mag: deque[tuple[int, Triple]] = deque(maxlen=2)  # two: M and Q may come before an I with an earlier time
        self._rpy: deque[tuple[int, Triple]] = deque(maxlen=2)

    def feed(self, data: bytes) -> list[Sample]:
        """See `Decoder`."""
        *messages, rest = (self._rest + data).split(b"\n")
        self._rest = rest[-LONGEST_LINE:]
        samples: list[Sample] = []
        for message in messages:
            line = message[-LONGEST_LINE:]
            # A message whose end was lost, or noise, may come before a whole message in the same line.
            starts = (0, *(begin.start() for begin in _BEGIN.finditer(line, 1)))
            first_whole = next((start for start in starts if self._read_message(line[start:], samples)), None)
            self.tally.bad_packets += first_whole != 0 and _BEGIN.match(line) is not None
        return samples

    def _read_message(self, message: bytes, samples: list[Sample]) -> bool:
        """Read a message, without its LF; return whether it is one that a sample needs."""
        read = _parse(message)
        if read is None:
            return False
        letter, us, n = read
        self.tally.packets += 1
        if letter == "I":
            acc, gyr = scaled(n[3:], GRAVITY), scaled(n[:3], DEG)
            samples.append(Sample(acc, gyr, _recent(self._mag, us), _recent(self._rpy, us), us / 1e6))
        elif letter == "M":
            self._mag.append((us, scaled(n, 1.0)))
        elif letter == "Q":
            self._rpy.append((us, from_north_west_up(rpy_from_quaternion(*n))))
        else:
            self._rpy.append((us, from_north_west_up(scaled(n, DEG))))
        return True


def _parse(message: bytes) -> tuple[str, int, tuple[float, ...]] | None:
    """Return letter, time in us and numbers of a plausible I, M, Q or A; None for anything else."""
    if not message:
        return None
    if message[0] & 0x80:
        known = _BINARY.get(message[0])
        if known is None:
            return None
        letter, layout = known
        if b"\xdb" in message:
            if message.count(b"\xdb") != message.count(STUFFED_LF) + message.count(STUFFED_ESC):
                return None
            message = message.replace(STUFFED_LF, b"\n").replace(STUFFED_ESC, b"\xdb")
        if len(message) != layout.size:
            return None
        us, *floats = layout.unpack(message)
        numbers = tuple(floats)
    else:
        text = _TEXT.fullmatch(message)
        if text is None:
            return None
        letter, us = text[1].decode(), int(text[2])
        numbers = tuple(map(float, text[3][1:].split(b",")))
        if len(numbers) != len(LIMITS[letter]):
            return None
    if not all(map(le, map(abs, numbers), LIMITS[letter])):  # NaN fails too
        return None
    if letter == "Q" and not 0.98 <= sum(x * x for x in numbers) <= 1.02:
        return None
    return letter, us, numbers


def _recent(values: deque[tuple[int, Triple]], us: int) -> Triple | None:
    """Return the newest value that is not later than `us` and at most 0.2 s older."""
    recent = [(age, value) for at, value in values if 0 <= (age := us - at) <= 200_000]
    return min(recent)[1] if recent else None
