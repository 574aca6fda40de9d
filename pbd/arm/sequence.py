"""One joint path through all keyframes: of the many ways to reach each, those that together move the joints least.

Each keyframe gets a dozen solutions or so: some that follow from those of the keyframe before, so that a way of holding
the arm is carried along for as long as it lasts, and some found afresh. Dynamic programming picks one of each
(route.py), by joint travel and by how near each is to limits and singularities. An arm with more than six joints then
slides along what freedom it has left, toward its neighbours and away from limits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from pbd.arm.candidates import MARGIN_RAD, solutions, strain, toward
from pbd.arm.descent import SOLVED, descend_each
from pbd.arm.hindrance import find_hindrance
from pbd.arm.ik import TOLERANCE_M, solve
from pbd.arm.model import ArmModel
from pbd.arm.relax import FULL_POSE
from pbd.arm.route import Allowed, Clear, Layer, NoWayError, Route
from pbd.arm.tool import Target, target
from pbd.errors import PlanError
from pbd.pose import Array, Pose

STARTS, STARTS_WIDE = 12, 81
"""Descents made for each keyframe: at first, and where every way is barred."""
SWEEPS = 3
MOST_REFUSALS = 300

_RIDGE = 1e-9  # keeps the projection onto the null space solvable where the arm is singular


class BarredError(PlanError):
    """No path was found that is free all along.

    Attributes:
        keyframe: the first that can't be come to; the number of them: it is the way back from the last.
        stands: whether the arm can stand there, so that it is the moves to it that are barred.
        path: (n, k) rad, the shortest of those that are free up to the keyframe before.
    """

    def __init__(self, keyframe: int, stands: bool, path: Array) -> None:
        way = f"way to keyframe {keyframe}" if keyframe < len(path) else f"way back from keyframe {keyframe - 1}"
        what = way if stands else f"arm pose at keyframe {keyframe}"
        message = f"no collision-free {what} was found; move the dock or the obstacle"
        super().__init__(message, keyframe=keyframe, stands=stands)
        self.keyframe, self.stands, self.path = keyframe, stands, path


def solve_sequence(
    arm: ArmModel,
    T_base_tool: Sequence[Pose],
    q_start: Array,
    *,
    q_end: Array | None = None,
    allowed: Allowed | None = None,
    clear: Clear | None = None,
) -> Array:
    """Find joints (n, k) that reach n tool poses, with little joint travel (sum of |dq|) from `q_start` (k,) on.

    Args:
        arm: the arm.
        T_base_tool: n poses of the tool in base.
        q_start: (k,) rad, where the arm comes from.
        q_end: (k,) rad, where it goes from the last pose, if anywhere.
        allowed: says whether the arm may stand at keyframe i with joints (k,); asked of as few as can be.
        clear: says whether it may move straight to keyframe i from joints (k,) to others: 0 is the way from `q_start`,
            n that to `q_end`. It is asked only where both ends are allowed.

    Raises:
        PlanError: a keyframe can't be reached; its fields are keyframe (from 0), value and bound (m), rotation (rad),
            nearest (the pose that can be), beyond (m, 0 where only the attitude is at fault), joints (at their limits).
        BarredError: no path was found that is allowed and clear.
    """
    n = len(T_base_tool)

    def stands(keyframe: int, q: Array) -> bool:
        return keyframe == n or allowed is None or allowed(keyframe, q)

    for starts in (STARTS, STARTS_WIDE):
        route = _lay_out(arm, T_base_tool, q_start, q_end, starts)
        try:
            return route.joints(route.shortest_free(stands, clear, MOST_REFUSALS))[1 : n + 1]
        except NoWayError as no_way:
            barred = BarredError(no_way.layer - 1, no_way.stands, route.joints(no_way.way)[1 : n + 1])
    raise barred


def _lay_out(arm: ArmModel, T_base_tool: Sequence[Pose], q_start: Array, q_end: Array | None, starts: int) -> Route:
    """Find the ways to hold the arm at each pose, whole turns taken toward where it may come from."""
    layers = [Layer(q_start[None], np.zeros(1))]
    before, travel = q_start[None], np.zeros(1)
    for keyframe, pose in enumerate(T_base_tool):
        found = solutions(arm, pose, before, starts)
        if not len(found):
            raise _out_of_reach(arm, keyframe, pose, before[0])
        turned = toward(arm, found, before[:, None])
        total = travel[:, None] + np.linalg.norm(turned - before[:, None], axis=2)
        via, each = total.argmin(axis=0), np.arange(len(found))
        before, cost = turned[via, each], strain(arm, turned[via, each])
        travel = total[via, each] + cost
        order = np.argsort(travel)
        before, travel = before[order], travel[order]
        layers.append(Layer(before, cost[order]))
    if q_end is not None:
        layers.append(Layer(q_end[None], np.zeros(1)))
    if len(q_start) > FULL_POSE:
        layers = _slide(arm, [target(pose) for pose in T_base_tool], layers)
    return Route(layers)


def _slide(arm: ArmModel, goals: Sequence[Target], layers: Sequence[Layer]) -> list[Layer]:
    """Slide the shortest path, each tool standing still, toward the middle of its neighbours; add it to the layers."""
    route = Route(layers)
    path = route.joints(route.shortest())
    costs = strain(arm, path)
    for _ in range(SWEEPS):
        for i, goal in enumerate(goals, start=1):
            q, before, after = path[i], path[i - 1], path[i + 1] if i + 1 < len(path) else path[i - 1]
            pull = 0.5 * (before + after) - q + _inward(arm, q)
            J = arm.jacobian(q)
            pull -= J.T @ np.linalg.solve(J @ J.T + _RIDGE * np.eye(6), J @ pull)
            ended, squares = descend_each(arm, goal, (q + pull)[None])
            # What it may cost to be better than what is there.
            most = costs[i] + _travel(before, q, after) - _travel(before, ended[0], after)
            if squares[0] < SOLVED and most > 0.0 and (cost := float(strain(arm, ended)[0])) < most:
                path[i], costs[i] = ended[0], cost
    slid_too = list(layers)
    for i in range(1, len(goals) + 1):
        slid_too[i] = Layer(np.vstack((layers[i].q, path[i])), np.append(layers[i].cost, costs[i]))
    return slid_too


def _inward(arm: ArmModel, q: Array) -> Array:
    """How far joints that are too near a limit are from where they aren't."""
    lower, upper = arm.limits.lower, arm.limits.upper
    inward: Array = np.maximum(0.0, MARGIN_RAD - (q - lower)) - np.maximum(0.0, MARGIN_RAD - (upper - q))
    return inward


def _travel(*path: Array) -> float:
    return sum(math.sqrt(way.dot(way)) for way in (b - a for a, b in pairwise(path)))


def _out_of_reach(arm: ArmModel, keyframe: int, pose: Pose, q_seed: Array) -> PlanError:
    nearest = solve(arm, pose, q_seed)
    hindrance = find_hindrance(arm, pose, nearest)
    x, y, z = pose.p
    return PlanError(
        f"keyframe {keyframe} is out of reach: the tool stays {100 * nearest.position_error_m:.1f} cm and "
        f"{np.rad2deg(nearest.rotation_error_rad):.1f} degrees from its pose at ({x:.3f}, {y:.3f}, {z:.3f}) m, which is"
        f" {hindrance}; move the dock, or make the path smaller with --scale",
        keyframe=keyframe,
        value=nearest.position_error_m,
        bound=TOLERANCE_M,
        rotation=nearest.rotation_error_rad,
        nearest=arm.forward(nearest.q),
        beyond=hindrance.beyond_m,
        joints=tuple(joint for joint, _ in hindrance.limits),
    )
