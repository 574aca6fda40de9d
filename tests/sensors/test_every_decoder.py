"""Every decoder copes with any chunking, noise and damage, and reads the next whole packet after it."""

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbd.sensors.protocols import PROTOCOLS
from tests.benchmarks.wires import MIXED
from tests.sensors.decoder_checks import assert_any_chunking, fuzz, missed_after_junk, mutated

PACKETS = {name: list(wire.packets(60)) for name, wire in MIXED.items()}
every = pytest.mark.parametrize("name", MIXED)


def test_no_protocol_is_left_out() -> None:
    assert MIXED.keys() == PROTOCOLS.keys(), "give it a stream in MIXED, in tests/benchmarks/wires.py"


@every
@settings(max_examples=8)
@given(seed=st.integers(0, 2**32))
def test_any_chunking_gives_the_same(name: str, seed: int) -> None:
    rng = random.Random(seed)
    sent = b"".join(PACKETS[name][:6])
    assert_any_chunking(MIXED[name].make, mutated(sent, rng) + rng.randbytes(50) + mutated(sent, rng), seed)


@every
def test_no_damage_raises_or_gives_what_was_not_sent(name: str) -> None:
    fuzz(MIXED[name].make, PACKETS[name], MIXED[name].checked, cases=100)


@every
def test_in_step_again_at_the_next_whole_packet(name: str) -> None:
    """One in 256 halves and the next packet have a right checksum together; a group may lack a part."""
    missed = missed_after_junk(MIXED[name].make, PACKETS[name], cases=80)
    assert max(missed) <= 1
    assert np.mean(missed) < 0.02 or name in ("lines", "razor", "witmotion", "gamepad")


@pytest.mark.parametrize("name", ["os5000", "ximu3", "vectornav", "xsens"])
def test_half_a_packet_swallows_nothing_of_the_next(name: str) -> None:
    first, *others = PACKETS[name][:20]
    whole = MIXED[name].make().feed(b"".join(others))
    for cut in range(1, len(first) - 2):
        assert MIXED[name].make().feed(first[:cut] + b"".join(others)) == whole


@every
def test_noise_does_not_grow_the_memory(name: str) -> None:
    decoder, rng = MIXED[name].make(), random.Random(1)
    beginnings = (packet[: rng.randrange(len(packet))] for packet in 4 * PACKETS[name])
    for filler in (bytes(1000), b"$", b"\x55\x51", b"\xfa\xff\x36\xff\x07\xff", b"1,2,", *beginnings, b""):
        decoder.feed((filler or rng.randbytes(1000)) * 50)
        assert sum(len(value) for value in vars(decoder).values() if isinstance(value, bytes)) < 4096
