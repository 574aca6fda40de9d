"""The columns of imu.csv (in SI units; importers convert), and the conversion of its compass angles."""

from __future__ import annotations

import numpy as np

from pbd.pose import Array

GYR, ACC, MAG = ("gx", "gy", "gz"), ("ax", "ay", "az"), ("mx", "my", "mz")
DEVICE = ("heading", "pitch", "roll")

CHANNELS = {"gyr": (GYR, 7), "acc": (ACC, 6), "mag": (MAG, 4), "device": (DEVICE, 6)}
"""Channel -> its columns and decimals, in their order in the file."""


def device_rpy(angles: Array) -> Array:
    """Roll, pitch, yaw about x, y, z of ENU from a compass' heading, pitch, roll: (n, 3) -> (n, 3) rad.

    A compass counts its heading clockwise from north and its pitch nose up; yaw counts from east, the other way round.
    """
    heading, pitch, roll = angles.T
    return np.column_stack((roll, -pitch, 0.5 * np.pi - heading))


def compass_angles(rpy: Array) -> Array:
    """Heading in 0..2 pi, pitch, roll: the inverse of `device_rpy`."""
    roll, pitch, yaw = rpy.T
    return np.column_stack((np.mod(0.5 * np.pi - yaw, 2.0 * np.pi), -pitch, roll))
