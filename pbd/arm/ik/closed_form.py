"""All ways to bring the tool of a six-joint arm to a pose, in closed form, where its axes allow that.

Two kinds of arms, each with up to eight ways: joints 2, 3 and 4 parallel with 5 and 6 crossing (UR, Z1), and joints 2
and 3 parallel with 4, 5 and 6 through one point (a spherical wrist). The formulas are the canonical subproblems of
Elias and Wen ("IK-Geo", 2022), after Paden and Kahan. An arm that is so only nearly is met nearly: descents finish it.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pbd.arm.model import ArmModel
from pbd.arm.tool import Target, in_universe
from pbd.pose import Array

PARALLEL, TOGETHER_M = 1e-3, 1e-3
"""Sine of the angle between parallel axes at most; distance of crossing ones at most, m."""
OUT_OF_REACH = 1.001
"""A cosine beyond this has no angle; one up to it is the arm stretched out."""
BEYOND_RAD = 0.05
"""A way this far beyond a joint's limit is left out: no descent from there comes back."""


class Axes(NamedTuple):
    """An arm with all joints at zero, in pinocchio's world.

    Attributes:
        h: (6, 3) the joints' directions.
        p: (6, 3) m, a point of each axis; where axes cross, that point.
        tool: p (3,) m and R (3, 3).
        signs: (6,) -1 where a parallel joint turns the other way than `h` says.
        spherical: the last three cross; else the middle three are parallel.
    """

    h: Array
    p: Array
    tool: Target
    signs: Array
    spherical: bool


def closed_form(arm: ArmModel, goal: Target) -> Array:
    """Return joints (m, 6) that bring the tool to a pose, to rounding; none where the arm isn't of these kinds."""
    axes = _axes(arm)
    if axes is None:
        return np.empty((0, len(arm.limits.lower)))
    wanted = in_universe(arm, goal)
    R = wanted.R @ axes.tool.R.T
    # Where the point of the last axis goes.
    p = wanted.p + R @ (axes.p[5] - axes.tool.p)
    found = np.array((_spherical if axes.spherical else _parallel)(axes, R, p)).reshape(-1, 6) * axes.signs
    found = within_turns(arm, found)
    within = ((found >= arm.limits.lower - BEYOND_RAD) & (found <= arm.limits.upper + BEYOND_RAD)).all(axis=1)
    ways: Array = found[within]
    return ways


def flipped_elbow(arm: ArmModel, q: Array) -> Array | None:
    """Return joints (k,) that hold the tool as joints q do, the elbow of three parallel joints on its other side.

    None where no three joints in a row are parallel, or the limits bar it.
    """
    elbow = _elbow(arm)
    if elbow is None:
        return None
    first, n, upper, fore, signs = elbow
    a, b, c = q[first : first + 3] * signs
    wrist = upper + _turn(n, b) @ fore
    other = max(_length(n, upper, fore, wrist), key=lambda angle: 1.0 - math.cos(angle - b), default=b)
    turn = _align(n, upper + _turn(n, other) @ fore, wrist)
    flipped = q.copy()
    flipped[first : first + 3] = np.array([a + turn, other, b + c - turn - other]) * signs
    flipped = within_turns(arm, flipped)
    beyond = np.maximum(arm.limits.lower - flipped, flipped - arm.limits.upper).max()
    return flipped if beyond < BEYOND_RAD else None


@lru_cache(maxsize=4)
def _elbow(arm: ArmModel) -> tuple[int, Array, Array, Array, Array] | None:
    """The first of three parallel joints, their axis, the ways (3,) m from each to the next, and their signs (3,)."""
    model, data = arm.model, arm.model.createData()
    h = pin.computeJointJacobians(model, data, pin.neutral(model))[3:].T
    for i in range(model.nv - 2 if arm.turns.all() else 0):
        if max(np.linalg.norm(np.cross(h[i], h[i + 1])), np.linalg.norm(np.cross(h[i], h[i + 2]))) < PARALLEL:
            p = [data.oMi[joint].translation for joint in range(i + 1, i + 4)]
            return i, h[i].copy(), p[1] - p[0], p[2] - p[1], np.sign(h[i : i + 3] @ h[i])
    return None


def within_turns(arm: ArmModel, q: Array) -> Array:
    """Turn joints (m, k) by whole turns to where they are nearest to the middle of their limits."""
    lower, upper = arm.limits.lower, arm.limits.upper
    middle = np.where(np.isfinite(upper - lower), 0.5 * (np.maximum(lower, -1e3) + np.minimum(upper, 1e3)), 0.0)
    turned: Array = q - 2.0 * np.pi * np.round((q - middle) / (2.0 * np.pi))
    return turned


@lru_cache(maxsize=4)
def _axes(arm: ArmModel) -> Axes | None:
    """The arm's axes; None where they are of neither kind."""
    model, data = arm.model, arm.model.createData()
    if model.nv != 6 or not arm.turns.all():
        return None
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    J = pin.computeJointJacobians(model, data, pin.neutral(model))
    h = J[3:].T.copy()
    p = np.array([data.oMi[joint].translation for joint in range(1, 7)])
    if np.linalg.norm(np.cross(h[1], h[2])) > PARALLEL:
        return None
    signs = np.ones(6)
    h[2], signs[2] = h[1], np.sign(h[1] @ h[2])
    wrist = crossing(h[4], p[4], h[5], p[5])
    if wrist is None:
        return None
    p[4] = p[5] = wrist
    tool = Target(data.oMf[arm.tool_id].translation.copy(), data.oMf[arm.tool_id].rotation.copy())
    off = p[5] - p[3]
    if np.linalg.norm(off - (off @ h[3]) * h[3]) < TOGETHER_M:
        p[3] = p[5]
        return Axes(h, p, tool, signs, True)
    if np.linalg.norm(np.cross(h[1], h[3])) < PARALLEL:
        h[3], signs[3] = h[1], np.sign(h[1] @ h[3])
        return Axes(h, p, tool, signs, False)
    return None


def _parallel(axes: Axes, R: Array, p: Array) -> list[list[float]]:
    h, at = axes.h, axes.p
    n, found = h[1], list[list[float]]()
    for q1 in _dot(n, h[0], p - at[0], n @ (at[5] - at[0])):
        R1 = _turn(h[0], -q1)
        rest, wrist = R1 @ R, R1 @ (p - at[0]) + at[0]
        for q5 in _dot(n, h[4], h[5], float(n @ rest @ h[5]), inverse=False):
            R5 = _turn(h[4], q5)
            q6 = -_align(h[5], R5.T @ n, rest.T @ n)
            R14 = rest @ _turn(h[5], -q6) @ R5.T
            u = _across(n, h[4])
            all_three = _align(n, u, R14 @ u)
            forearm = wrist - at[1] - _turn(n, all_three) @ (at[5] - at[3])
            for q3 in _length(n, at[2] - at[1], at[3] - at[2], forearm):
                q2 = _align(n, at[2] - at[1] + _turn(n, q3) @ (at[3] - at[2]), forearm)
                found.append([q1, q2, q3, all_three - q2 - q3, q5, q6])
    return found


def _spherical(axes: Axes, R: Array, p: Array) -> list[list[float]]:
    h, at = axes.h, axes.p
    n, found = h[1], list[list[float]]()
    for q1 in _dot(n, h[0], p - at[0], n @ (at[5] - at[0])):
        R1 = _turn(h[0], -q1)
        forearm = R1 @ (p - at[0]) + at[0] - at[1]
        for q3 in _length(n, at[2] - at[1], at[3] - at[2], forearm):
            q2 = _align(n, at[2] - at[1] + _turn(n, q3) @ (at[3] - at[2]), forearm)
            hand = _turn(n, -q2 - q3) @ R1 @ R
            for q5 in _dot(h[3], h[4], h[5], float(h[3] @ hand @ h[5]), inverse=False):
                R5 = _turn(h[4], q5)
                q4 = _align(h[3], R5 @ h[5], hand @ h[5])
                q6 = -_align(h[5], R5.T @ h[3], hand.T @ h[3])
                found.append([q1, q2, q3, q4, q5, q6])
    return found


def crossing(h: Array, p: Array, h_other: Array, p_other: Array) -> Array | None:
    """Where two axes cross; None where they don't."""
    normal = np.cross(h, h_other)
    square, off = float(normal @ normal), p_other - p
    if square < PARALLEL**2 or abs(off @ normal) > TOGETHER_M * math.sqrt(square):
        return None
    place: Array = p_other + h_other * float(np.cross(off, h) @ normal) / square
    return place


def _turn(axis: Array, angle: float) -> Array:
    x, y, z = axis
    c, s = math.cos(angle), math.sin(angle)
    d = 1.0 - c
    return np.array(
        [
            [c + x * x * d, x * y * d - z * s, x * z * d + y * s],
            [x * y * d + z * s, c + y * y * d, y * z * d - x * s],
            [x * z * d - y * s, y * z * d + x * s, c + z * z * d],
        ]
    )


def _cross(a: Array, b: Array) -> Array:
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _across(n: Array, v: Array) -> Array:
    """What is left of a vector across an axis; of one along it, anything across."""
    left: Array = v - (v @ n) * n
    return left if left @ left > 1e-6 else _cross(n, np.eye(3)[int(np.abs(n).argmin())])


def _align(axis: Array, v: Array, w: Array) -> float:
    """Angle by which v is to be turned about an axis to come nearest to w (subproblem 1)."""
    across = v - (v @ axis) * axis
    return math.atan2(_cross(axis, across) @ w, across @ w)


def _dot(n: Array, axis: Array, v: Array, d: float, *, inverse: bool = True) -> tuple[float, ...]:
    """Angles q with n . turn(axis, q) v = d, or turn(axis, -q) where `inverse` (subproblem 4); the nearest to it."""
    across = v - (v @ axis) * axis
    a, b = float(n @ across), float(n @ _cross(axis, across)) * (-1.0 if inverse else 1.0)
    size = math.hypot(a, b)
    if size < 1e-9:
        return (0.0,)
    cosine = (d - float(n @ axis) * float(v @ axis)) / size
    if abs(cosine) > OUT_OF_REACH:
        return ()
    middle, half = math.atan2(b, a), math.acos(max(-1.0, min(1.0, cosine)))
    return (middle + half, middle - half) if half > 0.0 else (middle,)


def _length(axis: Array, v: Array, w: Array, sum_: Array) -> tuple[float, ...]:
    """Angles q with |v + turn(axis, q) w| = |sum_|, all across the axis (subproblem 3); the nearest to it."""
    v, w, sum_ = (each - (each @ axis) * axis for each in (v, w, sum_))
    return _dot(v, axis, w, 0.5 * float(sum_ @ sum_ - v @ v - w @ w), inverse=False)
