"""What a robot's TOML needs of its URDF and SRDF: names, the chain of joints, limits, poses.

Plain XML reading, so that a `Robot` can be loaded where no robot library is installed. Kinematics are pinocchio's
business (pbd/arm/model.py). Formats: https://wiki.ros.org/urdf/XML, https://wiki.ros.org/srdf.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from pbd.errors import RobotError

ACTUATED = ("revolute", "continuous", "prismatic")


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
    mimics: bool

    @property
    def actuated(self) -> bool:
        """Whether it moves on its own account."""
        return self.kind in ACTUATED and not self.mimics


@dataclass(frozen=True)
class Urdf:
    """A URDF's links and joints by name."""

    path: Path
    links: tuple[str, ...]
    joints: Mapping[str, UrdfJoint]

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
        RobotError: not XML, not a URDF, or a joint that makes no sense.
    """
    root = _parse(path)
    if root.tag != "robot":
        raise RobotError(f"{path} is no URDF: its root is <{root.tag}>; give a file whose root is <robot>", path=path)
    joints = [_joint(path, element) for element in root.iterfind("joint")]
    links = tuple(_attribute(path, link, "name") for link in root.iterfind("link"))
    return Urdf(path, links, {joint.name: joint for joint in joints})


def read_poses(path: Path) -> dict[str, dict[str, float]]:
    """Read the named poses of an SRDF: pose name -> joint name -> rad or m; of two poses of one name the first wins."""
    poses: dict[str, dict[str, float]] = {}
    for state in _parse(path).iterfind("group_state"):
        joints = {_attribute(path, j, "name"): _number(path, j, "value") for j in state.iterfind("joint")}
        poses.setdefault(_attribute(path, state, "name"), joints)
    return poses


def listed(names: Iterable[str]) -> str:
    """Names for an error message."""
    return ", ".join(names) or "(none)"


class _NoDoctype(ET.TreeBuilder):
    """Neither format has a DOCTYPE, and the entities that one can define can swell a small file to gigabytes."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise ET.ParseError(f"a DOCTYPE ({name}) is not taken")


def _parse(path: Path) -> ET.Element:
    try:
        return ET.fromstring(path.read_bytes(), parser=ET.XMLParser(target=_NoDoctype()))
    except OSError as reason:
        raise RobotError(f"{path}: can't be read ({reason}); correct the path in the robot's TOML", path=path) from None
    except ET.ParseError as reason:
        raise RobotError(f"{path}: not valid XML: {reason}; mend it there", path=path) from None


def _joint(path: Path, element: ET.Element) -> UrdfJoint:
    name, kind = _attribute(path, element, "name"), _attribute(path, element, "type")
    parent, child, limit = element.find("parent"), element.find("child"), element.find("limit")
    if parent is None or child is None or (limit is None and kind in ("revolute", "prismatic")):
        raise RobotError(f"{path}: joint {name!r} lacks its parent, child or limit; add it", path=path, joint=name)
    bounded = limit is not None and kind != "continuous"
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=_attribute(path, parent, "link"),
        child=_attribute(path, child, "link"),
        lower=_number(path, limit, "lower", 0.0) if limit is not None and bounded else -math.inf,
        upper=_number(path, limit, "upper", 0.0) if limit is not None and bounded else math.inf,
        velocity=_number(path, limit, "velocity", math.inf) if limit is not None else math.inf,
        mimics=element.find("mimic") is not None,
    )


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
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RobotError(f"{path}: {key} = {text!r} of a <{element.tag}> is no number; correct it", path=path)
    return value
