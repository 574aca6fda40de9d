"""The demonstrated path from one keyframe to the next, as poses of the tool in base.

The hand trembles, and the tracked path is only known to within its uncertainty: it is smoothed by a cubic spline as far
as it stays within one sigma of what was tracked, and within SMOOTH_M and SMOOTH_RAD. It begins and ends exactly at the
keyframes, which may have been edited, or belong to a thing that stands elsewhere now: what is missing at either end is
shared out over the move, smoothly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pbd.data import Calibration, HandPath, Keyframe
from pbd.pose import Array, Pose, quat_exp, quat_inverse, quat_log, quat_multiply, quat_rotate

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

SMOOTH_M, SMOOTH_RAD = 0.005, np.radians(2.0)
"""Largest deviation, m and rad, of the smoothed path from the tracked one."""

SPACING_M, SPACING_RAD = 0.005, np.radians(2.0)
"""Largest distance, m and rad, between two poses of the path."""

FEWEST_POSES, FEWEST_SMOOTHED = 8, 5
"""Fewest poses of a path; fewest samples that are smoothed."""

STRENGTHS, END_WEIGHT = np.logspace(-12, 1, 27), 1e6
"""Strengths of smoothing that are tried; weight of both ends, which are met."""


@dataclass(frozen=True, eq=False)
class DemonstratedMove:
    """From one keyframe to the next: t (n,) s of the demonstration, increasing, and the tool's poses then."""

    t: Array
    T_base_tool: tuple[Pose, ...]

    @property
    def duration(self) -> float:
        """Seconds that the hand took."""
        return float(self.t[-1] - self.t[0])


def demonstrated_moves(
    path: HandPath,
    keyframes: Sequence[Keyframe],
    T_base_nav: Pose,
    T_base_tool: Sequence[Pose],
    calibration: Calibration,
    scale: float = 1.0,
    fixed: bool = False,
) -> tuple[DemonstratedMove, ...]:
    """Follow the hand between keyframes.

    Args:
        T_base_tool: where the tool is at each keyframe; the path is led from one to the next.
        calibration: its own scale multiplies `scale`.
        fixed: the tool keeps the rotation of T_base_tool.
    """
    scale *= calibration.scale
    moves = []
    for (before, after), (start, end) in zip(pairwise(keyframes), pairwise(T_base_tool), strict=True):
        t, p, wxyz = _sampled(path, before, after)
        p, wxyz = T_base_nav.act(scale * p), quat_multiply(T_base_nav.wxyz, wxyz)
        if fixed:
            wxyz = np.tile(start.wxyz, (len(p), 1))
        else:
            p, wxyz = (
                p + quat_rotate(wxyz, calibration.T_sensor_tool.p),
                quat_multiply(wxyz, calibration.T_sensor_tool.wxyz),
            )
        sigma = np.sqrt(np.minimum(np.diagonal(before.cov), np.diagonal(after.cov)).reshape(2, 3).max(axis=1))
        t, p, wxyz = _led(t, p, wxyz, start, end, min(scale * sigma[0], SMOOTH_M), min(sigma[1], SMOOTH_RAD))
        along = (Pose(p[i], wxyz[i]) for i in range(1, len(t) - 1))
        moves.append(DemonstratedMove(t, (start, *along, end)))
    return tuple(moves)


def _sampled(path: HandPath, before: Keyframe, after: Keyframe) -> tuple[Array, Array, Array]:
    """The samples of a move, from the last at rest to the first at rest: t, p_nav_sensor, wxyz_nav_sensor."""
    start, end = before.t + 0.5 * before.dwell_s, after.t - 0.5 * after.dwell_s
    inside = (path.t >= start - 1e-6) & (path.t <= end + 1e-6)
    if inside.sum() < 2:
        ends = before.T_nav_sensor, after.T_nav_sensor
        t = np.array([start, max(end, start + 1e-3)])
        return t, np.array([pose.p for pose in ends]), np.array([pose.wxyz for pose in ends])
    return path.t[inside], path.p_nav_sensor[inside], path.wxyz_nav_sensor[inside]


def _led(
    t: Array, p: Array, wxyz: Array, start: Pose, end: Pose, within_m: float, within_rad: float
) -> tuple[Array, Array, Array]:
    """Smooth samples of the tool in base, lead them from pose to pose, and take as many as the spacing asks for."""
    from scipy.interpolate import make_interp_spline

    share = (t - t[0]) / (t[-1] - t[0])
    wxyz = _continuous(wxyz)
    p = smoothed(share, p, within_m)(share)
    wxyz = smoothed(share, wxyz, 0.5 * within_rad)(share)  # of a unit quaternion: half the angle
    wxyz /= np.linalg.norm(wxyz, axis=1, keepdims=True)
    # What is missing at either end is shared out, so that the path leaves and comes as the hand did there.
    shifts = [wanted.p - p[i] for wanted, i in ((start, 0), (end, -1))]
    twists = [quat_log(quat_multiply(wanted.wxyz, quat_inverse(wxyz[i]))) for wanted, i in ((start, 0), (end, -1))]
    later = (share**2 * (3.0 - 2.0 * share))[:, None]
    p = p + (1.0 - later) * shifts[0] + later * shifts[1]
    wxyz = quat_multiply(quat_exp((1.0 - later) * twists[0] + later * twists[1]), wxyz)
    shift = np.linalg.norm(np.diff(p, axis=0), axis=1) / SPACING_M
    turn = np.linalg.norm(quat_log(quat_multiply(quat_inverse(wxyz[:-1]), wxyz[1:])), axis=1) / SPACING_RAD
    steps = np.append(0.0, np.cumsum(np.maximum(shift, turn))) + 1e-6 * share
    count = max(FEWEST_POSES, int(np.ceil(steps[-1])) + 1)
    at = np.interp(np.linspace(0.0, steps[-1], count), steps, share)
    order = min(3, len(share) - 1)
    p, wxyz = (make_interp_spline(share, values, k=order)(at) for values in (p, _continuous(wxyz)))
    return t[0] + at * (t[-1] - t[0]), p, wxyz


def smoothed(x: Array, values: Array, within: float) -> BSpline:
    """Fit the smoothest cubic spline to values (n, c) over x (n,) that leaves none by more than `within`.

    The ends are met. Fewer than five values are interpolated.
    """
    from scipy.interpolate import make_interp_spline, make_smoothing_spline

    exact: BSpline = make_interp_spline(x, values, k=min(3, len(x) - 1))
    if len(x) < FEWEST_SMOOTHED or within <= 0.0:
        return exact
    weights = np.ones(len(x))
    weights[[0, -1]] = END_WEIGHT
    best, low, high = exact, 0, len(STRENGTHS)
    while low < high:
        middle = (low + high) // 2
        spline = make_smoothing_spline(x, values, w=weights, lam=float(STRENGTHS[middle]))
        if np.linalg.norm(spline(x) - values, axis=1).max() <= within:
            best, low = spline, middle + 1
        else:
            high = middle
    return best


def _continuous(wxyz: Array) -> Array:
    """Quaternions (n, 4) of the same rotations, each on the side of the one before."""
    sides = np.sign(np.einsum("ij,ij->i", wxyz[1:], wxyz[:-1]))
    return np.asarray(wxyz * np.append(1.0, np.cumprod(np.where(sides == 0.0, 1.0, sides)))[:, None])
