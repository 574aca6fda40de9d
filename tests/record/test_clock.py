"""The device's times, what is made of wrong ones, and the samples that never came."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.record.clock import Clock
from pbd.record.losses import Losses
from pbd.sensors.decoding import Sample

HZ = 100.0


def taken(times: list[float | None], arrivals: list[float] | None = None) -> tuple[list[float], Clock]:
    """The times that samples are given which say these, and arrive as they should or as is said."""
    clock, out = Clock(), []
    for k, at in enumerate(times):
        arrival = 50.0 + (k / HZ if arrivals is None else arrivals[k])
        out += [t for t, _ in clock.take(Sample((0.0, 0.0, 9.8), t_device=at), arrival)]
    return out, clock


def steady(n: int, start: float = 7.0) -> list[float | None]:
    return [start + k / HZ for k in range(n)]


@given(st.integers(0, 49), st.floats(-100.0, 1e6).filter(lambda wrong: abs(wrong) > 1e-9))
def test_one_false_time_costs_itself_and_shifts_nothing(row: int, wrong: float) -> None:
    """Whatever it says; of a small leap onwards also what seems to lie before it."""
    times = steady(60)
    times[row] = 7.0 + row / HZ + wrong
    got, clock = taken(times)
    zero = times[0] if row == 0 and got[1] - got[0] < 2.0 / HZ else 7.0
    assert zero is not None
    true = {round(k, 6) for k in (7.0 + np.arange(60) / HZ - zero)}
    false = [t for t in got[:-1] if round(t, 6) not in true]
    assert len(false) <= (60 if row == 0 else 1)
    assert (np.diff(got) > 0.0).all()
    assert len(got) + clock.doubted >= 59
    assert len(got) >= 48
    if row > 10:
        assert got[-1] == pytest.approx(0.59)


def test_a_device_that_begins_anew_goes_on_by_the_hosts_clock() -> None:
    times = steady(50) + steady(50, start=0.2)
    arrivals = [k / HZ for k in range(50)] + [2.0 + k / HZ for k in range(50)]
    got, _ = taken(times, arrivals)
    assert got == pytest.approx(arrivals)


def test_a_gap_stays_a_gap() -> None:
    """Even where all of it arrives at once, as after a host that was busy."""
    times = steady(50) + steady(50, start=9.0)
    expected = [k / HZ for k in range(50)] + [2.0 + k / HZ for k in range(50)]
    for arrivals in (expected, [1.0] * 100):
        got, clock = taken(times, arrivals)
        assert got == pytest.approx(expected)
        assert clock.doubted == 0


@pytest.mark.parametrize("hz", [1.0, 5.0, 2000.0])
def test_slow_and_fast_devices(hz: float) -> None:
    steps = [k / hz for k in range(40)]
    got, clock = taken([3.0 + t for t in steps], steps)
    assert got == pytest.approx(steps)
    assert clock.doubted == 0


def test_the_same_time_twice_is_one_sample() -> None:
    times = steady(30)
    got, clock = taken([at for at in times for _ in range(2)], [k / HZ / 2.0 for k in range(60)])
    assert len(got) == 30
    assert clock.doubted == 29  # of the last one nothing is known yet


def test_the_first_sample_says_whose_clock_it_is() -> None:
    got, clock = taken([*steady(10), None, *steady(10, start=7.11)])
    assert clock.is_device
    assert len(got) == 20
    assert clock.doubted == 1
    got, clock = taken([None, *steady(10)])
    assert not clock.is_device
    assert len(got) == 11


def lost(times: np.ndarray) -> int:
    losses = Losses()
    for t in times:
        losses.take(float(t))
    losses.judge()
    return losses.lost


@given(st.integers(0, 10**6), st.floats(0.0, 0.2), st.sampled_from([40.0, 100.0, 400.0, 1000.0]))
def test_what_is_lost_is_counted(seed: int, share: float, hz: float) -> None:
    rng = np.random.default_rng(seed)
    kept = rng.random(500) >= share
    kept[[0, -1]] = True
    t = (np.arange(500) + rng.uniform(-0.1, 0.1, 500)) / hz
    assert lost(t[kept]) == 500 - kept.sum()


def test_a_clock_in_whole_milliseconds_loses_nothing() -> None:
    for hz in (40.0, 100.0, 128.0, 300.0, 400.0, 450.0, 1000.0):
        assert lost(np.round(1e3 * np.arange(2000) / hz) / 1e3) == 0


def test_few_samples_are_counted_too() -> None:
    assert lost(np.array([0.0, 0.01, 0.02, 0.05, 0.06])) == 2
    assert lost(np.array([0.0])) == 0
