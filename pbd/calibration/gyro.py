"""Estimate a gyro's bias, scale and misalignment: at rest it reads zero, in a move it turns as the vertical does."""

import numpy as np

from pbd.calibration.rests import Rests
from pbd.data import LinearErrors, Recording
from pbd.errors import CalibrationError, in_degrees
from pbd.pose import Array, quat_cumulative, quat_exp, quat_inverse, quat_rotate

PRIOR_SIGMA = 0.02
"""Prior sigma of the gyro's scale errors (a share) and of its axes' misalignment with the accelerometer's (rad)."""

LEAST_TURN = np.radians(20.0)
"""Smallest rotation, rad, of a move that is used: the axis of a smaller one is not meaningful."""

LARGEST_MISFIT = np.radians(10.0)
"""Largest disagreement, rad rms, of gyro and gravity after the fit. A larger one shows a wrong unit or wrong axes, and
so does an error of more than ten prior sigmas."""


def fit_gyro(recording: Recording, rests: Rests, up_sensor: Array | None = None, up_sigma: float = 0.0) -> LinearErrors:
    """Estimate the bias from the rests and, if the vertical is known there, scale and axes from the moves between them.

    With u_1, u_2 the vertical in sensor axes at two rests and R the rotation between them by the gyro, u_2 = R^-1 u_1.
    A matrix (nine unknowns, each with a prior) corrects the gyro so that this holds. The matrix includes the rotation
    of the gyro's axes relative to the accelerometer's.

    Source: D. Tedaldi, A. Pretto and E. Menegatti, A robust and easy to implement method for IMU calibration without
    external equipments, ICRA 2014.

    Args:
        recording: without NaN.
        rests: k rests of this recording.
        up_sensor: (k, 3) unit vertical at the rests, by a calibrated accelerometer; None: estimate the bias alone.
        up_sigma: rad, one sigma of the vertical's direction.

    Raises:
        CalibrationError: there is no gyro, or it contradicts the accelerometer.
    """
    if recording.gyr is None or rests.gyr is None:
        raise CalibrationError("the recording has no gyro; record one, or leave it out with --only acc")
    bias = np.average(rests.gyr, axis=0, weights=rests.samples)
    noise = rests.gyr_noise / np.sqrt(rests.samples.sum())
    in_rest = np.radians(0.003)  # rad/s; the bias wanders in a rest, and from rest to rest
    sigma = np.sqrt(noise**2 + in_rest**2 + rests.gyr.var(axis=0))
    matrix, matrix_sigma = np.eye(3), np.nan
    if up_sensor is not None and len(rests) > 1:
        after_move = float(np.hypot(np.radians(0.1), up_sigma))  # gyro and accelerometer are no better together
        matrix, matrix_sigma = _matrix(recording, rests, up_sensor, after_move, bias)
    return LinearErrors(bias, matrix, sigma, matrix_sigma)


def _matrix(recording: Recording, rests: Rests, up_sensor: Array, sigma: float, bias: Array) -> tuple[Array, float]:
    """Fit the gyro's matrix to the moves between rests, and give its largest sigma.

    `sigma`, rad, is of each residual of the vertical.
    """
    from scipy.optimize import least_squares

    assert recording.gyr is not None
    moves = []
    for k in range(len(rests) - 1):
        rows = slice(int(rests.stop[k]) - 1, int(rests.start[k + 1]) + 1)
        turns = (recording.gyr[rows] - bias) * np.diff(recording.t[rows], append=recording.t[rows.stop - 1])[:, None]
        tilted = np.arccos(np.clip(up_sensor[k] @ up_sensor[k + 1], -1.0, 1.0))
        if max(np.linalg.norm(turns, axis=1).sum(), tilted) > LEAST_TURN:
            moves.append((k, turns))
    if not moves:
        return np.eye(3), np.nan

    def residuals(x: Array) -> Array:
        matrix = np.eye(3) + PRIOR_SIGMA * x.reshape(3, 3)
        ends = ((k, quat_cumulative(quat_exp(turns @ matrix.T))[-1]) for k, turns in moves)
        off = [quat_rotate(quat_inverse(wxyz), up_sensor[k]) - up_sensor[k + 1] for k, wxyz in ends]
        return np.concatenate((np.ravel(off) / sigma, x))

    result = least_squares(residuals, np.zeros(9), max_nfev=60)  # a sound gyro needs four or five
    off = float(np.sqrt(np.mean((sigma * result.fun[:-9]) ** 2) * 3.0))
    if off > LARGEST_MISFIT or np.abs(result.x).max() > 10.0:  # prior sigmas
        raise CalibrationError(
            f"between the rests the gyro does not turn as gravity does (by {in_degrees(off)}, rms); is its "
            "unit rad/s, and are its axes the accelerometer's? import the recording with --unit gyr=deg/s, or name its "
            "columns",
            value=off,
            bound=LARGEST_MISFIT,
        )
    J = np.asarray(result.jac)
    largest = PRIOR_SIGMA * float(np.sqrt(np.diagonal(np.linalg.inv(J.T @ J)).max()))
    return np.asarray(np.eye(3) + PRIOR_SIGMA * result.x.reshape(3, 3)), largest
