"""Covariance of the tool's pose in base at each keyframe, by its sources."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pbd.calibration.tool_poses import KeyframesInBase
from pbd.data import Calibration
from pbd.pose import Array, quat_rotate, quat_to_matrix, skew

PARTS = {"start": "where the hand starts", "mount": "the mount", "tracking": "tracking"}
"""Sources of the tool's uncertainty, and their names for the user."""


def tool_covariances(placed: KeyframesInBase) -> dict[str, Array]:
    """Return the covariance (k, 6, 6) of the tool's position and rotation vector in base, m and rad, for each of PARTS.

    The sum of the parts is the total. From p_base_tool = t + R (s p + R_k l), with t and R nav in base, p and R_k the
    sensor in nav, l the tool in sensor axes: the uncertainty of each of them, propagated to first order. A mount that
    was never calibrated counts as exact.
    """
    J, calibration = _jacobians(placed), placed.calibration
    cov = {
        "start": calibration.cov_start,
        "mount": _mount_covariance(calibration),
        "tracking": np.array([keyframe.cov for keyframe in placed.keyframes]),
    }
    return {part: np.asarray(J[part] @ cov[part] @ J[part].transpose(0, 2, 1)) for part in PARTS}


def joint_tool_covariance(cov_nav_sensor: Array, placed: KeyframesInBase) -> Array:
    """Return the joint covariance (6k, 6k) of all tool poses. Errors of dock and mount are the same at all keyframes.

    Args:
        cov_nav_sensor: (6k, 6k), covariance of the keyframes in nav.
    """
    J, calibration = _jacobians(placed), placed.calibration
    start, mount = J["start"].reshape(-1, 6), J["mount"].reshape(-1, 6)
    k = len(placed.keyframes)
    tracked = np.einsum("iab,ibjc,jdc->iajd", J["tracking"], cov_nav_sensor.reshape(k, 6, k, 6), J["tracking"])
    joint: Array = start @ calibration.cov_start @ start.T + mount @ _mount_covariance(calibration) @ mount.T
    joint += tracked.reshape(6 * k, 6 * k)
    return joint


def _mount_covariance(calibration: Calibration) -> Array:
    cov = calibration.cov_sensor_tool
    return np.zeros((6, 6)) if cov is None else cov


def _jacobians(placed: KeyframesInBase) -> dict[str, Array]:
    """Return the Jacobian (k, 6, 6) of the tool's pose at each keyframe with respect to the pose of each part."""
    calibration, R = placed.calibration, quat_to_matrix(placed.T_base_nav.wxyz)
    scale = placed.scale * calibration.scale
    J = {part: np.zeros((len(placed.keyframes), 6, 6)) for part in PARTS}
    for k, keyframe in enumerate(placed.keyframes):
        lever = quat_rotate(keyframe.T_nav_sensor.wxyz, calibration.T_sensor_tool.p)
        from_nav = R @ (scale * keyframe.T_nav_sensor.p + lever)
        J["start"][k] = np.block([[np.eye(3), -skew(from_nav)], [np.zeros((3, 3)), np.eye(3)]])
        J["tracking"][k] = np.block([[scale * R, -R @ skew(lever)], [np.zeros((3, 3)), R]])
        J["mount"][k] = np.kron(np.eye(2), R @ quat_to_matrix(keyframe.T_nav_sensor.wxyz))
    return J


def base_sigmas(parts: Mapping[str, Array]) -> list[dict[str, Any]]:
    """Return each keyframe's sigmas for `--json`: base_sigma_m and base_sigma_deg (3), base_sigma_parts_m (3 each).

    A part without a covariance is None: a mount that was never calibrated, a keyframe that a person typed.
    """
    total = np.sqrt(np.diagonal(np.sum(list(parts.values()), axis=0), axis1=1, axis2=2))
    of_parts = {part: np.sqrt(np.diagonal(cov, axis1=1, axis2=2))[:, :3] for part, cov in parts.items()}
    return [
        {
            "base_sigma_m": sigma[:3].tolist(),
            "base_sigma_deg": np.degrees(sigma[3:]).tolist(),
            "base_sigma_parts_m": {
                part: of_part[k].tolist() if parts[part][k].any() else None for part, of_part in of_parts.items()
            },
        }
        for k, sigma in enumerate(total)
    ]
