"""What is done to every decoder: its stream in any pieces, with noise, flipped, lost and doubled bytes."""

from __future__ import annotations

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
    """All samples of the parts."""
    return [sample for part in parts for sample in decoder.feed(part)]


def mutated(data: bytes, rng: random.Random) -> bytes:
    """The data after one to three mishaps: bits flipped, bytes lost, doubled or swapped, noise between, an end cut."""
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
    """What stands in the samples, each vector by itself: a sample may lack what was lost."""
    named = [(name, getattr(s, name)) for s in samples for name in ("acc", "gyr", "mag", "rpy")]
    return {(name, value) for name, value in named if value is not None}


def unexplained(make: Make, checked: Checked, stream: bytes, samples: Sequence[Sample], clean: Parts) -> Parts:
    """What came of no packet with a right checksum: neither of those sent nor of any that chance has made."""
    strange = parts_of(samples) - clean
    if strange:  # a chance of one in 256 for a short checksum: look at what stands in the stream
        strange -= parts_of(sample for packet in checked(stream) for sample in make().feed(packet))
    return strange


def assert_sane(samples: Iterable[Sample]) -> None:
    """All numbers are finite."""
    for sample in samples:
        numbers = [x for name in ("acc", "gyr", "mag", "rpy") for x in getattr(sample, name) or ()]
        assert all(map(isfinite, [*numbers, sample.t_device or 0.0]))


def assert_any_chunking(make: Make, data: bytes, seed: int) -> None:
    """The same samples and the same tally in one piece, byte by byte and in random pieces."""
    whole = make()
    samples = whole.feed(data)
    rng = random.Random(seed)
    for parts in ([data[k : k + 1] for k in range(len(data))], pieces(data, rng), pieces(data, rng, 1000)):
        decoder = make()
        assert fed(decoder, parts) == samples
        assert decoder.tally == whole.tally


def fuzz(make: Make, packets: Sequence[bytes], checked: Checked | None, cases: int = 1000, seed: int = 4) -> None:
    """A thousand mishaps: nothing raised, nothing absurd, nothing from a wrong checksum."""
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
    """After half a packet or noise, how many of the whole packets that follow give no sample, case by case.

    The last packets are only there so that whatever waits for more bytes gets them.
    """
    missed = []
    expected = {(s.acc, s.gyr) for s in make().feed(b"".join(packets[:8]))}
    for case in range(cases):
        rng = random.Random(seed * 1_000_003 + case)
        half = rng.choice(packets)
        junk = rng.randbytes(rng.randrange(100)) if case % 2 else half[rng.randrange(len(half)) :]
        junk += half[: rng.randrange(len(half))]
        samples = make().feed(junk + b"".join(packets))
        missed.append(len(expected) - len(expected & {(s.acc, s.gyr) for s in samples}))
    return missed
