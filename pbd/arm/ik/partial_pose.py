"""The rule for arms of fewer than six joints, which can bring their tool only near to most poses.

**The position is met exactly. Of the rotations that this leaves the nearest is taken, where a degree between the
approach axes (the tool's z) counts as much as ten degrees of rotation about them.** Where the approach axis can be met
it is, and the rotation about it is as near as possible; where it can't, both are as near as the position allows.

A larger factor than ten would cost more than it gains: an arm whose last axis passes 8 mm beside its tool (so101) would
turn its jaws by 30 degrees to gain a twentieth of a degree of approach. With ten it loses less than that twentieth.

One least-squares problem is solved in which rotations have a small weight, then the position is made exact, which
hardly moves the joints. Rotations are compared by their axes, |z - z_target| and so on: the gradient is smooth
everywhere but at half a turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pbd.arm.ik.levenberg_marquardt import descend
from pbd.arm.ik.starts import starts_of
from pbd.arm.model import ArmModel, to_se3
from pbd.errors import warn
from pbd.pose import Array, Pose

FULL_POSE = 6
"""Joints needed to bring a tool to any pose."""

ABOUT_AXIS = 0.1
"""Weight of rotation about the approach axis, against that of the axis itself."""

SLACK_RAD = np.deg2rad(0.1)
"""A path may use any solution whose rotation, weighted by the rule, is this close to the nearest."""

NEAR_M, EXACT_M = 1e-5, 1e-9
"""Tolerance of the position, and the accuracy to which it is solved."""

TELL_RAD = np.deg2rad(5.0)
"""Rotation error above which a warning is given."""

NEAREST, ANYWHERE = 8, 16
"""Samples to start from: near the pose, and anywhere."""
AT_PLACE, EVERY = 32, 4
"""Where the position seems out of reach: samples near it, of which every so many is tried (neighbours are alike)."""

_ROUGH, _FINE = 0.3, 0.003  # m: what a rotation of one rad of the approach axis weighs, at first and at last
_ROUGH_STEPS, _FINE_STEPS = 8, 200
_KEPT = 4  # starts that are followed to the end
_APART_RAD = 0.2  # starts that end nearer to each other than this are one
_STILL_RAD = 1e-7


class PartialPose(NamedTuple):
    """Joints (k,), and how far from a pose they bring the tool: m, rad, rad."""

    q: Array
    position_m: float
    approach_rad: float
    about_rad: float

    @property
    def reached(self) -> bool:
        """Whether the position is met: it is all that is asked for."""
        return self.position_m <= NEAR_M

    @property
    def off(self) -> float:
        """How far the rotation is off, in rad, weighted by the rule."""
        return float(np.hypot(self.approach_rad, ABOUT_AXIS * self.about_rad))


def is_partial(arm: ArmModel) -> bool:
    """Whether an arm has too few joints for any pose."""
    return len(arm.robot.joints) < FULL_POSE


def solve_partial(arm: ArmModel, goal: pin.SE3, q_seeds: Array) -> list[PartialPose]:
    """Find different joints near to a pose, from seeds (m, k) and from the arm's own samples: the nearest first.

    Where not even the position can be met there is one: the nearest position.
    """
    samples = starts_of(arm)
    starts = (q_seeds, samples.nearest(goal, NEAREST), samples.q[:ANYWHERE])
    rough, bounds = _Residual(arm, goal, _ROUGH), (arm.limits.lower, arm.limits.upper)
    ended = [descend(rough, bounds, q, steps=_ROUGH_STEPS) for q in np.vstack(starts)]
    kept: list[Array] = []
    for q, _ in sorted(ended, key=lambda end: end[1]):
        if all(np.abs(q - other).max() > _APART_RAD for other in kept) and len(kept) < _KEPT:
            kept.append(q)
    places = [measure(arm, goal, nearest_place(arm, goal, q)) for q in kept]
    if not any(place.reached for place in places):  # the rotation may have led away from the position
        kept = [nearest_place(arm, goal, q) for q in samples.at(goal.translation, AT_PLACE)[::EVERY]]
        places += [measure(arm, goal, q) for q in kept]
        if not any(place.reached for place in places):
            return [min(places, key=lambda place: place.position_m)]
    ways = [finish(arm, goal, q) for q in kept]
    # Turning the tool may end at limits from which the position is lost.
    found = [way for way in ways if way.reached] or [place for place in places if place.reached]
    return sorted(found, key=lambda way: way.off)


def finish(arm: ArmModel, goal: pin.SE3, q_seed: Array) -> PartialPose:
    """Descend from a seed (k,) to the nearest joints by the rule."""
    bounds = (arm.limits.lower, arm.limits.upper)
    q, _ = descend(
        _Residual(arm, goal, _FINE), bounds, q_seed, steps=_FINE_STEPS, solved=EXACT_M**2, stalled=1.0, still=_STILL_RAD
    )
    return measure(arm, goal, nearest_place(arm, goal, q))


def nearest_place(arm: ArmModel, goal: pin.SE3, q_seed: Array) -> Array:
    """Descend from a seed (k,) to the joints whose tool is nearest to a target's position, whatever its rotation."""
    p_goal = goal.translation

    def residual(q: Array) -> tuple[Array, Array]:
        p, _, J = arm.tool(q)
        return p - p_goal, J[:3]

    q, _ = descend(residual, (arm.limits.lower, arm.limits.upper), q_seed, solved=EXACT_M**2)
    return q


def measure(arm: ArmModel, goal: pin.SE3, q: Array) -> PartialPose:
    """Measure how far joints (k,) bring the tool from a pose: its approach axis, then the shortest turn about it."""
    p, R, _ = arm.tool(q)
    off = goal.rotation.T @ R
    approach = np.arctan2(np.hypot(off[0, 2], off[1, 2]), off[2, 2])
    about = abs(np.arctan2(off[1, 0] - off[0, 1], off[0, 0] + off[1, 1]))
    return PartialPose(q, float(np.linalg.norm(p - goal.translation)), float(approach), float(about))


def hold(arm: ArmModel, T_base_tool: Sequence[Pose], q: Array) -> tuple[tuple[Pose, ...], Array]:
    """Return the tool's poses at the joints (n, k) that were found for n tool poses; warn where they are far off.

    With them how far off (n, 2) they are, rad: the approach axis, and the rotation about it. An arm with enough joints
    has the poses that were asked for, another one their positions with rotations of its own.
    """
    if not is_partial(arm):
        return tuple(T_base_tool), np.zeros((len(q), 2))
    found = [measure(arm, to_se3(pose), joints) for pose, joints in zip(T_base_tool, q, strict=True)]
    held = tuple(Pose(pose.p, arm.forward(joints).wxyz) for pose, joints in zip(T_base_tool, q, strict=True))
    off = np.array([(each.approach_rad, each.about_rad) for each in found]).reshape(-1, 2)
    if len(off) and off.max() > TELL_RAD:
        approach, about = np.rad2deg(off.max(axis=0))
        worst = int(np.argmax(np.hypot(off[:, 0], ABOUT_AXIS * off[:, 1])))
        warn(
            f"{arm.robot.name} has {q.shape[1]} joints and can't match the hand's orientation: its approach axis is up "
            f"to {approach:.0f} degrees off, the rotation about it up to {about:.0f} degrees, worst at keyframe "
            f"{worst}; use an arm with six joints, or move the dock"
        )
    return held, off


class _Residual:
    """The error (12,): position in m, then the tool's axes z, x and y less the target's, by their weights; with J."""

    def __init__(self, arm: ArmModel, goal: pin.SE3, weight_m: float) -> None:
        self.tool, self.p = arm.tool, goal.translation
        self.weights = weight_m * np.array([ABOUT_AXIS, ABOUT_AXIS, 1.0])
        self.axes = goal.rotation * self.weights

    def __call__(self, q: Array) -> tuple[Array, Array]:
        p, R, J_tool = self.tool(q)
        e, J = np.empty(12), np.empty((12, len(q)))
        e[:3], J[:3] = p - self.p, J_tool[:3]
        axes = R * self.weights
        e[3:] = (axes - self.axes).T.ravel()
        for column in range(3):  # an axis a that turns by w moves by w x a
            x, y, z = axes[:, column].tolist()
            cross = np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)))
            np.dot(cross, J_tool[3:], out=J[3 + 3 * column : 6 + 3 * column])
        return e, J
