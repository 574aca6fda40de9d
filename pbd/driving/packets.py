"""Packets of Feetech's STS servos: pure functions, no I/O.

A packet is FF FF, id, length, instruction (or, in an answer, the servo's error flags), data, checksum: the complement
of the sum of all bytes after FF FF. Words are little-endian; a negative one has its sign in the highest bit.
Source: Feetech, "Communication protocol manual of serial bus smart servo"; tests compare with Feetech's own SDK.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

HEADER = b"\xff\xff"
EVERYONE = 0xFE
"""The id that all servos listen to."""

SYNC_READ, SYNC_WRITE = 0x82, 0x83
SHORTEST, LONGEST = 2, 250
"""Length that a packet states, bytes: instruction and checksum, and as much as Feetech's SDK takes."""


class Answer(NamedTuple):
    """What a servo answers: its id, its error flags, the bytes of its registers."""

    id: int
    error: int
    data: bytes


def sync_read(ids: tuple[int, ...], address: int, length: int) -> bytes:
    """Ask each of these servos for `length` registers from `address` on; they answer one after another."""
    return _packet(SYNC_READ, bytes([address, length, *ids]))


def sync_write(address: int, values: Mapping[int, bytes]) -> bytes:
    """Write the registers from `address` on in each servo (by id) at once; none answers."""
    length = len(next(iter(values.values())))
    return _packet(SYNC_WRITE, bytes([address, length]) + b"".join(bytes([id_]) + data for id_, data in values.items()))


def take_answers(buffer: bytearray) -> Iterator[Answer]:
    """Take whole answers out of what has come; what is no packet is dropped byte by byte."""
    while True:
        start = buffer.find(HEADER)
        del buffer[: max(0, len(buffer) - 1) if start < 0 else start]
        if len(buffer) < 4:
            return
        length = buffer[3]
        if buffer[2] >= EVERYONE or not SHORTEST <= length <= LONGEST:
            del buffer[0]
            continue
        if len(buffer) < 4 + length:
            return
        body = bytes(buffer[2 : 4 + length])
        if checksum(body[:-1]) != body[-1]:
            del buffer[0]
            continue
        del buffer[: 4 + length]
        yield Answer(body[0], body[2], body[3:-1])


def checksum(body: bytes) -> int:
    """Complement of the sum, one byte."""
    return ~sum(body) & 0xFF


def signed(word: int, sign_bit: int) -> int:
    """Read a number whose sign is in a bit of its own."""
    magnitude = word & ((1 << sign_bit) - 1)
    return -magnitude if word >> sign_bit & 1 else magnitude


def word(value: int, sign_bit: int = 15) -> bytes:
    """Write a number as two bytes, its sign in a bit of its own."""
    return (abs(value) | (value < 0) << sign_bit).to_bytes(2, "little")


def _packet(instruction: int, data: bytes) -> bytes:
    body = bytes([EVERYONE, len(data) + 2, instruction]) + data
    return HEADER + body + bytes([checksum(body)])
