"""Separate gravity from motion."""

from __future__ import annotations

import numpy as np

from pbd.data import Attitude, Recording
from pbd.pose import Array, quat_rotate


def motion_acceleration(recording: Recording, attitude: Attitude, gravity: float) -> Array:
    """Acceleration of the sensor in nav, (n, 3) m/s2: specific force turned into nav, less gravity along z.

    The paper's equations 2-4, with the attitude as a quaternion. `gravity` is the norm that the sensor itself shows at
    rest: its scale error along the vertical then cancels.
    """
    a_nav = quat_rotate(attitude.wxyz_nav_sensor, _turning_taken_out(recording))
    a_nav[:, 2] -= gravity
    return a_nav


def _turning_taken_out(recording: Recording) -> Array:
    """Specific force (n, 3), each sample's mean as it would be in axes that keep the attitude of its middle.

    A sample is the mean over its interval in axes that turn meanwhile (sculling). With rate w and specific force f in
    sensor axes, to second order in the interval dt the mean of the turned f is

        f + dt^2 / 12 (w x f' + w x (w x f) / 2)

    Source: P. Savage, Strapdown inertial navigation integration algorithm design, part 2, JGCD 21 (1998).
    """
    f, w = recording.acc, recording.gyr
    if w is None:
        return f
    dt = 1.0 / recording.rate_hz
    change = np.gradient(f, dt, axis=0)  # per sample: where a sample is lost, the next one is as far as another
    turned: Array = f + dt**2 / 12.0 * (np.cross(w, change) + 0.5 * np.cross(w, np.cross(w, f)))
    return turned
