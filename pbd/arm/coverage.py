"""Whether the collision shapes of an arm cover it: what has none is never found to touch anything.

Shapes are as large as the links that they stand for; a mesh in millimetres that is read in metres isn't.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin

from pbd.arm.hulls import Body, drawn_bodies, link_bodies
from pbd.arm.model import ArmModel
from pbd.arm.motion_bounds import outline
from pbd.doors.urdf import read_urdf_xml

SMALL = 0.5
"""A shape is doubted below this share of what is drawn of its link, or of the distance between its joints. Of the
bundled arms' links the smallest shares are 0.78 and 0.79."""

LEAST_LINK_M = 0.01
"""A link whose joints are closer than this may do without a shape: a wrist may be several joints in one place."""


@dataclass(frozen=True)
class Doubt:
    """A link that no shape covers, or one far too small, and why that is thought ("has no collision shape")."""

    link: str
    why: str


@lru_cache(maxsize=4)
def doubts(arm: ArmModel) -> tuple[Doubt, ...]:
    """Return the links whose shapes can't be trusted, in the URDF's order.

    Raises:
        RobotError: as `link_bodies`.
    """
    bodies, found = link_bodies(arm), dict[str, str]()
    for joint in range(arm.full.njoints):
        own = [body for body in bodies if body.joint == joint]
        if (why := _between_joints(arm, joint, own)) is not None:
            found[own[0].name if own else _link(arm, joint)] = why
    for link in read_urdf_xml(arm.robot.urdf).iterfind("link"):
        name, drawn = link.get("name", ""), link.findall("visual")
        if drawn and link.findall("collision") and _solids(link, "visual") != _solids(link, "collision"):
            size = _size(body for body in bodies if body.name == name)
            seen = _size(body for visual in drawn for body in drawn_bodies(visual, arm.robot))
            if size < SMALL * seen:
                found[name] = f"has a collision shape of {_length(size)}, but is drawn {_length(seen)} large"
    return tuple(Doubt(link, found[link]) for link in arm.links if link in found)


def _between_joints(arm: ArmModel, joint: int, own: list[Body]) -> str | None:
    """Say what is wrong with all that moves with a joint (0: with the base), by how far the next joints are."""
    model = arm.full
    following = [i for i in range(1, model.njoints) if model.parents[i] == joint]
    length = max((float(np.linalg.norm(model.jointPlacements[i].translation)) for i in following), default=0.0)
    if not own:
        needed = joint == 0 or length > LEAST_LINK_M or not following
        return "has no collision shape" if needed else None
    size = _size(own)
    if joint == 0 or size >= SMALL * length:
        return None  # a base may stand anywhere
    return f"has a collision shape of {_length(size)}, but its joints are {_length(length)} apart"


def _solids(link: ET.Element, kind: str) -> list[tuple[str, dict[str, str]]]:
    return [(solid.tag, solid.attrib) for solid in link.findall(f"{kind}/geometry/*")]


def _link(arm: ArmModel, joint: int) -> str:
    """Name a link that moves with a joint; the base for those that don't move."""
    if joint == 0:
        return arm.robot.base
    frames = (frame for frame in arm.full.frames if frame.type == pin.FrameType.BODY and frame.parentJoint == joint)
    return str(next(frames).name)


def _size(bodies: Iterable[Body]) -> float:
    """The diagonal of the box that holds bodies on one joint or link, m."""
    ends = []
    for body in bodies:
        points, radius = outline(body)
        ends += [body.T_joint_body.act(points) - radius, body.T_joint_body.act(points) + radius]
    return float(np.linalg.norm(np.ptp(np.concatenate(ends), axis=0)))


def _length(metres: float) -> str:
    return f"{1e3 * metres:.2g} mm" if metres < 0.01 else f"{1e2 * metres:.1f} cm"
