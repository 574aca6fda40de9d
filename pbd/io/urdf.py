"""XML of a URDF or an SRDF; a URDF's size and numbers are checked; the shapes of its links.

Format: https://wiki.ros.org/urdf/XML.

The libraries get this checked XML instead of the file: urdfdom prints its errors to stderr, and a mesh scale that is
not a number crashes the distance computation.
"""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path
from xml.parsers import expat

import numpy as np

from pbd.data import Robot
from pbd.errors import RobotError, listed, printable
from pbd.io.atomic import is_file
from pbd.io.meshes import mesh_file
from pbd.io.numbers import finite_list
from pbd.io.read_file import read_bytes
from pbd.io.toml import LARGEST_NUMBER
from pbd.pose import Pose

LONGEST_M = 100.0
"""Largest coordinate of an <origin>, and largest size of a shape, m."""

LARGEST_LIMIT = 1e20
"""Largest limit of a joint, in SI units. Some URDFs write 1e16 for "no limit"."""

SMALLEST_M = 1e-6
"""Smallest size of a shape, m, and smallest scale of a mesh."""


@dataclass(frozen=True)
class _Rule:
    """How many numbers an attribute must have, and their bounds; `mirrored`: `least` bounds the magnitude."""

    count: int
    most: float = LARGEST_NUMBER
    least: float = -math.inf
    mirrored: bool = False
    needed: bool = False
    unit: str = ""

    def fault(self, text: str) -> str | None:
        """Return what is wrong with the attribute's text, or None."""
        try:
            values = finite_list(text, self.count)
        except ValueError:
            return "not a number" if self.count == 1 else "not three numbers"
        if max(map(abs, values)) > self.most:
            return f"larger than {self.most:g}{self.unit}"
        least = min(map(abs, values)) if self.mirrored else min(values)
        return f"smaller than {self.least:g}" if least < self.least else None


_NEEDED = _Rule(1, needed=True)
_LENGTH = _Rule(1, LONGEST_M, SMALLEST_M, needed=True, unit=" m")
RULES: dict[str, dict[str, _Rule]] = {
    "origin": {"xyz": _Rule(3, LONGEST_M, unit=" m"), "rpy": _Rule(3)},
    "axis": {"xyz": _Rule(3)},
    "limit": dict.fromkeys(("lower", "upper"), _Rule(1, LARGEST_LIMIT))
    | dict.fromkeys(("effort", "velocity"), _Rule(1, LARGEST_LIMIT, least=0.0)),
    "mimic": dict.fromkeys(("multiplier", "offset"), _Rule(1)),
    "safety_controller": dict.fromkeys(("soft_lower_limit", "soft_upper_limit"), _Rule(1, LARGEST_LIMIT)),
    "mass": {"value": _Rule(1, least=0.0, needed=True)},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), _NEEDED),
    "box": {"size": _Rule(3, LONGEST_M, SMALLEST_M, needed=True, unit=" m")},
    "cylinder": {"radius": _LENGTH, "length": _LENGTH},
    "sphere": {"radius": _LENGTH},
    "capsule": {"radius": _LENGTH, "length": _LENGTH},
    "mesh": {"scale": _Rule(3, LARGEST_NUMBER, SMALLEST_M, mirrored=True)},
}
"""Rules of the attributes of each element. Negative scales mirror a mesh."""

LINK_PARTS = ("inertial", "visual", "collision")
JOINT_PARTS = ("origin", "parent", "child", "axis", "limit", "mimic")
"""Elements of a <link> and of a <joint> that pbd reads."""

SOLIDS = ("box", "cylinder", "sphere", "capsule", "mesh")
"""Elements that a <geometry> may hold."""

Triple = tuple[float, float, float]


def read_xml(path: Path) -> ET.Element:
    """Parse an XML file and return its root; RobotError: it can't be read, with the line if the parser knows it."""
    data = read_bytes(path, RobotError, "correct its path, or mend the file", most=100_000_000)
    try:
        tree = _NoDoctype()
        # Names keep their prefix: as in urdfdom, it need not be declared (drake:acceleration, sensor:camera).
        parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartElementHandler, parser.EndElementHandler = tree.start, tree.end
        parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = tree.data, tree.doctype
        parser.Parse(data, True)
        root: ET.Element = tree.close()
    except (ET.ParseError, expat.ExpatError) as reason:
        raise RobotError.at(path, f"not valid XML: {reason}; correct it") from None
    except (ValueError, LookupError) as reason:  # the parser does not know the encoding
        raise RobotError.at(path, f"not valid XML: {reason}; save it as UTF-8") from None
    return root


class _NoDoctype(ET.TreeBuilder):
    """Refuses a DOCTYPE: its entities can make gigabytes of a small file, and no URDF or SRDF needs one."""

    def doctype(self, name: str, *_: object) -> None:
        raise ET.ParseError(f"a DOCTYPE ({name[:40]}) is not allowed")


def read_urdf_xml(path: Path) -> ET.Element:
    """Read a URDF and check each number in its links and joints; RobotError: it has too many parts or a wrong one."""
    root = read_xml(path)
    if root.tag != "robot":
        what = f"{path} is not a URDF: its root is <{printable(root.tag)}>; give a file whose root is <robot>"
        raise RobotError(what, path=path)
    macros = [f"<{part.tag}>" for part in root.iter() if part.tag.startswith("xacro:")]
    parts = (part for tag in ("link", "joint") for element in root.iterfind(tag) for part in element.iter())
    macros += [value for part in parts for value in part.attrib.values() if "${" in value or "$(" in value]
    if macros:
        what = f"{printable(macros[0])} is not expanded; run `xacro {path.name} > arm.urdf`, and give arm.urdf"
        raise RobotError.at(path, what)
    # The pairs of links grow with the square. The robots of example-robot-data have at most 130, and 101 moving joints.
    for what, most, count in (
        ("links", 500, len(root.findall("link"))),
        ("joints", 500, len(root.findall("joint"))),
        ("moving joints", 150, sum(joint.get("type") != "fixed" for joint in root.iterfind("joint"))),
        ("shapes", 2000, len(root.findall("link/visual")) + len(root.findall("link/collision"))),
    ):
        if count > most:
            tell = f"{count} {what}, more than the {most} that are read; give a file of the arm alone"
            raise RobotError.at(path, tell, value=count, bound=most)
    for link in root.iterfind("link"):
        for part in link:
            if part.tag in LINK_PARTS:
                _check_link_part(path, link, part)
    for joint in root.iterfind("joint"):
        for part in joint:
            if part.tag in (*JOINT_PARTS, "safety_controller"):
                _check_attributes(path, joint, part)
    return root


def kinematics_xml(path: Path) -> str:
    """Return the checked XML of links and joints without shapes, from which pinocchio builds a model."""
    root = read_urdf_xml(path)
    robot = ET.Element("robot", name=root.get("name") or "robot")
    for element in root:
        if element.tag in ("link", "joint"):
            keys = ("name", "type") if element.tag == "joint" else ("name",)
            kept = ET.SubElement(robot, element.tag, {key: element.get(key, "") for key in keys})
            parts = JOINT_PARTS if element.tag == "joint" else ("inertial",)
            kept.extend(part for part in element if part.tag in parts)
            for limit in kept.iterfind("limit"):  # urdfdom requires both
                limit.attrib.setdefault("effort", "0")
                limit.attrib.setdefault("velocity", "0")
    return ET.tostring(robot, encoding="unicode")


def _check_link_part(path: Path, link: ET.Element, part: ET.Element) -> None:
    for inner in part.iter():
        _check_attributes(path, link, inner)
    solids = [solid.tag for solid in part.findall("geometry/*")]
    if part.tag != "inertial" and (len(solids) != 1 or solids[0] not in SOLIDS):
        raise _wrong(path, link, f"a <{part.tag}>", f"must hold one of {listed(SOLIDS)}, has {listed(solids)}")
    if part.tag == "inertial" and (part.find("mass") is None or part.find("inertia") is None):
        raise _wrong(path, link, "the <inertial>", "lacks its <mass> or <inertia>")


def _check_attributes(path: Path, owner: ET.Element, element: ET.Element) -> None:
    """Check an element's attributes; `owner` is the link or joint that contains it."""
    if element.tag == "mesh" and not element.get("filename"):
        raise _wrong(path, owner, "a <mesh>", "has no filename")
    for key, rule in RULES.get(element.tag, {}).items():
        text = element.get(key)
        if text is None and rule.needed:
            raise _wrong(path, owner, f"a <{element.tag}>", f"has no {key}")
        if text is not None and (fault := rule.fault(text)):
            raise _wrong(path, owner, f"{key} = {printable(text)!r} in the <{element.tag}>", f"is {fault}")


def _wrong(path: Path, owner: ET.Element, part: str, fault: str) -> RobotError:
    name = owner.get("name", "")
    what = f"{part} of {owner.tag} {printable(name)!r} {fault}; correct it"
    return RobotError.at(path, what, **{owner.tag: name})


@dataclass(frozen=True, eq=False)
class Shape:
    """A <visual> or <collision> element.

    Attributes:
        element: "visual" or "collision".
        kind: "box", "cylinder", "sphere" or "mesh".
        size: m; box: x, y, z; cylinder: diameter, height; sphere: diameter; mesh: empty. A capsule is three shapes.
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
    """Read the shapes of all links, in the file's order; raises as `read_urdf_xml`.

    A link whose visual mesh is missing has its collision shapes as visual shapes too, if it has any.
    """
    root = read_urdf_xml(robot.urdf)
    named = {material.get("name"): rgb for material in root.iterfind("material") if (rgb := _rgb(material))}
    shapes = list[Shape]()
    for link in root.iterfind("link"):
        elements = (element for element in link if element.tag in ("visual", "collision"))
        own = [part for element in elements for part in _parts(_shape(link.get("name", ""), element, robot, named))]
        solid = [shape for shape in own if shape.element == "collision"]
        meshes = [shape.mesh for shape in own if (shape.element, shape.kind) == ("visual", "mesh")]
        if solid and not all(map(is_file, meshes)):
            own = [*(replace(shape, element="visual") for shape in solid), *solid]
        shapes += own
    return tuple(shapes)


def collision_shapes(robot: Robot) -> tuple[Shape, ...]:
    """Read the shapes for collision checks: a link's <collision> elements, or else its <visual> elements."""
    shapes = read_shapes(robot)
    with_collision = {shape.link for shape in shapes if shape.element == "collision"}
    return tuple(shape for shape in shapes if shape.element == "collision" or shape.link not in with_collision)


def _parts(shape: Shape) -> tuple[Shape, ...]:
    """Return the shape, or the cylinder and the two spheres that a capsule consists of."""
    if shape.kind != "capsule":
        return (shape,)
    diameter, length = shape.size
    ends = (shape.T_link_shape @ Pose.exp((0.0, 0.0, z, 0.0, 0.0, 0.0)) for z in (-0.5 * length, 0.5 * length))
    balls = (replace(shape, kind="sphere", size=(diameter,), T_link_shape=end) for end in ends)
    return (replace(shape, kind="cylinder"), *balls)


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
    return Shape(link, element.tag, T_link_shape, solid.tag, lengths[: 1 + (solid.tag != "sphere")], rgb=rgb)


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
