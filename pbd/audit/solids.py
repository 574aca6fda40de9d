"""The audit's own collision solids: convex hulls for a first test, the exact shapes where the hulls are close."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import coal
import numpy as np

from pbd.audit.arm import AuditArm, se3
from pbd.io.meshes import from_mesh, mesh_triangles, rounded_points
from pbd.io.urdf import Shape, Triple, collision_shapes
from pbd.lazy import cached_property
from pbd.pose import Array

MESH_DISTANCES_M = (2e-3, 5e-4, 1e-4)
"""Steps, m, in which the distance of a mesh is measured. A solid nearer than the last step counts as touching."""

ROUNDED_M = 1e-3
"""Grid, m, to which the corners of a mesh's hull are rounded. `Solid.pad` covers the rounding error."""

_REQUEST = coal.DistanceRequest()


@dataclass(frozen=True, eq=False)
class Solid:
    """A solid that moves with a joint.

    Attributes:
        name: name of its link, or of an object in the world.
        joint: index of the joint that carries it; 0 if it never moves.
        T_joint_solid: its pose in the joint's frame.
        hull: coal's geometry of its convex hull; for a primitive shape, the shape itself.
        reach: m, largest distance of its points from the joint's origin; infinite for a half-space.
        bounding_sphere: center (3,) m in the joint's frame, and radius, m; infinite for a half-space.
        pad: m, how far the solid may stick out of its hull.
        mesh: its file and scale, or None for a primitive shape.
    """

    name: str
    joint: int
    T_joint_solid: Any
    hull: Any
    reach: float
    bounding_sphere: tuple[Array, float]
    pad: float = 0.0
    mesh: tuple[Path, Triple] | None = None

    @cached_property
    def triangles(self) -> Array:
        """Triangles (m, 3, 3) of a mesh, m."""
        return mesh_triangles(*self.mesh) if self.mesh else np.empty((0, 3, 3))

    @cached_property
    def exact(self) -> Any:
        """coal's geometry of the solid itself. For a mesh, this is its surface only."""
        if self.mesh is None:
            return self.hull
        corners = self.triangles.reshape(-1, 3)
        surface = coal.BVHModelOBBRSS()
        surface.beginModel(len(self.triangles), len(corners))
        surface.addVertices(corners)
        surface.addTriangles(np.arange(len(corners), dtype=np.uint32).reshape(-1, 3))
        surface.endModel()
        return surface


@lru_cache(maxsize=16)
def link_solids(arm: AuditArm) -> tuple[Solid, ...]:
    """Read the solids of all links.

    Raises:
        RobotError: a shape can't be read.
    """
    return tuple(_link_solid(arm, shape) for shape in collision_shapes(arm.robot))


def _link_solid(arm: AuditArm, shape: Shape) -> Solid:
    joint, T_joint_link = arm.link_on_joint(shape.link)
    T_joint_solid = T_joint_link * se3(shape.T_link_shape)
    if shape.kind != "mesh":
        return simple_solid(shape.link, joint, T_joint_solid, shape.kind, shape.size)
    cached = from_mesh(
        shape.mesh, "audit", lambda soup: _hull_corners(soup.corners * shape.scale), ROUNDED_M, shape.scale
    )
    corners = cached["corners"]
    pad, mesh = 0.5 * float(np.sqrt(3.0)) * ROUNDED_M, (shape.mesh, shape.scale)
    at_joint = corners @ T_joint_solid.rotation.T + T_joint_solid.translation
    center = 0.5 * (at_joint.min(axis=0) + at_joint.max(axis=0))
    reach, radius = (float(np.linalg.norm(at_joint - p, axis=1).max()) + pad for p in (np.zeros(3), center))
    vertices = coal.StdVec_Vec3s()
    vertices.extend(list(corners))
    hull = coal.Convex.convexHull(vertices, True, "Qt")
    return Solid(shape.link, joint, T_joint_solid, hull, reach, (center, radius), pad, mesh)


def simple_solid(name: str, joint: int, T_joint_solid: Any, shape: str, size: tuple[float, ...]) -> Solid:
    """Make a primitive shape of a size in m.

    Args:
        name, joint, T_joint_solid: as in `Solid`.
        shape, size: box (x, y, z), sphere (diameter), cylinder (diameter, height) or capsule (diameter, height without
            the round ends).
    """
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


def half_space(name: str, T_universe_surface: Any) -> Solid:
    """Make a table of unlimited size: all points below z = 0 in its surface's frame."""
    solid = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    return Solid(name, 0, T_universe_surface, solid, np.inf, (T_universe_surface.translation.copy(), np.inf))


def sphere_distances(first: Solid, centers_first: Array, second: Solid, centers_second: Array) -> Array:
    """Return lower bounds (n,) m of the distance of two solids, from their bounding spheres.

    Args:
        first, second: the solids; at most one is a half-space.
        centers_first, centers_second: (n, 3) m, centers of the bounding spheres in the universe.
    """
    for surface, other, centers in ((first, second, centers_second), (second, first, centers_first)):
        if surface.reach == np.inf:
            T = surface.T_joint_solid
            heights: Array = (centers - T.translation) @ T.rotation[:, 2] - other.bounding_sphere[1]
            return heights
    radii = first.bounding_sphere[1] + second.bounding_sphere[1]
    return np.asarray(np.linalg.norm(centers_first - centers_second, axis=1) - radii)


def hull_distance(first: Solid, T_first: Any, second: Solid, T_second: Any) -> float:
    """Return a lower bound, m, of the distance of two solids, from their hulls; negative where the hulls overlap."""
    distance = coal.distance(first.hull, T_first, second.hull, T_second, _REQUEST, coal.DistanceResult())
    return float(distance) - first.pad - second.pad


def clearance(first: Solid, T_first: Any, second: Solid, T_second: Any) -> float:
    """Return a lower bound, m, of the distance of two solids; 0 where they touch (MESH_DISTANCES_M)."""
    apart = hull_distance(first, T_first, second, T_second)
    if apart > MESH_DISTANCES_M[0] or (first.mesh is None and second.mesh is None):
        return apart if apart > MESH_DISTANCES_M[-1] else 0.0
    for margin in MESH_DISTANCES_M:
        request = coal.CollisionRequest()
        request.security_margin = margin
        if not coal.collide(first.exact, T_first, second.exact, T_second, request, coal.CollisionResult()):
            return margin
    return 0.0


def one_encloses_other(first: Solid, T_first: Any, second: Solid, T_second: Any) -> bool:
    """Say whether one of two solids is inside the other, where their surfaces don't touch."""
    return _is_inside(first, T_first, second, T_second) or _is_inside(second, T_second, first, T_first)


def _is_inside(inner: Solid, T_inner: Any, outer: Solid, T_outer: Any) -> bool:
    point = inner.triangles[0, 0] if inner.mesh else np.zeros(3)
    a, b, c = np.moveaxis(outer.triangles - (T_outer.inverse() * T_inner).transform(point), 1, 0)
    # Winding number of the surface about the point: the sum of the triangles' solid angles (Van Oosterom and Strackee,
    # 1983) over 4 pi.
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    ab, bc, ca = (np.einsum("ni,ni->n", one, other) for one, other in ((a, b), (b, c), (c, a)))
    volume = np.einsum("ni,ni->n", a, np.cross(b, c))
    half_angles = np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
    return abs(float(half_angles.sum())) / (2.0 * np.pi) > 0.5


def _hull_corners(triangles: Array) -> dict[str, Array]:
    """Return the corners (n, 3) m of a mesh's hull. Rounding its points first leaves far fewer corners."""
    from scipy.spatial import ConvexHull, QhullError  # loads slowly, and hulls are cached on disk

    points = rounded_points(triangles, ROUNDED_M)
    try:
        return {"corners": points[ConvexHull(points).vertices]}
    except (QhullError, ValueError):  # a flat mesh has no hull, and crashes coal; its bounding box serves
        low, high = points.min(axis=0) - ROUNDED_M, points.max(axis=0) + ROUNDED_M
        return {"corners": np.array([np.where(mask, high, low) for mask in np.ndindex(2, 2, 2)])}
