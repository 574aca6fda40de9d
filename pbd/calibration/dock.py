"""A dock where an earlier demonstration stopped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pbd.calibration.frames import nav_in_base, tool_poses
from pbd.calibration.uncertainty import tool_covariances
from pbd.data import Calibration, Keyframe
from pbd.pose import Array, Pose


def dock_at(keyframes: Sequence[Keyframe], index: int, calibration: Calibration) -> tuple[Pose, Array]:
    """T_base_sensor at a keyframe, and the covariance (6, 6) of its position and heading: a dock has no other.

    Args:
        keyframes: of a demonstration; the first is where it started.
        index: which one.
        calibration: says where the demonstration started.
    """
    T_base_nav = nav_in_base(calibration, keyframes[0].T_nav_sensor.wxyz)
    bare = replace(calibration, T_sensor_tool=Pose.identity(), cov_sensor_tool=None)
    stopped = [keyframes[index]]
    cov = sum(tool_covariances(stopped, T_base_nav, bare).values(), np.zeros((1, 6, 6)))[0]
    cov[3:5] = cov[:, 3:5] = 0.0
    return tool_poses(stopped, T_base_nav, bare)[0], cov
