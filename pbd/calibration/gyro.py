"""Bias, scale and misalignment of a gyro: at rest it reads zero, and between rests it turns as the vertical does."""

from __future__ import annotations

import numpy as np

from pbd.calibration.rests import Rests
from pbd.data import Linear, Recording
from pbd.errors import CalibrationError
from pbd.pose import Array, quat_cumulative, quat_exp, quat_to_matrix, skew

PRIOR_SIGMA = 0.02
"""Prior sigma of the gyro's scale errors (a share) and of its axes' misalignment with the accelerometer's (rad)."""

VERTICAL_SIGMA = np.radians(0.1)
"""rad: least sigma of the vertical at a rest, and of how a move turns it."""

LEAST_TURN = np.radians(20.0)
"""rad: smallest turn of a move that is used."""

MAX_EVALUATIONS = 60
"""Limit of the fit's evaluations. A sound gyro needs four or five."""

LARGEST_MISFIT = np.radians(10.0)
"""rad rms: largest disagreement of gyro and gravity after the fit. Above it the gyro has another unit or other axes."""

LARGEST_ERROR = 10.0
"""Bound of the fit, in prior sigmas."""

BIAS_SIGMA = np.radians(0.003)
"""rad/s: least sigma of the bias, as it wanders."""


def fit_gyro(recording: Recording, rests: Rests, up_sensor: Array | None = None, up_sigma: float = 0.0) -> Linear:
    """The bias from the rests and, where the vertical is known there, scale and axes from the moves between them.

    With u the vertical in sensor axes at two rests and R the turn between them by the gyro, u_2 = R^-1 u_1. What is
    missing is laid to a matrix (nine unknowns, each held by a prior). The turn of the gyro's axes as a whole is against
    those of the accelerometer.

    Source: D. Tedaldi, A. Pretto and E. Menegatti, A robust and easy to implement method for IMU calibration without
    external equipments, ICRA 2014.

    Args:
        recording: without NaN.
        up_sensor: (k, 3) unit, by a calibrated accelerometer; None: the bias alone.
        up_sigma: rad, how well that shows the vertical.

    Raises:
        CalibrationError: there is no gyro.
    """
    if recording.gyr is None or rests.gyr is None:
        raise CalibrationError("the recording has no gyro; record one, or leave it out with --only acc")
    bias = np.average(rests.gyr, axis=0, weights=rests.seconds)
    noise = rests.gyr_noise / np.sqrt(rests.samples.sum())
    sigma = np.full(3, np.hypot(noise, BIAS_SIGMA))
    matrix = np.eye(3)
    if up_sensor is not None and len(rests) > 1:
        matrix = _matrix(recording, rests, up_sensor, float(np.hypot(VERTICAL_SIGMA, up_sigma)), bias)
    return Linear(bias, matrix, sigma)


def _matrix(recording: Recording, rests: Rests, up_sensor: Array, seen: float, bias: Array) -> Array:
    from scipy.optimize import least_squares

    assert recording.gyr is not None
    legs = []
    for k in range(len(rests) - 1):
        rows = slice(int(rests.stop[k]) - 1, int(rests.start[k + 1]) + 1)
        turns = (recording.gyr[rows] - bias) * np.diff(recording.t[rows], append=recording.t[rows.stop - 1])[:, None]
        tilted = np.arccos(np.clip(up_sensor[k] @ up_sensor[k + 1], -1.0, 1.0))
        if max(np.linalg.norm(turns, axis=1).sum(), tilted) > LEAST_TURN:
            legs.append((k, turns))
    if not legs:
        return np.eye(3)

    def look(x: Array) -> tuple[Array, Array]:
        """The residual and its derivative, taken in the middle of each sample's turn."""
        matrix = np.eye(3) + PRIOR_SIGMA * x.reshape(3, 3)
        off, changes = [], []
        for k, turns in legs:
            R = np.vstack((np.eye(3)[None], quat_to_matrix(quat_cumulative(quat_exp(turns @ matrix.T)))))
            up = up_sensor[k] @ R[-1]
            off.append(up - up_sensor[k + 1])
            changes.append(skew(up) @ R[-1].T @ np.einsum("nij,nk->ijk", 0.5 * (R[:-1] + R[1:]), turns).reshape(3, 9))
        residual = np.concatenate((np.ravel(off) / seen, x))
        return residual, np.vstack((PRIOR_SIGMA / seen * np.vstack(changes), np.eye(9)))

    def left(x: Array) -> Array:
        return look(x)[0]

    def change(x: Array) -> Array:
        return look(x)[1]

    result = least_squares(left, np.zeros(9), change, method="lm", max_nfev=MAX_EVALUATIONS)
    off = float(np.sqrt(np.mean((seen * result.fun[:-9]) ** 2) * 3.0))
    if off > LARGEST_MISFIT or np.abs(result.x).max() > LARGEST_ERROR:
        raise CalibrationError(
            f"between the rests the gyro does not turn as gravity does (by {np.degrees(off):.0f} degrees, rms); is its "
            "unit rad/s, and are its axes the accelerometer's? import the recording with --unit gyr=deg/s, or name its "
            "columns",
            value=off,
            bound=LARGEST_MISFIT,
        )
    return np.asarray(np.eye(3) + PRIOR_SIGMA * result.x.reshape(3, 3))
