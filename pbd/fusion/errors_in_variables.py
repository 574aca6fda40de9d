"""Take the noise out of what the matrices of gyro and accelerometer are multiplied with.

Both multiply *measured* rates and forces, whose noise is in the residuals too: each redundant row pushes a scale up by
the same small amount, and such rows grow with the number of takes (errors in variables). At an estimate, what a leg
leaves over is its noise, so that it can be removed.

Source: W. A. Fuller, Measurement error models, Wiley 1987, 1.1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array, quat_to_matrix, skew
from pbd.tracking.smoother.factors import leg_jacobian
from pbd.tracking.smoother.knots import Problem
from pbd.tracking.smoother.preintegration import ACC_MATRIX, GYR_MATRIX, LOWER, POS, ROT, VEL
from pbd.tracking.smoother.state import Fixed, State


def without_noise(problem: Problem, x: State, fixed: Fixed) -> Problem:
    """The same problem, its regressors as at an estimate, where its device's errors are given.

    The noise of a leg counts as constant in the gyro frame, and the hand as turned as in the leg's middle.
    """
    legs, rows = problem.legs, problem.rows
    left = leg_jacobian(problem, x)[:, :, -1]
    of_acc = _of_accelerometer(np.tensordot(fixed.components[:3], legs.parts, axes=1), legs.dU, left)
    C = quat_to_matrix(problem.frame.wxyz[(rows[:-1] + rows[1:]) // 2])
    J, lower, whole = legs.J.copy(), np.transpose(LOWER), np.array(np.divmod(np.arange(9), 3))
    J[:, VEL, ACC_MATRIX] -= _by_matrix(C, of_acc[:, 0], lower)
    J[:, POS, ACC_MATRIX] -= _by_matrix(C, of_acc[:, 1], lower)
    turned = _by_matrix(C, left[:, ROT], whole)
    swung = -skew(legs.dU) @ turned  # while the turn grows in proportion to time
    J[:, ROT, GYR_MATRIX] -= turned
    J[:, VEL, GYR_MATRIX] -= swung / 2.0
    J[:, POS, GYR_MATRIX] -= swung * legs.T[:, None, None] / 6.0
    return replace(problem, legs=replace(legs, J=J))


def _of_accelerometer(cov: Array, force: Array, left: Array) -> Array:
    """What the accelerometer's noise left over of velocity and way, (m, 2, 3); the rest is the gyro's.

    Along the force a small turn changes neither: the covariance (m, 9, 9) of a leg is the accelerometer's alone there.
    """
    along = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), np.finfo(float).tiny)
    own = np.einsum("ki,kaibj,kj->kab", along, cov[:, 3:, 3:].reshape(-1, 2, 3, 2, 3), along)
    weighted = np.linalg.solve(cov, left[:, :, None])[:, 3:, 0].reshape(-1, 2, 3)
    return np.asarray(own @ weighted)


def _by_matrix(C: Array, noise: Array, entries: NDArray[np.intp]) -> Array:
    """By how much noise (m, 3) in the gyro frame changes the columns of some entries (2, e) of a matrix, (m, 3, e)."""
    i, j = entries
    in_sensor = np.einsum("kji,kj->ki", C, noise)
    return np.asarray(C[:, :, i] * in_sensor[:, None, j])
