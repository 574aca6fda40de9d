"""The audit's own view of the gripper and of what it carries; the rules are those of docs/motion.md.

What the arm's last joint carries is the gripper, and may touch what is grasped. Where the model has nothing at the
tool's point a rod stands for it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import coal
import numpy as np

from pbd.arm.audit_arm import AuditArm, Frame
from pbd.arm.audit_nodes import coordinates
from pbd.arm.audit_solids import Solid, simple_solid
from pbd.data import GraspedObject, JointTrajectory
from pbd.pose import Array

THE_TOOL = "the tool"

ROD_RADIUS_M = 0.01
"""Radius of the rod, m."""
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

    `rests`: places in base where it stands before and after, while it is held.
    """

    start: float
    end: float
    joint: int
    T_joint_object: Frame
    rests: tuple[Frame, ...] = ()


def gripper_joints(arm: AuditArm) -> frozenset[int]:
    """Return the joint that carries the tool, and all that it carries."""
    joint, _ = arm.link(arm.robot.body)
    return frozenset(each for each in range(1, len(arm.parents)) if joint in arm.carriers(each))


def tool_rod(arm: AuditArm, links: Sequence[Solid]) -> Solid | None:
    """Return the rod from the gripper's nearest point to the tool's; None where the closed gripper reaches that."""
    joint, T_joint_body = arm.link(arm.robot.body)
    T_joint_tool = T_joint_body @ Frame.of(arm.robot.T_body_tool)
    placed = arm.placements(np.append(arm.robot.home, 0.0)[None])
    T_tool_base = (placed.at(joint, 0) @ T_joint_tool).inverse()
    start, gripper = T_joint_tool.inverse().p, gripper_joints(arm)
    nearest = np.inf
    for link in links:
        if link.joint not in gripper:
            continue
        place = T_tool_base @ placed.at(link.joint, 0) @ link.T_joint_solid
        if place.p[2] + float(link.support(place.R[2:])[0]) > -ROD_GAP_M:
            return None
        distance, point = _nearest(link, place)
        if distance < nearest:
            nearest, start = distance, point
    length = float(np.linalg.norm(start))
    if length < ROD_GAP_M:
        return None
    z = -start / length
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    end = start * (ROD_SHORT_M + ROD_RADIUS_M) / length
    T_tool_rod = Frame(np.stack((x, np.cross(z, x), z), axis=1), 0.5 * (start + end))
    size = (2.0 * ROD_RADIUS_M, float(np.linalg.norm(end - start)))
    return simple_solid(THE_TOOL, joint, T_joint_tool @ T_tool_rod, "capsule", size)


def _nearest(link: Solid, T_tool_link: Frame) -> tuple[float, Array]:
    """How far a link's hull is from the tool's point, m, and its nearest point (3,) in the tool's frame."""
    result, placed = coal.DistanceResult(), coal.Transform3s(T_tool_link.R, T_tool_link.p)
    point = coal.Sphere(0.0)
    distance = coal.distance(link.rough, placed, point, coal.Transform3s.Identity(), coal.DistanceRequest(), result)
    return float(distance), np.array(result.getNearestPoint1())


def follow_object(
    arm: AuditArm, trajectory: JointTrajectory, thing: GraspedObject, table: float | None
) -> list[Carried]:
    """Say where an object is during a motion: it stands upright where it is first gripped, then goes with the gripper.

    Nothing where the gripper never closes.
    """
    carried: list[Carried] = []
    joint, T_joint_body = arm.link(arm.robot.body)
    T_joint_tool = T_joint_body @ Frame.of(arm.robot.T_body_tool)
    T_base_object, since = None, -np.inf
    for start, end in _holds(trajectory):
        T_base_tool = _tool(arm, trajectory, start)
        if T_base_object is None:
            T_base_object = _standing(T_base_tool, thing.size[-1], table)
        if np.linalg.norm(T_base_tool.p - T_base_object.p) > REACH_M + 0.5 * max(thing.size):
            continue
        T_tool_object = T_base_tool.inverse() @ T_base_object
        T_base_after = _tool(arm, trajectory, end) @ T_tool_object
        carried.append(Carried(since, start, 0, T_base_object))
        carried.append(Carried(start, end, joint, T_joint_tool @ T_tool_object, (T_base_object, T_base_after)))
        T_base_object, since = T_base_after, end
    if T_base_object is not None and since < np.inf:
        carried.append(Carried(since, np.inf, 0, T_base_object))
    return carried


def may_rest(arm: AuditArm, carried: Carried, thing: Solid, support: Solid) -> Callable[[Array], bool] | None:
    """Say at which coordinates (k + 1,) a held object may touch a support; None where it never stands on that."""
    places = [rest.p for rest in carried.rests if _stands_on(thing, rest, support)]
    if not places:
        return None

    def allowed(x: Array) -> bool:
        p = arm.placements(x[None]).at(carried.joint, 0).act(carried.T_joint_object.p)
        return any(float(np.linalg.norm(p - place)) <= REST_M for place in places)

    return allowed


def _holds(trajectory: JointTrajectory) -> list[tuple[float, float]]:
    """From when to when the gripper holds, s: it has closed, and doesn't open yet."""
    t, opening = trajectory.gripper_t, trajectory.gripper_opening
    spans: list[tuple[float, float]] = []
    changes = [i for i in range(len(t) - 1) if opening[i + 1] != opening[i]]
    closed_at: float | None = float(t[0]) if changes and opening[changes[0] + 1] > opening[changes[0]] else None
    for i in changes:
        if opening[i + 1] < opening[i]:
            closed_at = float(t[i + 1])
        elif closed_at is not None:
            spans.append((closed_at, float(t[i])))
            closed_at = None
    return spans if closed_at is None else [*spans, (closed_at, np.inf)]


def _tool(arm: AuditArm, trajectory: JointTrajectory, t: float) -> Frame:
    return arm.tool(coordinates(trajectory, np.array([min(t, trajectory.duration)]))[0, :-1])


def _standing(T_base_tool: Frame, height: float, table: float | None) -> Frame:
    """Where an object stands that is gripped here: turned as the tool is, upright, on the table if that is near."""
    yaw = np.arctan2(T_base_tool.R[1, 0], T_base_tool.R[0, 0])
    p = T_base_tool.p.copy()
    if table is not None and p[2] - table <= height:
        p[2] = table + 0.5 * height
    return Frame(np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]]), p)


def _stands_on(thing: Solid, T_base_thing: Frame, support: Solid) -> bool:
    placed = [coal.Transform3s(each.R, each.p) for each in (T_base_thing, support.T_joint_solid)]
    result, request = coal.DistanceResult(), coal.DistanceRequest()
    distance = coal.distance(thing.exact, placed[0], support.exact, placed[1], request, result)
    return bool(abs(distance) <= REST_M and -result.normal[2] >= UPRIGHT)  # the normal leads to the support
