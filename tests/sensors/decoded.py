"""Helpers for tests of decoders."""

from collections.abc import Callable

from pbd.sensors.decoding import Decoder, Sample


def decode(make: Callable[[], Decoder], stream: bytes) -> list[Sample]:
    """Decode a stream with a new decoder."""
    return make().feed(stream)


def held_bytes(decoder: Decoder) -> int:
    """Number of the stream's bytes that a decoder keeps."""
    return sum(len(value) for value in vars(decoder).values() if isinstance(value, bytes | bytearray))
