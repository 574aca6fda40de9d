"""Bias, scale and misalignment of a gyro: at rest it turns by nothing, and between rests as the vertical does."""

from __future__ import annotations

import numpy as np

from pbd.calibration.rests import Rests
from pbd.data import Linear, Recording
from pbd.errors import CalibrationError
from pbd.pose import Array, quat_cumulative, quat_exp, quat_inverse, quat_rotate

PRIOR = 0.02
"""One sigma of a gyro's scale error (a share) and of how its axes lean against the accelerometer's (rad)."""

SEEN = np.radians(0.1)
"""rad: no rest shows the vertical better than this, and no move turns it more exactly."""

LEAST_TURN = np.radians(20.0)
"""Moves that turn by less tell next to nothing."""

MOST_TRIALS = 60
"""Of its errors; a sound gyro is found with two or three times ten."""

CONTRADICTS = np.radians(10.0)
"""rad, rms; after the fit gyro and gravity agree better than this, or the gyro is in another unit or has other axes."""

FARTHEST = 10.0
"""Prior sigmas; no gyro is so bad."""

BIAS_FLOOR = np.radians(0.003)
"""rad/s: a bias wanders."""


def fit_gyro(recording: Recording, rests: Rests, up_sensor: Array | None = None, up_sigma: float = 0.0) -> Linear:
    """The bias from the rests and, where the vertical is known there, scale and axes from the moves between them.

    With u the vertical in sensor axes at two rests and R the turn between them by the gyro, u_2 = R^-1 u_1. What is
    missing is laid to a matrix (nine unknowns, each held by a prior). The turn of the gyro's axes as a whole is against
    those of the accelerometer.

    Source: D. Tedaldi, A. Pretto and E. Menegatti, A robust and easy to implement method for IMU calibration without
    external equipments, ICRA 2014.

    Args:
        recording: without NaN.
        rests: of the recording.
        up_sensor: (k, 3) unit, by a calibrated accelerometer; None: the bias alone.
        up_sigma: rad, how well that shows the vertical.

    Raises:
        CalibrationError: there is no gyro.
    """
    if recording.gyr is None or rests.gyr is None:
        raise CalibrationError("the recording has no gyro; record one, or leave it out with --only acc")
    bias = np.average(rests.gyr, axis=0, weights=rests.seconds)
    noise = rests.gyr_noise / np.sqrt(rests.samples.sum())
    sigma = np.full(3, np.hypot(noise, BIAS_FLOOR))
    matrix = np.eye(3)
    if up_sensor is not None and len(rests) > 1:
        matrix = _matrix(recording, rests, up_sensor, float(np.hypot(SEEN, up_sigma)), bias)
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

    def left(x: Array) -> Array:
        matrix = np.eye(3) + PRIOR * x.reshape(3, 3)
        off = []
        for k, turns in legs:
            whole = quat_cumulative(quat_exp(turns @ matrix.T))[-1]
            off.append(quat_rotate(quat_inverse(whole), up_sensor[k]) - up_sensor[k + 1])
        return np.concatenate((np.ravel(off) / seen, x))

    result = least_squares(left, np.zeros(9), method="lm", max_nfev=MOST_TRIALS)
    off = float(np.sqrt(np.mean((seen * left(result.x)[:-9]) ** 2) * 3.0))
    if off > CONTRADICTS or np.abs(result.x).max() > FARTHEST:
        raise CalibrationError(
            f"between the rests the gyro does not turn as gravity does (by {np.degrees(off):.0f} degrees, rms); is its "
            "unit rad/s, and are its axes the accelerometer's? import the recording with --unit gyr=deg/s, or name its "
            "columns",
            value=off,
            bound=CONTRADICTS,
        )
    return np.asarray(np.eye(3) + PRIOR * result.x.reshape(3, 3))
