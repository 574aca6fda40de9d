"""Touch-ups: a person corrects a keyframe where the arm was off, and the others follow by their common errors."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pbd.calibration.tool_poses import KeyframesInBase, tool_poses
from pbd.calibration.uncertainty import diagonal_blocks, joint_tool_covariances, tool_covariances
from pbd.data import HandPath, Keyframe, TouchUp
from pbd.errors import warn
from pbd.pose import Array, Pose, quat_rotate

TOUCH_SIGMA_M = 0.0005
"""Sigma of a touch-up along each axis, m: an eye's accuracy with a ruler."""


class TouchedUp(NamedTuple):
    """The tool after touch-ups.

    Attributes:
        shift: (k, 3) m in base, of the tool at each keyframe.
        kept: (6k, 6k) maps the errors of the tool's poses before the touch-ups to what remains of them (Joseph's form).
        noise: (6k, 6k) m and rad, covariance of the errors that the touch-ups add.
        cov: (6k, 6k) m and rad, joint covariance of the tool's poses after them.
    """

    shift: Array
    kept: Array
    noise: Array
    cov: Array


def condition_on_touch_ups(
    touch_ups: Sequence[TouchUp], keyframes: Sequence[Keyframe], T_base_nav: Pose, cov: Array
) -> TouchedUp:
    """Condition the tool's positions on touch-ups, as a Kalman filter's update with the joint covariance.

    A touched keyframe moves exactly as asked, and stays there when others are touched. If it is touched again, both
    touch-ups add up. The tool's attitudes and their covariances do not change (Joseph's form holds for any gain).

    Args:
        touch_ups: in order. Those that were undone, or whose keyframe is gone, are ignored.
        keyframes: k of them.
        T_base_nav: nav's pose in base.
        cov: (6k, 6k), covariance of the tool's poses in base, before the touch-ups.
    """
    k = len(keyframes)
    own_shift, common_shift = np.zeros((k, 3)), np.zeros((k, 3))
    touched: list[int] = []
    only: set[int] = set()
    gain = np.zeros((k, 3, 0))
    for each in touch_ups:
        if (at := each.index_in(keyframes)) is None:
            continue
        by_base = quat_rotate(T_base_nav.wxyz, each.by_nav_m)
        if each.only:
            own_shift[at] += by_base
            only.add(at)
            continue
        touched = [*(other for other in touched if other != at), at]
        before, gain, targets = common_shift, _gain(cov, touched), common_shift[touched]
        targets[-1] += by_base
        common_shift = gain @ targets.ravel()
        common_shift[touched] = targets
        stay = sorted(only - {at})
        own_shift[stay] += before[stay] - common_shift[stay]
    kept, noise = _conditioning(touched, gain, only)
    return TouchedUp(common_shift + own_shift, kept, noise, kept @ cov @ kept.T + noise)


def _gain(cov: Array, touched: Sequence[int]) -> Array:
    """Return the gain (k, 3, 3m) from the m touched keyframes' shifts to each keyframe's shift."""
    rows = _position_rows(touched)
    S = cov[np.ix_(rows, rows)] + TOUCH_SIGMA_M**2 * np.eye(len(rows))
    return np.asarray(np.linalg.solve(S, cov[rows]).T.reshape(-1, 6, len(rows))[:, :3])


def _conditioning(touched: Sequence[int], gain: Array, only: Collection[int]) -> tuple[Array, Array]:
    """Return `kept` and `noise` of touch-ups; `only`: keyframes that were touched without the others."""
    k, rows = len(gain), _position_rows(touched)
    pose_gain = np.zeros((k, 6, len(rows)))
    pose_gain[:, :3] = gain
    K = pose_gain.reshape(6 * k, -1)
    kept = np.eye(6 * k)
    kept[:, rows] -= K
    noise = TOUCH_SIGMA_M**2 * K @ K.T
    alone = _position_rows(sorted(only))  # their position errors are those of the touch-up alone
    kept[alone] = noise[alone] = noise[:, alone] = 0.0
    noise[alone, alone] = TOUCH_SIGMA_M**2
    return kept, noise


def _position_rows(keyframes: Sequence[int]) -> list[int]:
    """Return the rows of keyframes' positions in the joint covariance."""
    return [6 * i + axis for i in keyframes for axis in range(3)]


def touched_up(placed: KeyframesInBase, touch_ups: Sequence[TouchUp] | None = None) -> TouchedUp:
    """Return the tool at keyframes after touch-ups: these, or by default the demonstration's own."""
    touch_ups = _touch_ups_of(placed.path) if touch_ups is None else touch_ups
    cov = np.sum([*joint_tool_covariances(placed).values()], axis=0)
    return condition_on_touch_ups(touch_ups, placed.keyframes, placed.T_base_nav, cov)


def touched_covariances(placed: KeyframesInBase) -> dict[str, Array]:
    """Return what `tool_covariances` does, after the demonstration's touch-ups, whose own errors are one more part."""
    if not _touch_ups_of(placed.path):
        return tool_covariances(placed)
    touched = touched_up(placed)
    joint = {part: touched.kept @ cov @ touched.kept.T for part, cov in joint_tool_covariances(placed).items()}
    if touched.noise.any():
        joint["touch-ups"] = touched.noise
    return {part: diagonal_blocks(cov) for part, cov in joint.items()}


def _touch_ups_of(path: HandPath | None) -> tuple[TouchUp, ...]:
    return () if path is None or path.tracking is None else path.tracking.demo.touch_ups


def touched_poses(placed: KeyframesInBase) -> tuple[Pose, ...]:
    """Return the poses of `tool_poses`, shifted by the demonstration's touch-ups."""
    poses = tool_poses(placed)
    if not (touch_ups := _touch_ups_of(placed.path)):
        return poses
    _warn_of_stale(touch_ups, placed)
    return tuple(Pose(pose.p + by, pose.wxyz) for pose, by in zip(poses, touched_up(placed).shift, strict=True))


def demonstrated_places(placed: KeyframesInBase) -> Array:
    """Return the tool's places in base, (k, 3) m, without nudges and touch-ups."""
    unmoved = [replace(each, nudge_base_m=np.zeros(3), nudge_tool_m=np.zeros(3)) for each in placed.keyframes]
    return np.array([pose.p for pose in tool_poses(replace(placed, keyframes=unmoved))])


def _warn_of_stale(touch_ups: Sequence[TouchUp], placed: KeyframesInBase) -> None:
    """Warn if the tool was elsewhere in base when it was touched up: it may have had another error there."""
    places, last = demonstrated_places(placed), dict[int, float]()
    for each in touch_ups:
        if (at := each.index_in(placed.keyframes)) is not None:
            p = each.from_base_m
            last[at] = 0.0 if p is None else float(np.linalg.norm(places[at] - p))
    stale = {at: away for at, away in last.items() if away > 0.002}  # m; rounding and like calibrations change it too
    if stale:
        worst = max(stale, key=lambda at: stale[at])
        warn(
            f"keyframe {worst} was touched up where the tool was {100.0 * stale[worst]:.1f} cm from where it is now "
            "without the touch-up (another calibration, --scale or --orientation, or known places since), so it may be "
            "wrong here: use those it was seen with, touch the keyframe again, or undo (pbd touch DEMO --robot R "
            "--undo)"
        )
