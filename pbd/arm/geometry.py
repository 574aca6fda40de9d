"""A robot's links as convex bodies: what distances are measured between.

A mesh becomes its convex hull, which fills its bends: a contact can be seen where the link itself is not, but none is
missed. A hull of many corners (CAD's round edges) loses most of them; `pad` covers what sticks out then.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from pbd.arm.model import ArmModel, from_se3, to_se3
from pbd.doors.meshes import Soup, from_mesh
from pbd.doors.shapes import Shape, collision_shapes
from pbd.pose import Array, Pose, readonly

CORNERS = 160
"""A hull of no more corners than this is kept as it is."""

SHORT_M = 5e-4
"""How far corners that are left out may lie beyond a face of the hull of the others, m."""

SLIVER_M = 1e-4
"""Thickness that is given to a flat mesh on each side, m."""


@dataclass(frozen=True, eq=False)
class Body:
    """A convex body that moves with a joint.

    Attributes:
        name: of the link that it is a part of, or of a thing in the world.
        joint: index in `arm.full`; 0 stands still.
        T_joint_body: where it is on the joint.
        shape: "hull", "box", "cylinder" or "capsule" (along z), "sphere", or "floor": all that is below z = 0.
        size: m; box: x, y, z; cylinder: diameter, height; capsule: the same, without its round ends; sphere: diameter;
            else empty.
        points: (n, 3) m, the hull's corners; (0, 3) for another shape.
        pad: m, by how much it is larger than that on all sides.
    """

    name: str
    joint: int
    T_joint_body: Pose
    shape: str
    size: tuple[float, ...] = ()
    points: Array = field(default_factory=lambda: np.empty((0, 3)))
    pad: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", readonly(self.points))


@lru_cache(maxsize=4)
def link_bodies(arm: ArmModel) -> tuple[Body, ...]:
    """Return the bodies of all links, in the URDF's order.

    Raises:
        RobotError: the URDF or a mesh can't be read.
    """
    return bodies_of(arm, collision_shapes(arm.robot))


def bodies_of(arm: ArmModel, shapes: Iterable[Shape]) -> tuple[Body, ...]:
    """Place links' shapes on the joints that carry them.

    Raises:
        RobotError: a mesh can't be read.
    """
    bodies = []
    for shape in shapes:
        frame = arm.full.frames[arm.full.getFrameId(shape.link, pin.FrameType.BODY)]
        placed = shape.link, int(frame.parentJoint), from_se3(frame.placement) @ shape.T_link_shape
        if shape.kind == "mesh":
            hull = from_mesh(shape.mesh, "hulls", lambda soup, scale=shape.scale: _hull(soup, scale), shape.scale)
            bodies.append(Body(*placed, "hull", points=hull["points"], pad=float(hull["pad"])))
        else:
            bodies.append(Body(*placed, shape.kind, shape.size))
    return tuple(bodies)


def _hull(soup: Soup, scale: tuple[float, float, float]) -> dict[str, Any]:
    points, pad = thinned_hull(soup.corners.reshape(-1, 3) * scale)
    return {"points": points, "pad": pad}


def thinned_hull(points: Array) -> tuple[Array, float]:
    """Return corners (k, 3) and a pad, m, so that the hull of these, larger by the pad, holds points (n, 3), m."""
    corners = hull_corners(points)
    if len(corners) <= CORNERS:
        return corners, 0.0
    kept = np.zeros(len(corners), dtype=bool)
    kept[np.argmax(corners @ _directions(64).T, axis=0)] = True
    while True:
        hull = ConvexHull(corners[kept])
        beyond = corners @ hull.equations[:, :3].T + hull.equations[:, 3]  # (corners, faces)
        short = beyond.max(axis=0) > SHORT_M
        if not short.any():
            break
        kept[np.argmax(beyond[:, short], axis=0)] = True
    shape = _convex(corners[kept])
    return corners[kept], max((_outside(shape, corner) for corner in corners[~kept]), default=0.0)


def hull_corners(points: Array) -> Array:
    """Corners (k, 3) of the hull of points (n, 3); what has no volume becomes the box around it, a little thicker."""
    try:
        return np.asarray(points[ConvexHull(points).vertices], dtype=np.float64)
    except (QhullError, ValueError):
        low, high = points.min(axis=0) - SLIVER_M, points.max(axis=0) + SLIVER_M
        return np.array([np.where(mask, high, low) for mask in np.ndindex(2, 2, 2)])


def _directions(count: int) -> Array:
    """Unit vectors (count, 3) spread evenly over the sphere, along a spiral."""
    i = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * i / count, np.pi * (1.0 + np.sqrt(5.0)) * i
    radius = np.sqrt(1.0 - z * z)
    return np.stack((radius * np.cos(turn), radius * np.sin(turn), z), axis=1)


@lru_cache(maxsize=1024)
def shape_of(body: Body) -> Any:
    """Return a body as coal takes it, without its pad."""
    if body.shape == "hull":
        return _convex(body.points)
    if body.shape == "box":
        return coal.Box(*body.size)
    if body.shape == "cylinder":
        return coal.Cylinder(0.5 * body.size[0], body.size[1])
    if body.shape == "capsule":
        return coal.Capsule(0.5 * body.size[0], body.size[1])
    if body.shape == "sphere":
        return coal.Sphere(0.5 * body.size[0])
    if body.shape == "floor":
        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    raise ValueError(f"{body.shape!r} is none of hull, box, cylinder, capsule, sphere, floor")


def _convex(points: Array) -> Any:
    listed = coal.StdVec_Vec3s()
    listed.extend(list(points))
    return coal.Convex.convexHull(listed, True, "Qt")


def apart(first: Body, T_first: Pose, second: Body, T_second: Pose) -> tuple[float, Array, Array]:
    """Measure two bodies in places of their own.

    Returns:
        Distance in m, negative as deep as they overlap; the first's nearest point (3,); the normal (3,) to the second.
    """
    result, placed = coal.DistanceResult(), [to_se3(T) for T in (T_first, T_second)]
    one, other = (coal.Transform3s(T.rotation, T.translation) for T in placed)
    distance = coal.distance(shape_of(first), one, shape_of(second), other, coal.DistanceRequest(), result)
    return distance - first.pad - second.pad, np.array(result.getNearestPoint1()), np.array(result.normal)


def _outside(hull: Any, point: Array) -> float:
    there, request, result = coal.Transform3s(np.eye(3), point), coal.DistanceRequest(), coal.DistanceResult()
    distance = coal.distance(hull, coal.Transform3s.Identity(), coal.Sphere(0.0), there, request, result)
    return max(0.0, float(distance))
