"""Roll, pitch and yaw from a device's own attitude. Plain floats: numpy is too slow for one sample at a time."""

from math import asin, atan2, copysign, pi, remainder

from pbd.sensors.decoding import Triple


def wrap_angle(angle: float) -> float:
    """Wrap an angle to -pi..pi, rad."""
    return remainder(angle, 2.0 * pi)


def rpy_from_quaternion(w: float, x: float, y: float, z: float) -> Triple:
    """Convert a quaternion of any length above zero to roll, pitch, yaw in rad, as `pbd.pose.quat_to_rpy` does."""
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    sine = 2.0 * (w * y - z * x) / (ww + xx + yy + zz)
    if abs(sine) > 1.0 - 1e-14:  # gimbal lock: roll and yaw are about the same axis, so yaw is set to zero
        return 2.0 * atan2(x, w), copysign(pi / 2.0, sine), 0.0
    roll = atan2(2.0 * (w * x + y * z), ww - xx - yy + zz)
    return roll, asin(sine), atan2(2.0 * (w * z + x * y), ww + xx - yy - zz)


def from_north_west_up(rpy: Triple) -> Triple:
    """Convert an attitude in north-west-up to east-north-up: yaw grows by a quarter turn. All angles in rad."""
    roll, pitch, yaw = rpy
    return roll, pitch, wrap_angle(yaw + pi / 2.0)


def from_north_east_down(rpy: Triple) -> Triple:
    """Convert an attitude of forward-right-down axes in north-east-down to forward-left-up axes in east-north-up, rad.

    Half a turn of both frames about their x axes flips the signs of pitch and yaw and gives north-west-up.
    """
    roll, pitch, yaw = rpy
    return roll, -pitch, wrap_angle(pi / 2.0 - yaw)
