"""The audit's own model of an arm: where its joints are, and how far they can move a point.

Coordinates `x` are (k + 1,): the arm's joints (rad; m where one slides), then the gripper's opening, 1 open to 0
closed. Places are in pinocchio's world ("universe").
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from pbd.data import Robot
from pbd.pose import Array, Pose, quat_to_matrix


def se3(pose: Pose) -> Any:
    """Write a Pose as pinocchio's."""
    return pin.SE3(quat_to_matrix(pose.wxyz), pose.p)


class AuditArm:
    """An arm, loaded anew.

    Attributes:
        model: pinocchio's model of the whole URDF.
        T_universe_base: where the robot's base is.
        tool_joint, T_joint_tool: what carries the tool, and where the tool is on it.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.model: Any = pin.buildModelFromUrdf(str(robot.urdf))
        self._data = self.model.createData()
        self._drives: dict[int, tuple[int, float, float]] = {}  # by joint: column of x; value = at_zero + slope * x
        for column, name in enumerate(robot.joints):
            self._drives[self.model.getJointId(name)] = (column, 1.0, 0.0)
        if gripper := robot.gripper:
            for name, opened, closed in zip(gripper.joints, gripper.open, gripper.closed, strict=True):
                self._drives[self.model.getJointId(name)] = (len(robot.joints), float(opened - closed), float(closed))
        self._column, self._slope, self._at_zero = map(np.array, zip(*self._drives.values(), strict=True))
        self._neutral = pin.neutral(self.model)
        at = np.array([self.model.joints[joint].idx_q for joint in self._drives])
        self._turns_once = np.array([self.model.joints[joint].nq == 1 for joint in self._drives])
        self._plain, self._round = at[self._turns_once], at[~self._turns_once]  # endless ones: cosine and sine
        joint, T_joint_base = self.link(robot.base)  # that joint stands still, but needn't be at the root
        pin.forwardKinematics(self.model, self._data, self._neutral)
        self.T_universe_base = self._data.oMi[joint] * T_joint_base
        self.tool_joint, T_joint_body = self.link(robot.body)
        self.T_joint_tool = T_joint_body * se3(robot.T_body_tool)

    def link(self, name: str) -> tuple[int, Any]:
        """Return the joint that carries a link, and the link's place on it."""
        frame = self.model.frames[self.model.getFrameId(name, pin.FrameType.BODY)]
        return int(frame.parentJoint), frame.placement

    def place(self, x: Array) -> Any:
        """Return T_universe_joint of all joints at coordinates x (k + 1,)."""
        return self.place_at(self.configurations(x))

    def place_at(self, q: Array) -> Any:
        """Return T_universe_joint of all joints at pinocchio's configuration q (nq,)."""
        pin.forwardKinematics(self.model, self._data, q)
        return pin.StdVec_SE3(self._data.oMi)

    def configurations(self, x: Array) -> Array:
        """Return pinocchio's configurations (..., nq) at coordinates x (..., k + 1)."""
        values = self._at_zero + self._slope * x[..., self._column]
        q = np.empty((*x.shape[:-1], self.model.nq))
        q[...] = self._neutral
        q[..., self._plain], angles = values[..., self._turns_once], values[..., ~self._turns_once]
        q[..., self._round], q[..., self._round + 1] = np.cos(angles), np.sin(angles)
        return q

    def tool(self, x: Array) -> Any:
        """T_base_tool at coordinates x (k + 1,)."""
        return self.T_universe_base.inverse() * self.place(x)[self.tool_joint] * self.T_joint_tool

    def carriers(self, joint: int) -> list[int]:
        """The joint and those that carry it, up to base."""
        return list(self.model.supports[joint])[:0:-1]

    def driven(self, joint: int) -> frozenset[int]:
        """Those of a joint and its carriers that the arm or the gripper drives."""
        return frozenset(self.carriers(joint)) & self._drives.keys()

    def motion(self, joint: int, reach: float) -> dict[int, Array]:
        """Bound, for each driven joint that carries `joint`, how far it moves a point: (k + 1,) m per unit of x.

        Args:
            reach: m, how far the point is from that joint's origin at most.
        """
        bounds = {}
        for each in self.carriers(joint):
            slides = self.model.joints[each].shortname().startswith("JointModelP")
            column, slope, at_zero = self._drives.get(each, (0, 0.0, 0.0))
            if slope:
                bounds[each] = np.zeros(len(self.robot.joints) + 1)
                bounds[each][column] = abs(slope) * (1.0 if slides else reach)
            # A point is no farther from the joint before than by the step there, and what this one slides.
            reach += float(np.linalg.norm(self.model.jointPlacements[each].translation))
            if slides and slope:
                limits = self.robot.limits
                ends = (limits.lower[column], limits.upper[column]) if column < len(self.robot.joints) else (0.0, 1.0)
                reach += max(abs(at_zero + slope * float(end)) for end in ends)
        return bounds
