"""The columns of imu.csv (in SI units; importers convert), and the conversion of its compass angles."""

import numpy as np

from pbd.pose import Array

GYR, ACC, MAG = ("gx", "gy", "gz"), ("ax", "ay", "az"), ("mx", "my", "mz")
ATTITUDE = ("heading", "pitch", "roll")
"""Columns of the gyro, the accelerometer, the magnetometer, and of the device's own attitude."""

IMU_COLUMNS = {"gyr": (GYR, 7), "acc": (ACC, 6), "mag": (MAG, 4), "device_rpy": (ATTITUDE, 6)}
"""Channel of a recording -> its columns and their number of decimals, in the file's order."""


def rpy_from_compass(angles: Array) -> Array:
    """Convert a compass' heading, pitch, roll (n, 3) to roll, pitch, yaw (n, 3) about x, y, z of ENU, rad.

    A compass counts heading clockwise from north and pitch nose up; yaw counts counterclockwise from east.
    """
    heading, pitch, roll = angles.T
    return np.column_stack((roll, -pitch, 0.5 * np.pi - heading))


def compass_from_rpy(rpy: Array) -> Array:
    """Convert roll, pitch, yaw (n, 3) to heading in 0..2 pi, pitch, roll, rad: the inverse of `rpy_from_compass`."""
    roll, pitch, yaw = rpy.T
    return np.column_stack((np.mod(0.5 * np.pi - yaw, 2.0 * np.pi), -pitch, roll))
