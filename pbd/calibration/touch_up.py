"""Touch-ups: where the arm was seen to be off at one keyframe, the others move with it as far as they err together."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from pbd.calibration.tool_poses import KeyframesInBase, tool_poses
from pbd.calibration.uncertainty import joint_tool_covariance
from pbd.data import HandPath, Keyframe, TouchUp
from pbd.pose import Array, Pose, quat_rotate

TOUCH_SIGMA_M = 0.0005
"""Sigma of a touch-up along each axis, m: what an eye tells beside a ruler."""

SAME_S = 0.002
"""Largest difference, s, between a keyframe's time and that in a touch-up of it: files have milliseconds."""


class TouchedUp(NamedTuple):
    """The tool after touch-ups: how far it goes elsewhere (k, 3) m in base, and its covariance (6k, 6k)."""

    shift: Array
    cov: Array


def keyframes_covariance(path: HandPath | None, keyframes: Sequence[Keyframe]) -> Array:
    """Joint covariance (6k, 6k) of keyframes in nav.

    A keyframe within a stop of the path errs with the path's others. One that a person inserted, or took the sigma of,
    is on its own.
    """
    k = len(keyframes)
    joint = np.zeros((k, 6, k, 6))
    joint[range(k), :, range(k)] = [keyframe.cov for keyframe in keyframes]
    if path is not None:
        spans = [(path.t[stop.start], path.t[stop.stop - 1]) for stop in path.stops]
        stops = {
            i: next((stop for stop, (since, until) in enumerate(spans) if since <= keyframe.t <= until), None)
            for i, keyframe in enumerate(keyframes)
            if keyframe.cov.any()
        }
        rows = [i for i, stop in stops.items() if stop is not None]
        of_path = path.covariance.joint([stop for stop in stops.values() if stop is not None])
        joint[np.ix_(rows, range(6), rows, range(6))] = of_path.reshape(len(rows), 6, len(rows), 6)
    return joint.reshape(6 * k, 6 * k)


def touch_up(touch_ups: Sequence[TouchUp], keyframes: Sequence[Keyframe], T_base_nav: Pose, cov: Array) -> TouchedUp:
    """Condition the tool's places on touch-ups: least squares with what errs together, as a Kalman filter's update.

    A keyframe that is touched goes exactly where it is asked to, and stays there when others are touched; touched
    again, the later one counts. The tool's attitudes stay as they were, and so do their covariances (Joseph's form
    holds for any gain).

    Args:
        touch_ups: those that were undone, or whose keyframe is gone, are passed over.
        cov: (6k, 6k) of the tool's poses in base, before.
    """
    k = len(keyframes)
    alone, together = np.zeros((k, 3)), np.zeros((k, 3))
    touched: list[int] = []
    only: set[int] = set()
    gain = np.zeros((k, 3, 0))
    for each in touch_ups:
        at = int(np.argmin([abs(keyframe.t - each.t) for keyframe in keyframes]))
        if each.undone or abs(keyframes[at].t - each.t) > SAME_S:
            continue
        by_base = quat_rotate(T_base_nav.wxyz, each.by_nav_m)
        if each.only:
            alone[at] += by_base
            only.add(at)
            continue
        before, wanted = together, together[at] + by_base
        touched = [*(other for other in touched if other != at), at]
        gain = _gain(cov, touched)
        targets = together[touched]
        targets[-1] = wanted
        together = gain @ targets.ravel()
        together[touched] = targets
        stay = sorted(only - {at})
        alone[stay] += before[stay] - together[stay]
    return TouchedUp(together + alone, _conditioned(cov, touched, gain, only))


def _gain(cov: Array, touched: Sequence[int]) -> Array:
    """How far each keyframe's place moves with those of the touched ones, (k, 3, 3m)."""
    rows = _places(touched)
    S = cov[np.ix_(rows, rows)] + TOUCH_SIGMA_M**2 * np.eye(len(rows))
    return np.asarray(np.linalg.solve(S, cov[rows]).T.reshape(-1, 6, len(rows))[:, :3])


def _conditioned(cov: Array, touched: Sequence[int], gain: Array, only: Collection[int]) -> Array:
    k, rows = len(gain), _places(touched)
    by_pose = np.zeros((k, 6, len(rows)))
    by_pose[:, :3] = gain
    K = by_pose.reshape(6 * k, -1)
    left = np.eye(6 * k)
    left[:, rows] -= K
    cov = left @ cov @ left.T + TOUCH_SIGMA_M**2 * K @ K.T
    alone = _places(sorted(only))  # that keyframe's place errs by the touch alone
    cov[alone] = cov[:, alone] = 0.0
    cov[alone, alone] = TOUCH_SIGMA_M**2
    return cov


def _places(keyframes: Sequence[int]) -> list[int]:
    """Rows of their positions in the joint covariance."""
    return [6 * i + axis for i in keyframes for axis in range(3)]


def touched_up(placed: KeyframesInBase, touch_ups: Sequence[TouchUp] | None = None) -> TouchedUp:
    """The tool at keyframes (as for `tool_poses`) after touch-ups: these, or by default the demonstration's own."""
    cov = joint_tool_covariance(keyframes_covariance(placed.path, placed.keyframes), placed)
    touch_ups = _touch_ups_of(placed.path) if touch_ups is None else touch_ups
    return touch_up(touch_ups, placed.keyframes, placed.T_base_nav, cov)


def _touch_ups_of(path: HandPath | None) -> tuple[TouchUp, ...]:
    return () if path is None or path.tracking is None else path.tracking.demo.touch_ups


def touched_poses(placed: KeyframesInBase, orientation: str = "demo") -> tuple[Pose, ...]:
    """The tool's poses of `tool_poses`, each where the demonstration's touch-ups move it."""
    poses = tool_poses(placed, orientation)
    if not _touch_ups_of(placed.path):
        return poses
    return tuple(Pose(pose.p + by, pose.wxyz) for pose, by in zip(poses, touched_up(placed).shift, strict=True))
