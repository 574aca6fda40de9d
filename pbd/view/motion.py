"""How the robot's parts move over a trajectory, from pinocchio's full model: arm and fingers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from pbd.data import JointTrajectory, Robot, Samples
from pbd.doors.urdf import kinematics
from pbd.errors import RobotError
from pbd.pose import Array, Pose, quat_from_matrix, quat_multiply, quat_rotate


@dataclass(frozen=True, eq=False)
class Track:
    """Poses of one frame in another at instants: p (n, 3) m and wxyz (n, 4)."""

    p: Array
    wxyz: Array

    def __matmul__(self, after: Pose) -> Track:
        return Track(self.p + quat_rotate(self.wxyz, after.p), quat_multiply(self.wxyz, after.wxyz))

    def seen_from(self, T_a_b: Pose) -> Track:
        """The same frame in a, where this track gives it in b."""
        return Track(T_a_b.act(self.p), quat_multiply(T_a_b.wxyz, self.wxyz))

    def act(self, points: Array) -> Array:
        """Points (k, 3) fixed in the moving frame, at each instant: (n, k, 3)."""
        return self.p[:, None] + quat_rotate(self.wxyz[:, None], points[None])

    def __getitem__(self, i: int) -> Pose:
        return Pose(self.p[i], self.wxyz[i])


class Motion:
    """A robot that goes through a trajectory, sampled at a constant rate.

    Attributes:
        t: (n,) s.
        local: each moving joint's frame in its parent joint's frame, by joint index from 1.
    """

    def __init__(self, robot: Robot, trajectory: JointTrajectory, rate_hz: float) -> None:
        self.robot = robot
        try:
            self.model = pin.buildModelFromXML(kinematics(robot.urdf))
        except (ValueError, RuntimeError) as error:
            raise RobotError(
                f"{robot.urdf} is not a URDF ({error}); check urdf in robots/*.toml", path=robot.urdf
            ) from error
        self.samples = trajectory.sample(rate_hz)
        self.t = self.samples.t
        self.local, self._world = self._forward(self._configurations(trajectory, self.samples))

    @cached_property
    def T_base_world(self) -> Pose:
        """The URDF's root in base, as at the start: base stands still."""
        joint, T_joint_base = self.link("base", self.robot.base)
        return (self._world[joint][0] @ T_joint_base).inverse()

    def parent(self, joint: int) -> int:
        """Index of the joint that a joint hangs on; 0 is the world."""
        return int(self.model.parents[joint])

    def name(self, joint: int) -> str:
        """A joint's name."""
        return str(self.model.names[joint])

    def link(self, what: str, link: str) -> tuple[int, Pose]:
        """The joint that a link moves with, and T_joint_link."""
        frame_id = self.model.getFrameId(link, pin.FrameType.BODY)
        if frame_id >= self.model.nframes:
            raise RobotError(f"{self.robot.urdf} has no link {link!r} ({what}); check robots/*.toml", link=link)
        frame = self.model.frames[frame_id]
        return int(frame.parentJoint), Pose.from_matrix(frame.placement.homogeneous)

    def joint(self, index: int) -> Track:
        """T_base_joint over time."""
        return self._world[index].seen_from(self.T_base_world)

    def tool(self) -> Track:
        """T_base_tool over time."""
        joint, T_joint_body = self.link("body", self.robot.body)
        return self.joint(joint) @ (T_joint_body @ self.robot.T_body_tool)

    def _configurations(self, trajectory: JointTrajectory, samples: Samples) -> Array:
        q = np.tile(pin.neutral(self.model), (len(samples.t), 1))
        moves = dict(zip(trajectory.joint_names, samples.q.T, strict=True))
        if (gripper := self.robot.gripper) is not None:
            for name, opened, closed in zip(gripper.joints, gripper.open, gripper.closed, strict=True):
                moves[name] = closed + (opened - closed) * samples.gripper
        for name, values in moves.items():
            if not self.model.existJointName(name):
                raise RobotError(
                    f"{self.robot.urdf} has no joint {name!r}; it has {', '.join(self.model.names[1:])}", joint=name
                )
            joint = self.model.joints[self.model.getJointId(name)]
            if joint.nq == 2 and joint.nv == 1:  # continuous: pinocchio keeps cosine and sine
                q[:, joint.idx_q], q[:, joint.idx_q + 1] = np.cos(values), np.sin(values)
            else:
                q[:, joint.idx_q] = values
        return q

    def _forward(self, q: Array) -> tuple[dict[int, Track], dict[int, Track]]:
        data, joints = self.model.createData(), range(1, self.model.njoints)
        local, world = np.empty((2, len(q), self.model.njoints, 4, 4))
        for i, configuration in enumerate(q):
            pin.forwardKinematics(self.model, data, configuration)
            for j in range(self.model.njoints):
                local[i, j], world[i, j] = data.liMi[j].homogeneous, data.oMi[j].homogeneous
        return {j: _track(local[:, j]) for j in joints}, {j: _track(world[:, j]) for j in range(self.model.njoints)}


def _track(matrices: Array) -> Track:
    return Track(matrices[:, :3, 3], quat_from_matrix(matrices[:, :3, :3]))
