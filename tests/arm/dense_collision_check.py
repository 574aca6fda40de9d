"""The oracle of the audit: a densely sampled check of a motion by pinocchio and coal, on the original meshes."""

from collections.abc import Collection, Sequence
from functools import cache
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
        self.model, links = _read(str(robot.urdf), tuple(map(str, robot.package_dirs)))
        self.geometry = links.copy()  # which shares the meshes
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
            pin.computeCollisions(self.model, data, self.geometry, placed, q, True)
            for q in self.configuration(samples.q, samples.gripper)
        )

    def configuration(self, q: Any, opening: Any) -> Any:
        """Return pinocchio's configuration for joints (k,) and an opening, or one for each of (n, k) and (n,)."""
        configuration = np.tile(pin.neutral(self.model), (*np.shape(opening), 1))
        for name, value in joint_values(self.robot, q, opening).items():
            configuration[..., self.model.joints[self.model.getJointId(name)].idx_q] = value
        return configuration


@cache
def _read(urdf: str, folders: tuple[str, ...]) -> tuple[Any, Any]:
    model = pin.buildModelFromUrdf(urdf)
    return model, pin.buildGeomFromUrdf(model, urdf, pin.GeometryType.COLLISION, package_dirs=[*folders])


def joint_values(robot: Robot, q: Any, opening: Any) -> dict[str, Any]:
    """Return the value, or the values (n,), of each joint of arm and gripper, by name."""
    values = dict(zip(robot.joints, np.transpose(q), strict=True))
    if (gripper := robot.gripper) is not None:
        fingers = gripper.closed + np.multiply.outer(opening, gripper.open - gripper.closed)
        values |= dict(zip(gripper.joints, fingers.T, strict=True))
    return values


def _shape(obstacle: Obstacle) -> Any:
    size = obstacle.size
    if obstacle.shape == "box":
        return coal.Box(*size)
    return coal.Sphere(0.5 * size[0]) if obstacle.shape == "sphere" else coal.Cylinder(0.5 * size[0], size[1])
