"""The audit's own view of the gripper and of the object that it carries; docs/motion.md has the rules.

The object's pose follows from the tool's (pbd.data.world), which the audit computes itself. The gripper, which is
all links beyond the arm's last joint, may touch the grasped object. Where the model has no solid at the tool's point,
a rod stands for the tool.
"""

from collections.abc import Callable, Sequence
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from pbd.audit.arm import AuditArm, se3
from pbd.audit.contact import coordinates
from pbd.audit.limits import ROUNDING, fail
from pbd.audit.solids import Solid, simple_solid
from pbd.data import GraspedObject, JointTrajectory, Robot
from pbd.data.world import THE_TOOL, ObjectPhase, gripped_spans, object_phases
from pbd.pose import Pose

ROD_RADIUS_M = 0.01
"""Radius of the rod, m (assumed)."""

ROD_SHORT_M = 0.005
"""Distance, m, from the end of the rod to the tool's point."""

ROD_GAP_M = 0.02
"""Distance, m, from the gripper to the tool's point, below which no rod is needed."""

NEAR_SUPPORT_M = 0.03
"""A held object may touch its support within this distance, m, of where it is gripped or let go."""

LEAST_NORMAL_UP = float(np.cos(np.radians(45.0)))
"""Smallest z of the normal of a surface on which an object can stand."""


def check_grips(trajectory: JointTrajectory, robot: Robot, grips: Sequence[bool | None]) -> None:
    """Check that the gripper closes (True) and opens (False) at its keyframes, while the arm stands, and only there.

    Raises:
        PlanError: it does not.
    """
    t, opening, before, strokes = trajectory.gripper_t, trajectory.gripper_opening, 1.0, 0
    gripper, moves = robot.gripper, trajectory.coefficients[:, 1:].any(axis=(1, 2))
    for keyframe, (arrives, closes) in enumerate(zip(trajectory.keyframe_t, grips, strict=True)):
        after = before if closes is None else float(not closes)
        if gripper is None or after == before:
            continue
        ends = arrives + gripper.stroke_s
        during = (trajectory.knots[1:] > arrives) & (trajectory.knots[:-1] < ends)
        off = np.abs(np.interp((arrives, ends), t, opening) - (before, after)).max()
        if off > ROUNDING or (moves & during).any():
            fail(f"there is no stroke of the gripper at keyframe {keyframe} while the arm stands", keyframe=keyframe)
        before, strokes = after, strokes + 1
    if np.abs(np.diff(opening, prepend=1.0)).sum() > strokes + ROUNDING:
        fail("the gripper moves where it should not")


def gripper_joints(arm: AuditArm) -> frozenset[int]:
    """Return the joint that carries the tool, and all joints beyond it."""
    return frozenset(each for each in range(1, arm.model.njoints) if arm.tool_joint in arm.ancestors(each))


def tool_rod(arm: AuditArm, links: Sequence[Solid]) -> Solid | None:
    """Return a rod from the gripper's nearest point to the tool's point; None where the closed gripper reaches it."""
    placed = arm.joint_poses(np.append(arm.robot.home, 0.0))
    T_tool_universe = (placed[arm.tool_joint] * arm.T_joint_tool).inverse()
    start, gripper = arm.T_joint_tool.inverse().translation, gripper_joints(arm)
    nearest = np.inf
    for link in links:
        if link.joint not in gripper:
            continue
        T_tool_link = T_tool_universe * placed[link.joint] * link.T_joint_solid
        ahead, _ = _distance(link.hull, T_tool_link, coal.Halfspace(np.array([0.0, 0.0, -1.0]), ROD_GAP_M))
        if ahead < 0.0:
            return None
        distance, found = _distance(link.hull, T_tool_link, coal.Sphere(0.0))
        if distance < nearest:
            nearest, start = distance, np.array(found.getNearestPoint1())
    length = float(np.linalg.norm(start))
    if length < ROD_GAP_M:
        return None
    end = start * (ROD_SHORT_M + ROD_RADIUS_M) / length
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), -start)
    T_tool_rod = pin.SE3(turn.matrix(), 0.5 * (start + end))
    size = (2.0 * ROD_RADIUS_M, float(np.linalg.norm(end - start)))
    return simple_solid(THE_TOOL, arm.tool_joint, arm.T_joint_tool * T_tool_rod, "capsule", size)


def follow_object(
    arm: AuditArm, trajectory: JointTrajectory, grasped: GraspedObject, table: float | None
) -> tuple[ObjectPhase, ...]:
    """Return where an object is during a motion, from the tool's poses as the audit computes them."""

    def tool(t: float) -> Pose:  # an object that is never let go counts as resting at the last keyframe
        return arm.tool_pose(coordinates(trajectory, np.array([min(t, *trajectory.keyframe_t[-1:])]))[0])

    return object_phases(grasped, gripped_spans(trajectory.gripper_t, trajectory.gripper_opening), tool, table)


def resting_contact(arm: AuditArm, phase: ObjectPhase, held: Solid, support: Solid) -> Callable[[Any], bool]:
    """Return a function of T_universe_joint that says whether the held object may touch a support.

    It may near the places where it was gripped or let go, if it stood on that support there.
    """
    up = arm.T_universe_base.rotation[:, 2]
    places = []
    for rest in (arm.T_universe_base * se3(pose) for pose in phase.rests):
        distance, found = _distance(held.hull, support.T_joint_solid.inverse() * rest, support.hull)
        # coal's normal points from the object to the support.
        if abs(distance) <= NEAR_SUPPORT_M and -(support.T_joint_solid.rotation @ found.normal) @ up >= LEAST_NORMAL_UP:
            places.append(rest.translation)

    def allowed(T_universe_joint: Any) -> bool:
        p = (T_universe_joint[held.joint] * held.T_joint_solid).translation
        return any(float(np.linalg.norm(p - place)) <= NEAR_SUPPORT_M for place in places)

    return allowed


def _distance(shape: Any, T: Any, other: Any) -> tuple[float, Any]:
    """Return the distance, m, of a shape at pose T from another at the origin, and coal's result."""
    result, placed = coal.DistanceResult(), coal.Transform3s(T.rotation, T.translation)
    distance = coal.distance(shape, placed, other, coal.Transform3s.Identity(), coal.DistanceRequest(), result)
    return float(distance), result
