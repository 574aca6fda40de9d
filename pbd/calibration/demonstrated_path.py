"""The demonstrated path from one keyframe to the next, as poses of the tool in base.

The hand trembles, and the tracked path is uncertain. So a cubic spline smooths it, within one sigma of the tracked path
and within SMOOTH_M and SMOOTH_RAD. The path starts and ends exactly at the keyframes. They may have been edited, or may
belong to an object that stands elsewhere now, so corrections at both ends are spread smoothly over the move.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from pbd.data import Calibration, HandPath, Keyframe
from pbd.pose import Array, Pose, quat_continuous, quat_exp, quat_inverse, quat_log, quat_multiply, quat_rotate

SMOOTH_M, SMOOTH_RAD = 0.005, np.radians(2.0)
"""Largest deviation, m and rad, of the smoothed path from the tracked one."""


@dataclass(frozen=True, eq=False)
class DemonstratedMove:
    """A move from one keyframe to the next: times t (n,) s of the demonstration, increasing, and the tool's poses."""

    t: Array
    T_base_tool: tuple[Pose, ...]


def demonstrated_moves(
    path: HandPath,
    keyframes: Sequence[Keyframe],
    T_base_nav: Pose,
    T_base_tool: Sequence[Pose],
    calibration: Calibration,
    scale: float = 1.0,
    fixed: bool = False,
) -> tuple[DemonstratedMove, ...]:
    """Return the hand's moves between keyframes.

    Args:
        path: the hand's.
        keyframes: in order of time.
        T_base_nav: nav in base.
        T_base_tool: the tool's pose at each keyframe, where the moves start and end.
        calibration: its mount; its own scale multiplies `scale`.
        scale: factor on the hand's positions.
        fixed: the tool keeps the rotation that it has at the start of each move.
    """
    scale *= calibration.scale
    moves = []
    for (before, after), (start, end) in zip(pairwise(keyframes), pairwise(T_base_tool), strict=True):
        t, p, wxyz = samples_of_move(path, before, after)
        p, wxyz = T_base_nav.act(scale * p), quat_multiply(T_base_nav.wxyz, wxyz)
        if fixed:
            wxyz = np.tile(start.wxyz, (len(p), 1))
        else:
            p = p + quat_rotate(wxyz, calibration.T_sensor_tool.p)
            wxyz = quat_multiply(wxyz, calibration.T_sensor_tool.wxyz)
        sigma = np.sqrt(np.minimum(np.diagonal(before.cov), np.diagonal(after.cov)).reshape(2, 3).max(axis=1))
        within = min(scale * sigma[0], SMOOTH_M), min(sigma[1], SMOOTH_RAD)
        t, p, wxyz = _smoothed_poses(t, p, wxyz, start, end, *within)
        moves.append(DemonstratedMove(t, (start, *map(Pose, p[1:-1], wxyz[1:-1]), end)))
    return tuple(moves)


def samples_of_move(path: HandPath, before: Keyframe, after: Keyframe) -> tuple[Array, Array, Array]:
    """Return t, p_nav_sensor and wxyz_nav_sensor of a move, from the last sample of a rest to the first of the next."""
    start, end = path.rest_at(before.t)[1], path.rest_at(after.t)[0]
    inside = (path.t >= start - 1e-6) & (path.t <= end + 1e-6)
    if inside.sum() < 2:
        ends = before.T_nav_sensor, after.T_nav_sensor
        t = np.array([start, max(end, start + 1e-3)])
        return t, np.array([pose.p for pose in ends]), np.array([pose.wxyz for pose in ends])
    return path.t[inside], path.p_nav_sensor[inside], path.wxyz_nav_sensor[inside]


def _smoothed_poses(
    t: Array, p: Array, wxyz: Array, start: Pose, end: Pose, within_m: float, within_rad: float
) -> tuple[Array, Array, Array]:
    """Smooth samples of the tool in base, lead them from `start` to `end`, and resample them.

    They become eight poses or more, at most 5 mm and 2 degrees apart.
    """
    from scipy.interpolate import make_interp_spline

    share = (t - t[0]) / (t[-1] - t[0])
    wxyz = quat_continuous(wxyz)
    p = smoothed(share, p, within_m)
    wxyz = smoothed(share, wxyz, 0.5 * within_rad)  # a unit quaternion changes by half the angle
    wxyz = wxyz / np.linalg.norm(wxyz, axis=1, keepdims=True)
    p, wxyz = with_ends_at(share, p, wxyz, start, end)
    shift = np.linalg.norm(np.diff(p, axis=0), axis=1) / 0.005
    turn = np.linalg.norm(quat_log(quat_multiply(quat_inverse(wxyz[:-1]), wxyz[1:])), axis=1) / np.radians(2.0)
    steps = np.append(0.0, np.cumsum(np.maximum(shift, turn))) + 1e-6 * share
    count = max(8, int(np.ceil(steps[-1])) + 1)
    at = np.interp(np.linspace(0.0, steps[-1], count), steps, share)
    order = min(3, len(share) - 1)
    p, wxyz = (make_interp_spline(share, values, k=order)(at) for values in (p, quat_continuous(wxyz)))
    return t[0] + at * (t[-1] - t[0]), p, wxyz


def with_ends_at(share: Array, p: Array, wxyz: Array, start: Pose, end: Pose) -> tuple[Array, Array]:
    """Change a path p (n, 3) m, wxyz (n, 4), at shares (n,) of the move's duration, to start and end at given poses.

    The corrections of both ends are spread over the move such that the velocities at the ends stay as they are.
    """
    shifts = [pose.p - p[i] for pose, i in ((start, 0), (end, -1))]
    turns = [quat_log(quat_multiply(pose.wxyz, quat_inverse(wxyz[i]))) for pose, i in ((start, 0), (end, -1))]
    of_end = (share**2 * (3.0 - 2.0 * share))[:, None]
    p = p + (1.0 - of_end) * shifts[0] + of_end * shifts[1]
    return p, quat_multiply(quat_exp((1.0 - of_end) * turns[0] + of_end * turns[1]), wxyz)


def smoothed(x: Array, values: Array, within: float) -> Array:
    """Smooth values (n, c) over x (n,): the smoothest of the cubic splines tried that stays within `within` of each.

    It passes through both ends. Fewer than five values stay as they are.
    """
    from scipy.interpolate import make_smoothing_spline

    if len(x) < 5 or not within > 0.0:
        return values
    weights, strengths = np.ones(len(x)), np.logspace(-12, 1, 27).tolist()
    weights[[0, -1]] = 1e6  # so large that it passes through them
    fitted = cache(lambda strength: make_smoothing_spline(x, values, w=weights, lam=strength)(x))
    too_smooth = bisect_right(strengths, within, key=lambda each: np.linalg.norm(fitted(each) - values, axis=1).max())
    return np.asarray(fitted(strengths[too_smooth - 1])) if too_smooth else values
