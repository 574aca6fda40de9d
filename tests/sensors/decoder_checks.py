"""Checks for every decoder: its stream in pieces of any size, with noise, flipped, lost and doubled bytes."""

import random
from collections.abc import Callable, Iterable, Iterator, Sequence
from math import isfinite

from pbd.sensors.decoding import Decoder, Sample

Make = Callable[[], Decoder]
Checked = Callable[[bytes], list[bytes]]
Parts = set[tuple[str, tuple[float, ...]]]


def pieces(data: bytes, rng: random.Random, longest: int = 64) -> Iterator[bytes]:
    """The data in pieces of 0 to `longest` bytes."""
    at = 0
    while at < len(data):
        step = rng.randint(0, longest)
        yield data[at : at + step]
        at += step


def fed(decoder: Decoder, parts: Iterable[bytes]) -> list[Sample]:
    """Feed all parts; return their samples."""
    return [sample for part in parts for sample in decoder.feed(part)]


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Damage the data one to three times: flip a bit, lose, double or swap bytes, insert noise, cut the start off."""
    mended = bytearray(data)
    for _ in range(rng.randint(1, 3)):
        at, run = rng.randrange(len(mended) + 1), rng.choice((1, 1, 2, 7, 40))
        mishap = rng.randrange(6)
        if mishap == 0 and at < len(mended):
            mended[at] ^= 1 << rng.randrange(8)
        elif mishap == 1:
            del mended[at : at + run]
        elif mishap == 2:
            mended[at:at] = rng.randbytes(run)
        elif mishap == 3:
            mended[at:at] = mended[at : at + run]
        elif mishap == 4:
            mended[at : at + run] = mended[at : at + run][::-1]
        elif mishap == 5:
            del mended[: rng.randrange(run)]
    return bytes(mended)


def parts_of(samples: Iterable[Sample]) -> Parts:
    """All vectors of the samples, each by itself, because a sample may lack a lost one."""
    named = [(name, getattr(s, name)) for s in samples for name in ("acc", "gyr", "mag", "rpy")]
    return {(name, value) for name, value in named if value is not None}


def unexplained(make: Make, checked: Checked, stream: bytes, samples: Sequence[Sample], clean: Parts) -> Parts:
    """The vectors that come from no packet with a right checksum, neither from those sent nor from one by chance."""
    strange = parts_of(samples) - clean
    if strange:  # a short checksum is right by chance once in 256: check the packets in the stream
        strange -= parts_of(sample for packet in checked(stream) for sample in make().feed(packet))
    return strange


def assert_sane(samples: Iterable[Sample]) -> None:
    """Assert that all numbers are finite."""
    for sample in samples:
        numbers = [x for name in ("acc", "gyr", "mag", "rpy") for x in getattr(sample, name) or ()]
        assert all(map(isfinite, [*numbers, sample.t_device or 0.0]))


def assert_any_chunking(make: Make, data: bytes, seed: int) -> None:
    """Assert that the stream in one piece, byte by byte and in random pieces gives the same samples and tally."""
    whole = make()
    samples = whole.feed(data)
    rng = random.Random(seed)
    for parts in ([data[k : k + 1] for k in range(len(data))], pieces(data, rng), pieces(data, rng, 1000)):
        decoder = make()
        assert fed(decoder, parts) == samples
        assert decoder.tally == whole.tally


def fuzz(make: Make, packets: Sequence[bytes], checked: Checked | None, cases: int = 1000, seed: int = 4) -> None:
    """Damage the stream many times: nothing is raised, and no sample is absurd or comes from a wrong checksum."""
    clean = parts_of(make().feed(b"".join(packets)))
    for case in range(cases):
        rng = random.Random(seed * 1_000_003 + case)
        first = rng.randrange(len(packets) - 6)
        stream = mutated(b"".join(packets[first : first + 6]), rng)
        samples = fed(make(), pieces(stream, rng))
        assert_sane(samples)
        if checked is not None:
            assert not unexplained(make, checked, stream, samples, clean), f"case {case}: {stream.hex()}"


def missed_after_junk(make: Make, packets: Sequence[bytes], cases: int = 300, seed: int = 5) -> list[int]:
    """For each case, how many of the whole packets after half a packet or noise give no sample.

    The last twelve packets only serve a decoder that waits for more bytes.
    """
    missed, followed = [], b"".join(packets[:20])
    expected = {(s.acc, s.gyr) for s in make().feed(b"".join(packets[:8]))}
    for case in range(cases):
        rng = random.Random(seed * 1_000_003 + case)
        half = rng.choice(packets)
        junk = rng.randbytes(rng.randrange(100)) if case % 2 else half[rng.randrange(len(half)) :]
        junk += half[: rng.randrange(len(half))]
        samples = make().feed(junk + followed)
        missed.append(len(expected) - len(expected & {(s.acc, s.gyr) for s in samples}))
    return missed
