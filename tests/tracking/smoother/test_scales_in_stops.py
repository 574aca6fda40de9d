"""What a stop shows of the sensor's matrices: how they change its mean specific force, and nothing by noise or sway."""

import numpy as np
import pytest

from pbd.pose import quat_exp, quat_to_matrix
from pbd.tracking.noise import BARE
from pbd.tracking.smoother.knots import Problem, _fix_sway
from pbd.tracking.smoother.preintegration import ACC_MATRIX, ERRORS, GYR_MATRIX, POS, VEL, Legs
from pbd.tracking.smoother.state import lower_matrix
from tests.not_none import not_none
from tests.scenarios import simulate
from tests.tracking.smoother.smoothed import smoothed

N = np.array((0.3, -0.2, 0.5, 0.7, -0.4, 0.1))
"""Entries of an accelerometer's matrix."""


@pytest.fixture(scope="module")
def problem() -> Problem:
    return not_none(smoothed(simulate("pour", "wt901", 0).recording).solution).problem


def test_in_a_stop_the_accelerometers_matrix_multiplies_the_mean_force(problem: Problem) -> None:
    legs, middle = problem.legs, (problem.rows[:-1] + problem.rows[1:]) // 2
    C = quat_to_matrix(problem.frame.wxyz[middle])
    gained = (C.transpose(0, 2, 1) @ legs.dU[:, :, None])[:, :, 0]
    for stop in range(len(problem.stops)):
        within = np.flatnonzero(problem.same_stop & (problem.stop_of[:-1] == stop))
        force = gained[within].sum(axis=0) / legs.T[within].sum()
        for k in within:
            change = -C[k] @ lower_matrix(N) @ force
            np.testing.assert_allclose(legs.J[k, VEL, ACC_MATRIX] @ N, change * legs.T[k], rtol=1e-9)
            np.testing.assert_allclose(legs.J[k, POS, ACC_MATRIX] @ N, change * legs.T[k] ** 2 / 2.0, rtol=1e-9)


def test_the_drift_of_the_gyro_frame_does_not_change_a_stops_force() -> None:
    """The bias is half a degree a second. The first stop has a knot, but no leg; the second is tested."""
    force, T = np.array((1.0, 2.0, 9.0)), np.ones(100)
    C = quat_to_matrix(quat_exp(np.radians(0.5) * np.arange(100.0)[:, None] * (1.0, 0.0, 0.0)))
    none = np.zeros((0, 0))
    legs = Legs(T, none, C @ force, none, np.ones((100, 9, ERRORS)), none)
    _fix_sway(legs, C, np.ones(100, dtype=np.intp))
    np.testing.assert_allclose(legs.J[:, VEL, ACC_MATRIX] @ N, -C @ lower_matrix(N) @ force, rtol=1e-9)


def test_only_moves_show_the_gyros_scales(problem: Problem) -> None:
    shown = problem.legs.J[:, :, GYR_MATRIX].any(axis=(1, 2))
    np.testing.assert_array_equal(shown, ~problem.same_stop)


@pytest.mark.parametrize("seed", [0, 1])
def test_noise_and_sway_raise_no_scale(seed: int) -> None:
    """Pouring turns the hand about x, which stays level: gravity never shows this axis' scale, of a prior of 1 %."""
    found = not_none(smoothed(simulate("pour", "wt901", seed).recording).solution).state.shared[ACC_MATRIX]
    assert abs(found[0]) < 0.3 * BARE.acc_scale
