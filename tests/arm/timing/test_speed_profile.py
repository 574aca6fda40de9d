"""The fastest profile along a path, compared with toppra and with results by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbd.arm.timing.path_smoothing import Curve
from pbd.arm.timing.speed_profile import fastest_profile
from tests.arm.timing.random_paths import limits_of, random_waypoints
from tests.arm.toppra_oracle import toppra_duration


@pytest.mark.parametrize("seed", range(4))
def test_it_is_as_fast_as_toppra(seed: int) -> None:
    limits = limits_of(2.0, 8.0, 1e9)
    curve = Curve.through(random_waypoints(seed), limits)
    assert curve is not None
    reference = toppra_duration(curve.s, curve.q(curve.s), limits)
    assert curve.profile(limits, 1.0).t[-1] == pytest.approx(reference, rel=0.003)


def test_a_straight_line_takes_what_bang_bang_takes() -> None:
    """By hand: full acceleration to the middle, full deceleration to the end; with a top speed, a plateau between."""
    s = np.linspace(0.0, 1.0, 2001)
    dq, ddq = np.ones((2001, 1)), np.zeros((2001, 1))
    free = fastest_profile(s, dq, ddq, np.array([100.0]), np.array([4.0]))
    assert free.t[-1] == pytest.approx(2.0 * np.sqrt(1.0 / 4.0), rel=1e-3)
    bound = fastest_profile(s, dq, ddq, np.array([0.5]), np.array([4.0]))
    assert bound.t[-1] == pytest.approx(1.0 / 0.5 + 0.5 / 4.0, rel=1e-3)
    np.testing.assert_allclose(bound.at(np.array([-1.0, 0.0, bound.t[-1], 99.0])), [0.0, 0.0, 1.0, 1.0], atol=1e-12)


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), velocity=st.floats(0.1, 5.0), acceleration=st.floats(0.5, 30.0))
def test_no_joint_exceeds_its_limits_at_any_grid_point(seed: int, velocity: float, acceleration: float) -> None:
    limits = limits_of(velocity, acceleration, 1e9)
    curve = Curve.through(random_waypoints(seed), limits)
    assert curve is not None
    pace = curve.profile(limits, 1.0)
    u = 0.5 * np.diff(pace.x) / np.diff(pace.s)
    dq, ddq = curve.q(pace.s, 1), curve.q(pace.s, 2)
    assert (np.abs(dq) * np.sqrt(pace.x)[:, None] <= velocity * (1 + 1e-9)).all()
    for end in (slice(None, -1), slice(1, None)):  # of each stretch
        reached = dq[end] * u[:, None] + ddq[end] * pace.x[end, None]
        assert (np.abs(reached) <= acceleration * (1 + 1e-6)).all()
    assert pace.x[0] == pace.x[-1] == 0.0
    assert (pace.x[1:-1] > 0.0).all()


def test_an_additional_speed_limit_is_kept() -> None:
    limits = limits_of(2.0, 8.0, 1e9)
    curve = Curve.through(random_waypoints(1), limits)
    assert curve is not None
    free = curve.profile(limits, 1.0)
    slow = fastest_profile(
        free.s, curve.q(free.s, 1), curve.q(free.s, 2), limits.velocity, limits.acceleration, 0.25 * free.x
    )
    assert (slow.x <= 0.25 * free.x + 1e-15).all()
    assert slow.t[-1] == pytest.approx(2.0 * free.t[-1], rel=0.01)
