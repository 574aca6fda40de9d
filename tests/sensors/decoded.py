"""Small words for tests of decoders."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from pbd.sensors.decoding import Decoder, Sample

_T = TypeVar("_T")


def known(value: _T | None) -> _T:
    """What has to be there."""
    assert value is not None
    return value


def decode(make: Callable[[], Decoder], stream: bytes) -> list[Sample]:
    """What a new decoder makes of a stream."""
    return make().feed(stream)


def held_bytes(decoder: Decoder) -> int:
    """How much of the stream a decoder keeps."""
    return sum(len(value) for value in vars(decoder).values() if isinstance(value, bytes | bytearray))
