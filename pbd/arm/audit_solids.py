"""The audit's own shapes: each <collision> element as it is, and one convex hull of each mesh for a first look.

A link without any takes its <visual> elements, as what can be seen can be hit. Hulls are kept in the user's cache by
the file's bytes; a mesh itself is read only where its hull comes near something.
"""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any

import coal
import numpy as np

from pbd.arm.audit_arm import AuditArm, Frame
from pbd.cache import recall, remember
from pbd.data import Robot
from pbd.errors import RobotError
from pbd.pose import Array, quat_from_rpy, quat_to_matrix

BEYOND_M = 1e-3
"""How far (m) corners of a mesh's hull may stick out of the hull of those that are kept; `ball` covers them."""

_VERSION = 1  # part of the cache's keys


@dataclass(frozen=True, eq=False)
class Solid:
    """A shape that moves with a joint.

    It lies inside the convex hull of `corners`, made larger by `ball` all round and by `disc` across z.

    Attributes:
        name: of its link, or of a thing in the world.
        joint: what carries it; 0: it stands still.
        T_joint_solid: its place there.
        corners: (n, 3) m.
        ball, disc: m.
        load: gives the shape itself, as coal takes it.
        floor: it is all that lies below z = 0, and has no corners.
    """

    name: str
    joint: int
    T_joint_solid: Frame
    corners: Array
    load: Callable[[], Any]
    ball: float = 0.0
    disc: float = 0.0
    floor: bool = False

    @cached_property
    def reach(self) -> float:
        """How far any of it is from its joint's origin at most, m."""
        p = self.T_joint_solid.act(self.corners)
        return float(np.linalg.norm(p, axis=1).max(initial=0.0)) + self.ball + self.disc

    @cached_property
    def around(self) -> tuple[Array, float]:
        """A ball that holds it: its middle (3,) on the joint, and its radius."""
        if self.floor:
            return np.zeros(3), np.inf
        middle = 0.5 * (self.corners.min(axis=0) + self.corners.max(axis=0))
        radius = float(np.linalg.norm(self.corners - middle, axis=1).max()) + self.ball + self.disc
        return self.T_joint_solid.act(middle), radius

    @cached_property
    def rough(self) -> Any:
        """The hull of the corners as coal takes it, or the shape itself where that is as simple."""
        return self.exact if len(self.corners) <= 8 else _hull(self.corners)

    @cached_property
    def exact(self) -> Any:
        """The shape itself, as coal takes it."""
        return self.load()

    def support(self, directions: Array) -> Array:
        """How far (n,) it reaches at most along unit directions (n, 3), in its own frame."""
        if self.floor:
            return np.zeros(len(directions))  # upward
        far: Array = (directions @ self.corners.T).max(axis=1)
        return far + self._round(directions)

    def box_support(self, directions: Array) -> Array:
        """The same of a box around it: more, but quick."""
        low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        far: Array = 0.5 * (directions @ (low + high) + np.abs(directions) @ (high - low))
        return far + self._round(directions)

    def _round(self, directions: Array) -> Array | float:
        return self.ball + (self.disc * np.hypot(directions[:, 0], directions[:, 1]) if self.disc else 0.0)


def link_solids(arm: AuditArm) -> list[Solid]:
    """Read the shapes of all links.

    Raises:
        RobotError: one can't be read.
    """
    solids = []
    for link in ET.parse(arm.robot.urdf).getroot().iterfind("link"):
        name = link.get("name", "")
        joint, T_joint_link = arm.link(name)
        for element in link.findall("collision") or link.findall("visual"):
            try:
                solids.append(_read(element, arm.robot, name, joint, T_joint_link))
            except (KeyError, IndexError, ValueError, OSError, RuntimeError) as reason:
                why = " ".join(str(reason).split())
                message = f"{arm.robot.urdf}: a shape of link {name!r} can't be audited ({why}); correct it there"
                raise RobotError(message, path=arm.robot.urdf, link=name) from None
    return solids


def simple_solid(name: str, joint: int, T_joint_solid: Frame, shape: str, size: tuple[float, ...]) -> Solid:
    """Make a box (x, y, z), a sphere (diameter), a cylinder or a capsule (diameter, height without round ends) in m."""
    if not all(np.isfinite(each) and each > 0.0 for each in size):
        raise ValueError(f"a {shape} of size {size}")
    half = 0.5 * np.array(size)
    if shape == "box":
        corners = half * np.array([np.where(mask, 1.0, -1.0) for mask in np.ndindex(2, 2, 2)])
        return Solid(name, joint, T_joint_solid, corners, partial(coal.Box, *size))
    if shape == "sphere":
        return Solid(name, joint, T_joint_solid, np.zeros((1, 3)), partial(coal.Sphere, half[0]), ball=half[0])
    ends = np.array([[0.0, 0.0, -half[1]], [0.0, 0.0, half[1]]])
    if shape == "cylinder":
        return Solid(name, joint, T_joint_solid, ends, partial(coal.Cylinder, half[0], size[1]), disc=half[0])
    if shape == "capsule":
        return Solid(name, joint, T_joint_solid, ends, partial(coal.Capsule, half[0], size[1]), ball=half[0])
    raise ValueError(f"{shape!r} is none of box, cylinder, capsule, sphere")


def floor(name: str, T_base_floor: Frame) -> Solid:
    """Make a table without an end."""
    below = partial(coal.Halfspace, np.array([0.0, 0.0, 1.0]), 0.0)
    return Solid(name, 0, T_base_floor, np.empty((0, 3)), below, floor=True)


def _read(element: ET.Element, robot: Robot, name: str, joint: int, T_joint_link: Frame) -> Solid:
    origin = element.find("origin")
    xyz, rpy = (_three(origin.get(key, "0 0 0") if origin is not None else "0 0 0") for key in ("xyz", "rpy"))
    T_joint_solid = T_joint_link @ Frame(quat_to_matrix(quat_from_rpy(rpy)), np.array(xyz))
    geometry = element.findall("geometry/*")[0]
    if geometry.tag == "mesh":
        path, scale = _find(geometry.attrib["filename"], robot), _three(geometry.get("scale", "1 1 1"))
        corners, ball = _mesh_corners(path, scale)
        return Solid(name, joint, T_joint_solid, corners, partial(_mesh, path, scale), ball=ball)
    keys = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}[geometry.tag]
    size = [float(value) for key in keys for value in geometry.attrib[key].split()]
    if geometry.tag != "box":
        size[0] *= 2.0
    return simple_solid(name, joint, T_joint_solid, geometry.tag, tuple(size))


@lru_cache(maxsize=64)
def _mesh_corners(path: Path, scale: tuple[float, ...]) -> tuple[Array, float]:
    """Return corners (n, 3) of a mesh's convex hull, and how far it reaches beyond the hull of these."""
    key = hashlib.sha256(repr((_VERSION, BEYOND_M, path.suffix, scale)).encode() + path.read_bytes()).hexdigest()
    kept = recall("audit", key)
    if kept is None:
        kept = _fewer(np.array(_hull(_vertices(path, scale)).points()))
        remember("audit", key, kept)
    return np.asarray(kept["corners"], dtype=np.float64), float(kept["beyond"])


def _fewer(corners: Array) -> dict[str, Any]:
    """Keep the corners of a hull that are outermost in one of many directions, as many as BEYOND_M asks for."""
    directions = 100
    while len(corners) > directions:
        few = corners[np.unique((corners @ _directions(directions).T).argmax(axis=0))]
        hull = _hull(few)
        beyond = max(_distance(hull, p) for p in corners)
        if beyond <= BEYOND_M:
            return {"corners": few, "beyond": beyond}
        directions *= 2
    return {"corners": corners, "beyond": 0.0}


def _mesh(path: Path, scale: tuple[float, ...]) -> Any:
    # Coal mixes up the faces of a Collada file with several materials: there the hull has to do.
    return _hull(_vertices(path, scale)) if path.suffix.lower() == ".dae" else _load(path, scale)


def _vertices(path: Path, scale: tuple[float, ...]) -> Array:
    return np.array(_load(path, scale).vertices())


@lru_cache(maxsize=64)
def _load(path: Path, scale: tuple[float, ...]) -> Any:
    return coal.MeshLoader().load(str(path), np.array(scale))


def _hull(points: Array) -> Any:
    if not np.isfinite(points).all():
        raise ValueError("a mesh with a number that is not finite")
    listed = coal.StdVec_Vec3s()
    listed.extend(list(points))
    return coal.Convex.convexHull(listed, True, "Qt")


def _distance(shape: Any, p: Array) -> float:
    """How far a point (3,) is outside a shape, m."""
    unmoved, there = coal.Transform3s.Identity(), coal.Transform3s(np.eye(3), p)
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return max(0.0, float(coal.distance(shape, unmoved, coal.Sphere(0.0), there, request, result)))


def _directions(count: int) -> Array:
    """Unit vectors (count, 3) spread evenly, along a spiral."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn, radius = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count), np.sqrt(1.0 - z**2)
    return np.stack((radius * np.cos(turn), radius * np.sin(turn), z), axis=1)


def _find(address: str, robot: Robot) -> Path:
    if not address.startswith("package://"):
        return robot.urdf.parent / address.removeprefix("file://")
    inside = Path(address.removeprefix("package://"))
    folders = [*robot.package_dirs, *(folder.parent for folder in robot.package_dirs if folder.name == inside.parts[0])]
    found = next((folder / inside for folder in folders if (folder / inside).is_file()), None)
    if found is None:
        raise FileNotFoundError(f"{address} is nowhere")
    return found


def _three(text: str) -> tuple[float, float, float]:
    x, y, z = map(float, text.split())
    if not np.isfinite((x, y, z)).all():
        raise ValueError(f"{text!r} is not finite")
    return x, y, z
