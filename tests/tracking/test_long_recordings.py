"""The fast forms that make tracking linear in time equal the slow forms, which are written out here."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pbd.data import GripEvent, Stop
from pbd.errors import PbdWarning
from pbd.pipeline import track
from pbd.pose import Array
from pbd.tracking.apply_constraints import _joseph_times
from pbd.tracking.keyframes import _grip_at_stops, _without_repeats
from pbd.tracking.moving_windows import squares, window_moments, window_sums
from tests.scenarios import pour
from tests.tracking.hand_paths import covariances, hand_path

vectors = st.integers(1, 60).flatmap(lambda n: arrays(np.float64, (n, 3), elements=st.floats(-1e3, 1e3)))
seeds = st.integers(0, 2**32 - 1)


@given(vectors)
def test_squares_are_numpys_to_the_bit(values: Array) -> None:
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


def any_stops(rng: np.random.Generator) -> tuple[list[Stop], Array]:
    """Random stops, in order, and times at 100 Hz."""
    lengths = rng.integers(1, 20, (int(rng.integers(1, 9)), 2))
    edges = np.cumsum(lengths.ravel()).reshape(-1, 2)
    stops = [Stop(int(start), int(stop), 0.01 * (int(stop - start) - 1)) for start, stop in edges]
    return stops, 0.01 * np.arange(edges[-1, 1], dtype=np.float64)


@given(seeds)
def test_a_grip_belongs_to_the_nearest_of_all_stops(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stops, t = any_stops(rng)
    events = tuple(GripEvent(float(at), bool(rng.integers(2))) for at in rng.uniform(-0.2, t[-1] + 0.2, 9))
    slowly = {}
    for event in events:
        away = [max(float(t[stop.start]) - event.t, event.t - float(t[stop.stop - 1]), 0.0) for stop in stops]
        slowly[int(np.argmin(away))] = event.closed
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert _grip_at_stops(events, t, tuple(stops)) == slowly
        assert _grip_at_stops(events, t, ()) == {}


@given(seeds)
def test_a_covariance_is_conditioned_as_a_dense_one(seed: int) -> None:
    """Joseph's form, block by block, for any gain."""
    rng = np.random.default_rng(seed)
    k, m = (int(number) for number in rng.integers(1, 6, 2))
    prior = hand_path(np.zeros((k + 1, 3)), covariances(rng, k, 1.0)).covariance
    gain, G, root = rng.normal(size=(k + 1, 6, m)), rng.normal(size=(k + 1, 6, m)), rng.normal(size=(m, m))
    K, H, P = gain.reshape(-1, m), G.reshape(-1, m).T, prior.joint()
    A = np.eye(len(P)) - K @ H
    slowly = A @ P @ A.T + K @ root @ root.T @ K.T
    columns = rng.normal(size=(k + 1, 6, 3))
    found = _joseph_times(prior, gain, G, root @ root.T, columns)
    assert found.reshape(-1, 3) == pytest.approx(slowly @ columns.reshape(-1, 3), rel=1e-9, abs=1e-9)


def test_a_grip_half_a_second_from_all_stops_is_told() -> None:
    t, stops = np.arange(300) / 100.0, (Stop(0, 101, 1.0),)
    assert _grip_at_stops((GripEvent(1.45, True),), t, stops) == {0: True}
    with pytest.warns(PbdWarning, match=r"the grip closed at 1\.55 s, 0\.6 s from the nearest stop"):
        assert _grip_at_stops((GripEvent(1.55, True),), t, stops) == {0: True}


def test_a_grip_that_repeats_the_one_before_is_left_out_and_told() -> None:
    with pytest.warns(PbdWarning, match="the grip closes at stop 2, but it is closed since stop 0: left out"):
        assert _without_repeats({2: True, 0: True, 3: False}) == {0: True, 3: False}


def test_a_first_grip_that_opens_is_left_out_and_told() -> None:  # as of two pairs of taps at one stop, for one
    with pytest.warns(PbdWarning, match="the grip opens at stop 1, but it is open from the start: left out"):
        assert _without_repeats({1: False, 3: True}) == {3: True}


def test_each_poses_covariance_is_its_block_of_the_joint_one() -> None:
    covariance = track(pour().recording).covariance
    slowly = replace(covariance, diagonal=None).of_each
    sigma = np.sqrt(np.einsum("kii->ki", slowly))
    assert covariance.of_each == pytest.approx(slowly, abs=1e-9 * float(sigma[1:].min()) ** 2, rel=1e-6)
    assert not covariance.of_each[0, :3].any()  # nav's origin, exactly
    assert covariance.moves is not None
    slowly = replace(covariance, moves=None).of_moves
    assert covariance.of_moves == pytest.approx(slowly, abs=1e-9 * float(np.einsum("kii->ki", slowly).min()), rel=1e-6)
