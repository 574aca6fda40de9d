"""VectorNav VN-100 (and its family): ASCII sentences and binary packets, both in one stream.

Source: VN-100 User Manual, "Asynchronous output" and "User configurable binary output packets"; sizes of the binary
fields: VectorNav's programming library 1.2 (`Packet::BinaryGroupLengths`, packet.cpp).

ASCII: `$VN<header>,fields*HH` CR LF, where HH is the XOR of the bytes between $ and *, or four digits of their CRC16.
Headers: VNYMR (yaw, pitch, roll in deg, then as VNMAR), VNMAR (magnetic field in gauss, acceleration in m/s2, angular
rate in rad/s), VNIMU (as VNMAR, uncompensated), and the answers to reading registers 27, 20, 54, 18, 19. The answers
count only until the device sends an acceleration by itself: within a stream they are no further samples.
Binary: 0xFA, a byte that names the groups, a 16-bit mask of fields for each group, the fields (little-endian), CRC16.

The device's axes are forward, right and down; its attitude is yaw, pitch and roll in north-east-down. **Samples are
rotated by half a turn about x**: their axes are forward, left and up, so y and z change sign. Acceleration is a
specific force, +g up at rest. Only binary packets have a time (`TimeStartup`).
"""

import re
from binascii import crc_hqx
from functools import lru_cache, reduce
from math import isfinite
from operator import le, xor
from struct import Struct, calcsize

from pbd.data.units import DEG, UT_PER_GAUSS
from pbd.sensors.attitude import from_north_east_down, rpy_from_quaternion
from pbd.sensors.decoding import PacketDecoder, Sample, Triple, scaled

LONGEST_LINE = 256
"""Longest sentence, bytes."""

SENTENCES: dict[bytes, tuple[int, dict[str, int]]] = {
    b"YMR": (12, {"ypr": 0, "mag": 3, "acc": 6, "gyr": 9}),
    b"MAR": (9, {"mag": 0, "acc": 3, "gyr": 6}),
    b"IMU": (11, {"mag": 0, "acc": 3, "gyr": 6}),
    b"RRG,18": (3, {"acc": 0}),
    b"RRG,19": (3, {"gyr": 0}),
}
SENTENCES |= {b"RRG,27": SENTENCES[b"YMR"], b"RRG,20": SENTENCES[b"MAR"], b"RRG,54": SENTENCES[b"IMU"]}
"""Header -> number of values, and the index at which yaw-pitch-roll, mag, acc and gyr begin. If the device is set to
add its status, that comes after the values and begins with a letter."""

FIELD_BYTES = (
    (8, 8, 8, 12, 16, 12, 24, 12, 12, 24, 20, 28, 2, 4, 8),
    (8, 8, 8, 2, 8, 8, 8, 4, 4, 1),
    (2, 12, 12, 12, 4, 4, 16, 12, 12, 12, 12, 2, 40),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28),
    (2, 12, 16, 36, 12, 12, 12, 12, 12, 12, 28, 24, 12),
    (2, 24, 24, 12, 12, 12, 12, 12, 12, 4, 4, 68, 64),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28),
)
"""Bytes of each field, in the order of the bits, of the groups common, time, IMU, GPS, attitude, INS and GPS2."""

FIELDS_READ = {
    "time": ((0, 0), (1, 0)),
    "ypr": ((0, 3), (4, 1)),
    "quat": ((0, 4), (4, 2)),
    "mag": ((0, 10), (2, 8)),
    "acc": ((0, 8), (2, 9)),
    "gyr": ((0, 5), (2, 10)),
    "raw mag": ((2, 1),),
    "raw acc": ((0, 9), (2, 2)),
    "raw gyr": ((0, 9), (2, 3)),
}
"""Quantity -> (group, bit) of its fields. A field may have two, in this order; the rest of it is skipped."""

VALUE_FORMATS = {"time": ("Q", 1), "quat": ("4f", 4)}
"""Struct format and number of values of a quantity; the others are three floats."""

_SENTENCE = re.compile(rb"\$(VN(RRG,\d\d|[A-Z]{3})([ -#%-)+-~]*))\*([0-9A-Fa-f]{4}|[0-9A-Fa-f]{2})\r?\n")
_FIELDS = re.compile(rb"((?:,[+-]?\d{1,9}(?:\.\d{1,12})?)*)(?:,[A-Z].*)?")


class VectorNavDecoder(PacketDecoder):
    """Decodes a VectorNav. Samples are in forward-left-up axes; `t_device`: time since start-up, s, if sent."""

    START = re.compile(rb"[$\xfa]")

    def __init__(self) -> None:
        super().__init__()
        self._streams = False  # whether the device sends accelerations by itself

    def _read_packet(self, data: bytes, at: int, samples: list[Sample]) -> int:
        return (self._sentence if data[at] == 0x24 else self._binary)(data, at, samples)

    def _sentence(self, data: bytes, at: int, samples: list[Sample]) -> int:
        end = data.find(b"\n", at, at + LONGEST_LINE)
        if end < 0:
            cut_off = len(data) - at < LONGEST_LINE and b"$VN".startswith(data[at : at + 3])
            return 0 if cut_off else -1
        sentence = _SENTENCE.fullmatch(data, at, end + 1)
        if sentence is None:
            return -1
        body, header, fields, check = sentence.groups()
        if int(check, 16) != (reduce(xor, body) if len(check) == 2 else crc_hqx(body, 0)):
            return -1
        if header in SENTENCES:
            count, offsets = SENTENCES[header]
            texts = _FIELDS.fullmatch(fields)
            numbers = tuple(map(float, texts[1].split(b",")[1:])) if texts else ()
            # An XOR does not notice bytes that came twice, so the values are checked as well.
            impossible = "ypr" in offsets and not all(map(le, map(abs, numbers), (180.01, 90.01, 180.01)))  # deg
            if len(numbers) != count or impossible:
                self.tally.bad_packets += 1
            elif not (is_answer := header.startswith(b"RRG")) or not self._streams:
                self._streams |= not is_answer
                samples.append(_sample(numbers, offsets))
        return end + 1 - at

    def _binary(self, data: bytes, at: int, samples: list[Sample]) -> int:
        groups = data[at + 1 : at + 2]
        fields_at = at + 2 + 2 * int.from_bytes(groups).bit_count()  # a mask of two bytes for each group
        if not groups or fields_at > len(data):
            return 0
        layout = _packet_layout(data[at + 1 : fields_at])
        if layout is None:
            return -1
        fields, offsets = layout
        end = fields_at + fields.size + 2
        if end > len(data):
            return 0
        if crc_hqx(data[at + 1 : end], 0):  # the CRC over a packet and its own CRC is zero
            return -1
        numbers = fields.unpack_from(data, fields_at)
        if not isfinite(sum(numbers)):
            self.tally.bad_packets += 1
        elif offsets:
            self._streams |= "acc" in offsets
            samples.append(_sample(numbers, offsets))
        return end - at


def _sample(numbers: tuple[float, ...], offsets: dict[str, int]) -> Sample:
    rpy: Triple | None = None
    if (i := offsets.get("ypr")) is not None:
        rpy = from_north_east_down(scaled(numbers[i : i + 3][::-1], DEG))
    elif (i := offsets.get("quat")) is not None:
        x, y, z, w = numbers[i : i + 4]
        rpy = from_north_east_down(rpy_from_quaternion(w, x, y, z)) if x or y or z or w else None
    time = offsets.get("time")
    return Sample(
        _forward_left_up(numbers, offsets.get("acc"), 1.0),
        _forward_left_up(numbers, offsets.get("gyr"), 1.0),
        _forward_left_up(numbers, offsets.get("mag"), UT_PER_GAUSS),
        rpy,
        None if time is None else numbers[time] * 1e-9,
    )


def _forward_left_up(numbers: tuple[float, ...], at: int | None, unit: float) -> Triple | None:
    """Rotate the vector at index `at` from forward-right-down to forward-left-up axes, and multiply it by `unit`."""
    return None if at is None else (numbers[at] * unit, -numbers[at + 1] * unit, -numbers[at + 2] * unit)


@lru_cache(maxsize=64)  # bounded, because noise has any header; a device sends three kinds of packets at most
def _packet_layout(header: bytes) -> tuple[Struct, dict[str, int]] | None:
    """Return the struct of a packet's fields and each quantity's index among its values, from its groups and masks.

    None if a group or field is unknown: then the packet's length is unknown too.
    """
    groups = [group for group in range(8) if header[0] >> group & 1]
    if not groups or groups[-1] >= len(FIELD_BYTES):
        return None
    formats, offsets, numbers = "<", dict[str, int](), 0
    for index, group in enumerate(groups):
        mask = int.from_bytes(header[1 + 2 * index : 3 + 2 * index], "little")
        if mask >> len(FIELD_BYTES[group]):
            return None
        for bit, size in enumerate(FIELD_BYTES[group]):
            if mask >> bit & 1:
                field = ""
                for what in (name for name, places in FIELDS_READ.items() if (group, bit) in places):
                    code, count = VALUE_FORMATS.get(what, ("3f", 3))
                    offsets[what], numbers, field = numbers, numbers + count, field + code
                formats += f"{field}{size - calcsize('<' + field)}x"
    for what in ("mag", "acc", "gyr"):  # uncompensated values are used only where compensated ones are not sent
        raw = offsets.pop(f"raw {what}", None)
        if raw is not None:
            offsets.setdefault(what, raw)
    return Struct(formats), offsets if offsets.keys() - {"time"} else {}
