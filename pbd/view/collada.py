"""COLLADA (DAE) files as coloured triangles.

Stock viewers lose parts of the robots' files where one geometry has several materials, so we read them ourselves: all
polygon primitives, node transforms and diffuse colours. As the tools around URDF do, up_axis is ignored and the unit is
obeyed. Format: https://www.khronos.org/files/collada_spec_1_4.pdf.
"""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pbd.doors.numbers import finite
from pbd.doors.xml import read_xml
from pbd.errors import RobotError
from pbd.pose import Array, quat_exp, quat_to_matrix
from pbd.view.meshes import Soup

MOST_BYTES = 100_000_000
"""Largest file: the largest COLLADA mesh of example-robot-data has 29 MB."""

MOST_TRIANGLES = 4_000_000
"""Most triangles of a mesh: small files can show one geometry any number of times."""

MOST_NODES = 20_000
"""Most nodes of a scene, counted each time that one is shown."""

MOST_LEVELS = 100
"""Deepest nesting of nodes."""

SHADERS = ("phong", "lambert", "blinn", "constant")


def read_collada(path: Path) -> Soup:
    """Read the triangles of a DAE file's scene, in metres; a face without a colour is NaN there.

    Raises:
        RobotError: the file is no COLLADA, or breaks its own references.
    """
    root = read_xml(path, RobotError, MOST_BYTES)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # numpy's for text that is no number
            soup = _Document(root).soup()
    except (KeyError, ValueError, IndexError, AttributeError, TypeError, DeprecationWarning) as error:
        raise RobotError(f"{path} can't be read as COLLADA ({error}); export the mesh again", path=path) from error
    return soup


class _Document:
    """An XML tree whose ids can be followed."""

    def __init__(self, root: ET.Element) -> None:
        self.root = root
        self.ids = {name: element for element in root.iter() if (name := element.get("id"))}
        unit = root.find("asset/unit")
        self.metres = 1.0 if unit is None else finite(unit.get("meter", "1"))
        self.steps = 0

    def soup(self) -> Soup:
        scale = np.diag([self.metres] * 3 + [1.0])
        parts: list[tuple[Array, Array]] = []
        count = 0
        for scene in self.root.iterfind("library_visual_scenes/visual_scene"):
            for node in scene.iterfind("node"):
                for instance, T_scene_node in self.instances(node, scale):
                    shown = list(self.primitives(instance, T_scene_node))
                    count += sum(len(corners) for corners, _ in shown)
                    if count > MOST_TRIANGLES:
                        raise ValueError(f"more than {MOST_TRIANGLES} triangles")
                    parts.extend(shown)
        return Soup.join(parts)

    def target(self, element: ET.Element, attribute: str) -> ET.Element:
        return self.ids[element.attrib[attribute].removeprefix("#")]

    def instances(self, node: ET.Element, T: Array, depth: int = 0) -> Iterator[tuple[ET.Element, Array]]:
        """Walk the nodes; the transforms of one apply in the order in which they are written."""
        self.steps += 1
        if depth > MOST_LEVELS or self.steps > MOST_NODES:
            raise ValueError("its nodes never end")
        for child in node:
            if child.tag in ("matrix", "translate", "rotate", "scale"):
                T = T @ _transform(child)
            elif child.tag == "node":
                yield from self.instances(child, T, depth + 1)
            elif child.tag == "instance_node":
                yield from self.instances(self.target(child, "url"), T, depth + 1)
            elif child.tag == "instance_geometry":
                yield child, T

    def primitives(self, instance: ET.Element, T: Array) -> Iterator[tuple[Array, Array]]:
        """The corners (m, 3, 3) and colours (m, 3) of each polygon primitive of a geometry."""
        colours = {
            bind.attrib["symbol"]: self.diffuse(self.target(bind, "target"))
            for bind in instance.iterfind("bind_material/technique_common/instance_material")
        }
        for mesh in self.target(instance, "url").iterfind("mesh"):
            for primitive in mesh:
                if primitive.tag not in ("triangles", "polylist", "polygons"):
                    continue
                corners = self.corners(primitive) @ T[:3, :3].T + T[:3, 3]
                if np.linalg.det(T[:3, :3]) < 0.0:
                    corners = corners[:, ::-1]
                rgb = colours.get(primitive.get("material", ""), np.full(3, np.nan))
                yield corners, np.tile(rgb, (len(corners), 1))

    def corners(self, primitive: ET.Element) -> Array:
        inputs = primitive.findall("input")
        stride = 1 + max(int(each.attrib["offset"]) for each in inputs)
        vertex = primitive.find("input[@semantic='VERTEX']")
        if vertex is None:
            raise ValueError("a primitive without vertices")
        position = self.target(vertex, "source").find("input[@semantic='POSITION']")
        if position is None:
            raise ValueError("vertices without positions")
        values = self.target(position, "source").findtext("float_array", "")
        points = np.fromstring(values, sep=" ").reshape(-1, 3)
        polygons = [_integers(p.text).reshape(-1, stride) for p in primitive.iterfind("p")]
        if not polygons:
            return np.empty((0, 3, 3))
        index = np.concatenate(polygons)[:, int(vertex.attrib["offset"])]
        if primitive.tag == "polylist":
            sides = _integers(primitive.findtext("vcount"))
        elif primitive.tag == "polygons":
            sides = np.array([len(polygon) for polygon in polygons])
        else:
            sides = np.full(len(index) // 3, 3)
        if sides.min(initial=0) < 0 or sides.sum() > len(index) or index.min(initial=0) < 0:
            raise ValueError("a polygon without corners")
        return points[index[_fans(sides)]]

    def diffuse(self, material: ET.Element) -> Array:
        """RGB in 0..1 as the file says it, NaN where the colour is a texture."""
        effect = material.find("instance_effect")
        if effect is None:
            return np.full(3, np.nan)
        for shader in SHADERS:
            colour = self.target(effect, "url").find(f"profile_COMMON/technique/{shader}/diffuse/color")
            if colour is not None:
                return np.fromstring(colour.text or "", sep=" ")[:3]
        return np.full(3, np.nan)


def _integers(text: str | None) -> NDArray[np.int64]:
    return np.fromstring(text or "", dtype=np.int64, sep=" ")


def _fans(sides: NDArray[np.int64]) -> NDArray[np.int64]:
    """Split polygons with `sides` corners each into triangles around their first corner: (m, 3) corner numbers."""
    first = np.repeat(np.cumsum(sides) - sides, np.maximum(sides - 2, 0))
    ends = np.cumsum(np.maximum(sides - 2, 0))
    second = np.arange(len(first)) - np.repeat(ends - np.maximum(sides - 2, 0), np.maximum(sides - 2, 0)) + 1
    return np.stack((first, first + second, first + second + 1), axis=-1)


def _transform(element: ET.Element) -> Array:
    values = np.fromstring(element.text or "", sep=" ")
    T = np.eye(4)
    if element.tag == "matrix":
        return values.reshape(4, 4)
    if element.tag == "translate":
        T[:3, 3] = values
    elif element.tag == "scale":
        T[:3, :3] = np.diag(values)
    else:
        T[:3, :3] = quat_to_matrix(quat_exp(values[:3] * np.radians(values[3])))
    return T
