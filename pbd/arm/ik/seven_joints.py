"""All solutions of a seven-joint arm's inverse kinematics, sampled over the angle of its last joint.

This works for arms whose axes 1, 2 and 3 intersect in one point (the shoulder), and axes 5 and 6 in another (the
wrist): panda, xarm7, iiwa. The angle of the last joint fixes the wrist. Three other angles then have up to two values
each: joint 4 (the elbow) from the distance of wrist and shoulder, joint 6 from the direction of the shoulder in the
wrist's frame, joint 2 from the rotation of the upper arm. He and Liu, "Analytical Inverse Kinematics for Franka Emika
Panda", 2021, do the same for panda by geometry. This code uses the canonical subproblems, as closed_form.py does, for
many angles at once.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pinocchio as pin

from pbd.arm.ik.subproblems import INTERSECTING_M, TINY, Axis, axes_of, sines, wrap_to_limits
from pbd.arm.model import ArmModel
from pbd.pose import Array

COUNT, FEWEST = 128, 8
"""Number of angles of the last joint that are tried: about COUNT in total, plus FEWEST in each range."""
PAST_RAD = 0.02
"""How far beyond the elbow's reach the last joint is tried, rad; solutions there separate neighbouring ranges."""
FAST_RAD, FINER, CLOSE_RAD = 0.3, 8, 1.0
"""If a joint moves by more than FAST_RAD between two neighbouring angles, and a solution there exceeds its limits by
less than CLOSE_RAD, FINER more angles are tried between them."""
APART_RAD = 1.0
"""Neighbouring solutions that differ by more than this in some joint, rad, belong to two branches."""
NEARLY_RAD = 0.2
"""A minimum of the limit excess below this, rad, may hide a short branch between two angles."""


@lru_cache(maxsize=16)
def _axes(arm: ArmModel) -> tuple[list[Axis], pin.SE3] | None:
    """Return the arm's axes and T_base_tool at zero; None if the arm is not of this kind."""
    if arm.model.nv != 7 or not arm.turns.all():
        return None
    axes, tool = axes_of(arm)
    shoulder, also, wrist = (axes[one].crossing(axes[other]) for one, other in ((0, 1), (1, 2), (4, 5)))
    if shoulder is None or also is None or wrist is None or np.linalg.norm(also - shoulder) > INTERSECTING_M:
        return None
    for axis, place in zip(axes, (*[shoulder] * 3, axes[3].p, wrist, wrist), strict=False):
        axis.p = place
    return axes, tool


def seven_joints(arm: ArmModel, goal: pin.SE3) -> list[Array]:
    """Return each self-motion branch as joints (m, 7) along it; an empty list for an arm that is not of this kind.

    A branch of one configuration lies just beyond the limits: a descent from it may lead to a short branch.
    """
    if (known := _axes(arm)) is None:
        return []
    axes, tool = known
    moved = goal * tool.inverse()
    R, to_shoulder = moved.rotation, axes[0].p - moved.act(axes[6].p)
    q7 = _last_joint_angles(arm, axes, R.T @ to_shoulder, axes[4].p - axes[6].p)
    q, off = _solutions(arm, axes, R, to_shoulder, q7)
    # Where other joints move much faster than the last, try more of its angles.
    near = np.flatnonzero((_largest_steps(q, off) > FAST_RAD).any(axis=0))
    finer = np.setdiff1d(q7[near] + np.linspace(0.0, 1.0, FINER + 2)[1:-1, None] * (q7[near + 1] - q7[near]), q7)
    if len(finer):
        q_finer, off_finer = _solutions(arm, axes, R, to_shoulder, finer)
        order = np.argsort(np.append(q7, finer))
        q, off = np.hstack((q, q_finer))[:, order], np.hstack((off, off_finer))[:, order]
    # Local minima of the limit excess.
    beside = np.pad(off, ((0, 0), (1, 1)), constant_values=np.inf)
    dips = (off > 0.0) & (off < NEARLY_RAD) & (off <= beside[:, :-2]) & (off <= beside[:, 2:])
    branches = list(q[dips][:, None])
    for family, inside, leap in zip(q, off == 0.0, _largest_steps(q, off), strict=True):
        at = np.flatnonzero(inside)
        ends = np.flatnonzero((np.diff(at) > 1) | (leap[at[:-1]] > APART_RAD)) + 1
        branches += [family[part] for part in np.split(at, ends) if len(part)]
    return branches


def _largest_steps(q: Array, off: Array) -> Array:
    """Return the largest joint motion (8, n - 1), rad, between neighbouring solutions q (8, n, 7); 0 far beyond the
    limits."""
    step = np.diff(q, axis=1)
    step -= 2.0 * np.pi * np.round(step / (2.0 * np.pi))
    near = np.minimum(off[:, :-1], off[:, 1:]) < CLOSE_RAD
    return np.where(near, np.abs(step).max(axis=2), 0.0)


def _solutions(arm: ArmModel, axes: Sequence[Axis], R: Array, from_last: Array, q7: Array) -> tuple[Array, Array]:
    """Return joints (8, n, 7) for both sides of shoulder, wrist and elbow, at n angles of the last joint.

    Also return how far (8, n) each is from a solution, rad: its limit excess or its shortfall as `to_plane` defines it,
    whichever is larger; 0 for a solution.
    """
    first, second, third, fourth, fifth, sixth, last = axes
    upper, fore = fourth.p - first.p, fifth.p - fourth.p
    # Remove the rotation of the last joint from the goal.
    turn7 = sines(q7)
    to_shoulder = from_last - last.unrotate(turn7, fifth.p - last.p) @ R.T
    seen = last.rotate(turn7, to_shoulder @ R)
    q4, short4 = fourth.to_distance(upper, fore, to_shoulder)
    turn4 = sines(q4)
    from_wrist = fourth.unrotate(turn4, -upper) - fore
    q6, short6 = sixth.to_plane(fifth.h, seen, from_wrist @ fifth.h)
    turn6 = sines(q6)
    q5 = -fifth.align(from_wrist, sixth.rotate(turn6, seen))
    turn5 = sines(q5)
    # Joints 1 to 3 rotate the upper arm: it must take axis 3 to `axis3`, and its inverse must take axis 1 to `axis1`.
    axis3 = last.unrotate(turn7, sixth.unrotate(turn6, fifth.unrotate(turn5, fourth.unrotate(turn4, third.h)))) @ R.T
    axis1 = fourth.rotate(turn4, fifth.rotate(turn5, sixth.rotate(turn6, last.rotate(turn7, first.h @ R))))
    q2, short2 = second.to_plane(first.h, third.h, axis3 @ first.h)
    turn2 = sines(q2)
    q1 = first.align(second.rotate(turn2, third.h), axis3)
    q3 = -third.align(second.unrotate(turn2, first.h), axis1)
    found = wrap_to_limits(arm, np.stack(np.broadcast_arrays(q1, q2, q3, q4, q5, q6, q7), axis=-1))
    excess = -arm.limit_margins(found).min(axis=-1)
    off = np.maximum(np.maximum(excess, short2), np.maximum(short4, short6))
    return found.reshape(8, -1, 7), off.reshape(8, -1)


def _last_joint_angles(arm: ArmModel, axes: Sequence[Axis], to_shoulder: Array, to_wrist: Array) -> Array:
    """Return sorted angles (n,) of the last joint, within limits, at which the wrist is within the elbow's reach."""
    first, fourth, fifth, h, (lower, upper) = axes[0], axes[3], axes[4], axes[6].h, (arm.limits.lower, arm.limits.upper)
    bends = np.linspace(max(lower[3], -np.pi), min(upper[3], np.pi), COUNT)
    reach = np.linalg.norm(fourth.p - first.p + fourth.rotate(sines(bends), fifth.p - fourth.p), axis=1)
    across = to_wrist - (to_wrist @ h) * h
    a, b = float(to_shoulder @ across), -float(to_shoulder @ np.cross(h, across))
    size, nearest = math.hypot(a, b), math.atan2(b, a)
    # |to_shoulder - turn(-q) to_wrist|^2 is `middle` - 2 `size` cos(q - nearest).
    middle = to_shoulder @ to_shoulder + to_wrist @ to_wrist - 2.0 * (to_shoulder @ h) * (to_wrist @ h)
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
