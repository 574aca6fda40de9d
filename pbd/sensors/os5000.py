"""OceanServer OS5000, OS500 and OS4000 compasses: sentences `$C` with tagged values and `$OHPR` with bare ones.

Source: OceanServer, Digital Compass Users Guide, OS5000 Series (format types 0x01 and 0x02). `$...*HH CR LF`, HH the
XOR of the bytes between $ and *. Units on the wire: degrees, g, milligauss (only after the user's field calibration).

Axes. The manual's example and a recorded sentence (see the tests) read Az = +1 when level, pitch = asin(Ax), roll =
atan2(Ay, Az). So x is forward, y left, z up, and the acceleration is a specific force. The magnetometer is assumed to
share these axes.

`$OHPR` names no values and leaves out those that the user did not select (ESC X). With 18 fields all are known. With 6,
of which the last three are small enough for g, they are heading, pitch, roll, Ax, Ay, Az. Otherwise the first three are
heading, pitch, roll and the rest is ignored. Set the device to `$C` (ESC *1) if you can. Its two gyro axes are not
used: there is no z, and the manual gives no unit.
"""

import re
from collections.abc import Mapping
from functools import reduce
from operator import le, xor

from pbd.data.units import DEG, GRAVITY, UT_PER_GAUSS
from pbd.sensors.attitude import from_north_east_down
from pbd.sensors.decoding import PacketDecoder, Sample, Triple, scaled

LARGEST_G = 20.0
"""Largest plausible acceleration along an axis, g. No OceanServer compass measures more than 8 g."""

_SENTENCE = re.compile(rb"\$([^$*\r\n]{1,250})\*([0-9A-Fa-f]{2})")
_INCOMPLETE = re.compile(rb"\$[^$*\r\n]{0,250}(\*[0-9A-Fa-f]?)?")
_NUMBER = rb"[-+]?(?:\d+(?:\.\d*)?|\.\d+)"
_TAGGED = re.compile(rb"C(?:%b)?(?:[A-Z][a-z]?%b)*" % (_NUMBER, _NUMBER))
_FIELD = re.compile(rb"([A-Z][a-z]?)(%b)" % _NUMBER)
_OHPR = re.compile(rb"OHPR(?:,(?:%b)?)*" % _NUMBER)
_OHPR_NAMES = tuple(b"C P R T D M Mx My Mz A Ax Ay Az - Gx Gy - -".split())


class OS5000Decoder(PacketDecoder):
    """Makes a sample from each sentence with acceleration, field or attitude. The device sends no time."""

    START = re.compile(rb"\$")

    def _read_packet(self, data: bytes, at: int, samples: list[Sample]) -> int:
        match = _SENTENCE.match(data, at)
        if match is None:
            return 0 if _INCOMPLETE.fullmatch(data, at) else -1
        body, checksum = match.groups()
        if reduce(xor, body) != int(checksum, 16):
            return -1
        try:
            sample = _sample(body)
        except ValueError:
            return -1
        if sample is not None:
            samples.append(sample)
        return match.end() - at


def _sample(body: bytes) -> Sample | None:
    """Read the text between $ and *. None: it has no data of ours; ValueError: it is malformed or implausible."""
    if body.startswith(b"OHPR,"):
        values = _comma_values(body)
    elif _TAGGED.fullmatch(body):
        fields = _FIELD.findall(body)
        values = {tag: float(text) for tag, text in fields}
        if len(values) < len(fields):
            raise ValueError("a tag comes twice")
    elif body.startswith(b"C") and not body[1:2].isalpha():
        raise ValueError("not tags and numbers")
    else:
        return None  # another sentence, such as $HCHDT
    acc = _vector(values, b"Ax", b"Ay", b"Az")
    mag = _vector(values, b"Mx", b"My", b"Mz")
    angles = _vector(values, b"R", b"P", b"C")
    if acc is not None and max(map(abs, acc)) > LARGEST_G:
        raise ValueError("an acceleration out of range")
    if angles is not None and not all(map(le, map(abs, angles), (180.0, 90.0, 360.0))):  # roll, pitch, heading
        raise ValueError("an angle out of range")
    if acc is None and mag is None and angles is None:
        return None
    return Sample(
        acc=None if acc is None else scaled(acc, GRAVITY),
        mag=None if mag is None else scaled(mag, 1e-3 * UT_PER_GAUSS),
        rpy=None if angles is None else from_north_east_down(scaled(angles, DEG)),
    )


def _comma_values(body: bytes) -> dict[bytes, float]:
    if not _OHPR.fullmatch(body):
        raise ValueError("not commas and numbers")
    texts = body.split(b",")[1:]
    names = _OHPR_NAMES[:3]
    if len(texts) == len(_OHPR_NAMES):
        names = _OHPR_NAMES
    elif len(texts) == 6 and all(text and abs(float(text)) <= LARGEST_G for text in texts[3:]):
        names = (b"C", b"P", b"R", b"Ax", b"Ay", b"Az")
    return {name: float(text) for name, text in zip(names, texts, strict=False) if text}


def _vector(values: Mapping[bytes, float], *names: bytes) -> Triple | None:
    x, y, z = map(values.get, names)
    return None if x is None or y is None or z is None else (x, y, z)
