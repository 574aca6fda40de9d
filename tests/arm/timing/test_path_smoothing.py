"""Moves along a curve: limits, ends, deviation from the curve, and duration compared with the optimum."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial import KDTree

from pbd.arm.timing import path_smoothing
from pbd.arm.timing.path_smoothing import Curve, curved_move
from pbd.arm.timing.piecewise_cubic import PiecewiseCubic
from pbd.arm.timing.speed_profile import SpeedProfile
from pbd.arm.timing.time_moves import ptp_move
from pbd.data import JointLimits
from pbd.pose import Array
from tests.arm.bundled import arm_of
from tests.arm.timing.random_paths import limits_of, random_waypoints
from tests.arm.toppra_oracle import toppra_duration
from tests.not_none import not_none


def at(pieces: PiecewiseCubic, places: int = 5) -> Array:
    """Return joints (n, k) along the pieces."""
    s = np.linspace(0.0, 1.0, places) * pieces.durations[:, None]
    powers = s[:, :, None] ** np.arange(4)
    joints: Array = np.einsum("ijp,ipk->ijk", powers, pieces.coefficients).reshape(-1, pieces.coefficients.shape[2])
    return joints


def off(pieces: PiecewiseCubic, curve: Curve) -> float:
    """Oracle: the largest distance of the joints from a densely sampled curve, rad."""
    on = curve.q(np.linspace(0.0, curve.s[-1], 20_000))
    some = at(pieces)[:: max(1, 5 * len(pieces.durations) // 100)]
    return float(np.max(KDTree(on).query(some)[0]))


def shares(pieces: PiecewiseCubic, limits: JointLimits) -> list[float]:
    """Oracle: the largest share of each limit, by finite differences."""
    dt, found = 1e-4, []
    knots = np.append(0.0, np.cumsum(pieces.durations))
    t = np.arange(0.0, knots[-1], dt)
    i = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(pieces.durations) - 1)
    q = np.einsum("np,npk->nk", (t - knots[i])[:, None] ** np.arange(4), pieces.coefficients[i])
    for limit in (limits.velocity, limits.acceleration):
        q = np.diff(q, axis=0) / dt
        found.append(float((np.abs(q) / limit).max()))
    return [*found, float((np.abs(6.0 * pieces.coefficients[:, 3]) / limits.jerk).max())]


def test_the_times_of_the_segments_are_linearised_as_finite_differences_say() -> None:
    step, x = np.array([0.2, 0.1, 0.4, 0.3]), np.array([0.0, 1.2, 0.7, 0.9, 0.0])
    times = path_smoothing._times
    _, (by_start, by_end) = times(step, x, 2.5)
    for k, change in enumerate(1e-6 * np.eye(5)[1:4], 1):
        slope = (times(step, x + change, 2.5)[0] - times(step, x - change, 2.5)[0]) / 2e-6
        expected = np.zeros(4)
        expected[k - 1], expected[k] = by_end[k - 1], by_start[k]
        np.testing.assert_allclose(slope, expected, rtol=1e-6)
    assert by_start[0] == by_end[-1] == 0.0  # at rest, where it is infinite


def test_the_path_parameter_is_the_time_of_the_slowest_joint() -> None:
    waypoints = np.array([[0.0, 0.0], [1.0, 0.5], [1.0, -0.5]])
    curve = not_none(Curve.through(waypoints, replace(limits_of(2.0, 8.0, 80.0, 2), velocity=np.array([2.0, 0.5]))))
    np.testing.assert_allclose(curve.s, [0.0, 1.0, 3.0], atol=1e-12)


@pytest.mark.parametrize(("jerk", "seed"), [(8000.0, 0), (400.0, 1), (80.0, 0), (20.0, 1)])
def test_limits_are_kept_ends_are_met_and_the_curve_is_followed(jerk: float, seed: int) -> None:
    limits, waypoints = limits_of(2.0, 8.0, jerk), random_waypoints(seed)
    curve = not_none(Curve.through(waypoints, limits))
    pieces = curved_move(waypoints, limits, 1.0)
    assert all(share <= 1.0 + 1e-4 for share in shares(pieces, limits))
    assert max(shares(pieces, limits)) > 0.99
    np.testing.assert_allclose(at(pieces)[[0, -1]], waypoints[[0, -1]], atol=1e-12)
    assert off(pieces, curve) < np.sqrt(3) * 1e-3  # rad, of three joints
    nearer = curved_move(waypoints, limits, 1.0, deviation_share=0.1)
    assert off(nearer, curve) < np.sqrt(3) * 1e-4
    assert all(share <= 1.0 + 1e-4 for share in shares(nearer, limits))


@settings(max_examples=8)
@given(seed=st.integers(0, 2**32 - 1), factor=st.floats(0.05, 1.0), size=st.floats(1e-6, 1.0))
def test_pieces_join_at_any_size_and_speed(seed: int, factor: float, size: float) -> None:
    limits, waypoints = limits_of(2.0, 8.0, 400.0), random_waypoints(seed, spread=size)
    pieces = curved_move(waypoints, limits, factor)
    h, c = pieces.durations[:, None], np.moveaxis(pieces.coefficients, 1, 0)
    ends = c[0] + h * (c[1] + h * (c[2] + h * c[3])), c[1] + h * (2 * c[2] + 3 * h * c[3]), 2 * c[2] + 6 * h * c[3]
    rest = np.zeros_like(waypoints[:1])
    for end, begin, last in zip(ends, (c[0], c[1], 2 * c[2]), (waypoints[-1:], rest, rest), strict=True):
        np.testing.assert_allclose(end, np.vstack((begin[1:], last)), atol=1e-8)
    velocity, acceleration, jerk = pieces.peaks()
    assert (velocity <= factor * limits.velocity).all()
    assert (acceleration <= factor * limits.acceleration).all()
    assert (jerk <= factor * limits.jerk).all()


@pytest.mark.parametrize("seed", range(2))
def test_with_a_high_jerk_limit_it_is_near_the_optimum_without_one(seed: int) -> None:
    limits = arm_of("panda").limits
    waypoints = arm_of("panda").robot.home + random_waypoints(seed, joints=7, spread=0.1)
    curve = not_none(Curve.through(waypoints, limits))
    assert ((waypoints > limits.lower) & (waypoints < limits.upper)).all()
    reference = toppra_duration(curve.s, curve.q(curve.s), limits)
    assert curved_move(waypoints, limits, 1.0).duration <= 1.01 * reference


@pytest.mark.parametrize(
    ("jerk", "share", "longer"), [(400.0, 1.0, 1.035), (80.0, 1.0, 1.035), (20.0, 1.0, 1.07), (60.0, 0.3, 1.035)]
)
def test_with_a_low_jerk_limit_it_is_near_the_optimum_along_a_line(jerk: float, share: float, longer: float) -> None:
    """Ruckig gives the optimum of a straight move; a curve that happens to be straight takes hardly longer.

    Its acceleration and deceleration are symmetrical.
    """
    limits, ends = limits_of(2.0, 8.0, jerk), np.array([[0.0, 0.0, 0.0], [0.9, -0.5, 0.3]])
    waypoints = ends[0] + np.linspace(0.0, 1.0, 40)[:, None] * (ends[1] - ends[0])
    best = ptp_move(ends[0], ends[1], limits, share).duration
    pieces = curved_move(waypoints, limits, share)
    assert best <= pieces.duration <= longer * best
    assert np.abs(at(pieces) + at(pieces)[::-1] - ends.sum(axis=0)).max() < 1e-3


@pytest.mark.parametrize(("seed", "best"), [(1, 1.0), (6, 0.75), (8, 0.5)])
def test_the_fastest_of_three_averages_is_taken(monkeypatch: pytest.MonkeyPatch, seed: int, best: float) -> None:
    """A shorter one is faster where no acceleration jumps by twice its limit."""
    limits, waypoints = limits_of(2.0, 8.0, 400.0), random_waypoints(seed)
    chosen, durations = curved_move(waypoints, limits, 1.0).duration, dict[float, float]()
    for share in (1.0, 0.75, 0.5):
        monkeypatch.setattr(path_smoothing, "_RAMPS", (share,))
        durations[share] = curved_move(waypoints, limits, 1.0).duration
    assert min(durations, key=lambda share: durations[share]) == best
    assert chosen == durations[best]


def test_an_average_is_over_four_pieces() -> None:
    """Of a ramp that takes twice the acceleration over the jerk: 2 ms."""
    pieces = curved_move(random_waypoints(1), limits_of(2.0, 8.0, 8000.0), 1.0)
    np.testing.assert_allclose(pieces.durations, 0.5e-3, rtol=0.01)


@pytest.mark.parametrize(("spread", "factor", "bound"), [(1e-4, 1.0, 90), (0.4, 0.5, None), (40.0, 0.1, 3000)])
def test_steps_that_keep_the_jerk_are_as_long_as_the_curve_allows(
    monkeypatch: pytest.MonkeyPatch, spread: float, factor: float, bound: int | None
) -> None:
    """By hand: an average over three steps of h and the spline leave the curve by 13/24 h^2 times the acceleration."""
    monkeypatch.setattr(path_smoothing, "jerk_limited_profile", lambda s, x_max, *_: SpeedProfile(s, x_max))
    limits, waypoints = limits_of(2.0, 8.0, 0.02), random_waypoints(2, spread=spread)
    limits = replace(limits, acceleration=np.array([4.0, 8.0, 2.0]))
    curve = not_none(Curve.through(waypoints, limits))
    h = np.sqrt(1e-3 / (13.0 / 24.0 * 8.0 * factor))
    steps = bound or curve.profile(limits, factor).t[-1] / h
    assert len(curved_move(waypoints, limits, factor).durations) == pytest.approx(steps + 4.0, abs=1.0)


def test_a_pause_of_a_demonstration_is_followed_at_a_five_hundredth_of_its_mean_speed() -> None:
    """A hand that goes 1 rad and 1 rad in 2 s each, and 1 mrad in 200 s between."""
    limits, waypoints = limits_of(2.0, 8.0, 400.0, 1), np.array([[0.0], [1.0], [1.001], [2.001]])
    moved = curved_move(waypoints, limits, 1.0, np.array([0.0, 2.0, 202.0, 204.0]))
    assert moved.duration - 4.0 == pytest.approx(0.001 / (0.002 * 2.001 / 204.0), rel=0.1)


def test_waypoints_within_a_nanosecond_are_one() -> None:
    limits = limits_of(2.0, 8.0, 400.0, 1)
    assert curved_move(np.array([[0.0], [1e-9]]), limits, 1.0).duration == 0.0
    assert curved_move(np.array([[0.0], [1e-8]]), limits, 1.0).duration > 0.0
    out_and_back = np.array([[0.0], [3e-9], [1.5e-9], [0.0]])
    assert curved_move(out_and_back, limits, 1.0).duration > 0.0  # the second and the third are one, not the ends


def test_a_demonstrations_own_pace_is_kept_where_the_limits_allow_it() -> None:
    """The hand moves from rest to rest, fastest in the middle, as hands do."""
    limits, path = limits_of(2.0, 8.0, 8000.0), random_waypoints(3)
    fast = curved_move(path, limits, 1.0).duration
    t = np.linspace(0.0, 4.0 * fast, 200)
    share = t / t[-1]
    spline = CubicSpline(np.linspace(0.0, 1.0, len(path)), path)
    waypoints = spline(10.0 * share**3 - 15.0 * share**4 + 6.0 * share**5)
    pieces = curved_move(waypoints, limits, 1.0, t)
    assert pieces.duration == pytest.approx(t[-1], rel=0.01)
    knots = np.append(0.0, np.cumsum(pieces.durations))
    for place in (50, 100, 150):
        i = int(np.searchsorted(knots, t[place])) - 1
        late = np.linalg.norm(pieces.coefficients[i, 0] - waypoints[place]) / np.linalg.norm(pieces.coefficients[i, 1])
        assert late < 0.01 * t[-1]
    hurried = curved_move(waypoints, limits, 1.0, 0.1 * t)
    assert fast * 0.99 <= hurried.duration <= 1.05 * fast


@pytest.mark.parametrize("jerk", [8000.0, 80.0])
def test_position_limits_are_kept_between_waypoints_at_a_limit(jerk: float) -> None:
    """A joint reaches its limit and stays there; the spline through these waypoints overshoots it."""
    one = np.minimum(np.linspace(-0.5, 0.5, 30), 0.0)
    waypoints = np.column_stack((one, np.linspace(0.0, 1.0, 30), np.zeros(30)))
    limits = replace(limits_of(2.0, 8.0, jerk), upper=np.array([0.0, 100.0, 100.0]))
    curve = not_none(Curve.through(waypoints, limits))
    assert curve.q(np.linspace(0.0, curve.s[-1], 1000))[:, 0].max() > 1e-4
    pieces = curved_move(waypoints, limits, 1.0)
    assert at(pieces, 20)[:, 0].max() <= 1e-9
    assert max(shares(pieces, limits)) <= 1.0 + 1e-4


def test_coincident_waypoints_take_no_time() -> None:
    limits = limits_of(2.0, 8.0, 400.0)
    none = curved_move(np.ones((5, 3)), limits, 1.0)
    assert none.duration == 0.0
    assert none.coefficients.shape == (0, 4, 3)
    twice = np.repeat(random_waypoints(0), 2, axis=0)
    assert curved_move(twice, limits, 1.0).duration == pytest.approx(
        curved_move(random_waypoints(0), limits, 1.0).duration, rel=1e-9
    )
