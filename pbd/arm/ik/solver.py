"""Inverse kinematics of one pose: descents from the given seed, then from many starts, until one reaches it.

An arm of six or more joints reaches a pose exactly or not at all. One with fewer follows the rule in partial_pose.py.
"""

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from pbd.arm.ik.levenberg_marquardt import MOST_STEPS, SOLVED, Residual, descend_each
from pbd.arm.ik.partial_pose import TOLERANCE_M, TOLERANCE_RAD, is_partial, solve_partial
from pbd.arm.ik.starts import starts_of
from pbd.arm.model import ArmModel, to_se3
from pbd.pose import Array, Pose

NEAREST_STARTS = 24
"""Number of samples near the pose that are tried first."""
NEAR_MISS, NEARLY_THERE = 0.2, 0.005
"""|e| (m, rad) of the best failed descent below which random restarts follow, few or many."""
FEW_RESTARTS, MANY_RESTARTS = 48, 400
"""Number of random restarts below NEAR_MISS, and below NEARLY_THERE."""
RESUMED = 3
"""Number of the best failed descents that are run to convergence."""


@dataclass(frozen=True, eq=False)
class IkResult:
    """The joints that reach a pose, or the nearest that were found.

    Attributes:
        q: (k,) rad, within the limits.
        position_error_m, rotation_error_rad: between the tool and the pose, by forward kinematics.
        reached: whether the errors that count are within tolerance: of an arm with too few joints for a full pose,
            only that of the position (partial_pose.py).
    """

    q: Array
    position_error_m: float
    rotation_error_rad: float
    reached: bool


def solve(arm: ArmModel, T_base_tool: Pose, q_seed: Array | None = None) -> IkResult:
    """Find joints for a tool pose, from `q_seed` (k,) rad first; deterministic.

    Return the first solution; if none is found, the joints with the smallest |e|, and `reached` is false. For an arm
    with too few joints, the nearest by its rule.
    """
    goal, starts = to_se3(T_base_tool), starts_of(arm)
    seeds = np.empty((0, len(arm.limits.lower))) if q_seed is None else q_seed[None]
    if is_partial(arm):
        return ik_result(arm, goal, solve_partial(arm, goal, seeds)[0].q)
    q, squares = descend_each(arm, goal, np.vstack((seeds, starts.nearest(goal, NEAREST_STARTS))))
    # At the edge of the reach steps are small, so all descents may have been given up early: resume the best.
    for i in np.argsort(squares)[:RESUMED]:
        if squares.min() >= SOLVED:
            (q[i],), (squares[i],) = descend_each(arm, goal, q[i : i + 1], patience=MOST_STEPS)
    if SOLVED <= squares.min() < NEAR_MISS**2:
        count = MANY_RESTARTS if squares.min() < NEARLY_THERE**2 else FEW_RESTARTS
        others, their_squares = descend_each(arm, goal, starts.q[:count])
        q, squares = np.vstack((q, others)), np.append(squares, their_squares)
    return ik_result(arm, goal, q[squares.argmin()])


def ik_result(arm: ArmModel, goal: pin.SE3, q: Array) -> IkResult:
    """Measure the tool's error from a pose at joints q (k,) by forward kinematics."""
    e, _ = Residual(arm, goal)(q)
    position, rotation = math.sqrt(e[:3].dot(e[:3])), math.sqrt(e[3:].dot(e[3:]))
    return IkResult(q, position, rotation, position <= TOLERANCE_M and (is_partial(arm) or rotation <= TOLERANCE_RAD))
