"""The tool's covariance in base, against poses that are drawn."""

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


def shaken(pose: Pose, by: Array) -> Pose:
    """Position, and the rotation in the outer frame."""
    return Pose(pose.p + by[:3], quat_multiply(quat_exp(by[3:]), pose.wxyz))


@pytest.mark.parametrize("part", ["start", "mount", "tracking"])
def test_each_part_is_what_drawing_it_shows(part: str) -> None:
    cov = covariance(len(part))
    scale = 1.5
    rng = np.random.default_rng(0)

    def tool(by: Array) -> Pose:
        zero = np.zeros(6)
        calibration = Calibration(
            "c",
            T_base_nav=T_BASE_NAV,
            T_sensor_tool=shaken(T_SENSOR_TOOL, by if part == "mount" else zero),
            scale=scale,
        )
        keyframe = Keyframe(0.0, 1.0, shaken(KEYFRAME, by if part == "tracking" else zero), np.eye(6))
        T_base_nav = shaken(T_BASE_NAV, by if part == "start" else zero)
        return tool_poses(KeyframesInBase([keyframe], T_base_nav, calibration))[0]

    exact = tool(np.zeros(6))
    drawn = []
    for by in rng.multivariate_normal(np.zeros(6), cov, 2000):
        pose = tool(by)
        turn = quat_log(quat_multiply(pose.wxyz, quat_inverse(exact.wxyz)))
        drawn.append(np.concatenate((pose.p - exact.p, turn)))
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
    expected = np.cov(np.array(drawn).T)
    sigma = np.sqrt(np.diagonal(expected))
    assert_allclose(parts[part][0] / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=0.12)


def test_a_dock_that_says_nothing_is_assumed() -> None:
    calibration = Calibration("c", T_base_dock=Pose.identity())
    keyframe = Keyframe(0.0, 1.0, Pose.identity(), np.zeros((6, 6)))
    parts = tool_covariances(KeyframesInBase([keyframe], Pose.identity(), calibration))
    assert_allclose(np.sqrt(np.diagonal(parts["start"][0])[:3]), DOCK_SIGMA_M)
