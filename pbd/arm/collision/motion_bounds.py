"""How far a body can move at most while joints turn: the bound that lets collision checks skip ahead.

A point moves with a turning joint by no more than the angle times its distance from the axis, whatever the other joints
do: a body is within a ball, and all places where another joint may take that are within a larger ball around its axis.
Two bodies get no nearer to each other than either moves as seen from the other: the one nearer to the axis bounds both.
Coordinates `x` are (k + 1,): the arm's joints q (rad; m where one slides), then the gripper's opening, 1 open to 0
closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pbd.arm.collision.geometry import Body
from pbd.arm.model import ArmModel
from pbd.pose import Array


def rates(arm: ArmModel, bodies: Sequence[Body], pairs: NDArray[np.int64]) -> Array:
    """Bound (p, k + 1), in m per unit of each coordinate, how fast the distance of each of the pairs (p, 2) changes.

    Only the joints between the two bodies count: those further down move both alike.
    """
    reach, chains, columns = [levers(arm, body) for body in bodies], _chains(arm), _columns(arm)
    bound = np.zeros((len(pairs), len(arm.robot.joints) + 1))
    for row, (first, second) in enumerate(pairs):
        for joint in chains[bodies[first].joint] ^ chains[bodies[second].joint]:
            if joint in columns:
                column, share = columns[joint]
                bound[row, column] += share * min(reach[first][joint], reach[second][joint])
    return bound


@lru_cache(maxsize=1024)
def levers(arm: ArmModel, body: Body) -> Array:
    """For each joint: m that any of the body's points moves at most per rad (or per m) of it.

    Of a joint that doesn't carry the body: as seen from what it carries.
    """
    model, found = arm.full, np.full(arm.full.njoints, np.inf)
    if body.shape == "floor":
        return found  # it has no end
    p, radius = outline(body)
    # By joint: where the body may be in the joint's frame, as balls around points.
    balls = {body.joint: (body.T_joint_body.act(p), radius)}
    for joint in reversed(list(model.supports[body.joint])[1:]):
        found[joint], p, radius = _swept(arm, joint, *balls[joint])
        placed = model.jointPlacements[joint]
        balls[model.parents[joint]] = p @ placed.rotation.T + placed.translation, radius
    for joint in range(1, model.njoints):
        if joint not in balls:
            (p, radius), placed = balls[model.parents[joint]], model.jointPlacements[joint]
            found[joint], p, radius = _swept(arm, joint, (p - placed.translation) @ placed.rotation, radius)
            balls[joint] = p, radius
    return found


def _swept(arm: ArmModel, joint: int, p: Array, radius: float) -> tuple[float, Array, float]:
    """Move balls around points (n, 3) in a joint's frame with the joint.

    Returns:
        m that they move at most per rad (or per m); points (m, 3) and a radius of balls that hold them all the way.
    """
    axis, slides = _axes(arm)[joint]
    if slides:
        return 1.0, p, radius + _most_slide(arm, joint)
    along = p @ axis
    centre = 0.5 * (along.min() + along.max()) * axis
    lever = float(np.linalg.norm(p - along[:, None] * axis, axis=1).max()) + radius
    return lever, centre[None], float(np.linalg.norm(p - centre, axis=1).max()) + radius


def outline(body: Body) -> tuple[Array, float]:
    """Points and a radius: all of the body lies within the radius of their hull."""
    if body.shape == "hull":
        return body.points, body.pad
    if body.shape == "sphere":
        return np.zeros((1, 3)), 0.5 * body.size[0] + body.pad
    if body.shape in ("cylinder", "capsule"):
        diameter, height = body.size
        return np.array([[0.0, 0.0, -0.5 * height], [0.0, 0.0, 0.5 * height]]), 0.5 * diameter + body.pad
    corners = 0.5 * np.array([np.where(mask, 1.0, -1.0) for mask in np.ndindex(2, 2, 2)])
    return corners * np.array(body.size), body.pad


@lru_cache(maxsize=4)
def _axes(arm: ArmModel) -> dict[int, tuple[Array, bool]]:
    """For each joint: its axis in its own frame, and whether it slides along it."""
    model, data = arm.full, arm.full.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    axes = {}
    for joint in range(1, model.njoints):
        J = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL).reshape(6, -1)
        column = J[:, model.joints[joint].idx_v]
        slides = not column[3:].any()
        axes[joint] = (column[:3] if slides else column[3:], slides)
    return axes


@lru_cache(maxsize=4)
def _chains(arm: ArmModel) -> list[set[int]]:
    """For each joint: it and those that carry it."""
    return [set(each) for each in arm.full.supports]


@lru_cache(maxsize=4)
def _columns(arm: ArmModel) -> dict[int, tuple[int, float]]:
    """For each joint that moves: its column among the coordinates, and its own motion per unit of that coordinate."""
    full, robot = arm.full, arm.robot
    columns = {full.getJointId(name): (i, 1.0) for i, name in enumerate(robot.joints)}
    if gripper := robot.gripper:
        strokes = np.abs(gripper.open - gripper.closed)
        columns |= {
            full.getJointId(name): (len(robot.joints), float(stroke))
            for name, stroke in zip(gripper.joints, strokes, strict=True)
        }
    return columns


def _most_slide(arm: ArmModel, joint: int) -> float:
    """How far a sliding joint can be from its zero, m; one that is locked stands at zero."""
    name, robot = arm.full.names[joint], arm.robot
    if name in robot.joints:
        i = robot.joints.index(name)
        return float(max(abs(robot.limits.lower[i]), abs(robot.limits.upper[i])))
    if robot.gripper and name in robot.gripper.joints:
        i = robot.gripper.joints.index(name)
        return float(max(abs(robot.gripper.open[i]), abs(robot.gripper.closed[i])))
    return 0.0
