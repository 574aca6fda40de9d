"""A device without any gyro takes its tilt from the accelerometer alone, and so the hand's acceleration for tilt."""

import numpy as np

from pbd.data import GRAVITY, Recording
from pbd.errors import warn
from pbd.pose import quat_from_rpy
from pbd.tracking.moving_windows import smoothed
from pbd.tracking.repair.gyro_consistency import up_in_sensor

UNSEEN_SHARE = 0.4
"""Largest share of a tilt compass's level acceleration in its vertical one, each a standard deviation. Where the hand
moves in all directions, two axes see 1.4 times what one sees, and in simulated lifts 0.7 times."""


def warn_of_tilt_compass(recording: Recording) -> None:
    """Warn if there is no gyro, and the device's own attitude leaves hardly any level acceleration.

    Its low-pass is undone first, to second order: of the attitude before it, the one that leaves least is taken.
    """
    if recording.gyr is not None or recording.device_rpy is None:
        return
    n = max(2, round(0.05 * recording.rate_hz))
    up = smoothed(up_in_sensor(quat_from_rpy(recording.device_rpy)), n)
    force = smoothed(recording.acc, n) / GRAVITY
    rate = np.gradient(up, axis=0)
    level, *late = (np.cross(up, each) for each in (force, rate, np.gradient(rate, axis=0)))
    by_late = np.column_stack([each.ravel() for each in late])
    left = level - (by_late @ np.linalg.lstsq(by_late, level.ravel())[0]).reshape(-1, 3)
    vertical = np.sum(up * force, axis=1)
    if np.linalg.norm(left.std(axis=0)) < UNSEEN_SHARE * min(vertical.std(), np.linalg.norm(up.std(axis=0))):
        warn(
            "the device's own attitude seems to come from its accelerometer alone: where the hand accelerates, it is "
            "off by degrees, positions by 10 cm and more, and their sigma is too narrow; use a sensor with a gyro"
        )
