"""A robot's links as convex bodies, from the <collision> elements of its URDF.

A link without any takes its <visual> elements (so100's gripper, z1's link01): what can be seen can be hit. Meshes
become convex parts (convex.py), kept in the user's cache by the file's bytes. Format:
https://wiki.ros.org/urdf/XML/link.
"""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from pbd.arm.convex import ConvexPart, convex_parts, simplified
from pbd.arm.model import ArmModel, from_se3
from pbd.cache import recall, remember
from pbd.data import Robot
from pbd.doors.meshes import load_by_assimp, mesh_file, read_mesh_bytes
from pbd.doors.urdf import read_urdf_xml
from pbd.errors import RobotError
from pbd.pose import Array, Pose, readonly

VERSION = 1
"""Part of the cache's keys: raise it when the same file would give other parts."""


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
        RobotError: a mesh is missing or can't be read, or an element makes no sense; the message names the link.
    """
    robot, bodies = arm.robot, []
    for link in read_urdf_xml(robot.urdf).iterfind("link"):
        name = link.get("name", "")
        frame = arm.full.frames[arm.full.getFrameId(name, pin.FrameType.BODY)]
        T_joint_link = from_se3(frame.placement)
        for element in link.findall("collision") or link.findall("visual"):
            try:
                parts = list(_read(element, robot))
            except (KeyError, IndexError, ValueError) as reason:
                raise RobotError(
                    f"{robot.urdf}: a shape of link {name!r} is invalid ({reason}); correct it",
                    path=robot.urdf,
                    link=name,
                ) from None
            for T_link_body, shape, size, part in parts:
                T_joint_body = T_joint_link @ T_link_body
                bodies.append(Body(name, int(frame.parentJoint), T_joint_body, shape, size, part.points, part.pad))
    return tuple(bodies)


def _read(element: ET.Element, robot: Robot) -> Iterator[tuple[Pose, str, tuple[float, ...], ConvexPart]]:
    T_link_body, nothing = _origin(element), ConvexPart(np.empty((0, 3)), 0.0)
    geometry = element.findall("geometry/*")[0]
    if geometry.tag == "box":
        yield T_link_body, "box", _numbers(geometry.attrib["size"]), nothing
    elif geometry.tag == "cylinder":
        size = (2.0 * float(geometry.attrib["radius"]), float(geometry.attrib["length"]))
        yield T_link_body, "cylinder", size, nothing
    elif geometry.tag == "sphere":
        yield T_link_body, "sphere", (2.0 * float(geometry.attrib["radius"]),), nothing
    elif geometry.tag == "mesh":
        path = mesh_file(geometry.attrib["filename"], robot.urdf, robot.package_dirs)
        for part in _mesh_parts(path, _numbers(geometry.get("scale", "1 1 1"))):
            yield T_link_body, "hull", (), part
    else:
        raise ValueError(f"{geometry.tag!r} is not a mesh, box, cylinder or sphere")


def drawn_bodies(element: ET.Element, robot: Robot) -> Iterator[Body]:
    """Give a link's <visual> element as bodies on the link; a mesh is as large as the box that holds it."""
    geometry = element.findall("geometry/*")[0]
    if geometry.tag != "mesh":
        for T_link_body, shape, size, part in _read(element, robot):
            yield Body("", 0, T_link_body, shape, size, part.points, part.pad)
        return
    path = mesh_file(geometry.attrib["filename"], robot.urdf, robot.package_dirs)
    scale = np.array(_numbers(geometry.get("scale", "1 1 1")))
    key = hashlib.sha256(repr((VERSION, path.suffix)).encode() + read_mesh_bytes(path)).hexdigest()
    if (kept := recall("boxes", key)) is None:
        vertices, _ = load_by_assimp(path)
        kept = {"box": np.stack((vertices.min(axis=0), vertices.max(axis=0)))}
        remember("boxes", key, kept)
    middle, size = scale * kept["box"].mean(axis=0), np.abs(scale) * np.ptp(kept["box"], axis=0)
    yield Body("", 0, _origin(element) @ Pose(middle, Pose.identity().wxyz), "box", tuple(size.tolist()))


def _mesh_parts(path: Path, scale: tuple[float, ...]) -> list[ConvexPart]:
    content = read_mesh_bytes(path)
    key = hashlib.sha256(repr((VERSION, path.suffix, scale)).encode() + content).hexdigest()
    if (kept := recall("hulls", key)) is not None:
        points = np.split(kept["points"], np.cumsum(kept["counts"])[:-1])
        return [ConvexPart(part, float(pad)) for part, pad in zip(points, kept["pads"], strict=True)]
    vertices, faces = load_by_assimp(path)
    vertices = vertices * np.array(scale)
    # Coal mixes up the faces of DAE files with several materials; their corners it reads right.
    parts = [simplified(vertices)] if path.suffix.lower() == ".dae" else convex_parts(vertices[faces])
    arrays = {
        "points": np.concatenate([part.points for part in parts]),
        "counts": np.array([len(part.points) for part in parts]),
        "pads": np.array([part.pad for part in parts]),
    }
    remember("hulls", key, arrays)
    return parts


def _origin(element: ET.Element) -> Pose:
    origin = element.find("origin")
    if origin is None:
        return Pose.identity()
    return Pose.from_rpy(_numbers(origin.get("xyz", "0 0 0")), _numbers(origin.get("rpy", "0 0 0")))


def _numbers(text: str) -> tuple[float, ...]:
    x, y, z = map(float, text.split())
    return x, y, z
