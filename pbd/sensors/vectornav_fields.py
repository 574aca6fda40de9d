"""Offsets of the fields in a VectorNav binary packet, from its byte of groups and its masks.

Sizes as in VectorNav's programming library 1.2 (`Packet::BinaryGroupLengths`, packet.cpp) and the VN-100 User Manual.
The device may send any fields of known size. Those that a sample does not need are skipped. A packet with a field
that is not known is refused, because its length is unknown.
"""

from __future__ import annotations

from functools import lru_cache
from struct import Struct, calcsize
from typing import NamedTuple

# Bytes of each field of the groups common, time, IMU, GPS, attitude, INS and GPS2, by bit.
FIELD_BYTES = (
    (8, 8, 8, 12, 16, 12, 24, 12, 12, 24, 20, 28, 2, 4, 8),
    (8, 8, 8, 2, 8, 8, 8, 4, 4, 1),
    (2, 12, 12, 12, 4, 4, 16, 12, 12, 12, 12, 2, 40),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28),
    (2, 12, 16, 36, 12, 12, 12, 12, 12, 12, 28, 24, 12),
    (2, 24, 24, 12, 12, 12, 12, 12, 12, 4, 4, 68, 64),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28),
)
# Fields that are read, by group and bit. The rest of a field is skipped.
READ = {
    (0, 0): ("time",),
    (0, 3): ("ypr",),
    (0, 4): ("quat",),
    (0, 5): ("gyr",),
    (0, 8): ("acc",),
    (0, 9): ("raw acc", "raw gyr"),
    (0, 10): ("mag",),
    (1, 0): ("time",),
    (2, 1): ("raw mag",),
    (2, 2): ("raw acc",),
    (2, 3): ("raw gyr",),
    (2, 8): ("mag",),
    (2, 9): ("acc",),
    (2, 10): ("gyr",),
    (4, 1): ("ypr",),
    (4, 2): ("quat",),
}
FORMATS = {"time": ("Q", 1), "quat": ("4f", 4)}
"""Format and count of a quantity's numbers; the others are three floats."""

# Bytes of the byte of groups and the masks that it announces.
GROUPS_LENGTH = tuple(1 + 2 * groups.bit_count() for groups in range(256))


class Layout(NamedTuple):
    """The fields of a packet without header and CRC, and where what is wanted begins among the unpacked numbers."""

    fields: Struct
    places: dict[str, int]


@lru_cache(maxsize=64)  # a device sends three kinds of packets at most; noise must not fill the memory
def layout_of(header: bytes) -> Layout | None:
    """From the byte of groups and its masks; None where a group or a field is not known."""
    groups = [group for group in range(8) if header[0] >> group & 1]
    if not groups or groups[-1] >= len(FIELD_BYTES):
        return None
    formats, places, numbers = "<", dict[str, int](), 0
    for index, group in enumerate(groups):
        mask = int.from_bytes(header[1 + 2 * index : 3 + 2 * index], "little")
        if mask >> len(FIELD_BYTES[group]):
            return None
        for bit, size in enumerate(FIELD_BYTES[group]):
            if mask >> bit & 1:
                field = ""
                for what in READ.get((group, bit), ()):
                    code, count = FORMATS.get(what, ("3f", 3))
                    places[what], numbers, field = numbers, numbers + count, field + code
                formats += f"{field}{size - calcsize('<' + field)}x"
    for what in ("mag", "acc", "gyr"):  # the uncompensated ones serve where the compensated ones are not sent
        raw = places.pop(f"raw {what}", None)
        if raw is not None:
            places.setdefault(what, raw)
    return Layout(Struct(formats), places if places.keys() - {"time"} else {})
