"""The ladder through all keyframes: of the configurations that reach each, those with least joint travel together.

Each keyframe gets about a dozen branches: some continue those of the keyframe before, for as long as they last, and
some start afresh. An arm with more than six joints then slides along its null space, toward its neighbours and away
from limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from pbd.arm.ik.branches import MARGIN_RAD, SAME_RAD, configuration_cost, find_branches, polish, turn_toward
from pbd.arm.ik.levenberg_marquardt import SOLVED, Residual, descend_each
from pbd.arm.ik.partial_pose import FULL_POSE
from pbd.arm.ik.unreachable import out_of_reach
from pbd.arm.ladder_graph import Barred, Ladder, Layer
from pbd.arm.model import ArmModel, to_se3
from pbd.pose import Array, Pose

STARTS, STARTS_WIDE, STARTS_CLOSE = 12, 81, 1000
"""Descents for each keyframe: at first, where moves next to it are barred, and where no configuration was free."""
CONTINUOUS_RAD, MOST_STEPS = 0.5, 60
"""Largest motion of a joint between two layers along a path, rad; barred moves there before the link is mended."""
SWEEPS = 3
"""Passes over the path in which each configuration slides toward the middle of its neighbours."""

_RIDGE = 1e-9  # keeps the projection onto the null space solvable where the arm is singular


class States(NamedTuple):
    """Configurations, the least travel first: q (m, k) rad, cost (m,) rad, travel (m,) rad from the start."""

    q: Array
    cost: Array
    travel: Array


class Unreachable(NamedTuple):
    """The first keyframe that has no solution, and joints (k,) near which one was sought."""

    keyframe: int
    q_seed: Array


def solve_path(arm: ArmModel, T_base_tool: Sequence[Pose], q_start: Array) -> Array:
    """Find joints (n, k) that reach n tool poses with little joint travel (sum of |dq|) from `q_start` (k,) on.

    Collisions are ignored: see choose_motion.py.

    Raises:
        PlanError: a keyframe can't be reached; see `out_of_reach` for its fields.
    """
    ladder = build_ladder(arm, T_base_tool, q_start, None, most_refused=1)
    if isinstance(ladder, Unreachable):
        raise out_of_reach(arm, ladder.keyframe, T_base_tool[ladder.keyframe], ladder.q_seed)
    path = ladder.shortest()
    return ladder.joints([] if isinstance(path, Barred) else path)[1:]


def build_ladder(
    arm: ArmModel,
    T_base_tool: Sequence[Pose],
    q_start: Array,
    q_end: Array | None,
    most_refused: int,
    wide_cost: float = 0.0,
) -> Ladder | Unreachable:
    """Lay out the branches at n poses: layer 0 is `q_start`, layer i + 1 pose i, the last `q_end`; both (k,)."""
    at = States(q_start[None], np.zeros(1), np.zeros(1))
    layers = [Layer(at.q, at.cost, most_refused)]
    for keyframe, pose in enumerate(T_base_tool):
        following = states_at(arm, pose, at, STARTS)
        if not len(following.q):
            return Unreachable(keyframe, at.q[0])
        at = following
        layers.append(Layer(at.q, at.cost, most_refused, wide_cost=wide_cost if keyframe > 0 else 0.0))
    if q_end is not None:
        layers.append(Layer(q_end[None], np.zeros(1), most_refused))
    ladder = Ladder(layers)
    if len(q_start) > FULL_POSE:
        _slide(arm, T_base_tool, ladder)
    return ladder


def states_at(arm: ArmModel, pose: Pose, before: States, starts: int) -> States:
    """Find the branches of a pose, with whole turns chosen nearest to the states before."""
    found = find_branches(arm, pose, before.q, starts)
    if not len(found):
        return States(found, np.empty(0), np.empty(0))
    turned = turn_toward(arm, found, before.q[:, None])
    total = before.travel[:, None] + np.linalg.norm(turned - before.q[:, None], axis=2)
    via, each = total.argmin(axis=0), np.arange(len(found))
    q = turned[via, each]
    cost = configuration_cost(arm, q)
    travel = total[via, each] + cost
    order = np.argsort(travel)
    return States(q[order], cost[order], travel[order])


def layers_along(arm: ArmModel, ladder: Ladder, place: int, T_base_tool: Sequence[Pose]) -> list[Layer] | None:
    """Lay out the branches at poses that follow on from a layer; None where a pose has none."""
    before, travel = ladder.layers[place], ladder.travel(place)
    order = np.argsort(travel)[: np.isfinite(travel).sum()]
    at, layers = States(before.q[order], before.cost[order], travel[order]), []
    for pose in T_base_tool:
        at = states_at(arm, pose, at, STARTS) if len(at.q) else at
        if not len(at.q):
            return None
        layers.append(Layer(at.q, at.cost, MOST_STEPS, CONTINUOUS_RAD, costly=True))
    return layers


def widen(
    arm: ArmModel,
    pose: Pose,
    ladder: Ladder,
    place: int,
    starts: int = STARTS_WIDE,
    stands: Callable[[Array], bool] = lambda q: True,
) -> int:
    """Add to a layer the new states that a larger search from the layer before finds; return how many.

    `stands`: whether a state is free.
    """
    before, known = ladder.layers[place - 1].q, ladder.layers[place].q
    found = states_at(arm, pose, States(before, np.zeros(len(before)), np.zeros(len(before))), starts)
    new = np.array([np.abs(known - q).max(axis=1).min() > SAME_RAD and stands(q) for q in found.q], dtype=bool)
    ladder.add(place, found.q[new], found.cost[new])
    return int(new.sum())


def add_turns(arm: ArmModel, ladder: Ladder, place: int, joint: int) -> int:
    """Add to a layer its states with a joint turned by a whole turn, within its limits; return how many."""
    q = np.repeat(ladder.layers[place].q, 2, axis=0)
    q[::2, joint] += 2.0 * np.pi
    q[1::2, joint] -= 2.0 * np.pi
    q = q[(q[:, joint] >= arm.limits.lower[joint]) & (q[:, joint] <= arm.limits.upper[joint])]
    if len(q):
        ladder.add(place, q, configuration_cost(arm, q))
    return len(q)


def turned(arm: ArmModel, q: Array, before: Array, most: int) -> Array:
    """Turn joints by whole turns, within limits; return for each of (m, k) the `most` nearest to any of (b, k)."""
    turns = 2.0 * np.pi * np.array([*product(*((-1.0, 0.0, 1.0) if turn else (0.0,) for turn in arm.turns))])
    found = []
    for each in q:
        other = each + turns
        other = other[((other >= arm.limits.lower) & (other <= arm.limits.upper)).all(axis=1)]
        far = np.linalg.norm(other[:, None] - before, axis=2).min(axis=1)
        found.append(other[np.argsort(far, kind="stable")[:most]])
    return np.vstack(found)


def turnable(arm: ArmModel, T_base_tool: Pose, q_before: Array, q: Array) -> set[int]:
    """Return the joints that had better be a whole turn elsewhere.

    They turn back by more than half a turn between q_before and q, or a direct motion to the pose would, to first
    order, lead them over their limits.
    """
    off, J = Residual(arm, to_se3(T_base_tool))(q_before)
    there = q_before - np.linalg.lstsq(J, off, rcond=None)[0]
    over = (there < arm.limits.lower) | (there > arm.limits.upper)
    back = np.abs(q - q_before) > np.pi
    return set(np.flatnonzero((over | back) & (arm.turns > 0.0)).tolist())


def _slide(arm: ArmModel, T_base_tool: Sequence[Pose], ladder: Ladder) -> None:
    """Slide the shortest path along null spaces, toward the middle of its neighbours; add it to the layers."""
    shortest = ladder.shortest()
    if isinstance(shortest, Barred):
        return
    path = ladder.joints(shortest)
    costs = configuration_cost(arm, path)
    goals = [to_se3(pose) for pose in T_base_tool]
    for _ in range(SWEEPS):
        for i, goal in enumerate(goals, start=1):
            q, before, after = path[i], path[i - 1], path[i + 1] if i + 1 < len(path) else path[i - 1]
            pull = 0.5 * (before + after) - q
            # Joints too near a limit are pulled to where they aren't.
            over, under = q - arm.limits.lower, arm.limits.upper - q
            pull += np.maximum(0.0, MARGIN_RAD - over) - np.maximum(0.0, MARGIN_RAD - under)
            J = arm.jacobian(q)
            pull -= J.T @ np.linalg.solve(J @ J.T + _RIDGE * np.eye(6), J @ pull)
            ended, squares = descend_each(arm, goal, (q + pull)[None])
            # It is better if it costs less than this.
            most = costs[i] + _travel(before, q, after) - _travel(before, ended[0], after)
            if squares[0] < SOLVED and most > 0.0 and (cost := float(configuration_cost(arm, ended)[0])) < most:
                path[i], costs[i] = ended[0], cost
    for i, goal in enumerate(goals, start=1):
        ladder.add(i, polish(arm, goal, path[i : i + 1]), costs[i : i + 1])


def _travel(*path: Array) -> float:
    return sum(math.sqrt(way.dot(way)) for way in (b - a for a, b in pairwise(path)))
