"""OceanServer OS5000, OS500 and OS4000 compasses: `$C` by its tags and `$OHPR` by its commas.

Source: OceanServer, Digital Compass Users Guide, OS5000 Series (format types 0x01 and 0x02). `$...*HH CR LF`, HH the
XOR of the bytes between $ and *. Units on the wire: degrees, g, milligauss (only after the user's field calibration).

Axes. The manual's own sentence and one from the field (tests) read Az = +1 level, pitch = asin(Ax), roll = atan2(Ay,
Az): x forward, y to the left, z up, specific force. That the magnetometer shares these axes is assumed.

`$OHPR` gives no names, and leaves out what was not asked for (ESC X): of 18 fields all are known; of 6, and with a
vector that can be one of g, it is heading, pitch, roll, Ax, Ay, Az; else the first three are heading, pitch, roll and
the rest is passed over. Ask for `$C` (ESC *1) where there is a choice. Its two gyro axes (no z, no unit in the manual)
are not used.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import reduce
from math import radians
from operator import xor

from pbd.data import GRAVITY
from pbd.sensors.attitude import from_north_east_down
from pbd.sensors.decoding import Sample, Tally, Triple

RANGE_G = 20.0
"""No OceanServer compass measures more than 8 g; a longer vector is not an acceleration."""

LIMITS_DEG = (180.0, 90.0, 360.0)
"""Of roll, pitch and heading."""

_SENTENCE = re.compile(rb"\$([^$*\r\n]{1,250})\*([0-9A-Fa-f]{2})")
_BEGUN = re.compile(rb"\$[^$*\r\n]{0,250}(\*[0-9A-Fa-f]?)?")
_NUMBER = rb"[-+]?(?:\d+(?:\.\d*)?|\.\d+)"
_C = re.compile(rb"C(?:%b)?(?:[A-Z][a-z]?%b)*" % (_NUMBER, _NUMBER))
_FIELD = re.compile(rb"([A-Z][a-z]?)(%b)" % _NUMBER)
_OHPR = re.compile(rb"OHPR(?:,(?:%b)?)*" % _NUMBER)
_OHPR_NAMES = tuple(b"C P R T D M Mx My Mz A Ax Ay Az - Gx Gy - -".split())


class OS5000Decoder:
    """Each sentence that carries acceleration, field or attitude gives a sample; there is no device time."""

    def __init__(self) -> None:
        self.tally = Tally()
        self._rest = b""

    def feed(self, data: bytes) -> list[Sample]:
        """See `Decoder`."""
        buffer = self._rest + data
        samples = []
        end = 0
        for match in _SENTENCE.finditer(buffer):
            self._skip(buffer[end : match.start()])
            end = match.end()
            body, checksum = match.groups()
            try:
                if reduce(xor, body) != int(checksum, 16):
                    raise ValueError("checksum")  # no sentence can begin inside: it holds no $
                sample = _sample(body)
            except ValueError:
                self.tally.bad_packets += 1
                continue
            self.tally.packets += 1
            if sample is not None:
                samples.append(sample)
        start = buffer.rfind(b"$", end)
        if start < 0 or not _BEGUN.fullmatch(buffer, start):
            start = len(buffer)
        self._skip(buffer[end:start])
        self._rest = buffer[start:]
        return samples

    def _skip(self, between: bytes) -> None:
        self.tally.skipped_bytes += len(between.translate(None, b"\r\n"))


def _sample(body: bytes) -> Sample | None:
    """Read what stands between $ and *; None where it has nothing for us, ValueError where it is not as described."""
    if body.startswith(b"OHPR,"):
        values = _by_commas(body)
    elif _C.fullmatch(body):
        values = _by_tags(body)
    elif body.startswith(b"C") and not body[1:2].isalpha():
        raise ValueError("not tags and numbers")
    else:
        return None  # another sentence, such as $HCHDT
    acc = _all_of(values, (b"Ax", b"Ay", b"Az"))
    mag = _all_of(values, (b"Mx", b"My", b"Mz"))
    angles = _all_of(values, (b"R", b"P", b"C"))
    if acc is not None and max(map(abs, acc)) > RANGE_G:
        raise ValueError("an acceleration out of range")
    if angles is not None and any(abs(angle) > limit for angle, limit in zip(angles, LIMITS_DEG, strict=True)):
        raise ValueError("an angle out of range")
    if acc is None and mag is None and angles is None:
        return None
    return Sample(
        acc=None if acc is None else (acc[0] * GRAVITY, acc[1] * GRAVITY, acc[2] * GRAVITY),
        mag=None if mag is None else (mag[0] * 0.1, mag[1] * 0.1, mag[2] * 0.1),
        rpy=None
        if angles is None
        else from_north_east_down((radians(angles[0]), radians(angles[1]), radians(angles[2]))),
    )


def _by_tags(body: bytes) -> dict[bytes, float]:
    fields = _FIELD.findall(body)
    values = {tag: float(text) for tag, text in fields}
    if len(values) < len(fields):
        raise ValueError("a tag comes twice")
    return values


def _by_commas(body: bytes) -> dict[bytes, float]:
    if not _OHPR.fullmatch(body):
        raise ValueError("not commas and numbers")
    texts = body.split(b",")[1:]
    names: Sequence[bytes] = _OHPR_NAMES[:3]
    if len(texts) == len(_OHPR_NAMES):
        names = _OHPR_NAMES
    elif len(texts) == 6 and all(text and abs(float(text)) <= RANGE_G for text in texts[3:]):
        names = (b"C", b"P", b"R", b"Ax", b"Ay", b"Az")
    return {name: float(text) for name, text in zip(names, texts, strict=False) if text}


def _all_of(values: Mapping[bytes, float], names: tuple[bytes, bytes, bytes]) -> Triple | None:
    first, second, third = (values.get(name) for name in names)
    return None if first is None or second is None or third is None else (first, second, third)
