"""All solutions of a six-joint arm's inverse kinematics in closed form, for two kinds of arms.

The first kind has axes 2, 3 and 4 parallel, and axes 5 and 6 intersecting (UR, Z1). The second has axes 2 and 3
parallel, and axes 4, 5 and 6 through one point (a spherical wrist). Both have up to eight solutions. If an arm is of a
kind only approximately, so are the solutions, and descents refine them.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pbd.arm.ik.subproblems import INTERSECTING_M, Axis, axes_of, sines, wrap_to_limits
from pbd.arm.model import ArmModel
from pbd.pose import Array

STRETCHED_RAD = float(np.arccosh(1.001))
"""Largest shortfall, rad (see `to_plane`), at which a pose at the edge of the arm's reach counts as reached."""
BEYOND_RAD = 0.05
"""A solution that exceeds a joint limit by more than this, rad, is left out: descents don't bring it back."""


_Solutions = tuple[tuple[Array, ...], tuple[Array, ...]]


class _Kind(NamedTuple):
    """An arm of one of the two kinds; `signs` (6,): -1 for a joint whose axis was reversed to equal that of joint 2."""

    axes: list[Axis]
    T_base_tool: pin.SE3
    signs: Array
    spherical: bool


def closed_form(arm: ArmModel, goal: pin.SE3) -> Array:
    """Return all solutions (m, 6) for a pose of the tool; (0, k) for an arm of neither kind."""
    kind = _kind(arm)
    if kind is None:
        return np.empty((0, len(arm.limits.lower)))
    moved = goal * kind.T_base_tool.inverse()
    R, p = moved.rotation, moved.act(kind.axes[5].p)  # the wrist's position for the goal
    q, short = (_spherical if kind.spherical else _parallel)(kind.axes, R, p)
    every = np.stack(np.broadcast_arrays(*q), axis=-1).transpose(2, 1, 0, 3).reshape(-1, 6)
    found = wrap_to_limits(arm, every * kind.signs)
    reached = np.max(np.broadcast_arrays(*short), axis=0).T.repeat(2) <= STRETCHED_RAD
    solutions: Array = found[reached & (arm.limit_margins(found).min(axis=-1) >= -BEYOND_RAD)]
    return solutions


def flipped_elbow(arm: ArmModel, q: Array) -> Array | None:
    """Return the joints (k,) with the same tool pose as q, but the elbow of three parallel joints on the other side.

    None if no three successive axes are parallel, or the limits are exceeded.
    """
    elbow = _elbow(arm)
    if elbow is None:
        return None
    first, axis, upper, fore, signs = elbow
    a, b, c = q[first : first + 3] * signs
    wrist = upper + axis.rotate(sines(b), fore)
    angles, _ = axis.to_distance(upper, fore, wrist)
    other = angles[np.cos(angles - b).argmin()]
    turn = axis.align(upper + axis.rotate(sines(other), fore), wrist)
    flipped = q.copy()
    flipped[first : first + 3] = np.array([a + turn, other, b + c - turn - other]) * signs
    flipped = wrap_to_limits(arm, flipped)
    return flipped if arm.limit_margins(flipped).min() > -BEYOND_RAD else None


@lru_cache(maxsize=16)
def _elbow(arm: ArmModel) -> tuple[int, Axis, Array, Array, Array] | None:
    """Return the index of the first of three parallel joints, its axis, the two offsets (3,) between them, m, and
    their signs (3,) relative to that axis; None if there are none."""
    axes, _ = axes_of(arm)
    for i, (a, b, c) in enumerate(zip(axes, axes[1:], axes[2:], strict=False) if arm.turns.all() else ()):
        if a.is_parallel(b) and a.is_parallel(c):
            return i, a, b.p - a.p, c.p - b.p, np.sign([a.h @ each.h for each in (a, b, c)])
    return None


@lru_cache(maxsize=16)
def _kind(arm: ArmModel) -> _Kind | None:
    if arm.model.nv != 6 or not arm.turns.all():
        return None
    (axes, tool), signs = axes_of(arm), np.ones(6)
    _, second, third, fourth, fifth, last = axes
    wrist = fifth.crossing(last)
    if wrist is None or not second.is_parallel(third):
        return None
    fifth.p = last.p = wrist
    off = wrist - fourth.p
    spherical = bool(np.linalg.norm(off - (off @ fourth.h) * fourth.h) < INTERSECTING_M)
    if spherical:
        fourth.p = wrist
    elif not second.is_parallel(fourth):
        return None
    for i in (2,) if spherical else (2, 3):
        signs[i], axes[i].h = np.sign(second.h @ axes[i].h), second.h
    return _Kind(axes, tool, signs, spherical)


def _parallel(axes: list[Axis], R: Array, p: Array) -> _Solutions:
    """Return six arrays of angles, for both sides of elbow, wrist and shoulder (2, 2, 2), and three shortfalls, rad."""
    first, second, third, fourth, fifth, last = axes
    n, upper, fore = second.h, third.p - second.p, fourth.p - third.p
    q1, short1 = first.to_plane(p - first.p, n, n @ (last.p - first.p))
    turn1 = sines(q1)
    q5, short5 = fifth.to_plane(n, last.h, first.unrotate(turn1, R @ last.h) @ n)
    turn5 = sines(q5)
    q6 = -last.align(fifth.unrotate(turn5, n), first.rotate(turn1, n) @ R)
    through = last.unrotate(sines(q6), fifth.unrotate(turn5, upper)) @ R.T
    all_three = second.align(upper, first.unrotate(turn1, through))
    wrist = first.unrotate(turn1, p - first.p) + first.p - second.p - second.rotate(sines(all_three), last.p - fourth.p)
    q3, short3 = second.to_distance(upper, fore, wrist)
    q2 = second.align(upper + second.rotate(sines(q3), fore), wrist)
    return (q1, q2, q3, all_three - q2 - q3, q5, q6), (short1, short5, short3)


def _spherical(axes: list[Axis], R: Array, p: Array) -> _Solutions:
    """Return the same for a spherical wrist, for both sides of wrist, elbow and shoulder."""
    first, second, third, fourth, fifth, last = axes
    n, upper, fore = second.h, third.p - second.p, fourth.p - third.p
    q1, short1 = first.to_plane(p - first.p, n, n @ (last.p - first.p))
    turn1 = sines(q1)
    wrist = first.unrotate(turn1, p - first.p) + first.p - second.p
    q3, short3 = second.to_distance(upper, fore, wrist)
    q2 = second.align(upper + second.rotate(sines(q3), fore), wrist)
    turn23 = sines(q2 + q3)
    end = second.unrotate(turn23, first.unrotate(turn1, R @ last.h))
    q5, short5 = fifth.to_plane(fourth.h, last.h, end @ fourth.h)
    turn5 = sines(q5)
    q4 = fourth.align(fifth.rotate(turn5, last.h), end)
    q6 = -last.align(fifth.unrotate(turn5, fourth.h), first.rotate(turn1, second.rotate(turn23, fourth.h)) @ R)
    return (q1, q2, q3, q4, q5, q6), (short1, short3, short5)
