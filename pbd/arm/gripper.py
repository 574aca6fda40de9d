"""The gripper for collision checks: the links that the tool's joint carries, or a rod if the model has no gripper.

Many URDFs end at the flange, while the tool frame lies ahead of it, between the fingertips of a gripper that the model
lacks. A capsule from the flange to the tool's origin stands for that gripper. Like fingers, it may touch the grasped
object and nothing else.
"""

from collections.abc import Iterable
from functools import lru_cache

import numpy as np
import pinocchio as pin

from pbd.arm.collision.geometry import Body, body_distance, link_bodies
from pbd.arm.model import ArmModel, from_se3
from pbd.data.world import THE_TOOL
from pbd.pose import Array, Pose, quat_from_xyzw

ROD_RADIUS_M = 0.01
"""Radius of the rod, m (assumed)."""

ROD_SHORT_M = 0.005
"""Gap between the end of the rod and the tool's origin, m, since the origin may come down to the table."""

LEAST_GAP_M = 0.02
"""The rod is added if all links end farther behind the tool's origin than this, m."""

AJAR = 0.1
"""Opening, 0 closed to 1 open, at which the direction of the jaws is measured: wide enough for rounding errors not to
count."""

STILL_M = 1e-6
"""Motion, m, of the tool's origin with a finger, or of a finger away from it, below which the finger does not open."""

_AHEAD, _FLIPPED = Body("ahead", 0, Pose.identity(), "floor"), Pose(np.zeros(3), np.array([0.0, 1.0, 0.0, 0.0]))
_POINT = Body("point", 0, Pose.identity(), "sphere", (0.0,))


def opening_direction(arm: ArmModel) -> Array | None:
    """Return the direction (3,) in the tool's frame in which the jaws begin to open; None if the model has no jaws.

    It is that of the finger which moves most at the tool's origin.
    """
    closed, ajar = _joints_in_tool(arm, 0.0), _joints_in_tool(arm, AJAR)
    fingers = [] if arm.robot.gripper is None else map(arm.full.getJointId, arm.robot.gripper.joints)
    moved = [(ajar[each] @ closed[each].inverse()).p for each in fingers]
    most = max(moved, key=lambda p: float(np.linalg.norm(p)), default=np.zeros(3))
    length = float(np.linalg.norm(most))
    return most / length if length > STILL_M else None


def jaw_gap(arm: ArmModel, opening: float) -> float:
    """Return the distance, m, of the fingers from the tool's origin, which lies between them; 0 without fingers."""
    joints = _joints_in_tool(arm, opening)
    fingers = set() if arm.robot.gripper is None else {*map(arm.full.getJointId, arm.robot.gripper.joints)}
    gaps = (
        body_distance(body, joints[body.joint] @ body.T_joint_body, _POINT, Pose.identity())
        for body in link_bodies(arm)
        if not fingers.isdisjoint(arm.full.supports[body.joint])
    )
    return max(0.0, min((distance for distance, _, _ in gaps), default=0.0))


def _joints_in_tool(arm: ArmModel, opening: float) -> list[Pose]:
    """Return the poses of all joints of `full` in the tool's frame, while the arm is at home."""
    data = arm.full.createData()
    pin.forwardKinematics(arm.full, data, arm.configurations(np.append(arm.robot.home, opening)))
    T_tool_base = arm.T_joint_tool.inverse() @ from_se3(data.oMi[arm.tool_joint]).inverse()
    return [T_tool_base @ from_se3(T_base_joint) for T_base_joint in data.oMi]


def gripper_links(arm: ArmModel, bodies: Iterable[Body]) -> frozenset[str]:
    """Return the names of the bodies that the tool's joint carries; these may touch the grasped object."""
    return frozenset(body.name for body in bodies if arm.tool_joint in list(arm.full.supports[body.joint]))


@lru_cache(maxsize=16)
def arm_bodies(arm: ArmModel) -> tuple[Body, ...]:
    """Return the bodies of all links, and the rod if the model has no gripper."""
    rod = tool_rod(arm)
    return link_bodies(arm) if rod is None else (*link_bodies(arm), rod)


def tool_rod(arm: ArmModel) -> Body | None:
    """Return the rod from the nearest point of the tool's links to the tool's origin; None if they reach that far."""
    links, joints = link_bodies(arm), _joints_in_tool(arm, 0.0)
    gripper = gripper_links(arm, links)
    nearest, start = np.inf, arm.T_joint_tool.inverse().p
    for link in links:
        if link.name not in gripper:
            continue
        T_tool_body = joints[link.joint] @ link.T_joint_body
        if body_distance(link, T_tool_body, _AHEAD, _FLIPPED)[0] < LEAST_GAP_M:
            return None
        distance, p_tool, _ = body_distance(link, T_tool_body, _POINT, Pose.identity())
        if distance < nearest:
            nearest, start = distance, p_tool
    length = float(np.linalg.norm(start))
    if length < LEAST_GAP_M:
        return None
    end = start * (ROD_SHORT_M + ROD_RADIUS_M) / length
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end - start)
    T_tool_rod = Pose(0.5 * (start + end), quat_from_xyzw(turn.coeffs()))
    size = (2.0 * ROD_RADIUS_M, float(np.linalg.norm(end - start)))
    return Body(THE_TOOL, arm.tool_joint, arm.T_joint_tool @ T_tool_rod, "capsule", size)
