"""What a robot looks like: the <visual> elements of its URDF, each as a compact mesh on its link.

Format: https://wiki.ros.org/urdf/XML/visual. A mesh's own colours win over the URDF's material, as in RViz.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from pbd.data import Robot
from pbd.doors.meshes import mesh_file
from pbd.doors.numbers import finite_list
from pbd.doors.urdf import read_urdf_xml
from pbd.errors import RobotError
from pbd.pose import Pose
from pbd.view import shapes
from pbd.view.mesh_files import load_mesh
from pbd.view.meshes import Mesh

Rgb = tuple[float, float, float]
GREY: Rgb = (0.75, 0.76, 0.78)
"""For what no file gives a colour."""


@dataclass(frozen=True, eq=False)
class Visual:
    """A mesh and how it lies on a link."""

    link: str
    T_link_visual: Pose
    mesh: Mesh


def read_visuals(robot: Robot) -> tuple[Visual, ...]:
    """Read all visual elements of the robot's URDF, in the file's order.

    Raises:
        RobotError: the URDF or a mesh can't be read; the message names the link.
    """
    root = read_urdf_xml(robot.urdf)
    colours = {
        name: rgb for material in root.iterfind("material") if (rgb := _rgb(material)) and (name := _name(material))
    }
    visuals = []
    for link in root.iterfind("link"):
        for element in link.iterfind("visual"):
            material = element.find("material")
            named = None if material is None else _rgb(material) or colours.get(_name(material))
            try:
                visuals.append(Visual(_name(link), _origin(element), _mesh(element, robot, named or GREY)))
            except (KeyError, IndexError, ValueError) as error:
                raise RobotError(
                    f"{robot.urdf}: a visual of link {_name(link)!r} is malformed ({error}); correct it",
                    path=robot.urdf,
                ) from error
    return tuple(visuals)


def _mesh(visual: ET.Element, robot: Robot, rgb: Rgb) -> Mesh:
    geometry = visual.findall("geometry/*")[0]
    if geometry.tag == "mesh":
        scale = _triple(geometry.get("scale", "1 1 1"))
        return load_mesh(mesh_file(geometry.attrib["filename"], robot.urdf, robot.package_dirs), scale, rgb)
    if geometry.tag == "box":
        return shapes.box(_triple(geometry.attrib["size"]), rgb)
    if geometry.tag == "cylinder":
        return shapes.cylinder(float(geometry.attrib["radius"]), float(geometry.attrib["length"]), rgb)
    if geometry.tag == "sphere":
        return shapes.sphere(float(geometry.attrib["radius"]), rgb)
    raise ValueError(f"geometry {geometry.tag!r} is none of mesh, box, cylinder, sphere")


def _name(element: ET.Element) -> str:
    return element.get("name", "")


def _triple(text: str) -> Rgb:
    x, y, z = finite_list(text, 3)
    return x, y, z


def _rgb(material: ET.Element) -> Rgb | None:
    """None where there is no colour, or it is no three numbers."""
    colour = material.find("color")
    try:
        return None if colour is None else _triple(" ".join(colour.get("rgba", "").split()[:3]))
    except ValueError:
        return None


def _origin(visual: ET.Element) -> Pose:
    origin = visual.find("origin")
    if origin is None:
        return Pose.identity()
    return Pose.from_rpy(np.array(_triple(origin.get("xyz", "0 0 0"))), _triple(origin.get("rpy", "0 0 0")))
