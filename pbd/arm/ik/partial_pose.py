"""The rule for arms of fewer than six joints, which can't bring their tool to a pose but only near it.

**The position is met exactly. Of the rotations that this leaves, the nearest is taken, where a degree between the
approach axes (the tool's z) counts as much as ten degrees of rotation about them.** So where the approach axis can be
met it is, and the rotation about it comes as near as it can; where it can't, both are as near as the position allows.

Ten, and not without end: an arm whose last axis passes 8 mm beside its tool (so101) would turn its jaws by 30 degrees
to gain a twentieth of a degree of approach. At ten it gives away less than that twentieth.

It is solved as one least-squares problem in which rotations weigh little against the position, and then the position
is made exact, which moves the joints by next to nothing. Rotations are compared by their axes, |z - z_target| and so
on, which has a smooth gradient everywhere but at half a turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pbd.arm.ik.levenberg_marquardt import descend
from pbd.arm.ik.starts import starts_of
from pbd.arm.model import ArmModel
from pbd.arm.tool import Target, in_universe, target, tool_in_universe
from pbd.errors import warn
from pbd.pose import Array, Pose

FULL_POSE = 6
"""Joints that it takes to bring a tool to any pose."""

ABOUT_AXIS = 0.1
"""Weight of rotation about the approach axis, against that of the axis itself."""

SLACK_RAD = np.deg2rad(0.1)
"""A path may take any solution whose rotation is this close to the nearest, as the rule counts."""

NEAR_M, EXACT_M = 1e-5, 1e-9
"""Tolerance of the position, and the accuracy to which it is solved."""

TELL_RAD = np.deg2rad(5.0)
"""Rotation error above which a warning is given."""

NEAREST, ANYWHERE = 8, 16
"""Samples to start from: near the pose, and from all over."""
AT_PLACE, EVERY = 32, 4
"""Where the place seems out of reach: samples near it, and the share of them that is tried (neighbours lead to one)."""

_ROUGH, _FINE = 0.3, 0.003  # m: what a rotation of one rad of the approach axis weighs, at first and at last
_ROUGH_STEPS, _FINE_STEPS = 8, 200
_KEPT = 4  # of the starts are followed to the end
_APART_RAD = 0.2  # starts that come nearer to each other than this are one
_STILL_RAD = 1e-7


class PartialPose(NamedTuple):
    """The joints (k,) that come nearest to a pose by the rule, and how near: m, rad, rad."""

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
        """How far the rotation is off, in rad, as the rule counts."""
        return float(np.hypot(self.approach_rad, ABOUT_AXIS * self.about_rad))


def is_partial(arm: ArmModel) -> bool:
    """Whether an arm has too few joints for any pose."""
    return len(arm.robot.joints) < FULL_POSE


def solve_partial(arm: ArmModel, goal: Target, q_seeds: Array) -> list[PartialPose]:
    """Find different ways to come near to a pose, from seeds (m, k) and from the arm's own: the nearest first.

    Where not even the position can be met there is one: the nearest place.
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
    if not any(place.reached for place in places):  # not yet: the rotation may have led away from where it can be
        kept = [nearest_place(arm, goal, q) for q in samples.at(goal.p, AT_PLACE)[::EVERY]]
        places += [measure(arm, goal, q) for q in kept]
        if not any(place.reached for place in places):
            return [min(places, key=lambda place: place.position_m)]
    ways = [finish(arm, goal, q) for q in kept]
    # Turning the tool right may run into limits, from which the way back to the place is barred.
    found = [way for way in ways if way.reached] or [place for place in places if place.reached]
    return sorted(found, key=lambda way: way.off)


def finish(arm: ArmModel, goal: Target, q_seed: Array) -> PartialPose:
    """Go from a seed (k,) down to the nearest way to hold the tool by the rule."""
    bounds = (arm.limits.lower, arm.limits.upper)
    q, _ = descend(
        _Residual(arm, goal, _FINE), bounds, q_seed, steps=_FINE_STEPS, solved=EXACT_M**2, stalled=1.0, still=_STILL_RAD
    )
    return measure(arm, goal, nearest_place(arm, goal, q))


def nearest_place(arm: ArmModel, goal: Target, q_seed: Array) -> Array:
    """Go from a seed (k,) down to the joints whose tool is nearest to a target's position, however it is turned."""
    tool, p_target = tool_in_universe(arm), in_universe(arm, goal).p

    def look(q: Array) -> tuple[Array, Array]:
        p, _, J = tool(q)
        return p - p_target, J[:3]

    q, _ = descend(look, (arm.limits.lower, arm.limits.upper), q_seed, solved=EXACT_M**2)
    return q


def measure(arm: ArmModel, goal: Target, q: Array) -> PartialPose:
    """Say how near joints (k,) bring the tool to a pose: its approach axis first, then the shortest turn about it."""
    p, R, _ = tool_in_universe(arm)(q)
    p_target, R_target = in_universe(arm, goal)
    off = R_target.T @ R
    approach = np.arctan2(np.hypot(off[0, 2], off[1, 2]), off[2, 2])
    about = abs(np.arctan2(off[1, 0] - off[0, 1], off[0, 0] + off[1, 1]))
    return PartialPose(q, float(np.linalg.norm(p - p_target)), float(approach), float(about))


def hold(arm: ArmModel, T_base_tool: Sequence[Pose], q: Array) -> tuple[tuple[Pose, ...], Array]:
    """Say which poses in base an arm holds at the joints (n, k) found for n tool poses; warn where that is far off.

    With them how far off (n, 2) they are, rad: the approach axis, and the rotation about it.
    Of an arm with joints enough they are those asked for. Of another the positions are, and the rotations its own.
    """
    if not is_partial(arm):
        return tuple(T_base_tool), np.zeros((len(q), 2))
    found = [measure(arm, target(pose), joints) for pose, joints in zip(T_base_tool, q, strict=True)]
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

    def __init__(self, arm: ArmModel, goal: Target, weight_m: float) -> None:
        self.tool = tool_in_universe(arm)
        self.p, self.R = in_universe(arm, goal)
        self.weights = weight_m * np.array([ABOUT_AXIS, ABOUT_AXIS, 1.0])

    def __call__(self, q: Array) -> tuple[Array, Array]:
        p, R, J_tool = self.tool(q)
        e, J = np.empty(12), np.empty((12, len(q)))
        e[:3], J[:3] = p - self.p, J_tool[:3]
        axes = R * self.weights
        e[3:] = (axes - self.R * self.weights).T.ravel()
        for column in range(3):  # an axis a that turns by w moves by w x a
            x, y, z = axes[:, column].tolist()
            cross = np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)))
            np.dot(cross, J_tool[3:], out=J[3 + 3 * column : 6 + 3 * column])
        return e, J
