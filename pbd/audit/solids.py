"""The audit's own solids: the convex hull of each shape for a first look, and the shape itself where that is near."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import coal
import numpy as np

from pbd.audit.arm import AuditArm, se3
from pbd.io.meshes import from_mesh, mesh_triangles
from pbd.io.urdf_shapes import Shape, Triple, collision_shapes
from pbd.pose import Array

NEARER_M = (2e-3, 5e-4, 1e-4)
"""Thresholds, m, of a mesh's distance; below the last one counts as contact."""

ROUNDED_M = 1e-3
"""Corners of a mesh's hull are rounded to this, m; `pad` covers it."""

_REQUEST = coal.DistanceRequest()


@dataclass(frozen=True, eq=False)
class Solid:
    """A solid that moves with a joint.

    Attributes:
        name: of its link, or of a thing in the world.
        joint: what carries it; 0: it stands still.
        T_joint_solid: its place there.
        hull: as coal takes it; for what isn't a mesh the solid itself.
        reach: m, how far any of it is from the joint's origin at most; infinite for a floor.
        ball: its center (3,) m in the joint's frame, and its radius, m: it holds the solid. A floor's is infinite.
        pad: m, how far it may stick out of its hull.
        mesh: its file and scale, or None.
    """

    name: str
    joint: int
    T_joint_solid: Any
    hull: Any
    reach: float
    ball: tuple[Array, float]
    pad: float = 0.0
    mesh: tuple[Path, Triple] | None = None

    @cached_property
    def triangles(self) -> Array:
        """(m, 3, 3) m of a mesh."""
        return mesh_triangles(*self.mesh) if self.mesh else np.empty((0, 3, 3))

    @cached_property
    def exact(self) -> Any:
        """The solid itself, as coal takes it: of a mesh its surface."""
        if self.mesh is None:
            return self.hull
        corners = self.triangles.reshape(-1, 3)
        surface = coal.BVHModelOBBRSS()
        surface.beginModel(len(self.triangles), len(corners))
        surface.addVertices(corners)
        surface.addTriangles(np.arange(len(corners), dtype=np.uint32).reshape(-1, 3))
        surface.endModel()
        return surface


def link_solids(arm: AuditArm) -> list[Solid]:
    """Read the solids of all links.

    Raises:
        RobotError: one can't be read.
    """
    return [_of_link(arm, shape) for shape in collision_shapes(arm.robot)]


def _of_link(arm: AuditArm, shape: Shape) -> Solid:
    joint, T_joint_link = arm.link(shape.link)
    T_joint_solid = T_joint_link * se3(shape.T_link_shape)
    if shape.kind != "mesh":
        return simple_solid(shape.link, joint, T_joint_solid, shape.kind, shape.size)
    kept = from_mesh(shape.mesh, "audit", lambda soup: _corners(soup.corners * shape.scale), ROUNDED_M, shape.scale)
    corners = kept["corners"]
    pad, mesh = 0.5 * float(np.sqrt(3.0)) * ROUNDED_M, (shape.mesh, shape.scale)
    at_joint = corners @ T_joint_solid.rotation.T + T_joint_solid.translation
    center = 0.5 * (at_joint.min(axis=0) + at_joint.max(axis=0))
    far, radius = (float(np.linalg.norm(at_joint - p, axis=1).max()) + pad for p in (np.zeros(3), center))
    return Solid(shape.link, joint, T_joint_solid, _hull(corners), far, (center, radius), pad, mesh)


def simple_solid(name: str, joint: int, T_joint_solid: Any, shape: str, size: tuple[float, ...]) -> Solid:
    """Make a box (x, y, z), a sphere (diameter), a cylinder or a capsule (diameter, height without round ends) in m."""
    radius, height = 0.5 * size[0], size[-1]
    if shape == "box":
        solid, extent = coal.Box(*size), 0.5 * float(np.linalg.norm(size))
    elif shape == "sphere":
        solid, extent = coal.Sphere(radius), radius
    elif shape == "cylinder":
        solid, extent = coal.Cylinder(radius, height), float(np.hypot(radius, 0.5 * height))
    else:
        solid, extent = coal.Capsule(radius, height), radius + 0.5 * height
    center = T_joint_solid.translation.copy()
    return Solid(name, joint, T_joint_solid, solid, float(np.linalg.norm(center)) + extent, (center, extent))


def floor(name: str, T_universe_floor: Any) -> Solid:
    """Make a table without an end."""
    solid = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    return Solid(name, 0, T_universe_floor, solid, np.inf, (T_universe_floor.translation.copy(), np.inf))


def balls_apart(first: Solid, centers_first: Array, second: Solid, centers_second: Array) -> Array:
    """How far two solids are apart (n,), m, at least, with the centers of their balls at (n, 3) in the universe."""
    for floor, other, centers in ((first, second, centers_second), (second, first, centers_first)):
        if floor.reach == np.inf:
            T = floor.T_joint_solid
            heights: Array = (centers - T.translation) @ T.rotation[:, 2] - other.ball[1]
            return heights
    distances: Array = np.linalg.norm(centers_first - centers_second, axis=1) - first.ball[1] - second.ball[1]
    return distances


def hull_distance(first: Solid, T_first: Any, second: Solid, T_second: Any) -> float:
    """How far the hulls of two solids are apart, m, at least; negative where they overlap."""
    distance = coal.distance(first.hull, T_first, second.hull, T_second, _REQUEST, coal.DistanceResult())
    return float(distance) - first.pad - second.pad


def clearance(first: Solid, T_first: Any, second: Solid, T_second: Any) -> float:
    """How far two solids are apart, m, at least; 0 where they touch or are within the last of NEARER_M."""
    apart = hull_distance(first, T_first, second, T_second)
    if apart > NEARER_M[0] or (first.mesh is None and second.mesh is None):
        return apart if apart > NEARER_M[-1] else 0.0
    for margin in NEARER_M:
        request = coal.CollisionRequest()
        request.security_margin = margin
        if not coal.collide(first.exact, T_first, second.exact, T_second, request, coal.CollisionResult()):
            return margin
    return 0.0


def one_in_the_other(first: Solid, T_first: Any, second: Solid, T_second: Any) -> bool:
    """Whether one of two solids that don't touch is inside the other, a mesh: its surface alone doesn't tell."""
    return _is_inside(first, T_first, second, T_second) or _is_inside(second, T_second, first, T_first)


def _is_inside(thing: Solid, T_thing: Any, around: Solid, T_around: Any) -> bool:
    if around.mesh is None or thing.reach == np.inf:
        return False
    point = thing.triangles[0, 0] if thing.mesh else np.zeros(3)
    a, b, c = np.moveaxis(around.triangles - (T_around.inverse() * T_thing).transform(point), 1, 0)
    # The winding number of the surface about the point: its solid angles (Van Oosterom and Strackee, 1983) over 4 pi.
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    ab, bc, ca = (np.einsum("ni,ni->n", one, other) for one, other in ((a, b), (b, c), (c, a)))
    volume = np.einsum("ni,ni->n", a, np.cross(b, c))
    half_angles = np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
    return abs(float(half_angles.sum())) / (2.0 * np.pi) > 0.5


def _corners(triangles: Array) -> dict[str, Array]:
    """Corners (n, 3) of a mesh's hull, once its points are rounded: far fewer."""
    points = np.unique(np.rint(triangles.reshape(-1, 3) / ROUNDED_M), axis=0) * ROUNDED_M
    try:
        return {"corners": np.array(_hull(points).points())}
    except (RuntimeError, ValueError):  # flat: the box around it
        low, high = points.min(axis=0) - ROUNDED_M, points.max(axis=0) + ROUNDED_M
        return {"corners": np.array([np.where(mask, high, low) for mask in np.ndindex(2, 2, 2)])}


def _hull(points: Array) -> Any:
    listed = coal.StdVec_Vec3s()
    listed.extend(list(points))
    return coal.Convex.convexHull(listed, True, "Qt")
