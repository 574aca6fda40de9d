"""What goes between the live viewer and its server, by pipes of their own: commands as frames, answers as bytes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import BinaryIO

TAKEN, REFUSED = b"1", b"0"
"""The server's answers to a command."""

FRAMES = 3
"""Of a command: its type, its path, its message."""


def packed(frames: Iterable[bytes]) -> bytes:
    """Frames as they are sent: each led by its length (uint32, little-endian)."""
    return b"".join(len(frame).to_bytes(4, "little") + frame for frame in frames)


def read_command(stream: BinaryIO) -> list[bytes]:
    """Read a command's frames.

    Raises:
        EOFError: the other end is closed.
    """
    return [_read(stream, int.from_bytes(_read(stream, 4), "little")) for _ in range(FRAMES)]


def _read(stream: BinaryIO, size: int) -> bytes:
    data = stream.read(size)
    if len(data) < size:
        raise EOFError
    return data
