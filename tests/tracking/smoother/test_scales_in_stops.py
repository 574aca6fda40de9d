"""What a stop shows of the sensor's matrices: how they change its mean specific force, and nothing by noise or sway."""

import numpy as np
import pytest

from pbd.pose import Array, quat_exp, quat_to_matrix
from pbd.tracking.smoother.knots import LONG_STOP_S, Problem, _fix_sway
from pbd.tracking.smoother.preintegration import ACC_MATRIX, ERRORS, GYR_MATRIX, POS, VEL, Legs
from pbd.tracking.smoother.state import lower_matrix
from tests.known import known
from tests.scenarios import simulate
from tests.tracking.smoother.test_smoother import smoothed


@pytest.fixture(scope="module")
def problem() -> Problem:
    return known(smoothed(simulate("pour", "wt901", 0).recording).solution).problem


def mean_force(problem: Problem, stop: int) -> Array:
    """Return a stop's mean specific force (3,) m/s2 in the gyro frame, by the velocity gained between its knots."""
    inside = np.flatnonzero(problem.stop_of == stop)
    first, last = inside[0], inside[-1]
    return np.asarray((problem.legs.U[last] - problem.legs.U[first]) / (problem.t[last] - problem.t[first]))


def test_in_a_stop_the_accelerometers_matrix_multiplies_the_mean_force(problem: Problem) -> None:
    N = np.array((0.3, -0.2, 0.5, 0.7, -0.4, 0.1))
    middle = (problem.rows[:-1] + problem.rows[1:]) // 2
    for k in np.flatnonzero(problem.same_stop):
        C, T = quat_to_matrix(problem.frame.wxyz[middle[k]]), problem.legs.T[k]
        change = -C @ lower_matrix(N) @ C.T @ mean_force(problem, problem.stop_of[k])
        np.testing.assert_allclose(problem.legs.J[k, VEL, ACC_MATRIX] @ N, change * T, rtol=1e-9)
        np.testing.assert_allclose(problem.legs.J[k, POS, ACC_MATRIX] @ N, change * T**2 / 2.0, rtol=1e-9)


def test_in_a_long_stop_the_drift_of_the_gyro_frame_does_not_change_the_force() -> None:
    """The second of two stops lasts 100 s, the gyro's bias 0.05 degrees a second. The first has a knot, but no leg."""
    t, T, force, N = (
        np.arange(100.0),
        np.ones(100),
        np.array((1.0, 2.0, 9.0)),
        np.array((0.3, -0.2, 0.5, 0.7, -0.4, 0.1)),
    )
    C = quat_to_matrix(quat_exp(np.radians(0.05) * (t + 0.5)[:, None] * (1.0, 0.0, 0.0)))
    none = np.zeros((0, 0))
    legs = Legs(T, none, C @ force, none, np.ones((100, 9, ERRORS)), none)
    _fix_sway(legs, t, C, np.ones(100, dtype=np.intp))
    error = np.linalg.norm(legs.J[:, VEL, ACC_MATRIX] @ N + C @ lower_matrix(N) @ force, axis=1)
    largest = np.linalg.norm(force) * np.linalg.norm(lower_matrix(N), 2)
    assert error.max() < 0.5 * LONG_STOP_S * np.radians(0.05) * largest


def test_only_moves_show_the_gyros_scales(problem: Problem) -> None:
    shown = problem.legs.J[:, :, GYR_MATRIX].any(axis=(1, 2))
    np.testing.assert_array_equal(shown, ~problem.same_stop)


@pytest.mark.parametrize("seed", [0, 1])
def test_noise_and_sway_raise_no_scale(seed: int) -> None:
    """Pouring turns the hand about x, which stays level: gravity never shows this axis' scale, of a prior of 1 %."""
    found = known(smoothed(simulate("pour", "wt901", seed).recording).solution).state.shared[ACC_MATRIX]
    assert abs(found[0]) < 0.002
