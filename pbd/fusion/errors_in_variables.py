"""Remove sensor noise from the rates and forces that the matrices of gyro and accelerometer multiply.

Both matrices multiply *measured* rates and forces, and the same noise is in the residuals. So each redundant row biases
the estimated scales upward by the same small amount, and more takes have more such rows (errors in variables). At an
estimate, the residual of a leg is its noise, which can be subtracted.

Source: W. A. Fuller, Measurement error models, Wiley 1987, 1.1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pbd.pose import Array, quat_to_matrix, skew
from pbd.tracking.moving_windows import Rows
from pbd.tracking.smoother.factors import leg_jacobian
from pbd.tracking.smoother.knots import Problem
from pbd.tracking.smoother.preintegration import ACC_MATRIX, GYR_MATRIX, LOWER, POS, ROT, VEL
from pbd.tracking.smoother.state import Fixed, State


def without_noise(problem: Problem, x: State, fixed: Fixed) -> Problem:
    """Return the problem with noise-free regressors of the matrices, at an estimate with given sensor errors.

    The noise of a leg counts as constant in the gyro frame, and the hand's attitude as that in the middle of the leg.
    """
    legs, rows = problem.legs, problem.rows
    residual = leg_jacobian(problem, x)[:, :, -1]
    acc_noise = _accelerometer_part(np.tensordot(fixed.components[:3], legs.parts, axes=1), legs.dU, residual)
    C = quat_to_matrix(problem.frame.wxyz[(rows[:-1] + rows[1:]) // 2])
    J, full = legs.J.copy(), np.divmod(np.arange(9), 3)
    J[:, VEL, ACC_MATRIX] -= _matrix_columns(C, acc_noise[:, 0], LOWER)
    J[:, POS, ACC_MATRIX] -= _matrix_columns(C, acc_noise[:, 1], LOWER)
    rotation = _matrix_columns(C, residual[:, ROT], full)
    velocity = -skew(legs.dU) @ rotation  # the rotation error grows linearly during the leg
    J[:, ROT, GYR_MATRIX] -= rotation
    J[:, VEL, GYR_MATRIX] -= velocity / 2.0
    J[:, POS, GYR_MATRIX] -= velocity * legs.T[:, None, None] / 6.0
    return replace(problem, legs=replace(legs, J=J))


def _accelerometer_part(cov: Array, force: Array, residual: Array) -> Array:
    """Return the accelerometer's share of the residuals of velocity and position, (m, 2, 3); the rest is the gyro's.

    A small rotation changes neither of them along the force. So along the force the covariance (m, 9, 9) of a leg is
    the accelerometer's alone.
    """
    along = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), np.finfo(float).tiny)
    acc_cov = np.einsum("ki,kaibj,kj->kab", along, cov[:, 3:, 3:].reshape(-1, 2, 3, 2, 3), along)
    weighted = np.linalg.solve(cov, residual[:, :, None])[:, 3:, 0].reshape(-1, 2, 3)
    return np.asarray(acc_cov @ weighted)


def _matrix_columns(C: Array, noise: Array, entries: tuple[Rows, Rows]) -> Array:
    """Return how noise (m, 3) in the gyro frame changes the Jacobian's columns of e entries of a matrix: (m, 3, e).

    Args:
        C: (m, 3, 3), gyro frame <- sensor.
    """
    i, j = entries
    in_sensor = np.einsum("kji,kj->ki", C, noise)
    return np.asarray(C[:, :, i] * in_sensor[:, None, j])
