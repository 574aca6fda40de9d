"""Inverse kinematics for arms that move their tool in fewer than six directions, and so reach most poses only in part.

**The position is met exactly. Of the rotations that remain possible, the nearest is taken; one degree between the
approach axes (the tool's z) counts as much as ten degrees of rotation about them.** If the approach axis can be met, it
is, and the rotation about it is as near as possible. If not, both are as near as the position allows.

A factor above ten would cost more than it gains: an arm whose last axis passes 8 mm beside its tool (so101) would turn
its jaws by 30 degrees to gain a twentieth of a degree of approach. With ten it loses less than that twentieth.

The solver minimizes one least-squares problem in which rotations have a small weight. It then makes the position exact,
which hardly moves the joints. Rotations are compared by their axes, |z - z_target| and so on, which gives a smooth
gradient everywhere except at half a turn.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from pbd.arm.ik.levenberg_marquardt import StopRule, descend
from pbd.arm.ik.starts import distinct, starts_of
from pbd.arm.model import ArmModel, to_se3
from pbd.errors import in_degrees, warn
from pbd.pose import Array, Pose

ABOUT_AXIS_WEIGHT = 0.1
"""Weight of the rotation about the approach axis, relative to that of the approach axis itself."""

SLACK_RAD = np.deg2rad(0.1)
"""On a path, a solution's weighted rotation error, rad, may be larger than the best solution's by up to this."""

TOLERANCE_M, TOLERANCE_RAD = 1e-5, 1e-5
"""Largest errors of the tool's position, m, and rotation, rad, at which a pose counts as reached."""

WARN_RAD = np.deg2rad(5.0)
"""Rotation error above which a warning is given, rad."""

NEAREST_STARTS, RANDOM_STARTS = 8, 16
"""Number of sampled starts near the pose, and of others at random."""
POSITION_STARTS, POSITION_STRIDE = 32, 4
"""If the position seems out of reach: number of samples near it, of which every fourth is tried, as neighbours are
alike."""

_ROUGH, _FINE = 0.3, 0.003  # m: weight of 1 rad of the approach axis, in the first descents and in the last
_ROUGH_RULE, _FINE_RULE = StopRule(steps=8), StopRule(steps=200, stalled=1.0, still=1e-7)
_KEPT = 4  # number of starts from which the last descents are made
_APART_RAD = 0.2  # descents that end closer to each other than this in every joint count as one


class PartialPose(NamedTuple):
    """Joints (k,), and the tool's error there: position, m; approach axis, rad; rotation about it, rad."""

    q: Array
    position_m: float
    approach_rad: float
    about_rad: float

    @property
    def reached(self) -> bool:
        """Whether the position is met, which is all that counts."""
        return self.position_m <= TOLERANCE_M

    @property
    def weighted_rad(self) -> float:
        """The rotation error weighted by the rule, rad."""
        return float(np.hypot(self.approach_rad, ABOUT_AXIS_WEIGHT * self.about_rad))


def is_partial(arm: ArmModel) -> bool:
    """Whether an arm can't reach any pose: it has too few joints, or too many of them move the tool alike."""
    return starts_of(arm).directions < 6


def is_redundant(arm: ArmModel) -> bool:
    """Whether an arm reaches any pose with joints to spare, so that it can move without moving its tool."""
    return len(arm.robot.joints) > 6 and not is_partial(arm)


def solve_partial(arm: ArmModel, goal: pin.SE3, q_seeds: Array) -> list[PartialPose]:
    """Find different solutions for a pose, the nearest first, from seeds (m, k) and sampled starts.

    If not even the position can be met, return only the joints nearest to it.
    """
    samples = starts_of(arm)
    starts = (q_seeds, samples.nearest(goal, NEAREST_STARTS), samples.q[:RANDOM_STARTS])
    rough = _Residual(arm, goal, _ROUGH)
    ended = [descend(rough, arm.limits, q, _ROUGH_RULE) for q in np.vstack(starts)]
    kept = [*distinct(np.array([q for q, _ in sorted(ended, key=lambda end: end[1])]), _KEPT, _APART_RAD)]
    places = [measure(arm, goal, nearest_position(arm, goal, q)) for q in kept]
    if not any(place.reached for place in places):  # the weight of the rotation may have led away from the position
        kept = [
            nearest_position(arm, goal, q) for q in samples.at(goal.translation, POSITION_STARTS)[::POSITION_STRIDE]
        ]
        places += [measure(arm, goal, q) for q in kept]
        if not any(place.reached for place in places):
            return [min(places, key=lambda place: place.position_m)]
    solutions = [refine_partial(arm, goal, q) for q in kept]
    # A descent that turns the tool may end at limits where the position cannot be met.
    found = [each for each in solutions if each.reached] or [place for place in places if place.reached]
    return sorted(found, key=lambda each: each.weighted_rad)


def refine_partial(arm: ArmModel, goal: pin.SE3, q_seed: Array) -> PartialPose:
    """Descend from a seed (k,) to a solution by the rule."""
    q, _ = descend(_Residual(arm, goal, _FINE), arm.limits, q_seed, _FINE_RULE)
    return measure(arm, goal, nearest_position(arm, goal, q))


def nearest_position(arm: ArmModel, goal: pin.SE3, q_seed: Array) -> Array:
    """Descend from a seed (k,) to the joints whose tool is nearest to a target's position, in any rotation."""
    p_goal = goal.translation

    def residual(q: Array) -> tuple[Array, Array]:
        p, _, J = arm.tool_with_jacobian(q)
        return p - p_goal, J[:3]

    return descend(residual, arm.limits, q_seed, StopRule())[0]


def measure(arm: ArmModel, goal: pin.SE3, q: Array) -> PartialPose:
    """Measure the tool's error from a pose at joints q (k,)."""
    p, R, _ = arm.tool_with_jacobian(q)
    off = goal.rotation.T @ R
    approach = np.arctan2(np.hypot(off[0, 2], off[1, 2]), off[2, 2])
    about = abs(np.arctan2(off[1, 0] - off[0, 1], off[0, 0] + off[1, 1]))
    return PartialPose(q, float(np.linalg.norm(p - goal.translation)), float(approach), float(about))


def held_poses(arm: ArmModel, T_base_tool: Sequence[Pose], q: Array) -> tuple[tuple[Pose, ...], Array]:
    """Return the poses that the arm holds at joints (n, k) found for n tool poses; warn if rotations are far off.

    Also return the errors (n, 2), rad, of the approach axis and of the rotation about it. An arm with enough joints
    holds the poses as requested; another one holds their positions with rotations of its own.
    """
    if not is_partial(arm):
        return tuple(T_base_tool), np.zeros((len(q), 2))
    found = [measure(arm, to_se3(pose), joints) for pose, joints in zip(T_base_tool, q, strict=True)]
    held = tuple(Pose(pose.p, arm.forward(joints).wxyz) for pose, joints in zip(T_base_tool, q, strict=True))
    off = np.array([(each.approach_rad, each.about_rad) for each in found]).reshape(-1, 2)
    if len(off) and off.max() > WARN_RAD:
        names = "its approach axis", "its rotation about the approach axis"
        most = zip(names, off.max(axis=0).tolist(), strict=True)
        told = ", ".join(f"{name} is off by up to {in_degrees(rad)}" for name, rad in most if round(np.degrees(rad)))
        half_turn = off[:, 1].min() > 0.5 * np.pi  # everywhere: the tool's frame is meant the other way round
        turn = "turn T_body_tool by half a turn about its own z, if the jaws are alike, " if half_turn else ""
        worst = int(np.argmax(np.hypot(off[:, 0], ABOUT_AXIS_WEIGHT * off[:, 1])))
        warn(
            f"{arm.robot.name} moves its tool in {starts_of(arm).directions} of 6 directions and can't match the "
            f"hand's orientation: {told}, worst at keyframe {worst}; {turn}use an arm that moves it in all 6, as most "
            "of six joints do, move the dock, or try a smaller --scale"
        )
    return held, off


class _Residual:
    """The error (12,), m: position, then the differences of the weighted axes x, y and z; and its Jacobian (12, k)."""

    def __init__(self, arm: ArmModel, goal: pin.SE3, weight_m: float) -> None:
        self.tool, self.p = arm.tool_with_jacobian, goal.translation
        self.weights = weight_m * np.array([ABOUT_AXIS_WEIGHT, ABOUT_AXIS_WEIGHT, 1.0])
        self.axes = goal.rotation * self.weights

    def __call__(self, q: Array) -> tuple[Array, Array]:
        p, R, J_tool = self.tool(q)
        e, J = np.empty(12), np.empty((12, len(q)))
        e[:3], J[:3] = p - self.p, J_tool[:3]
        axes = R * self.weights
        e[3:] = (axes - self.axes).T.ravel()
        for column in range(3):  # an axis a that rotates by w changes by w x a
            x, y, z = axes[:, column].tolist()
            cross = np.array(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)))
            np.dot(cross, J_tool[3:], out=J[3 + 3 * column : 6 + 3 * column])
        return e, J
