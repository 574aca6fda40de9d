"""Names, joint chain, limits and named poses from a URDF and an SRDF.

Their XML is read directly, so that a `Robot` can be loaded without a robot library. pbd/arm/model.py builds the
kinematic model. Formats: https://wiki.ros.org/urdf/XML, https://wiki.ros.org/srdf.
"""

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from pbd.data import MimicJoint
from pbd.errors import RobotError, listed, printable
from pbd.io.numbers import finite, finite_list
from pbd.io.urdf import LONGEST_M, read_urdf_xml, read_xml

ACTUATED = ("revolute", "continuous", "prismatic")
"""Types of joints with one degree of freedom."""

JOINT_TYPES = (*ACTUATED, "fixed", "floating", "planar")


@dataclass(frozen=True)
class UrdfJoint:
    """A joint at `xyz`, m, in `parent`, with limits in rad and rad/s, or m and m/s; infinite if the URDF has none.

    The position limits are those of its <safety_controller> where these are narrower: ROS controllers keep to them.
    """

    name: str
    kind: str
    parent: str
    child: str
    xyz: tuple[float, ...]
    lower: float
    upper: float
    velocity: float
    mimic: MimicJoint | None

    @property
    def unlimited_mimic(self) -> bool:
        """Whether the joint mimics another and its limits are equal, which is a placeholder."""
        return self.mimic is not None and self.lower == self.upper


@dataclass(frozen=True)
class Urdf:
    """A URDF's links, its joints (name -> joint), and its meshes: (link, address in the URDF, needed to draw only)."""

    path: Path
    links: tuple[str, ...]
    joints: Mapping[str, UrdfJoint]
    meshes: tuple[tuple[str, str, bool], ...]

    def chain(self, base: str, body: str) -> tuple[UrdfJoint, ...]:
        """Return the joints from base to body, fixed ones too; RobotError: `base` is not above `body` in the tree."""
        above = {joint.child: joint for joint in self.joints.values()}
        chain: list[UrdfJoint] = []
        while body != base:
            if body not in above:
                last = chain[0].child if chain else body
                raise RobotError.at(self.path, f"no joints lead from {base!r} to {last!r}; choose another base")
            chain.append(above[body])
            body = above[body].parent
        return tuple(reversed(chain))

    def followers(self, leaders: Collection[str]) -> dict[str, MimicJoint]:
        """Return each joint that mimics one of the `leaders`, also through other joints, and how."""
        found = {}
        for joint in self.joints.values():
            at, multiplier, offset = joint, 1.0, 0.0
            for _ in self.joints:  # no longer: joints may mimic each other in a circle
                if at.name in leaders or at.mimic is None:
                    break
                offset += multiplier * at.mimic.offset
                multiplier *= at.mimic.multiplier
                at = self.joints[at.mimic.leader]
            if at.name in leaders and joint.name not in leaders:
                found[joint.name] = MimicJoint(joint.name, at.name, multiplier, offset)
        return found

    def with_followers(self, leader: str) -> UrdfJoint:
        """Return a joint with its limits narrowed to what the joints that mimic it can follow."""
        narrow = self.joints[leader]
        for name, mimic in self.followers([leader]).items():
            follower, gear = self.joints[name], mimic.multiplier
            if gear == 0.0:
                continue
            # Equal limits are a placeholder, but nothing slides without end.
            endless = follower.kind == "prismatic" and math.isinf(narrow.upper - narrow.lower)
            if endless or not follower.unlimited_mimic:
                ends = sorted((end - mimic.offset) / gear for end in (follower.lower, follower.upper))
                narrow = replace(narrow, lower=max(narrow.lower, ends[0]), upper=min(narrow.upper, ends[1]))
            if follower.velocity > 0.0:  # 0 means unknown
                velocity = follower.velocity / abs(gear)
                narrow = replace(narrow, velocity=min(narrow.velocity or math.inf, velocity))
        return narrow


def read_urdf(path: Path) -> Urdf:
    """Read the links and joints of a URDF; RobotError: a joint is not valid, or the links and joints are not a tree."""
    root = read_urdf_xml(path)
    joints = [_joint(path, element) for element in root.iterfind("joint")]
    links = {_attribute(path, link, "name"): link for link in root.iterfind("link")}
    _check_tree(path, [link.get("name", "") for link in root.iterfind("link")], joints)
    meshes = (
        (name, _attribute(path, mesh, "filename"), part.tag == "visual" and link.find("collision") is not None)
        for name, link in links.items()
        for part in link
        for mesh in part.iter("mesh")
    )
    return Urdf(path, tuple(links), {joint.name: joint for joint in joints}, tuple(dict.fromkeys(meshes)))


def read_named_poses(path: Path) -> dict[str, dict[str, float]]:
    """Read an SRDF's named poses: pose -> joint -> rad or m. The first of two poses with one name wins."""
    poses: dict[str, dict[str, float]] = {}
    for state in read_xml(path).iterfind("group_state"):
        joints = {}
        for joint in state.iterfind("joint"):
            name, text = (_attribute(path, joint, key) for key in ("name", "value"))
            if len(text.split()) > 1:  # a floating or planar joint, which no arm has
                continue
            try:
                joints[name] = finite(text)
            except ValueError:
                raise RobotError.at(path, f"value = {text!r} of a <joint> is not a number; correct it") from None
        poses.setdefault(_attribute(path, state, "name"), joints)
    return poses


def _check_tree(path: Path, links: Sequence[str], joints: Sequence[UrdfJoint]) -> None:
    """Refuse links and joints that are not a tree. Pinocchio refuses them too, but prints its reasons to stderr."""
    known = [joint.name for joint in joints]
    for what, names in (
        ("two links are named {}; rename one of them", links),
        ("two joints are named {}; rename one of them", known),
        ("link {} is the child of two joints; keep one of them", [joint.child for joint in joints]),
    ):
        if twice := next((name for name, count in Counter(names).items() if count > 1), None):
            raise RobotError.at(path, what.format(repr(twice)))
    if "universe" in (*links, *known):  # pinocchio's frame of the world: it finds no other of that name
        raise RobotError.at(path, "a link or joint is named 'universe', as pinocchio's own frame is; rename it")
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in links:
                what = f"joint {joint.name!r} joins {link!r}, which is not a link of it; correct it, or add the link"
                raise RobotError.at(path, what, joint=joint.name)
        if joint.mimic is not None and joint.mimic.leader not in known:
            what = f"joint {joint.name!r} mimics {joint.mimic.leader!r}, which is not a joint of it; correct or remove"
            raise RobotError.at(path, f"{what} its <mimic>", joint=joint.name)
    try:
        TopologicalSorter({joint.child: [joint.parent] for joint in joints}).prepare()
    except CycleError as error:
        loop = sorted(set(error.args[1]))
        raise RobotError.at(path, f"the joints form a loop of links: {listed(loop)}; remove one joint") from None
    children = {joint.child for joint in joints}
    if len(roots := [link for link in links if link not in children]) > 1:
        raise RobotError.at(path, f"several root links: {listed(roots)}; connect all but one")


def _joint(path: Path, element: ET.Element) -> UrdfJoint:
    """Read a <joint>, whose numbers `read_urdf_xml` has checked."""
    name, kind = _attribute(path, element, "name"), _attribute(path, element, "type")
    bounded = kind in ("revolute", "prismatic")
    parts = {part.tag: part for part in reversed(list(element))}  # the first of each tag
    tags = ("origin", "limit", "axis", "safety_controller")
    origin, limit, axis, soft = (parts.get(tag, ET.Element(tag)).attrib for tag in tags)
    wrong = ""
    if kind not in JOINT_TYPES:
        wrong = f"has the type '{printable(kind)}'; make it one of {listed(JOINT_TYPES)}"
    elif lacking := [tag for tag in ("parent", "child", *["limit"] * bounded) if tag not in parts]:
        wrong = f"has no {listed(f'<{tag}>' for tag in lacking)}; add it"
    elif kind in ACTUATED and not any(map(float, axis.get("xyz", "1").split())):
        wrong = "has no axis to move about; give it one"
    if wrong:
        raise RobotError.at(path, f"joint {name!r} {wrong}", joint=name)
    lower, upper = -math.inf, math.inf
    if bounded:
        lower, upper = (float(limit.get(key, 0.0)) for key in ("lower", "upper"))
        if {"soft_lower_limit", "soft_upper_limit"} <= soft.keys():
            lower, upper = max(lower, float(soft["soft_lower_limit"])), min(upper, float(soft["soft_upper_limit"]))
    if kind == "prismatic":  # some URDFs write 1e16 for "no limit": no collision check would come to an end
        lower, upper = max(lower, -LONGEST_M), min(upper, LONGEST_M)
    follows = None
    if (mimic := parts.get("mimic")) is not None and kind != "fixed":  # exporters keep the <mimic> of what they fixed
        gear, offset = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
        follows = MimicJoint(name, _attribute(path, mimic, "joint"), gear, offset)
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=_attribute(path, parts["parent"], "link"),
        child=_attribute(path, parts["child"], "link"),
        xyz=finite_list(origin.get("xyz", "0 0 0"), 3),
        lower=lower,
        upper=upper,
        velocity=float(limit.get("velocity", math.inf)),
        mimic=follows,
    )


def _attribute(path: Path, element: ET.Element, key: str) -> str:
    if not (value := element.get(key)):
        raise RobotError.at(path, f"a <{element.tag}> has no {key}; add it")
    return value
