"""Whether a trajectory touches anything, by a plain loop that shares nothing with the planner but the URDF.

Every pair of shapes is looked at on nodes so close that no point of the arm moves more than STEP_M from one to the
next (audit_nodes.py). At each node a pair must be apart by what it may move against each other until half-way to the
next node, so nothing can happen in between. Balls around the shapes, then planes between their hulls tell most pairs
apart; where neither does, the shapes themselves are asked. Where these are near, nodes are put closer together until
they touch or don't.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import coal
import numpy as np

from pbd.arm.audit_arm import AuditArm, Frame, Rows
from pbd.arm.audit_inside import is_inside
from pbd.arm.audit_nodes import Nodes, node_times, nodes_at
from pbd.arm.audit_solids import Solid
from pbd.data import JointTrajectory
from pbd.pose import Array

STEP_M = 5e-3
"""How far any point of the arm moves at most from node to node, m."""
FINEST_M = 1e-4
"""What comes nearer than this touches, m."""
CLOSER = 8
"""Where shapes are near, a step between nodes is divided by this."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two shapes that must not touch from `start` to `end` (s), unless `allowed` says so of coordinates (k + 1,)."""

    first: Solid
    second: Solid
    start: float = -np.inf
    end: float = np.inf
    allowed: Callable[[Array], bool] | None = None


@dataclass(frozen=True, eq=False)
class Touch:
    """Two shapes that touch at t (s)."""

    pair: Pair
    t: float

    @property
    def bodies(self) -> tuple[str, str]:
        """Their names; what stands around comes last."""
        ordered = sorted((self.pair.first, self.pair.second), key=lambda solid: solid.joint == 0)
        return ordered[0].name, ordered[1].name


def find_touch(arm: AuditArm, trajectory: JointTrajectory, pairs: Sequence[Pair]) -> Touch | None:
    """Return the first touch of a motion, or None."""
    reach: dict[int, float] = {}
    for solid in {solid for pair in pairs for solid in (pair.first, pair.second)}:
        reach[solid.joint] = max(reach.get(solid.joint, 0.0), solid.reach)
    bounds = {joint: arm.motion(joint, far) for joint, far in reach.items()}
    fastest = np.max([sum(bound.values(), np.zeros(len(arm.robot.joints) + 1)) for bound in bounds.values()], axis=0)
    marks = [mark for pair in pairs for mark in (pair.start, pair.end) if 0.0 < mark < trajectory.duration]
    nodes = nodes_at(arm, trajectory, node_times(trajectory, fastest, STEP_M, marks))
    first = None
    for pair in pairs:
        one, other = bounds[pair.first.joint], bounds[pair.second.joint]
        # Joints that carry both move neither against the other.
        between = [bound for joint, bound in (*one.items(), *other.items()) if joint not in one or joint not in other]
        rates = sum(between, np.zeros_like(fastest))
        found = _first_touch(arm, trajectory, pair, rates, nodes, min(pair.end, first.t if first else np.inf))
        if found is not None and (first is None or found.t < first.t):
            first = found
    return first


def near_share(arm: AuditArm, x: Array, pair: Pair, distance: float) -> float:
    """In which share of coordinates (n, k + 1) two shapes are within a distance, m."""
    n = len(x)
    nodes = Nodes(np.arange(float(n)), x, np.zeros_like(x), arm.placements(x))
    near = _not_told_apart(pair, nodes, np.arange(n), np.full(n, distance))
    return sum(_apart(pair, nodes, row, distance) <= distance for row in near) / n


def _first_touch(
    arm: AuditArm, trajectory: JointTrajectory, pair: Pair, rates: Array, nodes: Nodes, end: float
) -> Touch | None:
    """Look at one pair up to `end`, s; `rates` (k + 1,) bound how far it moves per unit of each coordinate."""
    travel = nodes.moved @ rates
    step = np.diff(travel, prepend=travel[0], append=travel[-1])
    need = 0.5 * np.maximum(step[:-1], step[1:]) + 0.5 * FINEST_M
    rows = np.flatnonzero((nodes.t >= pair.start) & (nodes.t <= end))
    clear_to = -np.inf
    for row in _not_told_apart(pair, nodes, rows, need[rows]):
        if travel[row] + need[row] <= clear_to or (pair.allowed and pair.allowed(nodes.x[row])):
            continue
        apart = _apart(pair, nodes, row, need[row])
        if apart > need[row]:
            # What isn't inside at first can't come there without touching the surface.
            if row == rows[0] and _one_in_the_other(pair, nodes, row):
                return Touch(pair, float(nodes.t[row]))
            clear_to = travel[row] + apart
        elif need[row] <= FINEST_M or _apart(pair, nodes, row, 0.0) <= 0.0:
            return Touch(pair, float(nodes.t[row]))
        else:
            around = pairwise(nodes.t[max(0, row - 1) : row + 2])
            t = np.unique([np.linspace(start, stop, CLOSER + 1) for start, stop in around])
            found = _first_touch(arm, trajectory, pair, rates, nodes_at(arm, trajectory, t), end)
            if found is not None:
                return found
    return None


def _not_told_apart(pair: Pair, nodes: Nodes, rows: Rows, need: Array) -> list[int]:
    """Return the nodes at which neither balls nor a plane keep two hulls apart by more than what is needed (n,)."""
    first, second = pair.first, pair.second
    near_by = _norm((nodes.middles(second) - nodes.middles(first))[rows]) - first.around[1] - second.around[1] <= need
    rows, need = rows[near_by], need[near_by]
    if not len(rows):
        return []
    R, p = nodes.placed.between(first.joint, second.joint, rows)
    one, other = first.T_joint_solid, second.T_joint_solid
    R, p = one.R.T @ R @ other.R, (p + R @ other.p - one.p) @ one.R
    near: list[int] = []
    while len(rows):
        middle = len(rows) // 2
        normal = _normal(first, second, Frame(R[middle], p[middle]))
        toward, far = -normal @ R, p @ normal - first.support(normal[None])[0]
        left = far - second.box_support(toward) <= need
        left[left] = far[left] - second.support(toward[left]) <= need[left]
        if left[middle]:
            near.append(int(rows[middle]))
            left[middle] = False
        rows, need, R, p = rows[left], need[left], R[left], p[left]
    return sorted(near)


def _normal(first: Solid, second: Solid, T_first_second: Frame) -> Array:
    """Return a direction (3,) along which two hulls are apart, if they are: which one is not relied upon."""
    if first.floor:
        return np.array([0.0, 0.0, 1.0])
    there = coal.Transform3s(T_first_second.R, T_first_second.p)
    result = coal.DistanceResult()
    coal.distance(first.rough, coal.Transform3s.Identity(), second.rough, there, coal.DistanceRequest(), result)
    return np.array(result.normal)


def _apart(pair: Pair, nodes: Nodes, row: int, need: float) -> float:
    """How far two shapes are apart, m, at least: 0 where they are nearer than what is needed."""
    placed = [nodes.placed.at(each.joint, row) @ each.T_joint_solid for each in (pair.first, pair.second)]
    one, other = (coal.Transform3s(place.R, place.p) for place in placed)
    shapes = pair.first.exact, pair.second.exact
    if any(isinstance(shape, coal.BVHModelBase) for shape in shapes):
        request, found = coal.CollisionRequest(), coal.CollisionResult()
        request.security_margin = need
        touching = coal.collide(shapes[0], one, shapes[1], other, request, found)
        return 0.0 if touching else need + max(0.0, float(found.distance_lower_bound))
    distance = coal.distance(shapes[0], one, shapes[1], other, coal.DistanceRequest(), coal.DistanceResult())
    return max(0.0, float(distance))


def _one_in_the_other(pair: Pair, nodes: Nodes, row: int) -> bool:
    first, second = (
        (each, nodes.placed.at(each.joint, row) @ each.T_joint_solid) for each in (pair.first, pair.second)
    )
    return is_inside(*first, *second) or is_inside(*second, *first)


def _norm(vectors: Array) -> Array:
    lengths: Array = np.sqrt(np.einsum("ni,ni->n", vectors, vectors))
    return lengths
