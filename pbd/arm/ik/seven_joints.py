"""All ways to bring the tool of a seven-joint arm to a pose, for a row of angles of its last joint.

For arms whose joints 1, 2 and 3 cross in one point (the shoulder), and 5 and 6 in another (the wrist): panda, xarm7,
iiwa. With the last joint given, the wrist's place is known, and each of three angles has up to two values: the elbow's
from how far the wrist is from the shoulder, joint 6's from where the shoulder lies as seen from the wrist, joint 2's
from how the upper arm is turned. (He and Liu, "Analytical Inverse Kinematics for Franka Emika Panda", 2021, has the
same for panda by geometry. Here it is by the canonical subproblems, as in closed_form.py, many angles at a time.)
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pbd.arm.ik.closed_form import crossing, within_turns
from pbd.arm.model import ArmModel
from pbd.arm.tool import Target, in_universe
from pbd.pose import Array

COUNT, FEWEST = 128, 8
"""Angles of the last joint that are tried: in all, and at least in each range of it."""
PAST_RAD = 0.02
"""How far past the elbow's reach the last joint is tried, so that two ranges of it are never taken for one."""
LEAP_RAD, FINER, CLOSE_RAD = 0.3, 8, 1.0
"""Where another joint moves by more from one angle to the next, so many are tried between; so near to the limits."""
APART_RAD = 1.0
"""Where it moves by more even so, these are two branches."""
NEARLY_RAD = 0.2
"""A place where a family comes this near to the limits, and stays beyond, may lead to a short branch."""
TINY = 1e-12
"""Keeps a ratio finite where a joint has no say."""


class _Axes(NamedTuple):
    """An arm with all joints at zero, in pinocchio's world: directions h (7, 3) and points p (7, 3) m of its axes.

    v @ K[i], of K (7, 3, 3), is the cross product h[i] x v.
    """

    h: Array
    p: Array
    K: Array
    tool: Target


@lru_cache(maxsize=4)
def _axes(arm: ArmModel) -> _Axes | None:
    model, data = arm.model, arm.model.createData()
    if model.nv != 7 or not arm.turns.all():
        return None
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    h = pin.computeJointJacobians(model, data, pin.neutral(model))[3:].T.copy()
    p = np.array([data.oMi[joint].translation for joint in range(1, 8)])
    shoulder, also, wrist = (crossing(h[a], p[a], h[b], p[b]) for a, b in ((0, 1), (1, 2), (4, 5)))
    if shoulder is None or also is None or wrist is None or np.linalg.norm(also - shoulder) > 1e-3:
        return None
    p[:3], p[4:6] = shoulder, wrist
    tool = data.oMf[arm.tool_id]
    return _Axes(h, p, np.cross(h[:, None], np.eye(3)), Target(tool.translation.copy(), tool.rotation.copy()))


def seven_joints(arm: ArmModel, goal: Target) -> list[Array]:
    """Return every branch, as joints (m, 7) along it; an arm that isn't of this kind has none.

    Those of one configuration lie just beyond the limits: a descent from there may lead to a short branch.
    """
    axes = _axes(arm)
    if axes is None:
        return []
    wanted = in_universe(arm, goal)
    R = wanted.R @ axes.tool.R.T
    to_shoulder = axes.p[0] - R @ (axes.p[6] - axes.tool.p) - wanted.p
    q7 = _last(arm, axes, R.T @ to_shoulder, axes.p[4] - axes.p[6])
    if not len(q7):
        return []
    q, off = _ways(arm, axes, R, to_shoulder, q7)
    # Where other joints are far faster than the last, branches are short in it.
    near = np.flatnonzero((_leaps(q, off) > LEAP_RAD).any(axis=0))
    finer = np.setdiff1d(q7[near] + np.linspace(0.0, 1.0, FINER + 2)[1:-1, None] * (q7[near + 1] - q7[near]), q7)
    if len(finer):
        q_finer, off_finer = _ways(arm, axes, R, to_shoulder, finer)
        order = np.argsort(np.append(q7, finer))
        q, off = np.hstack((q, q_finer))[:, order], np.hstack((off, off_finer))[:, order]
    branches = list(q[_dips(off)][:, None])
    for family, inside, leap in zip(q, off == 0.0, _leaps(q, off), strict=True):
        at = np.flatnonzero(inside)
        ends = np.flatnonzero((np.diff(at) > 1) | (leap[at[:-1]] > APART_RAD)) + 1
        branches += [family[part] for part in np.split(at, ends) if len(part)]
    return branches


def _dips(off: Array) -> NDArray[np.bool_]:
    """Where families (8, n) come nearest to the limits and stay beyond."""
    beside = np.pad(off, ((0, 0), (1, 1)), constant_values=np.inf)
    dips: NDArray[np.bool_] = (off > 0.0) & (off < NEARLY_RAD) & (off <= beside[:, :-2]) & (off <= beside[:, 2:])
    return dips


def _leaps(q: Array, off: Array) -> Array:
    """How far joints (8, n, 7) move from each angle of the last to the next, rad (8, n - 1); 0 far from the limits."""
    step = np.diff(q, axis=1)
    step -= 2.0 * np.pi * np.round(step / (2.0 * np.pi))
    near = np.minimum(off[:, :-1], off[:, 1:]) < CLOSE_RAD
    return np.where(near, np.abs(step).max(axis=2), 0.0)


def _ways(arm: ArmModel, axes: _Axes, R: Array, from_last: Array, q7: Array) -> tuple[Array, Array]:
    """Return joints (8, n, 7) by the sides of shoulder, wrist and elbow and by n angles of the last joint.

    With them how far (8, n) each is from being a way, rad: outside its limits, or short of a place where two ways meet;
    0 where it is one.
    """
    h, at, K = axes.h, axes.p, axes.K
    upper, fore = at[3] - at[0], at[4] - at[3]
    # Joints 1 to 6 turn and place what the last leaves.
    turn7 = _sines(q7)
    to_shoulder = from_last - _turned(K[6].T, turn7, at[4] - at[6]) @ R.T
    seen = _turned(K[6], turn7, to_shoulder @ R)
    q4, short4 = _meet(upper, K[3], fore, 0.5 * (_dot(to_shoulder, to_shoulder) - upper @ upper - fore @ fore))
    turn4 = _sines(q4)
    from_wrist = _turned(K[3].T, turn4, -upper) - fore
    q6, short6 = _meet(h[4], K[5], seen, from_wrist @ h[4])
    turn6 = _sines(q6)
    q5 = -_align(K[4], from_wrist, _turned(K[5], turn6, seen))
    turn5 = _sines(q5)
    # What turns the upper arm takes axis 3 there, and back to axis 1.
    there = _turned(K[5].T, turn6, _turned(K[4].T, turn5, _turned(K[3].T, turn4, h[2])))
    there = _turned(K[6].T, turn7, there) @ R.T
    back = _turned(K[4], turn5, _turned(K[5], turn6, _turned(K[6], turn7, h[0] @ R)))
    back = _turned(K[3], turn4, back)
    q2, short2 = _meet(h[0], K[1], h[2], there @ h[0])
    turn2 = _sines(q2)
    q1 = _align(K[0], _turned(K[1], turn2, h[2]), there)
    q3 = -_align(K[2], _turned(K[1].T, turn2, h[0]), back)
    found = within_turns(arm, np.stack(np.broadcast_arrays(q1, q2, q3, q4, q5, q6, q7), axis=-1))
    beyond = np.maximum(arm.limits.lower - found, found - arm.limits.upper).max(axis=-1)
    off = np.maximum(np.maximum(beyond, short2), np.maximum(short4, short6))
    return found.reshape(8, -1, 7), np.maximum(off, 0.0).reshape(8, -1)


def _last(arm: ArmModel, axes: _Axes, to_shoulder: Array, to_wrist: Array) -> Array:
    """Angles (n,) of the last joint, in order: all over where the wrist is in the elbow's reach, within limits."""
    h, at, (lower, upper) = axes.h, axes.p, (arm.limits.lower, arm.limits.upper)
    bends = np.linspace(max(lower[3], -np.pi), min(upper[3], np.pi), COUNT)
    reach = np.linalg.norm(at[3] - at[0] + _turned(axes.K[3], _sines(bends), at[4] - at[3]), axis=1)
    across = to_wrist - (to_wrist @ h[6]) * h[6]
    a, b = float(to_shoulder @ across), -float(to_shoulder @ np.cross(h[6], across))
    size, nearest = math.hypot(a, b), math.atan2(b, a)
    # |to_shoulder - turn(-q) to_wrist|^2 is `middle` less 2 `size` cos(q - nearest).
    middle = to_shoulder @ to_shoulder + to_wrist @ to_wrist - 2.0 * (to_shoulder @ h[6]) * (to_wrist @ h[6])
    cosines = (middle - np.array([reach.min(), reach.max()]) ** 2) / max(2.0 * size, TINY)
    near, far = np.arccos(np.clip(cosines, -1.0, 1.0)) + np.array([-PAST_RAD, PAST_RAD])
    ends = (max(lower[6], -np.pi), min(upper[6], np.pi))
    parts = [
        (max(ends[0], start + turn), min(ends[1], end + turn))
        for turn in (nearest - 2.0 * np.pi, nearest, nearest + 2.0 * np.pi)
        for start, end in ((-far, -near), (near, far))
    ]
    parts = [(start, end) for start, end in parts if end > start]
    every = sum(end - start for start, end in parts) / COUNT
    tried = [np.linspace(start, end, FEWEST + int((end - start) / every)) for start, end in parts]
    return np.unique(np.concatenate(tried)) if tried else np.empty(0)


def _sines(q: Array) -> tuple[Array, Array]:
    """Sine, and one less the cosine, (..., 1) of angles (...)."""
    return np.sin(q)[..., None], (1.0 - np.cos(q))[..., None]


def _turned(K: Array, sines: tuple[Array, Array], v: Array) -> Array:
    """Vectors (..., 3) turned about an axis, by angles of which the sines are given; back with K.T."""
    across = v @ K
    turned: Array = v + sines[0] * across + sines[1] * (across @ K)
    return turned


def _dot(v: Array, w: Array) -> Array:
    dot: Array = np.einsum("...i,...i", v, w)
    return dot


def _align(K: Array, v: Array, w: Array) -> Array:
    """Angles (...) by which v is to be turned about an axis to come nearest to w; both (..., 3)."""
    across = v @ K
    angle: Array = np.arctan2(_dot(across, w), -_dot(across @ K, w))
    return angle


def _meet(n: Array, K: Array, v: Array, d: Array) -> tuple[Array, Array]:
    """Angles (2, ...) about an axis with n . turned(v) = d (...), to both sides; and how far they are short, rad.

    Where there is none it is the nearest, short by the angle's imaginary part.
    """
    across = v @ K
    a, b = -(across @ K) @ n, across @ n
    cosine = (d - v @ n + a) / np.maximum(np.hypot(a, b), TINY)
    half, middle = np.arccos(np.clip(cosine, -1.0, 1.0)), np.arctan2(b, a)
    return np.stack((middle + half, middle - half)), np.arccosh(np.maximum(np.abs(cosine), 1.0))
