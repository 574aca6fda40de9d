"""One joint path through all keyframes: of the many ways to reach each, those that together move the joints least.

Each keyframe gets up to a dozen solutions: some that follow from those of the keyframe before, so that a way of holding
the arm is carried along for as long as it lasts, and some found afresh. Dynamic programming (Viterbi) picks one of
each. An arm with more than six joints then slides along what freedom it has left, toward its neighbours.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from pbd.arm.ik import SOLVED, TOLERANCE_M, IkResult, descend, solve
from pbd.arm.model import ArmModel
from pbd.arm.reach import reach_map
from pbd.errors import PlanError
from pbd.pose import Array, Pose

CARRIED = 6
"""Solutions of the keyframe before to start from: those with the least travel so far."""
FRESH = 8
"""Samples to start from: of the FRESH_FROM nearest to the pose, those nearest to any solution before."""
FRESH_FROM = 256
SWEEPS = 3

_SAME = 1e-3  # rad: solutions nearer than this to each other are one


def solve_sequence(arm: ArmModel, T_base_tool: Sequence[Pose], q_start: Array) -> Array:
    """Find joints (n, k) that reach n tool poses, with little joint travel (sum of |dq|) from `q_start` (k,) on.

    Raises:
        PlanError: a keyframe can't be reached; its fields are keyframe (from 0), value and bound (m), rotation (rad).
    """
    # Per keyframe: its solutions (m, k), least travel first, and which solution before each is best come to from.
    layers: list[tuple[Array, Array]] = []
    before, travel = q_start[None], np.zeros(1)
    for keyframe, pose in enumerate(T_base_tool):
        found = _solutions(arm, pose, (*before[:CARRIED], *_fresh(arm, pose, before)))
        if not found:
            result = solve(arm, pose, before[0])
            if not result.reached:
                raise _out_of_reach(keyframe, pose, result)
            found = [result.q]
        each = np.arange(len(found))
        reached = _toward(arm, np.array(found), before[:, None])
        total = travel[:, None] + np.linalg.norm(reached - before[:, None], axis=2)
        via = np.argmin(total, axis=0)
        order = np.argsort(total[via, each])
        via = via[order]
        before, travel = reached[via, order], total[via, order]
        layers.append((before, via))
    path = np.empty((len(layers), len(q_start)))
    choice = 0
    for i in reversed(range(len(layers))):
        solutions, via = layers[i]
        path[i], choice = solutions[choice], int(via[choice])
    if len(q_start) > 6:
        for _ in range(SWEEPS):
            _slide(arm, T_base_tool, path, q_start)
    return path


def _fresh(arm: ArmModel, pose: Pose, before: Array) -> Array:
    samples = reach_map(arm).nearest(pose, FRESH_FROM)
    away = np.linalg.norm(_toward(arm, samples, before[:, None]) - before[:, None], axis=2).min(axis=0)
    return samples[np.argsort(away)[:FRESH]]


def _solutions(arm: ArmModel, pose: Pose, seeds: Iterable[Array]) -> list[Array]:
    """Descend from every seed; return the different solutions."""
    found: list[Array] = []
    for seed in seeds:
        q, square = descend(arm, pose, seed)
        if square < SOLVED and all(np.abs(q - other).max() > _SAME for other in found):
            found.append(q)
    return found


def _toward(arm: ArmModel, q: Array, target: Array) -> Array:
    """Turn joints q by whole turns, as far as their limits let them, to where they are nearest to a target."""
    turns = np.round((target - q) / (2.0 * np.pi)) * arm.turns
    least, most = np.ceil((arm.limits.lower - q) / (2.0 * np.pi)), np.floor((arm.limits.upper - q) / (2.0 * np.pi))
    turned: Array = q + 2.0 * np.pi * np.clip(turns, np.minimum(least, 0.0), np.maximum(most, 0.0))
    return turned


def _slide(arm: ArmModel, T_base_tool: Sequence[Pose], path: Array, q_start: Array) -> None:
    """Move each configuration in place, the tool standing still, toward the middle of its neighbours."""
    for i, pose in enumerate(T_base_tool):
        q, q_before = path[i], path[i - 1] if i else q_start
        q_after = path[i + 1] if i + 1 < len(path) else q_before
        J = arm.jacobian(q)
        pull = 0.5 * (q_before + q_after) - q
        pull = pull - J.T @ np.linalg.solve(J @ J.T + 1e-9 * np.eye(6), J @ pull)
        slid, square = descend(arm, pose, q + pull)
        if square < SOLVED and _travel(q_before, slid, q_after) < _travel(q_before, q, q_after):
            path[i] = slid


def _travel(*path: Array) -> float:
    return float(sum(np.linalg.norm(b - a) for a, b in pairwise(path)))


def _out_of_reach(keyframe: int, pose: Pose, nearest: IkResult) -> PlanError:
    x, y, z = pose.p
    return PlanError(
        f"keyframe {keyframe} is out of reach: the tool gets no nearer than {100 * nearest.position_error_m:.1f} cm and"
        f" {np.rad2deg(nearest.rotation_error_rad):.1f} degrees to its pose at ({x:.3f}, {y:.3f}, {z:.3f}) m;"
        " move the dock, or make the path smaller with --scale",
        keyframe=keyframe,
        value=nearest.position_error_m,
        bound=TOLERANCE_M,
        rotation=nearest.rotation_error_rad,
    )
