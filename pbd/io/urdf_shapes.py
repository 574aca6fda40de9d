"""The shapes of a robot's links in its URDF. Format: https://wiki.ros.org/urdf/XML/link."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pbd.data import Robot
from pbd.io.meshes import mesh_file
from pbd.io.numbers import finite_list
from pbd.io.urdf import read_urdf_xml
from pbd.pose import Pose

Triple = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Shape:
    """A <visual> or <collision> element.

    Attributes:
        element: "visual" or "collision".
        kind: "box", "cylinder", "sphere" or "mesh".
        size: m; box: x, y, z; cylinder: diameter, height; sphere: diameter; mesh: empty.
        scale: scale of the mesh's coordinates, along x, y, z.
        rgb: the colour of the URDF's material, 0..1, or None.
    """

    link: str
    element: str
    T_link_shape: Pose
    kind: str
    size: tuple[float, ...] = ()
    mesh: Path = Path()
    scale: Triple = (1.0, 1.0, 1.0)
    rgb: Triple | None = None


def read_shapes(robot: Robot) -> tuple[Shape, ...]:
    """Read the shapes of all links, in the file's order; raises as `read_urdf_xml`."""
    root = read_urdf_xml(robot.urdf)
    named = {material.get("name"): rgb for material in root.iterfind("material") if (rgb := _rgb(material))}
    return tuple(
        _shape(link.get("name", ""), element, robot, named)
        for link in root.iterfind("link")
        for element in link
        if element.tag in ("visual", "collision")
    )


def collision_shapes(robot: Robot) -> tuple[Shape, ...]:
    """Read the shapes for collision checks: a link's <collision> elements, or else its <visual> elements."""
    shapes = read_shapes(robot)
    with_collision = {shape.link for shape in shapes if shape.element == "collision"}
    return tuple(shape for shape in shapes if shape.element == "collision" or shape.link not in with_collision)


def _shape(link: str, element: ET.Element, robot: Robot, named: dict[str | None, Triple]) -> Shape:
    origin, material, solid = element.find("origin"), element.find("material"), element.findall("geometry/*")[0]
    T_link_shape = Pose.identity()
    if origin is not None:
        xyz, rpy = (np.array(_triple(origin.get(key, "0 0 0"))) for key in ("xyz", "rpy"))
        T_link_shape = Pose.from_rpy(xyz, rpy)
    rgb = None if material is None else _rgb(material) or named.get(material.get("name"))
    if solid.tag == "mesh":
        path = mesh_file(solid.attrib["filename"], robot.urdf, robot.package_dirs)
        scale = _triple(solid.get("scale", "1 1 1"))
        return Shape(link, element.tag, T_link_shape, "mesh", mesh=path, scale=scale, rgb=rgb)
    if solid.tag == "box":
        return Shape(link, element.tag, T_link_shape, "box", _triple(solid.attrib["size"]), rgb=rgb)
    lengths = (2.0 * float(solid.attrib["radius"]), float(solid.get("length", "0")))
    return Shape(link, element.tag, T_link_shape, solid.tag, lengths[: 1 + (solid.tag == "cylinder")], rgb=rgb)


def _triple(text: str) -> Triple:
    x, y, z = finite_list(text, 3)
    return x, y, z


def _rgb(material: ET.Element) -> Triple | None:
    """Return a material's colour; None if it has none, or not three numbers."""
    colour = material.find("color")
    try:
        return None if colour is None else _triple(" ".join(colour.get("rgba", "").split()[:3]))
    except ValueError:
        return None
