"""A robot's links as convex bodies, between which distances are measured.

A mesh is replaced by its convex hull. The hull is larger, so a contact may be found too early, but none is missed.
Where the hulls of two links touch, their meshes decide (clearance.py).
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import coal
import numpy as np

from pbd.arm.model import ArmModel, to_se3
from pbd.data.world import beyond_reach
from pbd.errors import RobotError
from pbd.frozen_arrays import readonly
from pbd.io.meshes import from_mesh, mesh_triangles, rounded_points
from pbd.io.urdf import Shape, Triple, collision_shapes
from pbd.pose import Array, Pose

ROUNDED_M = 1e-3
"""Grid to which the corners of a mesh's hull are rounded, m; it leaves far fewer corners."""

PAD_M = 0.5 * 3.0**0.5 * ROUNDED_M
"""Largest displacement of a corner by rounding, m."""

SLABS = 4
"""Number of parts into which a mesh is cut: of 2 to 6, this one needs the fewest queries of ur5's meshes."""


@dataclass(frozen=True, eq=False)
class Body:
    """A convex body that moves with a joint.

    Attributes:
        name: its link's name, or the name of an object in the world.
        joint: index in `arm.full` of the joint that carries it; 0: it does not move.
        T_joint_body: its pose in the joint's frame.
        shape: "hull", "box", "cylinder" or "capsule" (along z), "sphere", or "floor": everything below z = 0.
        size: m; box: x, y, z; cylinder: diameter, height; capsule: diameter, height without its round ends; sphere:
            diameter; hull, floor: empty.
        points: (n, 3) m, the corners of a hull; (0, 3) for other shapes.
        pad: m, by how much the body is larger than its shape on all sides.
        mesh: file and scale of the mesh that a hull replaces, or None.
    """

    name: str
    joint: int
    T_joint_body: Pose
    shape: str
    size: tuple[float, ...] = ()
    points: Array = field(default_factory=lambda: np.empty((0, 3)))
    pad: float = 0.0
    mesh: tuple[Path, Triple] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", readonly(self.points))


@lru_cache(maxsize=16)
def link_bodies(arm: ArmModel) -> tuple[Body, ...]:
    """Return the bodies of all links, in the URDF's order.

    Raises:
        RobotError: the URDF or a mesh can't be read.
    """
    return bodies_of(arm, collision_shapes(arm.robot))


def bodies_of(arm: ArmModel, shapes: Iterable[Shape]) -> tuple[Body, ...]:
    """Make bodies of links' shapes, each in the frame of the joint that carries it.

    Raises:
        RobotError: a mesh can't be read, or is in mm.
    """
    bodies = []
    for shape in shapes:
        joint, T_joint_link = arm.link_on_joint(shape.link)
        placed = shape.link, joint, T_joint_link @ shape.T_link_shape
        if shape.kind == "mesh":
            mesh = shape.mesh, shape.scale
            points = _hull(*mesh)
            if far := beyond_reach(points.ravel()):
                remedy = 'if it is in mm, give it scale="0.001 0.001 0.001" in the URDF'
                raise RobotError(f"mesh {shape.mesh} has a corner at {far}; {remedy}", path=shape.mesh)
            bodies.append(Body(*placed, "hull", points=points, pad=PAD_M, mesh=mesh))
        else:
            bodies.append(Body(*placed, shape.kind, shape.size))
    return tuple(bodies)


def _hull(path: Path, scale: Triple) -> Array:
    """Return the corners (k, 3) of the hull of a mesh's rounded points, m; for a flat mesh, of its bounding box."""
    return from_mesh(path, "hulls", lambda soup: _corners(soup.corners * scale), ROUNDED_M, scale)["points"]


def _corners(triangles: Array) -> dict[str, Any]:
    from scipy.spatial import ConvexHull, QhullError  # loads slowly, and hulls are cached on disk

    rounded = rounded_points(triangles, ROUNDED_M)
    try:
        return {"points": rounded[ConvexHull(rounded).vertices]}
    except (QhullError, ValueError):
        low, high = rounded.min(axis=0) - ROUNDED_M, rounded.max(axis=0) + ROUNDED_M
        return {"points": np.array([np.where(mask, high, low) for mask in np.ndindex(2, 2, 2)])}


@lru_cache(maxsize=1024)
def shape_of(body: Body) -> Any:
    """Return a body's shape as a coal geometry, without its pad."""
    if body.shape == "hull":
        corners = coal.StdVec_Vec3s()
        corners.extend(list(body.points))
        return coal.Convex.convexHull(corners, True, "Qt")
    if body.shape == "box":
        return coal.Box(*body.size)
    if body.shape == "cylinder":
        return coal.Cylinder(0.5 * body.size[0], body.size[1])
    if body.shape == "capsule":
        return coal.Capsule(0.5 * body.size[0], body.size[1])
    if body.shape == "sphere":
        return coal.Sphere(0.5 * body.size[0])
    return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)  # the floor


def _extent(body: Body) -> tuple[float, float]:
    """Return a lower and an upper bound of a body's width, m."""
    if body.shape == "floor":
        return np.inf, np.inf
    if body.shape == "hull":
        sides = np.ptp(body.points, axis=0)
        return 0.0, float(np.linalg.norm(sides)) + 2.0 * body.pad
    if body.shape == "sphere":
        return body.size[0], body.size[0]
    if body.shape == "box":
        return min(body.size), float(np.linalg.norm(body.size))
    diameter, height = body.size
    round_ends = diameter if body.shape == "capsule" else 0.0
    return min(diameter, height + round_ends), float(np.hypot(diameter, height)) + round_ends


def mesh_depth(first: Body, second: Body) -> float:
    """Return the overlap of two bodies' hulls, m, up to which their meshes decide whether they touch.

    Infinite for two links. Another body could lie inside a link's mesh without touching its surface, once it overlaps
    the hull by more than its own thickness; the hull decides then, unless the body is too large to fit inside.
    """
    if first.mesh is None or second.mesh is None:
        meshed, other = (first, second) if first.mesh else (second, first)
        thin, long = _extent(other)
        return 0.0 if meshed.mesh is None else np.inf if long > _extent(meshed)[1] else thin
    return np.inf


@lru_cache(maxsize=256)
def _surface_of(body: Body) -> Any:
    """Return the surface of a body's mesh as a coal geometry; the body's shape if it has no mesh."""
    if body.mesh is None:
        return shape_of(body)
    triangles = mesh_triangles(*body.mesh)
    corners = triangles.reshape(-1, 3)
    surface = coal.BVHModelOBBRSS()
    surface.beginModel(len(triangles), len(corners))
    surface.addVertices(corners)
    surface.addTriangles(np.arange(len(corners), dtype=np.uint32).reshape(-1, 3))
    surface.endModel()
    return surface


@lru_cache(maxsize=256)
def _slabs_of(body: Body) -> tuple[Any, ...]:
    """Cut a body's mesh across its longest side; return the hulls of the parts, or the body's shape without a mesh.

    These hulls fit the mesh better than one hull, and are far faster to check than the mesh.
    """
    if body.mesh is None:
        return (shape_of(body),)
    path, scale = body.mesh
    parts = from_mesh(path, "slabs", lambda soup: _slabs(soup.corners * scale), ROUNDED_M, scale)
    return tuple(shape_of(Body(body.name, 0, body.T_joint_body, "hull", points=points)) for points in parts.values())


def _slabs(triangles: Array) -> dict[str, Any]:
    """Return the rounded corners of the hulls of a mesh's parts."""
    triangles = triangles.reshape(-1, 3, 3)
    corners, edges = triangles.reshape(-1, 3), np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    axis = int(np.ptp(corners, axis=0).argmax())
    cuts, slabs = np.linspace(corners[:, axis].min(), corners[:, axis].max(), SLABS + 1), dict[str, Any]()
    for i, ends in enumerate(pairwise(cuts)):
        parts = [corners[(corners[:, axis] >= ends[0]) & (corners[:, axis] <= ends[1])]]
        for cut in ends:
            start, end = edges[(edges[:, :, axis] - cut).prod(axis=1) < 0.0].transpose(1, 0, 2)
            parts.append(start + ((cut - start[:, axis]) / (end - start)[:, axis])[:, None] * (end - start))
        if len(part := np.vstack(parts)):
            slabs[f"slab{i}"] = _corners(part)["points"]
    return slabs


def mesh_distance(first: Body, T_first: Any, second: Body, T_second: Any, margin_m: float) -> float | None:
    """Return a lower bound of the distance of two bodies' meshes, m; None if they are closer than `margin_m`."""
    T_first, T_second = (coal.Transform3s(T.rotation, T.translation) for T in (T_first, T_second))
    pad, asked, least = first.pad + second.pad, coal.DistanceRequest(), coal.DistanceResult()
    for one, other in product(_slabs_of(first), _slabs_of(second)):
        coal.distance(one, T_first, other, T_second, asked, least)
        if not least.min_distance - pad >= margin_m:
            break
    else:
        return float(least.min_distance - pad)
    request = coal.CollisionRequest()
    request.security_margin = margin_m
    touch = coal.collide(_surface_of(first), T_first, _surface_of(second), T_second, request, coal.CollisionResult())
    return None if touch else margin_m


def body_distance(first: Body, T_first: Pose, second: Body, T_second: Pose) -> tuple[float, Array, Array]:
    """Measure the distance of two bodies at given poses.

    Returns:
        Distance, m, negative by the depth of the overlap; the first body's nearest point (3,); the normal (3,) to the
        second.
    """
    result, placed = coal.DistanceResult(), [to_se3(T) for T in (T_first, T_second)]
    one, other = (coal.Transform3s(T.rotation, T.translation) for T in placed)
    distance = coal.distance(shape_of(first), one, shape_of(second), other, coal.DistanceRequest(), result)
    return distance - first.pad - second.pad, np.array(result.getNearestPoint1()), np.array(result.normal)
