"""The audit's own model of an arm: where its joints are, and how far they can move a point.

Coordinates `x` are (k + 1,): the arm's joints (rad; m for a sliding joint), then the gripper's opening: 1 is open, 0
is closed. "universe" is the world frame of pinocchio's model, the root of the URDF.
"""

from typing import Any

import numpy as np
import pinocchio as pin

from pbd.data import Robot
from pbd.io.urdf import kinematics_xml
from pbd.pose import Array, Pose, quat_to_matrix


def se3(pose: Pose) -> Any:
    """Convert a Pose to pinocchio's SE3."""
    return pin.SE3(quat_to_matrix(pose.wxyz), pose.p)


class AuditArm:
    """An arm, loaded from its URDF independently of the planner.

    Attributes:
        model: pinocchio's model of the whole URDF.
        T_universe_base: pose of the robot's base.
        tool_joint, T_joint_tool: index of the joint that carries the tool, and the tool's pose in that joint's frame.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.model: Any = pin.buildModelFromXML(kinematics_xml(robot.urdf))
        self._data = self.model.createData()
        # Joint -> (column of x, slope, offset). Joint value = offset + slope * x[column].
        self._drives: dict[int, tuple[int, float, float]] = {}
        for column, name in enumerate(robot.joints):
            self._drives[self.model.getJointId(name)] = (column, 1.0, 0.0)
        if gripper := robot.gripper:
            for name, opened, closed in zip(gripper.joints, gripper.open, gripper.closed, strict=True):
                self._drives[self.model.getJointId(name)] = (len(robot.joints), float(opened - closed), float(closed))
        for each in robot.mimic_joints:
            leader = robot.joints.index(each.leader)
            self._drives[self.model.getJointId(each.joint)] = (leader, each.multiplier, each.offset)
        self._column, self._slope, self._offset = map(np.array, zip(*self._drives.values(), strict=True))
        self._neutral = pin.neutral(self.model)
        at = np.array([self.model.joints[joint].idx_q for joint in self._drives])
        scalar = np.array([self.model.joints[joint].nq == 1 for joint in self._drives])
        self._scalar, self._scalar_at = scalar, at[scalar]
        self._endless_at = at[~scalar]  # pinocchio represents an endless joint by cosine and sine
        joint, T_joint_base = self.link_on_joint(robot.base)  # undriven joint, but not always the universe
        pin.forwardKinematics(self.model, self._data, self._neutral)
        self.T_universe_base = self._data.oMi[joint] * T_joint_base
        self.tool_joint, T_joint_body = self.link_on_joint(robot.body)
        self.T_joint_tool = T_joint_body * se3(robot.T_body_tool)

    def link_on_joint(self, name: str) -> tuple[int, Any]:
        """Return the joint that carries a link, and the link's pose in that joint's frame."""
        frame = self.model.frames[self.model.getFrameId(name, pin.FrameType.BODY)]
        return int(frame.parentJoint), frame.placement

    def joint_poses(self, x: Array) -> Any:
        """Return T_universe_joint of all joints at coordinates x (k + 1,)."""
        return self.joint_poses_at(self.configurations(x))

    def joint_poses_at(self, q: Array) -> Any:
        """Return T_universe_joint of all joints at pinocchio's configuration q (nq,)."""
        pin.forwardKinematics(self.model, self._data, q)
        return pin.StdVec_SE3(self._data.oMi)

    def configurations(self, x: Array) -> Array:
        """Return pinocchio's configurations (..., nq) at coordinates x (..., k + 1)."""
        values = self._offset + self._slope * x[..., self._column]
        q = np.empty((*x.shape[:-1], self.model.nq))
        q[...] = self._neutral
        q[..., self._scalar_at], angles = values[..., self._scalar], values[..., ~self._scalar]
        q[..., self._endless_at], q[..., self._endless_at + 1] = np.cos(angles), np.sin(angles)
        return q

    def tool_pose(self, x: Array) -> Pose:
        """Return T_base_tool at coordinates x (k + 1,)."""
        T_universe_tool = self.joint_poses(x)[self.tool_joint] * self.T_joint_tool
        return Pose.from_matrix((self.T_universe_base.inverse() * T_universe_tool).homogeneous)

    def drive_matrix(self) -> Array:
        """Return the matrix (nv, k) that maps velocities of the arm's joints to those of all joints of the model."""
        k = len(self.robot.joints)
        gears = np.zeros((self.model.nv, k))
        for joint, (column, slope, _) in self._drives.items():
            if column < k:
                gears[self.model.joints[joint].idx_v, column] = slope
        return gears

    def ancestors(self, joint: int) -> list[int]:
        """Return a joint and its ancestors, child first."""
        return list(self.model.supports[joint])[:0:-1]

    def driven_ancestors(self, joint: int) -> frozenset[int]:
        """Return those of `ancestors` that the arm or the gripper moves."""
        return frozenset(self.ancestors(joint)) & self._drives.keys()

    def motion_bounds(self, joint: int, reach: float) -> dict[int, Array]:
        """Bound how far each driven ancestor of `joint` moves a point: ancestor -> (k + 1,) m per unit of x.

        Args:
            joint: index of the joint that carries the point.
            reach: m, largest distance of the point from the joint's origin.
        """
        bounds = {}
        for ancestor in self.ancestors(joint):
            slides = self.model.joints[ancestor].shortname().startswith("JointModelP")
            column, slope, offset = self._drives.get(ancestor, (0, 0.0, 0.0))
            if slope:
                bounds[ancestor] = np.zeros(len(self.robot.joints) + 1)
                bounds[ancestor][column] = abs(slope) * (1.0 if slides else reach)
            # The point's distance from the previous joint grows at most by the link's length and this joint's slide.
            reach += float(np.linalg.norm(self.model.jointPlacements[ancestor].translation))
            if slides and slope:
                limits = self.robot.limits
                ends = (limits.lower[column], limits.upper[column]) if column < len(self.robot.joints) else (0.0, 1.0)
                reach += max(abs(offset + slope * float(end)) for end in ends)
        return bounds
