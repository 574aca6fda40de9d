"""The tool's covariance in base, against finite differences of its pose."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.calibration.tool_poses import KeyframesInBase, tool_poses
from pbd.calibration.uncertainty import tool_covariances
from pbd.data import Calibration, Keyframe
from pbd.data.calibration import DOCK_SIGMA_M
from pbd.pose import Array, Pose, quat_exp, quat_inverse, quat_log, quat_multiply

T_BASE_NAV = Pose(np.array([0.4, -0.1, 0.2]), quat_exp((0.0, 0.0, 0.7)))
T_SENSOR_TOOL = Pose(np.array([0.02, -0.01, 0.15]), quat_exp((3.0, 0.2, 0.1)))
KEYFRAME = Pose(np.array([0.2, 0.1, -0.1]), quat_exp((0.3, -0.5, 0.9)))


def covariance(seed: int) -> Array:
    root = 0.004 * np.random.default_rng(seed).normal(size=(6, 6))
    return np.asarray(root @ root.T)


def moved(pose: Pose, step: Array) -> Pose:
    """Shift the position, and rotate in the outer frame."""
    return Pose(pose.p + step[:3], quat_multiply(quat_exp(step[3:]), pose.wxyz))


@pytest.mark.parametrize("part", ["start", "mount", "tracking"])
def test_each_part_agrees_with_finite_differences(part: str) -> None:
    cov, scale = covariance(len(part)), 1.5

    def tool(step: Array) -> Pose:
        start, mount, tracking = (step if name == part else np.zeros(6) for name in ("start", "mount", "tracking"))
        T_base_nav, T_sensor_tool = moved(T_BASE_NAV, start), moved(T_SENSOR_TOOL, mount)
        calibration = Calibration("c", T_base_nav=T_BASE_NAV, T_sensor_tool=T_sensor_tool, scale=scale)
        keyframe = Keyframe(0.0, 1.0, moved(KEYFRAME, tracking), np.eye(6))
        return tool_poses(KeyframesInBase([keyframe], T_base_nav, calibration))[0]

    columns = []
    for step in 1e-5 * np.eye(6):
        ahead, behind = tool(step), tool(-step)
        turn = quat_log(quat_multiply(ahead.wxyz, quat_inverse(behind.wxyz)))
        columns.append(np.concatenate((ahead.p - behind.p, turn)) / 2e-5)
    J = np.column_stack(columns)
    calibration = Calibration(
        "c",
        T_base_nav=T_BASE_NAV,
        cov_base=cov if part == "start" else np.zeros((6, 6)),
        T_sensor_tool=T_SENSOR_TOOL,
        cov_sensor_tool=cov if part == "mount" else None,
        scale=scale,
    )
    keyframe = Keyframe(0.0, 1.0, KEYFRAME, cov if part == "tracking" else np.zeros((6, 6)))
    parts = tool_covariances(KeyframesInBase([keyframe], T_BASE_NAV, calibration))
    for name, found in parts.items():
        if name != part:
            assert_allclose(found, 0.0)
    assert_allclose(parts[part][0], J @ cov @ J.T, rtol=0.0, atol=1e-9 * np.trace(cov))


def test_a_dock_without_a_covariance_has_the_default_sigma() -> None:
    calibration = Calibration("c", T_base_dock=Pose.identity())
    keyframe = Keyframe(0.0, 1.0, Pose.identity(), np.zeros((6, 6)))
    parts = tool_covariances(KeyframesInBase([keyframe], Pose.identity(), calibration))
    assert_allclose(np.sqrt(np.diagonal(parts["start"][0])[:3]), DOCK_SIGMA_M)
