"""The audit's own view of the gripper and of what it carries; the rules are those of docs/motion.md.

What the arm's last joint carries is the gripper, and may touch what is grasped. Where the model has nothing at the
tool's point a rod stands for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from pbd.audit.arm import AuditArm
from pbd.audit.solids import Solid, simple_solid
from pbd.audit.touch import coordinates
from pbd.data import GraspedObject, JointTrajectory

THE_TOOL = "the tool"

ROD_RADIUS_M = 0.01

ROD_SHORT_M = 0.005
"""How far before the tool's point the rod ends, m."""

ROD_GAP_M = 0.02
"""A gripper that ends closer than this to the tool's point, m, needs no rod."""

REST_M = 0.03
"""Within this of where it was gripped or is let go, m, a held object may touch what it stands on there."""

REACH_M = 0.05
"""A gripper that closes farther than this from an object's outside, m, doesn't take it."""

UPRIGHT = float(np.cos(np.radians(45.0)))
"""What an object stands on faces upward: the least z of its normal."""


@dataclass(frozen=True, eq=False)
class Carried:
    """Where an object is from `start` to `end` (s): on a joint, 0 where it stands still.

    `rests`: places in the universe where it stands before and after, while it is held.
    """

    start: float
    end: float
    joint: int
    T_joint_object: Any
    rests: tuple[Any, ...] = ()


def gripper_joints(arm: AuditArm) -> frozenset[int]:
    """Return the joint that carries the tool, and all that it carries."""
    return frozenset(each for each in range(1, arm.model.njoints) if arm.tool_joint in arm.carriers(each))


def tool_rod(arm: AuditArm, links: Sequence[Solid]) -> Solid | None:
    """Return the rod from the gripper's nearest point to the tool's; None where the closed gripper reaches that."""
    placed = arm.place(np.append(arm.robot.home, 0.0))
    T_tool_universe = (placed[arm.tool_joint] * arm.T_joint_tool).inverse()
    start, gripper = arm.T_joint_tool.inverse().translation, gripper_joints(arm)
    nearest = np.inf
    for link in links:
        if link.joint not in gripper:
            continue
        T_tool_link = T_tool_universe * placed[link.joint] * link.T_joint_solid
        ahead, _ = _apart(link.hull, T_tool_link, coal.Halfspace(np.array([0.0, 0.0, -1.0]), ROD_GAP_M))
        if ahead < 0.0:
            return None
        distance, found = _apart(link.hull, T_tool_link, coal.Sphere(0.0))
        if distance < nearest:
            nearest, start = distance, np.array(found.getNearestPoint1())
    length = float(np.linalg.norm(start))
    if length < ROD_GAP_M:
        return None
    end = start * (ROD_SHORT_M + ROD_RADIUS_M) / length
    z = -start / length
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    T_tool_rod = pin.SE3(np.stack((x, np.cross(z, x), z), axis=1), 0.5 * (start + end))
    size = (2.0 * ROD_RADIUS_M, float(np.linalg.norm(end - start)))
    return simple_solid(THE_TOOL, arm.tool_joint, arm.T_joint_tool * T_tool_rod, "capsule", size)


def follow_object(
    arm: AuditArm, trajectory: JointTrajectory, thing: GraspedObject, table: float | None
) -> list[Carried]:
    """Say where an object is during a motion: it stands upright where it is first gripped, then goes with the gripper.

    Nothing where the gripper never closes.
    """
    carried: list[Carried] = []
    T_base_object, since = None, -np.inf

    def tool(t: float) -> Any:
        return arm.tool(coordinates(trajectory, np.array([min(t, trajectory.duration)]))[0])

    for start, end in _holds(trajectory):
        T_base_tool = tool(start)
        if T_base_object is None:
            T_base_object = _standing(T_base_tool, thing.size[-1], table)
        if np.linalg.norm(T_base_tool.translation - T_base_object.translation) > REACH_M + 0.5 * max(thing.size):
            continue
        T_tool_object = T_base_tool.inverse() * T_base_object
        rests = tuple(arm.T_universe_base * each for each in (T_base_object, tool(end) * T_tool_object))
        carried.append(Carried(since, start, 0, rests[0]))
        carried.append(Carried(start, end, arm.tool_joint, arm.T_joint_tool * T_tool_object, rests))
        T_base_object, since = tool(end) * T_tool_object, end
    if T_base_object is not None and since < np.inf:
        carried.append(Carried(since, np.inf, 0, arm.T_universe_base * T_base_object))
    return carried


def may_rest(arm: AuditArm, carried: Carried, thing: Solid, support: Solid) -> Callable[[Any], bool] | None:
    """Say at which T_universe_joint a held object may touch a support; None where it never stands on that."""
    up = arm.T_universe_base.rotation[:, 2]
    places = []
    for rest in carried.rests:
        distance, found = _apart(thing.hull, support.T_joint_solid.inverse() * rest, support.hull)
        # The normal leads to the support.
        if abs(distance) <= REST_M and -(support.T_joint_solid.rotation @ found.normal) @ up >= UPRIGHT:
            places.append(rest.translation)
    if not places:
        return None

    def allowed(T_universe_joint: Any) -> bool:
        p = (T_universe_joint[carried.joint] * carried.T_joint_object).translation
        return any(float(np.linalg.norm(p - place)) <= REST_M for place in places)

    return allowed


def _holds(trajectory: JointTrajectory) -> list[tuple[float, float]]:
    """From when to when the gripper holds, s: it has closed, and doesn't open yet."""
    t, opening = trajectory.gripper_t, trajectory.gripper_opening
    changes = [i for i in range(len(t) - 1) if opening[i + 1] != opening[i]]
    closed_at: float | None = float(t[0]) if changes and opening[changes[0] + 1] > opening[changes[0]] else None
    spans: list[tuple[float, float]] = []
    for i in changes:
        if opening[i + 1] < opening[i]:
            closed_at = float(t[i + 1])
        elif closed_at is not None:
            spans.append((closed_at, float(t[i])))
            closed_at = None
    return spans if closed_at is None else [*spans, (closed_at, np.inf)]


def _standing(T_base_tool: Any, height: float, table: float | None) -> Any:
    """Where an object stands that is gripped here: turned as the tool is, upright, on the table if that is near."""
    x, p = T_base_tool.rotation[:, 0], T_base_tool.translation.copy()
    if table is not None and p[2] - table <= height:
        p[2] = table + 0.5 * height
    return pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, float(np.arctan2(x[1], x[0]))), p)


def _apart(shape: Any, T: Any, other: Any) -> tuple[float, Any]:
    """Distance in m of a shape from another at the origin, and coal's result."""
    result, placed = coal.DistanceResult(), coal.Transform3s(T.rotation, T.translation)
    distance = coal.distance(shape, placed, other, coal.Transform3s.Identity(), coal.DistanceRequest(), result)
    return float(distance), result
