"""Separate gravity from motion."""

from __future__ import annotations

from pbd.data import Attitude, Recording
from pbd.pose import Array, quat_rotate


def motion_acceleration(recording: Recording, attitude: Attitude, gravity: float) -> Array:
    """Acceleration of the sensor in nav, (n, 3) m/s2: specific force turned into nav, less gravity along z.

    The paper's equations 2-4, with the attitude as a quaternion. `gravity` is the norm that the sensor itself shows at
    rest: its scale error along the vertical then cancels.
    """
    a_nav = quat_rotate(attitude.wxyz_nav_sensor, recording.acc)
    a_nav[:, 2] -= gravity
    return a_nav
