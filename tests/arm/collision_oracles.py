"""Shared by collision tests: random coordinates, raw meshes, exact distances."""

from functools import lru_cache

import coal
import numpy as np
import pinocchio as pin
from scipy.optimize import nnls

from pbd.arm.collision.allowed_collisions import sample_coordinates
from pbd.arm.collision.clearance import Clearance
from pbd.arm.collision.geometry import Body
from pbd.arm.collision.motion_check import MotionHit, all_hits
from pbd.arm.collision.scene import CollisionScene
from pbd.arm.model import ArmModel
from pbd.data import JointTrajectory
from pbd.pose import Array, Pose, quat_from_xyzw
from tests.arm.bundled import arm_of


def coordinates(arm: ArmModel, count: int, seed: int = 1) -> Array:
    """Draw random coordinates (count, k + 1), in another order than the samples that decide which pairs are checked."""
    return np.random.default_rng(seed).permuted(sample_coordinates(arm, count), axis=0)


def placements(arm: ArmModel, x: Array) -> list[Pose]:
    """Return T_universe_joint of all joints at coordinates (k + 1,)."""
    data = arm.full.createData()
    pin.forwardKinematics(arm.full, data, arm.configurations(x))
    poses = [pin.SE3ToXYZQUAT(placement) for placement in data.oMi]
    return [Pose(pose[:3], quat_from_xyzw(pose[3:])) for pose in poses]


def points_of(body: Body, joints: list[Pose]) -> Array:
    """Return the corners (n, 3) of a hull or a box, or the ends of a capsule's axis, in pinocchio's world."""
    points = body.points
    if body.shape == "box":
        points = 0.5 * np.array(body.size) * np.array([np.where(mask, 1.0, -1.0) for mask in np.ndindex(2, 2, 2)])
    if body.shape == "capsule":
        points = 0.5 * body.size[1] * np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    return (joints[body.joint] @ body.T_joint_body).act(points)


def rounding_of(body: Body) -> float:
    """Return how far a body extends beyond the hull of those points, m."""
    return body.pad + (0.5 * body.size[0] if body.shape == "capsule" else 0.0)


def hull_distance(a: Array, b: Array) -> float:
    """Return the distance of the hulls of points (n, 3) and (m, 3), m, by least squares over convex combinations."""
    heavy = 1e3  # makes the weights of either hull add up to one
    A = np.vstack((np.hstack((a.T, -b.T)), np.repeat([[heavy, 0.0], [0.0, heavy]], [len(a), len(b)], axis=1)))
    weights, _ = nnls(A, np.array([0.0, 0.0, 0.0, heavy, heavy]))
    return float(np.linalg.norm(weights[: len(a)] @ a - weights[len(a) :] @ b))


class RawMeshes:
    """The collision meshes of the URDF, as pinocchio reads them, checked by coal triangle by triangle."""

    def __init__(self, arm: ArmModel) -> None:
        self.arm, robot = arm, arm.robot
        folders = [str(folder) for folder in robot.package_dirs]
        self.geometry = pin.buildGeomFromUrdf(
            arm.full, str(robot.urdf), pin.GeometryType.COLLISION, package_dirs=folders
        )
        self.links = [str(arm.full.frames[thing.parentFrame].name) for thing in self.geometry.geometryObjects]
        self.data = arm.full.createData()

    def watch(self, links: set[frozenset[str]]) -> None:
        """Check only these pairs of links."""
        self.geometry.removeAllCollisionPairs()
        for i, first in enumerate(self.links):
            for j, second in enumerate(self.links[:i]):
                if frozenset((first, second)) in links:
                    self.geometry.addCollisionPair(pin.CollisionPair(j, i))
        self.placed = self.geometry.createData()

    def touching(self, x: Array) -> set[frozenset[str]]:
        """Return the pairs of links whose meshes touch at coordinates (k + 1,)."""
        q = self.arm.configurations(x)
        pin.computeCollisions(self.arm.full, self.data, self.geometry, self.placed, q, False)
        pairs = zip(self.geometry.collisionPairs, self.placed.collisionResults, strict=True)
        return {frozenset((self.links[pair.first], self.links[pair.second])) for pair, r in pairs if r.isCollision()}

    def vertices(self, i: int) -> Array:
        """Return the corners (n, 3) of a mesh, or the centre (1, 3) of another shape, in the frame of its joint."""
        thing = self.geometry.geometryObjects[i]
        points = (
            np.array(thing.geometry.vertices()) if isinstance(thing.geometry, coal.BVHModelBase) else np.zeros((1, 3))
        )
        return np.asarray(points @ thing.placement.rotation.T + thing.placement.translation)


@lru_cache
def raw_meshes(name: str) -> RawMeshes:
    return RawMeshes(arm_of(name))


def links_watched(clearance: Clearance) -> set[frozenset[str]]:
    return {frozenset((clearance.bodies[a].name, clearance.bodies[b].name)) for a, b in clearance.pairs}


def links_touching(clearance: Clearance, x: Array) -> set[frozenset[str]]:
    touching = clearance.pairs[clearance.distances(x) <= 0.0]
    return {frozenset((clearance.bodies[a].name, clearance.bodies[b].name)) for a, b in touching}


def first_hit(scene: CollisionScene, trajectory: JointTrajectory) -> MotionHit | None:
    """Return the first hit of a motion; None if it is free."""
    return next(iter(all_hits(scene, trajectory)), None)
