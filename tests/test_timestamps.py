"""Time stamps from arrivals: bursts, stalls and losses, with the truth beside."""

from __future__ import annotations

import numpy as np
import pytest

from pbd.pose import Array
from pbd.timestamps import Stamper, straighten


def arrivals(rate_hz: float, kind: str, seed: int, seconds: float = 40.0) -> tuple[Array, Array, int]:
    """True times of the samples that came, when they arrived, and how many did not come."""
    rng = np.random.default_rng(seed)
    n = int(rate_hz * seconds)
    true = np.arange(n) / rate_hz * 1.00003  # no crystal is exact
    came = np.ones(n, dtype=bool)
    if "lost" in kind:
        came[rng.choice(np.arange(n // 8, n - n // 8), 5, replace=False)] = False
        came[n // 2 : n // 2 + 3] = False
    t = true[came]
    arrival = t + 0.003 + rng.exponential(0.0005, len(t))
    if "bursts" in kind:  # a USB frame of 16 ms
        arrival = np.maximum(arrival, np.ceil(t / 0.016) * 0.016 + 0.003 + rng.exponential(0.0003, len(t)))
    for stalled in rng.integers(0, len(t), 5):  # a host that is busy for 0.2 s
        rows = slice(stalled, stalled + int(0.2 * rate_hz))
        arrival[rows] = np.maximum(arrival[rows], arrival[stalled] + 0.2)
    return t, np.maximum.accumulate(arrival), n - int(came.sum())


@pytest.mark.parametrize("kind", ["plain", "bursts", "lost", "lost in bursts"])
@pytest.mark.parametrize("rate_hz", [40.0, 100.0, 400.0])
@pytest.mark.parametrize("seed", range(3))
def test_stamps_are_right_to_a_sample_where_some_are_lost_and_to_a_millisecond_elsewhere(
    rate_hz: float, kind: str, seed: int
) -> None:
    true, arrival, missing = arrivals(rate_hz, kind, seed)
    t, lost = straighten(arrival)
    off = t - true
    off -= np.median(off)
    assert lost == missing
    assert (np.diff(t) > 0.0).all()
    assert np.percentile(np.abs(off), 95) < 0.0015
    assert np.abs(off).max() < 1.05 / rate_hz + 0.001


def test_few_samples_are_taken_as_they_came() -> None:
    assert straighten(np.array([]))[1] == 0
    t, lost = straighten(np.array([5.0, 5.1]))
    assert t == pytest.approx([0.0, 0.1])
    assert lost == 0


@pytest.mark.parametrize("kind", ["plain", "bursts", "lost"])
def test_stamps_as_they_come_increase_and_follow(kind: str) -> None:
    true, arrival, _ = arrivals(100.0, kind, 1)
    stamper = Stamper()
    t = np.array([stamper.stamp(at) for at in arrival])
    assert (np.diff(t) > 0.0).all()
    off = t - (true - true[0])
    assert np.abs(off - np.median(off)).max() < 0.1
    assert stamper.arrivals == arrival.tolist()
