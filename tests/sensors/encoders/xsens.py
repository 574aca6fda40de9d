"""What an Xsens MTi sends, written from the MT Low Level Communication Protocol."""

import random
import struct
from collections.abc import Sequence
from math import floor

COUNTER, TICKS, QUATERNION, EULER = 0x1020, 0x1060, 0x2010, 0x2030
DELTA_V, ACC, GYR, DELTA_Q, MAG = 0x4010, 0x4020, 0x8020, 0x8030, 0xC020
FLOAT, FIXED_12_20, FIXED_16_32, DOUBLE = range(4)
NED, NWU = 0x4, 0x8


def item(identifier: int, numbers: Sequence[float], precision: int = FLOAT) -> bytes:
    """One item in one of the four precisions."""
    if precision == FIXED_16_32:
        parts = [(round(number * 2**32) % 2**32, floor(round(number * 2**32) / 2**32)) for number in numbers]
        data = b"".join(struct.pack(">Ih", *part) for part in parts)
    elif precision == FIXED_12_20:
        data = b"".join(struct.pack(">i", round(number * 2**20)) for number in numbers)
    else:
        data = struct.pack(f">{len(numbers)}{'d' if precision == DOUBLE else 'f'}", *numbers)
    return raw_item(identifier | precision, data)


def raw_item(identifier: int, data: bytes) -> bytes:
    """Identifier, size, data."""
    return struct.pack(">HB", identifier, len(data)) + data


def clock(counter: int, ticks: int) -> bytes:
    """Packet counter and sample time, both wrapping around."""
    return raw_item(COUNTER, struct.pack(">H", counter % 2**16)) + raw_item(TICKS, struct.pack(">I", ticks % 2**32))


def message(*items: bytes) -> bytes:
    """An MTData2 message, of extended length where it must be."""
    payload = b"".join(items)
    length = bytes([len(payload)]) if len(payload) < 255 else b"\xff" + struct.pack(">H", len(payload))
    inner = b"\xff\x36" + length + payload
    return b"\xfa" + inner + bytes([-sum(inner) % 256])


def packets(count: int, seed: int = 0, hz: float = 400.0) -> list[bytes]:
    """So many messages at this rate with time, acceleration, rate and quaternion; the field in every fourth."""
    rng, out = random.Random(seed), []
    for k in range(count):
        turn = [rng.gauss(0.0, 1.0) for _ in range(4)]
        items = [
            clock(k, 50_000 + round(k * 1e4 / hz)),
            item(QUATERNION, [x / sum(y * y for y in turn) ** 0.5 for x in turn]),
            item(ACC, [rng.gauss(0.0, 6.0) for _ in range(3)]),
            item(GYR, [rng.gauss(0.0, 1.0) for _ in range(3)]),
        ]
        if k % 4 == 0:
            items.append(item(MAG, [rng.gauss(0.0, 0.6) for _ in range(3)]))
        out.append(message(*items))
    return out


def checked(data: bytes) -> list[bytes]:
    """All pieces of a stream that say how long they are and have a right checksum: what a sample may have come from."""
    found, begin = [], data.find(b"\xfa\xff\x36")
    while begin >= 0:
        size, first = data[begin + 3 : begin + 4], begin + 4
        if size == b"\xff":
            size, first = data[begin + 4 : begin + 6], begin + 6
        end = first + int.from_bytes(size) + 1
        if end <= len(data) and sum(data[begin + 1 : end]) % 256 == 0:
            found.append(data[begin:end])
        begin = data.find(b"\xfa\xff\x36", begin + 1)
    return found
