"""Packets of Feetech's STS servos: pure functions, no I/O.

A packet is FF FF, id, length, instruction (in an answer: the servo's error flags), data, checksum. The checksum is the
complement of the sum of all bytes after FF FF. Words are little-endian in sign-magnitude form; the sign bit differs.
Source: Feetech, "Communication protocol manual of serial bus smart servo". Tests compare with Feetech's own SDK.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

HEADER = b"\xff\xff"
BROADCAST_ID = 0xFE
"""The id that addresses all servos."""


class Answer(NamedTuple):
    """A servo's answer: its id, its error flags, the bytes of its registers."""

    id: int
    error: int
    data: bytes


def sync_read(ids: tuple[int, ...], address: int, length: int) -> bytes:
    """Encode a request for `length` registers from `address` on of several servos, which answer one after another."""
    return _packet(0x82, bytes([address, length, *ids]))


def sync_write(address: int, values: Mapping[int, bytes]) -> bytes:
    """Encode a write of registers from `address` on in several servos at once (id -> bytes). None answers."""
    length = len(next(iter(values.values())))
    return _packet(0x83, bytes([address, length]) + b"".join(bytes([id_]) + data for id_, data in values.items()))


def take_answers(buffer: bytearray) -> Iterator[Answer]:
    """Take complete answers out of the buffer. Bytes that begin no packet are dropped one by one."""
    while True:
        start = buffer.find(HEADER)
        del buffer[: max(0, len(buffer) - 1) if start < 0 else start]
        if len(buffer) < 4:
            return
        length = buffer[3]
        # At least instruction and checksum, and at most what Feetech's SDK takes.
        if buffer[2] >= BROADCAST_ID or not 2 <= length <= 250:
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
    """Complement of the sum of the bytes, one byte."""
    return ~sum(body) & 0xFF


def decode_word(data: bytes, at: int = 0, sign_bit: int = 15) -> int:
    """Decode the two bytes at index `at` as a sign-magnitude number."""
    raw = int.from_bytes(data[at : at + 2], "little")
    magnitude = raw & ((1 << sign_bit) - 1)
    return -magnitude if raw >> sign_bit & 1 else magnitude


def encode_word(value: int, sign_bit: int = 15) -> bytes:
    """Encode a sign-magnitude number as two bytes."""
    return (abs(value) | (value < 0) << sign_bit).to_bytes(2, "little")


def _packet(instruction: int, data: bytes) -> bytes:
    body = bytes([BROADCAST_ID, len(data) + 2, instruction]) + data
    return HEADER + body + bytes([checksum(body)])
