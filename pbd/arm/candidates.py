"""The ways to hold the arm at a pose that a joint path may choose from, and what speaks against each."""

from __future__ import annotations

import numpy as np

from pbd.arm.descent import SOLVED, descend_each
from pbd.arm.ik import solve
from pbd.arm.model import ArmModel
from pbd.arm.relax import SLACK_RAD, finish, is_relaxed, solve_relaxed
from pbd.arm.seeds import manipulability, seed_map
from pbd.arm.tool import target
from pbd.pose import Array, Pose

MARGIN_RAD = 0.1
"""A joint that is nearer to a limit than this (rad, or m) is too near."""
AT_LIMIT = 0.3
"""What a joint at its limit costs, in rad of joint travel."""
SINGULAR = 0.3
"""What a singular arm costs, in rad of joint travel; half as dexterous as three of four configurations: a quarter."""

CARRIED_RELAXED = 2
"""An arm with too few joints starts from so many solutions of the keyframe before: it has few, and is slow."""
CARRIED_APART_RAD, FRESH_APART_RAD = 0.3, 1.2
"""Starts that are as near as this to each other, in every joint, lead to the same solution."""
SAME_RAD = 1e-3
"""Solutions as near as this to each other are one."""


def solutions(arm: ArmModel, T_base_tool: Pose, before: Array, starts: int) -> Array:
    """Find different joints (m, k) for a pose.

    Args:
        arm: the arm.
        T_base_tool: the tool's pose in base.
        before: (b, k) rad, where the arm may come from, the likeliest first.
        starts: how many descents are made at most: a third of them from `before`, the others from seeds near the pose,
            those first from which the way to what is carried is shortest.

    Returns:
        None, an array (0, k), where even the full search finds none.
    """
    if is_relaxed(arm):
        return _relaxed(arm, T_base_tool, before)
    goal = target(T_base_tool)
    carried = _apart(before, starts // 3, CARRIED_APART_RAD)
    seeds = seed_map(arm).around(goal)
    way = seeds[:, None] - carried
    way -= (2.0 * np.pi) * arm.turns * np.round(way / (2.0 * np.pi))
    order = np.einsum("smk,smk->sm", way, way).min(axis=1).argsort()
    fresh = _apart(seeds[order[: len(order) // 2]], starts - starts // 3, FRESH_APART_RAD)
    q, squares = descend_each(arm, goal, np.vstack((carried, fresh)), all_of_them=True)
    found = q[squares < SOLVED]
    if len(found):
        return _apart(found, len(found), SAME_RAD)
    result = solve(arm, T_base_tool, before[0])
    return result.q[None] if result.reached else found


def toward(arm: ArmModel, q: Array, there: Array) -> Array:
    """Turn joints q by whole turns, as far as their limits let them, to where they are nearest to others."""
    turns = np.round((there - q) / (2.0 * np.pi)) * arm.turns
    least, most = np.ceil((arm.limits.lower - q) / (2.0 * np.pi)), np.floor((arm.limits.upper - q) / (2.0 * np.pi))
    turned: Array = q + 2.0 * np.pi * np.clip(turns, np.minimum(least, 0.0), np.maximum(most, 0.0))
    return turned


def strain(arm: ArmModel, q: Array) -> Array:
    """Return what near limits and singularities cost configurations (m, k), as rad of joint travel (m,)."""
    near_limits = np.maximum(0.0, 1.0 - margins(arm, q) / MARGIN_RAD)
    J = np.array([arm.jacobian(configuration) for configuration in q])
    dexterity = manipulability(J) / seed_map(arm).clumsy
    cost: Array = AT_LIMIT * (near_limits**2).sum(axis=1) + SINGULAR * np.maximum(0.0, 1.0 - dexterity) ** 2
    return cost


def margins(arm: ArmModel, q: Array) -> Array:
    """Return how far joints are from the nearer of their limits, rad."""
    return np.minimum(q - arm.limits.lower, arm.limits.upper - q)


def _relaxed(arm: ArmModel, T_base_tool: Pose, before: Array) -> Array:
    goal, carried = target(T_base_tool), _apart(before, CARRIED_RELAXED, CARRIED_APART_RAD)
    ways = solve_relaxed(arm, goal, carried) + [finish(arm, goal, q) for q in carried]
    reached = [way for way in ways if way.reached]
    least = min((way.off for way in reached), default=0.0)
    found = np.array([way.q for way in reached if way.off <= least + SLACK_RAD]).reshape(-1, before.shape[1])
    return _apart(found, len(found), SAME_RAD)


def _apart(q: Array, most: int, apart: float) -> Array:
    """Take the first of configurations (m, k) that aren't as near as this to one already taken, in every joint."""
    left, taken = q, list[Array]()
    while len(left) and len(taken) < most:
        taken.append(left[0])
        left = left[np.abs(left - left[0]).max(axis=1) > apart]
    return np.array(taken).reshape(-1, q.shape[1])
