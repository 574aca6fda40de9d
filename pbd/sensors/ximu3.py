"""x-io Technologies x-IMU3: ASCII and binary messages, both in one stream.

Source: x-IMU3 User Manual, "Communication protocol" (github.com/xioTechnologies/x-IMU3-User-Manual). A message is a
letter, the device's time in microseconds and numbers, ended by LF: `I,<us>,gx,gy,gz,ax,ay,az` (deg/s, g),
`M,<us>,x,y,z` (its own unit, kept), `Q,<us>,w,x,y,z`, `A,<us>,roll,pitch,yaw` (deg). Binary ones begin with the letter
+ 0x80, then uint64 and float32, little-endian; LF inside is stuffed (0x0A -> DB DC, 0xDB -> DB DD), so LF always ends.

A sample is an I. It is given the M and the attitude (Q or A) that were taken last before it by the device's clock, if
not more than 0.2 s before: a magnetometer at 20 Hz repeats, and the device's attitude is one message late where it is
sent after its I. Attitude is taken as north-west-up, the device's default `ahrs_axes_convention`.

There is no checksum. A message is believed if its form is right and its numbers are finite and within 1.5 times what
the device can measure.
"""

from __future__ import annotations

import re
from collections import deque
from operator import le
from struct import Struct

from pbd.data.units import DEG, GRAVITY
from pbd.sensors.attitude import from_north_west_up, rpy_from_quaternion
from pbd.sensors.decoding import Sample, Tally, Triple, scaled

LONGEST_LINE = 1024  # bytes of a line that are looked at; notes and answers to commands are below 300
JOIN_US = 200_000
LIMITS = {  # of what can be meant: 1.5 times the ranges of 2000 deg/s and 16 g; a field of 1 is about the earth's; deg
    "I": (3000.0, 3000.0, 3000.0, 24.0, 24.0, 24.0),
    "M": (100.0, 100.0, 100.0),
    "Q": (1.01, 1.01, 1.01, 1.01),
    "A": (180.01, 90.01, 180.01),
}
STUFFED_LF, STUFFED_ESC = b"\xdb\xdc", b"\xdb\xdd"

_TEXT = re.compile(rb"([IMQA]),(\d{1,20})((?:,[+-]?\d{1,9}(?:\.\d{1,9})?){3,6})\r?")
_OTHER = re.compile(  # R, L, E, H, T, B, W, U: numbers; N, F, S: text; answers to commands
    rb"[RLEHTBWU],\d{1,20}(?:,[+-]?\d+(?:\.\d+)?){1,9}\r?|[NFS],\d{1,20},[ -~]*\r?|\{[ -~]*\}\r?"
    rb"|[\xce\xc6].{8}[ -~]*|\xd3.{8,}",
    re.DOTALL,
)
_OTHER_SIZES = {0xD2: (9,), 0xCC: (3, 7), 0xC5: (3, 7), 0xC8: (3,), 0xD4: (1,), 0xC2: (3,), 0xD7: (2,), 0xD5: (4,)}
_BINARY = {ord(letter) | 0x80: (letter, Struct(f"<xQ{len(n)}f")) for letter, n in LIMITS.items()}
_BEGIN = re.compile(b"[IMQA" + bytes(_BINARY) + b"]")


class XImu3Decoder:
    """Bytes of an x-IMU3 to samples: m/s2, rad/s, the device's own unit of the field, rad, s since its start."""

    def __init__(self) -> None:
        self.tally = Tally()
        self._rest = b""
        self._mag: deque[tuple[int, Triple]] = deque(maxlen=2)  # two: M and Q may come before an I that was taken first
        self._rpy: deque[tuple[int, Triple]] = deque(maxlen=2)

    def feed(self, data: bytes) -> list[Sample]:
        """See `Decoder`."""
        *messages, rest = (self._rest + data).split(b"\n")
        self._rest = rest[-LONGEST_LINE:]
        samples: list[Sample] = []
        for message in messages:
            line = message[-LONGEST_LINE:]
            # A message whose end was lost stands in front of a whole one in the same line, and so does noise.
            starts = (0, *(begin.start() for begin in _BEGIN.finditer(line, 1)))
            first_whole = next((start for start in starts if self._take(line[start:], samples)), None)
            self.tally.bad_packets += first_whole != 0 and _BEGIN.match(line) is not None
        return samples

    def _take(self, message: bytes, samples: list[Sample]) -> bool:
        """Take a message, without its LF; False where it is none."""
        read = _read(message)
        if read is None:
            other = _is_other(message)
            self.tally.packets += other
            return other
        letter, us, n = read
        self.tally.packets += 1
        if letter == "I":
            acc, gyr = scaled(n[3:], GRAVITY), scaled(n[:3], DEG)
            samples.append(Sample(acc, gyr, _before(self._mag, us), _before(self._rpy, us), us / 1e6))
        elif letter == "M":
            self._mag.append((us, scaled(n, 1.0)))
        elif letter == "Q":
            self._rpy.append((us, from_north_west_up(rpy_from_quaternion(*n))))
        else:
            self._rpy.append((us, from_north_west_up(scaled(n, DEG))))
        return True


def _read(message: bytes) -> tuple[str, int, tuple[float, ...]] | None:
    """Letter, time and numbers of an I, M, Q or A that can be true; None for everything else."""
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
    if not all(map(le, map(abs, numbers), LIMITS[letter])):  # nor is NaN less or equal
        return None
    if letter == "Q" and not 0.98 <= sum(x * x for x in numbers) <= 1.02:
        return None
    return letter, us, numbers


def _is_other(message: bytes) -> bool:
    """Whether it is a whole message of which a sample takes nothing: temperature, battery, an answer to a command."""
    sizes = _OTHER_SIZES.get(message[0]) if message else None
    if sizes is None:
        return _OTHER.fullmatch(message) is not None
    return len(message) - message.count(b"\xdb") in [9 + 4 * count for count in sizes]


def _before(taken: deque[tuple[int, Triple]], us: int) -> Triple | None:
    """The newest value that was taken at that time or up to 0.2 s before."""
    fit = [(age, value) for at, value in taken if 0 <= (age := us - at) <= JOIN_US]
    return min(fit)[1] if fit else None
