"""Roll, pitch and yaw from a device's own quaternion, in plain floats: a decoder has microseconds, not arrays."""

from __future__ import annotations

from math import asin, atan2, pi, remainder

from pbd.sensors.decoding import Triple

QUARTER = pi / 2.0
SINGULAR_SINE = 1.0 - 1e-14  # as in pbd.pose.quat_to_rpy, its twin over arrays


def wrapped(angle: float) -> float:
    """The same angle within half a turn of zero, rad."""
    return remainder(angle, 2.0 * pi)


def rpy_from_quaternion(w: float, x: float, y: float, z: float) -> Triple:
    """Roll, pitch, yaw in rad, as `pbd.pose.quat_to_rpy`, of a quaternion of any length but zero."""
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    sine = 2.0 * (w * y - z * x) / (ww + xx + yy + zz)
    if abs(sine) > SINGULAR_SINE:  # roll and yaw turn about one axis there
        return 2.0 * atan2(x, w), QUARTER if sine > 0.0 else -QUARTER, 0.0
    roll = atan2(2.0 * (w * x + y * z), ww - xx - yy + zz)
    return roll, asin(sine), atan2(2.0 * (w * z + x * y), ww + xx - yy - zz)


def from_north_west_up(rpy: Triple) -> Triple:
    """Attitude in north-west-up as attitude in the project's east-north-up: a quarter turn of yaw, rad."""
    roll, pitch, yaw = rpy
    return roll, pitch, wrapped(yaw + QUARTER)


def from_north_east_down(rpy: Triple) -> Triple:
    """Attitude of forward-right-down axes in north-east-down as that of forward-left-up axes in east-north-up, rad.

    Both frames are turned by half a turn about their own x axis, which turns pitch and yaw round; then as above.
    """
    roll, pitch, yaw = rpy
    return roll, -pitch, wrapped(QUARTER - yaw)
