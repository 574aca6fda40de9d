"""Check that an arm's collision shapes cover its links, since a link without a shape never touches anything.

A shape should be as large as its link. A mesh in the wrong unit is not.
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pinocchio as pin

from pbd.arm.collision.geometry import Body, bodies_of, link_bodies
from pbd.arm.collision.motion_bounds import outline
from pbd.arm.model import ArmModel
from pbd.errors import in_mm_or_cm
from pbd.io.urdf import Shape, read_shapes

SMALL_SHARE = 0.5
"""A shape is doubtful if its size is below this share of its link's visual shape, or of the distance between its
joints. The smallest shares of the bundled arms are 0.78 and 0.79."""

LEAST_LINK_M = 0.01
"""A link whose joints are closer than this, m, needs no shape: in a wrist several joints may be at one point."""


@lru_cache(maxsize=16)
def doubtful_shapes(arm: ArmModel) -> dict[str, str]:
    """Return the links with doubtful shapes, in the URDF's order, and why ("has no collision shape").

    Raises:
        RobotError: as `link_bodies`.
    """
    bodies, found = link_bodies(arm), dict[str, str]()
    for joint in range(arm.full.njoints):
        own = [body for body in bodies if body.joint == joint]
        if (why := _between_joints(arm, joint, own)) is not None:
            found[own[0].name if own else _link(arm, joint)] = why
    shapes = read_shapes(arm.robot)
    for link in arm.links:
        drawn, hit = ([s for s in shapes if (s.link, s.element) == (link, each)] for each in ("visual", "collision"))
        if drawn and hit and [_solid(shape) for shape in drawn] != [_solid(shape) for shape in hit]:
            size, seen = _size(body for body in bodies if body.name == link), _size(bodies_of(arm, drawn))
            if size < SMALL_SHARE * seen:
                found[link] = f"has a collision shape of {in_mm_or_cm(size)}, but is drawn {in_mm_or_cm(seen)} large"
    return {link: found[link] for link in arm.links if link in found}


def _between_joints(arm: ArmModel, joint: int, own: list[Body]) -> str | None:
    """Compare the size of the bodies on a joint (0: the base) with the distance to the next; say what is wrong."""
    model = arm.full
    following = [i for i in range(1, model.njoints) if model.parents[i] == joint]
    length = max((float(np.linalg.norm(model.jointPlacements[i].translation)) for i in following), default=0.0)
    if not own:
        needed = length > LEAST_LINK_M or not following
        if joint == 0:  # the root of a rail, a lift or a gantry is often no more than a frame
            needed = not all(arm.axes[i][1] for i in following)
        return "has no collision shape" if needed else None
    size = _size(own)
    if joint == 0 or size >= SMALL_SHARE * length:
        return None  # a base may be small and stand far from joint 1
    return f"has a collision shape of {in_mm_or_cm(size)}, but its joints are {in_mm_or_cm(length)} apart"


def _solid(shape: Shape) -> tuple[object, ...]:
    return shape.kind, shape.size, shape.mesh, shape.scale


def _link(arm: ArmModel, joint: int) -> str:
    """Return the name of a link that moves with a joint; the base for joint 0."""
    if joint == 0:
        return arm.robot.base
    frames = (frame for frame in arm.full.frames if frame.type == pin.FrameType.BODY and frame.parentJoint == joint)
    return str(next(frames).name)


def _size(bodies: Iterable[Body]) -> float:
    """Return the diagonal of the bounding box of bodies on one joint, m."""
    ends = []
    for body in bodies:
        points, radius = outline(replace(body, pad=0.0))
        ends += [body.T_joint_body.act(points) - radius, body.T_joint_body.act(points) + radius]
    return float(np.linalg.norm(np.ptp(np.concatenate(ends), axis=0)))
