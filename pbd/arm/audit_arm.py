"""The audit's own view of an arm: where its joints are, worked out anew from the URDF for many instants at once.

Everything is in `base`. Coordinates `x` are (n, k + 1): the arm's joints (rad; m where one slides), then the gripper's
opening, 1 open to 0 closed. Nothing here is shared with the planner but the URDF and the robot's values.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pbd.data import Robot
from pbd.pose import Array, Pose, quat_from_matrix, quat_to_matrix

Rows = NDArray[np.intp]
"""Which of many instants."""
X = (1.0, 0.0, 0.0)
"""The axis of a joint of which the URDF doesn't say it."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A placement: rotation (3, 3) and position (3,) in m."""

    R: Array
    p: Array

    def __matmul__(self, other: Frame) -> Frame:
        return Frame(self.R @ other.R, self.R @ other.p + self.p)

    def inverse(self) -> Frame:
        """The other way round."""
        return Frame(self.R.T, -self.R.T @ self.p)

    def act(self, points: Array) -> Array:
        """Move points (..., 3)."""
        moved: Array = points @ self.R.T + self.p
        return moved

    def pose(self) -> Pose:
        """As a Pose."""
        return Pose(self.p, quat_from_matrix(self.R))

    @staticmethod
    def of(pose: Pose) -> Frame:
        """From a Pose."""
        return Frame(quat_to_matrix(pose.wxyz), pose.p)


@dataclass(frozen=True, eq=False)
class Placements:
    """Where joints are at n instants: R (joints, n, 3, 3), p (joints, n, 3) in base; joint 0 is base itself."""

    R: Array
    p: Array

    def at(self, joint: int, node: int) -> Frame:
        """One joint at one instant."""
        return Frame(self.R[joint, node], self.p[joint, node])

    def points(self, joint: int, point: Array) -> Array:
        """Where a point (3,) that is fixed to a joint is: (n, 3)."""
        there: Array = (self.R[joint].reshape(-1, 3) @ point).reshape(-1, 3) + self.p[joint]
        return there

    def between(self, first: int, second: int, rows: Rows) -> tuple[Array, Array]:
        """Return the second joint in the first: R (m, 3, 3), p (m, 3) at m of the instants."""
        inverse = np.swapaxes(self.R[first, rows], 1, 2)
        p = self.p[second, rows] - self.p[first, rows]
        return inverse @ self.R[second, rows], (inverse @ p[:, :, None])[:, :, 0]


@dataclass(frozen=True, eq=False)
class _Drive:
    """What moves a joint: a column of x, and value = at_zero + slope * x; column -1: it is locked at zero."""

    column: int
    slope: float
    at_zero: float


class AuditArm:
    """An arm, loaded anew.

    Attributes:
        robot: its values.
        model: pinocchio's model of the whole URDF.
        parents: of each joint; 0 is what stands still.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.model: Any = pin.buildModelFromUrdf(str(robot.urdf))
        self.parents = [int(parent) for parent in self.model.parents]
        joints = {joint.get("name"): joint for joint in ET.parse(robot.urdf).getroot().iterfind("joint")}
        self._axes, self._slides = [np.zeros(3)], [False]
        for name in self.model.names[1:]:
            written = joints[name].find("axis")
            axis = np.array([float(each) for each in written.get("xyz", "1 0 0").split()] if written is not None else X)
            self._axes.append(axis / np.linalg.norm(axis))
            self._slides.append(joints[name].get("type") == "prismatic")
        self._drives = [_Drive(-1, 0.0, 0.0)] * self.model.njoints
        for column, name in enumerate(robot.joints):
            self._drives[self.model.getJointId(name)] = _Drive(column, 1.0, 0.0)
        if gripper := robot.gripper:
            for name, opened, closed in zip(gripper.joints, gripper.open, gripper.closed, strict=True):
                drive = _Drive(len(robot.joints), float(opened - closed), float(closed))
                self._drives[self.model.getJointId(name)] = drive
        _, T_universe_base = self.link(robot.base)
        self.T_base_universe = T_universe_base.inverse()

    def link(self, name: str) -> tuple[int, Frame]:
        """Return the joint that carries a link, and the link's place on it."""
        frame = self.model.frames[self.model.getFrameId(name, pin.FrameType.BODY)]
        return int(frame.parentJoint), Frame(frame.placement.rotation.copy(), frame.placement.translation.copy())

    def placements(self, x: Array) -> Placements:
        """Work out where the joints are at coordinates (n, k + 1)."""
        n, model = len(x), self.model
        R, p = np.empty((model.njoints, n, 3, 3)), np.empty((model.njoints, n, 3))
        R[0], p[0] = np.eye(3), 0.0
        for joint in range(1, model.njoints):
            step = Frame(model.jointPlacements[joint].rotation, model.jointPlacements[joint].translation)
            parent = self.parents[joint]
            if parent == 0:
                step = self.T_base_universe @ step
            drive, axis = self._drives[joint], self._axes[joint]
            value = drive.at_zero + (drive.slope * x[:, drive.column] if drive.column >= 0 else np.zeros(n))
            moved = step.p + (value[:, None] * (step.R @ axis) if self._slides[joint] else 0.0)
            R[joint] = R[parent] @ (step.R if self._slides[joint] else step.R @ _turns(axis, value))
            p[joint] = (R[parent] @ np.broadcast_to(moved, (n, 3))[:, :, None])[:, :, 0] + p[parent]
        return Placements(R, p)

    def carriers(self, joint: int) -> list[int]:
        """The joint and those that carry it, up to base."""
        chain = []
        while joint > 0:
            chain.append(joint)
            joint = self.parents[joint]
        return chain

    def driven(self, joint: int) -> frozenset[int]:
        """Those of a joint and its carriers that the arm or the gripper drives."""
        return frozenset(each for each in self.carriers(joint) if self._drives[each].column >= 0)

    def motion(self, joint: int, reach: float) -> dict[int, Array]:
        """Bound, for each driven joint that carries `joint`, how far a point of it moves: (k + 1,) m per unit of x.

        Args:
            joint: what the point is fixed to.
            reach: m, how far the point is from that joint's origin at most.
        """
        bounds = {}
        for each in self.carriers(joint):
            drive = self._drives[each]
            bound = np.zeros(len(self.robot.joints) + 1)
            if drive.column >= 0:
                bound[drive.column] = abs(drive.slope) * (1.0 if self._slides[each] else reach)
            bounds[each] = bound
            # A point is no farther from the joint before than by the step there, and what this one slides.
            reach += float(np.linalg.norm(self.model.jointPlacements[each].translation)) + self._most_slide(each)
        return bounds

    def _most_slide(self, joint: int) -> float:
        if not self._slides[joint]:
            return 0.0
        drive, name = self._drives[joint], self.model.names[joint]
        if name in self.robot.joints:
            column = self.robot.joints.index(name)
            return float(max(abs(self.robot.limits.lower[column]), abs(self.robot.limits.upper[column])))
        return max(abs(drive.at_zero), abs(drive.at_zero + drive.slope))

    def tool(self, q: Array) -> Frame:
        """T_base_tool at joints (k,), by pinocchio's own kinematics of the whole URDF."""
        model, data = self.model, self.model.createData()
        configuration = pin.neutral(model)
        for name, angle in zip(self.robot.joints, q, strict=True):
            joint = model.joints[model.getJointId(name)]
            values = angle if joint.nq == 1 else (np.cos(angle), np.sin(angle))
            configuration[joint.idx_q : joint.idx_q + joint.nq] = values
        pin.framesForwardKinematics(model, data, configuration)
        placed = data.oMf[model.getFrameId(self.robot.body, pin.FrameType.BODY)]
        T_universe_body = Frame(placed.rotation.copy(), placed.translation.copy())
        return self.T_base_universe @ T_universe_body @ Frame.of(self.robot.T_body_tool)


def _turns(axis: Array, angle: Array) -> Array:
    """Rotations (n, 3, 3) about a unit axis (3,) by angles (n,): Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: Array = np.eye(3) + np.sin(angle)[:, None, None] * K + (1.0 - np.cos(angle))[:, None, None] * (K @ K)
    return turned
