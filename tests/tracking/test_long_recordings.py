"""What makes tracking linear in time gives what the slow forms give, which are written out here."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pbd.data import Stop
from pbd.pose import Array
from pbd.tracking.integration import integrate_move
from pbd.tracking.steady import median, squares, window_moments, window_sums
from pbd.tracking.stops import COAST_S, COAST_SHARE, COAST_SPEED, COASTING_STOPS, _drop_coasting, _nearest

numbers = st.floats(-1e3, 1e3)
vectors = st.integers(1, 60).flatmap(lambda n: arrays(np.float64, (n, 3), elements=numbers))


@given(vectors)
def test_medians_and_squares_are_numpys_to_the_bit(values: Array) -> None:
    assert np.array_equal(median(values), np.median(values, axis=0))
    assert np.array_equal(squares(values), (values**2).sum(axis=1))


@given(vectors, st.integers(1, 20))
def test_window_sums_are_the_sums_over_each_window(values: Array, n: int) -> None:
    n = min(n, len(values))
    slowly = np.array([values[i : i + n].sum(axis=0) for i in range(len(values) - n + 1)])
    assert window_sums(values, n) == pytest.approx(slowly, abs=1e-9)
    variance, mean = window_moments(values, n)
    assert mean == pytest.approx(slowly / n, abs=1e-9)
    spread = np.array([values[i : i + n].var(axis=0).sum() for i in range(len(values) - n + 1)])
    assert variance == pytest.approx(spread, abs=1e-6)


@given(st.lists(st.tuples(st.integers(1, 9), st.integers(1, 9), st.booleans()), min_size=1, max_size=30))
def test_the_nearest_long_run_is_found_among_all(steps: list[tuple[int, int, bool]]) -> None:
    """Runs in order and apart; some are long, whichever; of a long one the nearest is itself."""
    found, at = [], 0
    for gap, length, is_long in steps:
        found.append((slice(at + gap, at + gap + length), is_long))
        at += gap + length
    long = [run for run, is_long in found if is_long]
    for run, _ in found if long else ():
        slowly = min(long, key=lambda other: max(other.start - run.stop, run.start - other.stop))
        assert long[_nearest(run, long)] == slowly


def without_coasting(stops: list[Stop], t: Array, a_nav: Array) -> tuple[Stop, ...]:
    """Every closure anew, every time."""

    def coasts(stops: list[Stop]) -> bool:
        if any(stop.dwell_s >= COAST_S for stop in stops[1:-1]):
            return False
        moves = [slice(before.stop - 1, after.start + 1) for before, after in pairwise(stops)]
        closures = np.array([integrate_move(t[move], a_nav[move]).closure for move in moves])
        speed = min(np.linalg.norm(closures[0]), np.linalg.norm(closures[-1]))
        return bool(speed > COAST_SPEED and np.linalg.norm(closures.sum(axis=0)) < COAST_SHARE * speed)

    kept, k = list(stops), 1
    while k < len(kept) - 1:
        ends = range(k + 1, min(k + 1 + COASTING_STOPS, len(kept)))
        end = next((end for end in ends if coasts(kept[k - 1 : end + 1])), None)
        if end is None:
            k += 1
        else:
            del kept[k:end]
    return tuple(kept)


def swaying(lengths: list[tuple[int, int]], pushes: Array) -> tuple[list[Stop], Array, Array]:
    """Stops of so many rows after moves of so many, at 100 Hz; in each move the hand is pushed by one of `pushes`."""
    stops, at, a_nav = [], 0, []
    for (move, rest), push in zip(lengths, pushes, strict=True):
        a_nav += [np.tile((push, 0.3 * push, 0.0), (move, 1)), np.zeros((rest, 3))]
        stops.append(Stop(at + move, at + move + rest, 0.01 * (rest - 1)))
        at += move + rest
    return stops, 0.01 * np.arange(at, dtype=np.float64), np.concatenate(a_nav)


lengths = st.lists(st.tuples(st.integers(2, 20), st.integers(2, 80)), min_size=2, max_size=25)


@settings(deadline=None)
@given(lengths, st.integers(0, 2**32 - 1))
def test_the_same_stops_are_dropped_as_coasting(lengths: list[tuple[int, int]], seed: int) -> None:
    pushes = np.random.default_rng(seed).choice((-1.0, -0.5, 0.0, 0.5, 1.0), size=len(lengths))
    stops, t, a_nav = swaying(lengths, pushes)
    assert _drop_coasting(stops, t, a_nav) == without_coasting(stops, t, a_nav)


def test_some_stops_are_dropped_as_coasting() -> None:
    """There and back in two pushes: what lies between is no stop."""
    stops, t, a_nav = swaying([(10, 90), (10, 10), (10, 90)], np.array([0.0, 1.0, -1.0]))
    assert _drop_coasting(stops, t, a_nav) == (stops[0], stops[2])
