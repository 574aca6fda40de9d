"""Covariance of the tool's pose in base at each keyframe, by its sources."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pbd.calibration.tool_poses import KeyframesInBase, tool_poses
from pbd.data.calibration import TOOL_DOWN
from pbd.data.covariance import errors_at
from pbd.pose import Array, quat_inverse, quat_multiply, quat_rotate, quat_to_matrix, skew

SOURCES = {"start": "where the hand starts", "mount": "the mount", "tracking": "tracking"}
"""Sources of the tool's uncertainty, and their names for the user."""


def _joint_errors(placed: KeyframesInBase) -> tuple[Array, Array]:
    """Return the covariance (6k + 18, 6k + 18) of the errors of k keyframes in nav, of the start in base, of the
    tool on the sensor and of the scale, without those of the calibration; and their derivatives (6k + 18, 10) by the
    calibration's errors (`CalibrationUpdate`).

    A keyframe has the path's error e at its time, which it has in common with the others. If a person gave it a larger
    sigma, an independent error adds to e. If the sigma is smaller, the person measured the keyframe: as after a Kalman
    filter's update, its error is a share of e, and an independent one. A keyframe without a covariance is exact.
    """
    path, keyframes, update = placed.path, placed.keyframes, placed.update
    k = len(keyframes)
    cov, by_calibration = np.zeros((k + 3, 6, k + 3, 6)), np.zeros((k + 3, 6, 10))
    cov[range(k), :, range(k)] = [keyframe.cov for keyframe in keyframes]
    by_calibration[k, :, :6], by_calibration[k + 1, :3, 6:9], by_calibration[k + 2, 0, 9] = np.eye(6), np.eye(3), 1.0
    if path is not None:
        rows = [i for i, keyframe in enumerate(keyframes) if keyframe.cov.any()]
        at = path.stop_numbers([keyframes[i].t for i in rows])
        of_path = path.covariance.joint_at(at)
        own, of_each = np.diagonal(cov[rows, :, rows], axis1=1, axis2=2), np.diagonal(of_path).reshape(-1, 6)
        share = np.minimum(1.0, np.divide(own, of_each, out=np.ones_like(own), where=of_each > 0.0))
        rest = own - share**2 * of_each
        if update is not None:
            rows, at = [*rows, k, k + 1, k + 2], np.append(at, len(path.stops) + np.arange(3.0))
            share, rest = np.vstack((share, np.ones((3, 6)))), np.vstack((rest, np.zeros((3, 6))))
            of_path = update.covariance.joint_at(at)
            by_calibration[rows] = share[:, :, None] * errors_at(at, update.by_calibration)
        joint = np.outer(share, share) * of_path + np.diag(rest.ravel())
        cov[np.ix_(rows, range(6), rows, range(6))] = joint.reshape(len(at), 6, len(at), 6)
    return cov.reshape(6 * k + 18, -1), by_calibration.reshape(-1, 10)


def tool_covariances(placed: KeyframesInBase) -> dict[str, Array]:
    """Return the covariance (k, 6, 6) of the tool's position and rotation vector in base, m and rad, by its SOURCES.

    The sum of the parts is the total. From p_base_tool = t + R (s p + R_k l), with t and R nav in base, p and R_k the
    sensor in nav, l the tool in sensor axes: the uncertainty of each of them, propagated to first order. With a fixed
    orientation R_k is that of keyframe 0. A mount that was never calibrated counts as exact.
    """
    if placed.orientation == "demo" and placed.update is None:
        # Errors in common don't matter: each keyframe's own, as keyframes.toml has it.
        placed = replace(placed, path=None)
    return {part: diagonal_blocks(cov) for part, cov in joint_tool_covariances(placed).items()}


def diagonal_blocks(joint: Array) -> Array:
    """Return the covariance (k, 6, 6) of each pose, from the joint one (6k, 6k)."""
    k = len(joint) // 6
    return joint.reshape(k, 6, k, 6)[range(k), :, range(k)]


def joint_tool_covariances(placed: KeyframesInBase, of_sensor: bool = False) -> dict[str, Array]:
    """Return the joint covariance (6k, 6k) of all tool poses, for each of SOURCES.

    `of_sensor`: the sensor itself is meant, with a T_sensor_tool of identity; errors of the mount count then only as
    far as known places made errors of start and path of them.

    Errors of dock and mount are the same at all keyframes. Known places, whose own errors are a part of
    "tracking", correlate dock, mount, scale and tracking; each part is what remains of that source's errors. The
    scale's is a part of "start", without its correlation with nav's pose, which the file does not keep.
    """
    J, calibration = _jacobians(placed), placed.calibration
    if of_sensor:
        J["mount"] = np.zeros_like(J["mount"])
    cov_mount = np.zeros((6, 6)) if calibration.cov_sensor_tool is None else calibration.cov_sensor_tool

    shown = np.array([keyframe.T_nav_sensor.p for keyframe in placed.keyframes]) * placed.scale * calibration.scale
    by_scale = np.pad(quat_rotate(placed.T_base_nav.wxyz, shown), ((0, 0), (0, 3)))[:, :, None]

    def of_tool(errors: Array) -> Array:
        """Map errors (6k + 18, c) of keyframes, start, mount and scale to those of the tool's poses, (6k, c)."""
        poses = errors[:-18].reshape(len(placed.keyframes), 6, -1)
        with_first = np.concatenate((np.broadcast_to(poses[:1], poses.shape), poses), axis=1)
        start, mount, scale = errors[-18:-12], errors[-12:-6], errors[-6:-5]
        in_base = J["tracking"] @ with_first + J["start"] @ start + J["mount"] @ mount + by_scale @ scale
        return np.asarray(in_base.reshape(-1, errors.shape[1]))

    cov, by_calibration = _joint_errors(placed)
    start, tip, scale = np.split(of_tool(by_calibration), [6, 9], axis=1)
    mount = np.hstack((tip, J["mount"].reshape(-1, 6)[:, 3:]))
    of_start, of_mount = start @ calibration.cov_start @ start.T, mount @ cov_mount @ mount.T
    of_start += calibration.scale_sigma**2 * scale @ scale.T
    return {"start": of_start, "mount": of_mount, "tracking": of_tool(of_tool(cov).T)}


def _jacobians(placed: KeyframesInBase) -> dict[str, Array]:
    """Return the Jacobian of the tool's pose at each keyframe with respect to the pose of each part.

    They are (k, 6, 6); that of "tracking" is (k, 6, 12): first keyframe 0's pose, which matters with a fixed
    orientation, then the keyframe's own.
    """
    calibration, R, zero, one = placed.calibration, quat_to_matrix(placed.T_base_nav.wxyz), np.zeros((3, 3)), np.eye(3)
    scale, fixed, keyframes = placed.scale * calibration.scale, placed.orientation == "fixed", placed.keyframes
    turn = _fixed_turn(placed) if fixed else one
    J = {part: np.zeros((len(keyframes), 6, 12 if part == "tracking" else 6)) for part in SOURCES}
    for k, keyframe in enumerate(keyframes):
        wxyz = (keyframes[0] if fixed else keyframe).T_nav_sensor.wxyz
        lever = quat_rotate(wxyz, calibration.T_sensor_tool.p)
        from_nav, R_base_sensor = R @ (scale * keyframe.T_nav_sensor.p + lever), R @ quat_to_matrix(wxyz)
        turned = np.vstack((-R @ skew(lever), turn @ R))
        J["start"][k] = np.block([[one, -skew(from_nav)], [zero, turn]])
        J["mount"][k] = np.block([[R_base_sensor, zero], [zero, turn @ R_base_sensor]])
        J["tracking"][k, :3, 6:9] = scale * R
        J["tracking"][k, :, slice(3, 6) if fixed else slice(9, 12)] = turned
    return J


def _fixed_turn(placed: KeyframesInBase) -> Array:
    """Return how the fixed tool turns, (3, 3), if the demonstrated tool at keyframe 0 turns: about base's z alone."""
    demo = replace(placed, keyframes=placed.keyframes[:1], orientation="demo")
    w, x, y, z = quat_multiply(tool_poses(demo)[0].wxyz, quat_inverse(TOOL_DOWN.wxyz))
    # d(2 atan2(z, w)), see `yaw_toward`, for (w, x, y, z) turned on the left
    yaw = np.array((w * y + z * x, z * y - w * x, w * w + z * z)) / (w * w + z * z)
    return np.outer((0.0, 0.0, 1.0), yaw)


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
