"""Inverse kinematics of one pose: descents from the given joints, then from many starts, until one arrives.

An arm of six joints or more reaches a pose exactly or not at all; one with fewer comes near by the rule in
partial_pose.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd.arm.ik.levenberg_marquardt import SOLVED, UNTIL_IT_STOPS, descend_each, residual_norms
from pbd.arm.ik.partial_pose import is_partial, solve_partial
from pbd.arm.ik.starts import starts_of
from pbd.arm.model import ArmModel, to_se3
from pbd.pose import Array, Pose

TOLERANCE_M = 1e-5
TOLERANCE_RAD = 1e-5

NEAREST, NEAREST_PARTIAL = 24, 8
"""Samples near the pose that are tried first; and those for an arm with too few joints."""
NEAR_MISS, NEARLY_THERE = 0.2, 0.005
"""|e| (m, rad) of the best failed descent below which the pose may still be reached from another branch."""
ANYWHERE, EVERYWHERE = 48, 400
"""Random restarts below NEAR_MISS, and below NEARLY_THERE."""
RESUMED = 3
"""How many of the best failed descents are run to convergence."""


@dataclass(frozen=True, eq=False)
class IkResult:
    """The joints that bring the tool to a pose, or the nearest that were found.

    Attributes:
        q: (k,) rad, within the limits.
        position_error_m, rotation_error_rad: from the tool to the pose, by forward kinematics.
        partial: the arm has too few joints for any pose: only the position must be met (partial_pose.py).
    """

    q: Array
    position_error_m: float
    rotation_error_rad: float
    partial: bool = False

    @property
    def reached(self) -> bool:
        """Whether the errors that count are within tolerance."""
        return self.position_error_m <= TOLERANCE_M and (self.partial or self.rotation_error_rad <= TOLERANCE_RAD)


def solve(arm: ArmModel, T_base_tool: Pose, q_seed: Array | None = None) -> IkResult:
    """Find joints for a tool pose; the result is the same each time.

    Args:
        q_seed: (k,) rad, tried first, if joints are known that should be near.

    Returns:
        The first solution, or, where `reached` is false, the joints with the smallest |e|. For an arm with too few
        joints the nearest by its rule.
    """
    goal, starts = to_se3(T_base_tool), starts_of(arm)
    seeds = np.empty((0, len(arm.limits.lower))) if q_seed is None else q_seed[None]
    if is_partial(arm):  # the whole pose may be within reach by chance
        q, squares = descend_each(arm, goal, starts.nearest(goal, NEAREST_PARTIAL))
        return check(arm, T_base_tool, q[-1] if squares[-1] < SOLVED else solve_partial(arm, goal, seeds)[0].q)
    q, squares = descend_each(arm, goal, np.vstack((seeds, starts.nearest(goal, NEAREST))))
    # Steps are small at the edge of the reach, and all descents may be given up early: resume the nearest.
    for i in np.argsort(squares)[:RESUMED]:
        if squares.min() >= SOLVED:
            (q[i],), (squares[i],) = descend_each(arm, goal, q[i : i + 1], patience=UNTIL_IT_STOPS)
    if SOLVED <= squares.min() < NEAR_MISS**2:
        count = EVERYWHERE if squares.min() < NEARLY_THERE**2 else ANYWHERE
        others, their_squares = descend_each(arm, goal, starts.q[:count])
        q, squares = np.vstack((q, others)), np.append(squares, their_squares)
    return check(arm, T_base_tool, q[squares.argmin()])


def check(arm: ArmModel, T_base_tool: Pose, q: Array) -> IkResult:
    """Measure how far the tool is from a pose at joints q (k,), by forward kinematics."""
    return IkResult(q, *residual_norms(arm, to_se3(T_base_tool), q), is_partial(arm))
