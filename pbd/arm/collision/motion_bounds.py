"""Bounds on how far bodies move when joints move; they let collision checks take long steps.

A revolute joint moves a point by no more than the angle times the point's distance from the axis. To bound that
distance for all positions of the other joints, a body is enclosed in a ball, and all positions of that ball, as a joint
turns, in a larger ball around a point of the joint's axis. Two bodies approach each other by no more than either moves
in the frame of the other, so the smaller of the two bounds counts.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pbd.arm.collision.geometry import Body
from pbd.arm.model import ArmModel
from pbd.pose import Array


def rates(arm: ArmModel, bodies: Sequence[Body], pairs: NDArray[np.int64]) -> Array:
    """Return a bound (p, k + 1) on the change of each pair's distance, m per unit of each coordinate; pairs (p, 2).

    Only the joints between the two bodies count: joints before them move both alike.
    """
    reach, chains = [lever_arms(arm, body) for body in bodies], [set(each) for each in arm.full.supports]
    bound = np.zeros((len(pairs), len(arm.robot.joints) + 1))
    for row, (first, second) in enumerate(pairs):
        for joint in chains[bodies[first].joint] ^ chains[bodies[second].joint]:
            if joint in arm.drives:
                column, slope, _ = arm.drives[joint]
                bound[row, column] += abs(slope) * min(reach[first][joint], reach[second][joint])
    return bound


def moving_pairs(arm: ArmModel, bodies: Sequence[Body], pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the pairs (p, 2) of bodies that some joint moves relative to each other."""
    return pairs[(rates(arm, bodies, pairs) > 0.0).any(axis=1)]


@lru_cache(maxsize=1024)
def lever_arms(arm: ArmModel, body: Body) -> Array:
    """Return for each joint a bound on the motion of the body's points, m per rad (or per m for a prismatic joint).

    For a joint that does not carry the body, it is the motion relative to what the joint carries.
    """
    model, found = arm.full, np.full(arm.full.njoints, np.inf)
    if body.shape == "floor":
        return found  # infinitely large
    p, radius = outline(body)
    # Joint -> all positions of the body in the joint's frame, as balls around points.
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
    """Sweep balls around points (n, 3) in a joint's frame with the joint.

    Returns:
        The largest motion, m per rad (or per m); points (m, 3) and the radius of balls that enclose the sweep.
    """
    axis, slides = arm.axes[joint]
    if slides:
        return 1.0, p, radius + _most_slide(arm, joint)
    along = p @ axis
    centre = 0.5 * (along.min() + along.max()) * axis
    lever = float(np.linalg.norm(p - along[:, None] * axis, axis=1).max()) + radius
    return lever, centre[None], float(np.linalg.norm(p - centre, axis=1).max()) + radius


def outline(body: Body) -> tuple[Array, float]:
    """Return points (n, 3) and a radius, m: the body lies within this radius of the points' hull."""
    if body.shape == "hull":
        return body.points, body.pad
    if body.shape == "sphere":
        return np.zeros((1, 3)), 0.5 * body.size[0] + body.pad
    if body.shape in ("cylinder", "capsule"):
        diameter, height = body.size
        return np.array([[0.0, 0.0, -0.5 * height], [0.0, 0.0, 0.5 * height]]), 0.5 * diameter + body.pad
    corners = 0.5 * np.array([np.where(mask, 1.0, -1.0) for mask in np.ndindex(2, 2, 2)])
    return corners * np.array(body.size), body.pad


def _most_slide(arm: ArmModel, joint: int) -> float:
    """Return the largest distance of a prismatic joint from its zero, m; a joint that nothing drives stays at zero."""
    if joint not in arm.drives:
        return 0.0
    column, slope, at_zero = arm.drives[joint]
    ends = np.append(arm.limits.lower, 0.0)[column], np.append(arm.limits.upper, 1.0)[column]
    return max(abs(at_zero + slope * float(end)) for end in ends)
