"""The noise of a leg is removed from the rates and forces that the sensor's matrices multiply."""

from dataclasses import replace

import numpy as np
import pytest

from pbd.fusion.marginals import marginal_of, without_noise
from pbd.pose import Array, quat_to_matrix
from pbd.simulation.simulate import simulate
from pbd.track_alone import track_alone
from pbd.tracking.noise import densities
from pbd.tracking.smoother.preintegration import ACC_MATRIX, GYR_MATRIX, POS, ROT, VEL, gyro_frame, preintegrate

OFFSET = 0.1
"""Error of one leg: rad/s along x; m/s2 upward, where a small rotation of gravity can't be mistaken for it."""


@pytest.mark.parametrize(
    ("sensor", "rows", "columns"), [("acc", VEL, ACC_MATRIX), ("acc", POS, ACC_MATRIX), ("gyr", ROT, GYR_MATRIX)]
)
def test_an_error_of_one_leg_is_not_in_its_regressors(sensor: str, rows: slice, columns: slice) -> None:
    found = track_alone(simulate("pour", "modern", 1), "default", None, False)[1].solution
    assert found is not None
    problem, x = found.problem, found.state
    frame, T, interval = problem.frame, problem.legs.T, 1.0 / 100.0
    k = int(np.flatnonzero(~problem.same_stop)[3])
    inside = slice(problem.rows[k] + 1, problem.rows[k + 1])
    wrong: dict[str, Array] = {"gyr": frame.gyr.copy(), "acc": frame.acc.copy()}
    up = np.array((0.0, 0.0, OFFSET))
    back = quat_to_matrix(frame.wxyz[inside]).transpose(0, 2, 1) @ x.E[k].T @ up
    wrong[sensor][inside] += back if sensor == "acc" else (OFFSET, 0.0, 0.0)
    seen = gyro_frame(frame.t, wrong["gyr"], wrong["acc"], interval)
    density = densities(problem.noise, frame.gyr, frame.u, interval)
    C = quat_to_matrix(seen.wxyz[problem.rows])
    legs = preintegrate(seen, problem.rows, density)
    moved = replace(x, E=x.E @ problem.C @ C.transpose(0, 2, 1))
    J = without_noise(replace(problem, frame=seen, legs=legs, C=C), moved, found.fixed).legs.J[k, rows, columns]
    right = problem.legs.J[k, rows, columns]
    error = OFFSET * float(T[k]) * (0.5 * float(T[k]) if rows == POS else 1.0)
    assert np.abs(legs.J[k, rows, columns] - right).max() > 0.7 * error
    np.testing.assert_allclose(J, right, atol=0.15 * error)


@pytest.mark.parametrize("seed", [0, 1])
def test_noise_does_not_raise_the_scales_that_a_take_tells(seed: int) -> None:
    """Those of a gyro with much noise, about the axes about which the hand turns it."""
    solution = track_alone(simulate("pour", "os5000", seed), "default", None, False)[1].solution
    assert solution is not None
    yy, zz = np.arange(GYR_MATRIX.start, GYR_MATRIX.stop)[[4, 8]]
    raised, found = marginal_of(solution, [0]).device, marginal_of(solution, [0], solution.state).device
    assert raised[yy] > found[yy] + 1e-5
    assert raised[zz] > found[zz] + 1e-5
