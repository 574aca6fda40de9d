"""What a robot's TOML needs of its URDF and SRDF: names, the chain of joints, limits, poses.

Plain XML reading, so that a `Robot` can be loaded where no robot library is installed. Kinematics are pinocchio's
business (pbd/arm/model.py). Formats: https://wiki.ros.org/urdf/XML, https://wiki.ros.org/srdf.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pbd.doors.numbers import finite
from pbd.doors.urdf import read_urdf_xml
from pbd.doors.xml import read_xml
from pbd.errors import RobotError, listed

ACTUATED = ("revolute", "continuous", "prismatic")
KINDS = (*ACTUATED, "fixed", "floating", "planar")


@dataclass(frozen=True)
class Mimic:
    """A joint's position is another's times `multiplier` plus `offset`."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfJoint:
    """A joint: what it joins, its limits (rad or m; rad/s or m/s), infinite where the URDF sets none."""

    name: str
    kind: str
    parent: str
    child: str
    lower: float
    upper: float
    velocity: float
    mimic: Mimic | None

    @property
    def actuated(self) -> bool:
        """Whether it moves on its own account."""
        return self.kind in ACTUATED and self.mimic is None


@dataclass(frozen=True)
class Urdf:
    """A URDF's links, its joints by name, and its meshes: (link, address as it stands there)."""

    path: Path
    links: tuple[str, ...]
    joints: Mapping[str, UrdfJoint]
    meshes: tuple[tuple[str, str], ...]

    def chain(self, base: str, body: str) -> tuple[UrdfJoint, ...]:
        """Return the joints from one link down to another, fixed ones included.

        Raises:
            RobotError: a link isn't there (the message lists those that are), or `body` doesn't hang on `base`.
        """
        for role, link in (("base", base), ("body", body)):
            if link not in self.links:
                raise RobotError(f"{self.path} has no link {link!r}; set {role} to one of {listed(self.links)}")
        above = {joint.child: joint for joint in self.joints.values()}
        chain: list[UrdfJoint] = []
        link = body
        while link != base:
            if link not in above or len(chain) > len(above):
                raise RobotError(f"{self.path}: no joints lead from {base!r} to {body!r}; choose another base")
            chain.append(above[link])
            link = above[link].parent
        return tuple(reversed(chain))


def read_urdf(path: Path) -> Urdf:
    """Read the links and joints of a URDF.

    Raises:
        RobotError: not XML, not a URDF, a joint that makes no sense, or links and joints that are no tree.
    """
    root = read_urdf_xml(path)
    joints = [_joint(path, element) for element in root.iterfind("joint")]
    links = [_attribute(path, link, "name") for link in root.iterfind("link")]
    _check_tree(path, links, joints)
    meshes = [
        (name, _attribute(path, mesh, "filename"))
        for name, link in zip(links, root.iterfind("link"), strict=True)
        for mesh in link.iterfind(".//mesh")
    ]
    return Urdf(path, tuple(links), {joint.name: joint for joint in joints}, tuple(dict.fromkeys(meshes)))


def _check_tree(path: Path, links: Sequence[str], joints: Sequence[UrdfJoint]) -> None:
    """Pinocchio asks for it too, but tells its reasons past us."""
    above = {joint.child: joint for joint in joints}
    for what, names in (("links are named", links), ("joints are named", [joint.name for joint in joints])):
        if twice := _twice(names):
            raise RobotError(f"{path}: two {what} {twice!r}; rename one of them", path=path)
    known = set(links)
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in known:
                what = f"joint {joint.name!r} joins {link!r}, which is not a link of it"
                raise RobotError(f"{path}: {what}; correct it, or add the link", path=path, joint=joint.name)
    if twice := _twice([joint.child for joint in joints]):
        what = f"link {twice!r} is the child of two joints"
        raise RobotError(f"{path}: {what}; keep one of them", path=path, joint=above[twice].name)
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        raise RobotError(f"{path}: several root links: {listed(roots)}; connect all but one", path=path)
    below: dict[str, list[str]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint.child)
    reached = list(roots)
    for link in reached:
        reached += below.get(link, [])
    if len(reached) < len(links):
        ring = sorted(known - set(reached))
        raise RobotError(f"{path}: links that hang on each other in a ring: {listed(ring)}; cut it open", path=path)


def _twice(names: Sequence[str]) -> str | None:
    return next((name for name, count in Counter(names).items() if count > 1), None)


def read_poses(path: Path) -> dict[str, dict[str, float]]:
    """Read the named poses of an SRDF: pose name -> joint name -> rad or m; of two poses of one name the first wins."""
    poses: dict[str, dict[str, float]] = {}
    for state in read_xml(path, RobotError).iterfind("group_state"):
        joints = {_attribute(path, j, "name"): _number(path, j, "value") for j in state.iterfind("joint")}
        poses.setdefault(_attribute(path, state, "name"), joints)
    return poses


def _joint(path: Path, element: ET.Element) -> UrdfJoint:
    name, kind = _attribute(path, element, "name"), _attribute(path, element, "type")
    if kind not in KINDS:
        raise RobotError(
            f"{path}: joint {name!r} has the type {kind!r}; make it one of {listed(KINDS)}", path=path, joint=name
        )
    parent, child, limit = element.find("parent"), element.find("child"), element.find("limit")
    if parent is None or child is None or (limit is None and kind in ("revolute", "prismatic")):
        raise RobotError(f"{path}: joint {name!r} lacks its parent, child or limit; add it", path=path, joint=name)
    axis = element.find("axis")
    if axis is not None and kind in ACTUATED and not any(map(float, axis.get("xyz", "1").split())):
        raise RobotError(f"{path}: joint {name!r} has no axis to move about; give it one", path=path, joint=name)
    bounded = limit is not None and kind != "continuous"
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=_attribute(path, parent, "link"),
        child=_attribute(path, child, "link"),
        lower=_number(path, limit, "lower", 0.0) if limit is not None and bounded else -math.inf,
        upper=_number(path, limit, "upper", 0.0) if limit is not None and bounded else math.inf,
        velocity=_number(path, limit, "velocity", math.inf) if limit is not None else math.inf,
        mimic=_mimic(path, element.find("mimic")),
    )


def _mimic(path: Path, element: ET.Element | None) -> Mimic | None:
    if element is None:
        return None
    multiplier, offset = _number(path, element, "multiplier", 1.0), _number(path, element, "offset", 0.0)
    return Mimic(_attribute(path, element, "joint"), multiplier, offset)


def _attribute(path: Path, element: ET.Element, key: str) -> str:
    value = element.get(key)
    if not value:
        raise RobotError(f"{path}: a <{element.tag}> has no {key}; add it", path=path)
    return value


def _number(path: Path, element: ET.Element, key: str, default: float | None = None) -> float:
    text = element.get(key)
    if text is None and default is not None:
        return default
    try:
        return finite(text or "")
    except ValueError:
        what = f"{key} = {text!r} of a <{element.tag}> is not a number"
        raise RobotError(f"{path}: {what}; correct it", path=path) from None
