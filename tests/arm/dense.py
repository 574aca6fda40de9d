"""The oracle of the audit: a densely sampled check of a motion by pinocchio and coal, on the original meshes."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from pbd.data import JointTrajectory, Obstacle, Robot
from pbd.pose import quat_to_matrix


class Dense:
    """The meshes of a URDF, and obstacles, checked every `every_s` seconds."""

    def __init__(self, robot: Robot, obstacles: Sequence[Obstacle], every_s: float = 1e-3) -> None:
        self.robot, self.every_s = robot, every_s
        self.model = pin.buildModelFromUrdf(str(robot.urdf))
        folders = [str(folder) for folder in robot.package_dirs]
        kind = pin.GeometryType.COLLISION
        self.geometry = pin.buildGeomFromUrdf(self.model, str(robot.urdf), kind, package_dirs=folders)
        self.names = [str(self.model.frames[each.parentFrame].name) for each in self.geometry.geometryObjects]
        base = self.model.frames[self.model.getFrameId(robot.base, pin.FrameType.BODY)].placement
        for obstacle in obstacles:
            there = obstacle.T_base_obstacle
            placed = base * pin.SE3(quat_to_matrix(there.wxyz), there.p)
            self.geometry.addGeometryObject(pin.GeometryObject(obstacle.name, 0, placed, _shape(obstacle)))
            self.names.append(obstacle.name)

    def touch(self, trajectory: JointTrajectory, pairs: Collection[frozenset[str]], margin_m: float) -> bool:
        """Whether any of the pairs of names comes within a margin, m."""
        self.geometry.removeAllCollisionPairs()
        for i, first in enumerate(self.names):
            for j, second in enumerate(self.names[:i]):
                if frozenset((first, second)) in pairs:
                    self.geometry.addCollisionPair(pin.CollisionPair(j, i))
        placed, data = self.geometry.createData(), self.model.createData()
        for request in placed.collisionRequests:
            request.security_margin = margin_m
        t = np.append(np.arange(0.0, trajectory.duration, self.every_s), trajectory.duration)
        samples = trajectory.at(t)
        return any(
            pin.computeCollisions(self.model, data, self.geometry, placed, self.configuration(q, opening), True)
            for q, opening in zip(samples.q, samples.gripper, strict=True)
        )

    def configuration(self, q: Any, opening: float) -> Any:
        configuration = pin.neutral(self.model)
        for name, value in joint_values(self.robot, q, opening).items():
            configuration[self.model.joints[self.model.getJointId(name)].idx_q] = value
        return configuration


def joint_values(robot: Robot, q: Any, opening: float) -> dict[str, float]:
    """Return the value of each joint of arm and gripper, by name."""
    values = dict(zip(robot.joints, q, strict=True))
    if (gripper := robot.gripper) is not None:
        values |= dict(zip(gripper.joints, gripper.closed + opening * (gripper.open - gripper.closed), strict=True))
    return values


def _shape(obstacle: Obstacle) -> Any:
    size = obstacle.size
    if obstacle.shape == "box":
        return coal.Box(*size)
    return coal.Sphere(0.5 * size[0]) if obstacle.shape == "sphere" else coal.Cylinder(0.5 * size[0], size[1])
