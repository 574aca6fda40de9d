"""Poses of a robot's joints and links over time: forward kinematics of arm and fingers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from pbd.data import Robot
from pbd.lazy import cached_property
from pbd.pose import Array, Pose, quat_from_matrix, quat_multiply, quat_rotate

FRAME_RATE_HZ = 50.0
"""Frames per second of the animation. The page interpolates between them."""


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of one frame in another at n instants: p (n, 3) m and wxyz (n, 4)."""

    p: Array
    wxyz: Array

    def __matmul__(self, after: Pose) -> Poses:
        return Poses(self.p + quat_rotate(self.wxyz, after.p), quat_multiply(self.wxyz, after.wxyz))

    def act(self, points: Array) -> Array:
        """Transform points (k, 3) that are fixed in the moving frame: (n, k, 3), at each instant."""
        return self.p[:, None] + quat_rotate(self.wxyz[:, None], points[None])

    def __getitem__(self, i: int) -> Pose:
        return Pose(self.p[i], self.wxyz[i])


@dataclass(frozen=True, eq=False)
class RobotMotion:
    """Configurations of a whole robot over time.

    Attributes:
        model: pinocchio's model of the whole URDF; its world is base.
        t: (n,) s.
        q: (n, nq) pinocchio's configurations.
    """

    model: Any
    t: Array
    q: Array

    def joints(self) -> Iterator[tuple[int, int, str, Poses]]:
        """Each joint's index, its parent joint's index (0: the world), its name, and its pose in the parent."""
        for joint in range(1, self.model.njoints):
            local = self._placements[0][:, joint]
            yield joint, int(self.model.parents[joint]), str(self.model.names[joint]), _poses(local)

    def joint(self, index: int) -> Poses:
        """T_base_joint over time."""
        return _poses(self._placements[1][:, index])

    def link(self, name: str) -> tuple[int, Pose]:
        """Index of the joint that moves a link, and T_joint_link."""
        frame = self.model.frames[self.model.getFrameId(name, pin.FrameType.BODY)]
        return int(frame.parentJoint), Pose.from_matrix(frame.placement.homogeneous)

    def tool(self, robot: Robot) -> Poses:
        """T_base_tool over time."""
        joint, T_joint_body = self.link(robot.body)
        return self.joint(joint) @ (T_joint_body @ robot.T_body_tool)

    @cached_property
    def _placements(self) -> Array:
        """(2, n, joints, 4, 4): each joint's pose in its parent joint, and in the world."""
        data, placements = self.model.createData(), np.empty((2, len(self.q), self.model.njoints, 4, 4))
        for i, q in enumerate(self.q):
            pin.forwardKinematics(self.model, data, q)
            for j in range(self.model.njoints):
                placements[:, i, j] = data.liMi[j].homogeneous, data.oMi[j].homogeneous
        return placements


def _poses(matrices: Array) -> Poses:
    return Poses(matrices[:, :3, 3], quat_from_matrix(matrices[:, :3, :3]))
