"""Writes WitMotion packets, from the maker's description of them."""

import struct
from collections.abc import Mapping, Sequence

ACC, GYR, ANGLE, MAG, QUATERNION = 0x51, 0x52, 0x53, 0x54, 0x59


def packet(kind: int, words: Sequence[int]) -> bytes:
    """Four numbers of 16 bits; a missing fourth is what the device sends as temperature."""
    body = struct.pack("<BB4h", 0x55, kind, *words, *(2500,) * (4 - len(words)))
    return body + bytes([sum(body) % 256])


def group(parts: Mapping[int, Sequence[int]]) -> bytes:
    return b"".join(packet(kind, parts[kind]) for kind in sorted(parts))


def whole_sample(words: Sequence[int]) -> bytes:
    """Acceleration, angular rate and angles in one packet, as the Bluetooth models send them."""
    return struct.pack("<BB9h", 0x55, 0x61, *words)
