"""Helpers for tests of decoders."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from pbd.sensors.decoding import Decoder, Sample

_T = TypeVar("_T")


def known(value: _T | None) -> _T:
    """Assert that the value is there, and return it."""
    assert value is not None
    return value


def decode(make: Callable[[], Decoder], stream: bytes) -> list[Sample]:
    """Decode a stream with a new decoder."""
    return make().feed(stream)


def held_bytes(decoder: Decoder) -> int:
    """Number of the stream's bytes that a decoder keeps."""
    return sum(len(value) for value in vars(decoder).values() if isinstance(value, bytes | bytearray))
