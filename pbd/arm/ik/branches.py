"""The different configurations that reach a pose, for a joint path to choose from, and their cost."""

import numpy as np
import pinocchio as pin

from pbd.arm.ik.closed_form import closed_form, flipped_elbow
from pbd.arm.ik.levenberg_marquardt import SOLVED, descend_each
from pbd.arm.ik.partial_pose import SLACK_RAD, is_partial, is_redundant, refine_partial, solve_partial
from pbd.arm.ik.seven_joints import seven_joints
from pbd.arm.ik.solver import solve
from pbd.arm.ik.starts import distinct, relative_manipulability, starts_of
from pbd.arm.model import ArmModel, to_se3
from pbd.pose import Array, Pose

MARGIN_RAD = 0.1
"""Distance of a joint from its limit, rad of joint travel, below which being near the limit has a cost."""
AT_LIMIT_COST = 0.3
"""Cost of a joint at its limit, in rad of joint travel."""
SINGULAR_COST = 0.3
"""Cost of a singular configuration, in rad of joint travel."""

EARLIER_PARTIAL = 2
"""Number of configurations in `before` from which an arm with too few joints starts: its descents are slow."""
EARLIER_APART_RAD, FRESH_APART_RAD, FRESH_APART_REDUNDANT_RAD = 0.3, 2.0, 1.2
"""Starts that differ by less than this in every joint count as one: those in `before`; new seeds; new seeds of a
redundant arm."""
ALONG_APART_RAD = 0.6
"""Largest spacing of the configurations taken along the self-motion of a redundant arm."""
NEARBY = 256
"""Number of seeds near the pose from which starts are chosen."""
SAME_RAD = 1e-3
"""Solutions that differ by less than this in every joint are one."""


def find_branches(arm: ArmModel, T_base_tool: Pose, before: Array, starts: int) -> Array:
    """Find different configurations (m, k) that reach a pose; (0, k) if even `solve` finds none.

    Args:
        arm, T_base_tool: the arm, and the pose.
        before: (b, k) rad, where the arm may come from, the likeliest first.
        starts: number of descents: a third from `before`, the others from seeds near the pose, those nearest to
            `before` first. From each self-motion curve of a redundant arm, at most a third as many are taken.
    """
    if is_partial(arm):
        return _partial_pose_solutions(arm, T_base_tool, before)
    goal = to_se3(T_base_tool)
    third = starts // 3
    earlier = distinct(before, third, EARLIER_APART_RAD)
    around = min(ALONG_APART_RAD, 2.0 * np.pi / third)
    curves = (branch[_nearest_first(arm, branch, earlier)] for branch in seven_joints(arm, goal))
    analytic = np.vstack((closed_form(arm, goal), *(distinct(branch, third, around) for branch in curves)))
    # A singular pose has more solutions; descents from `before` find those.
    if len(analytic) and len(found := _solutions(arm, goal, np.vstack((analytic, earlier)))):
        return found
    seeds = starts_of(arm).nearest(goal, NEARBY)
    distance = FRESH_APART_REDUNDANT_RAD if is_redundant(arm) else FRESH_APART_RAD
    fresh = distinct(seeds[_nearest_first(arm, seeds, earlier)], starts - third, distance)
    found = _solutions(arm, goal, np.vstack((earlier, fresh)))
    if not len(found) and (result := solve(arm, T_base_tool, before[0])).reached:
        return result.q[None]
    return found


def _solutions(arm: ArmModel, goal: pin.SE3, q_seeds: Array) -> Array:
    """Return the different solutions (m, k) to which seeds descend."""
    q, squares = descend_each(arm, goal, q_seeds, all_seeds=True)
    return distinct(q[squares < SOLVED], len(q), SAME_RAD)


def _nearest_first(arm: ArmModel, q: Array, earlier: Array) -> Array:
    """Return the order of configurations q (m, k) by the distance, modulo whole turns, to the nearest in `earlier`."""
    dq = q[:, None] - earlier
    dq -= (2.0 * np.pi) * arm.turns * np.round(dq / (2.0 * np.pi))
    dq *= arm.travel_scale
    order: Array = np.einsum("smk,smk->sm", dq, dq).min(axis=1).argsort()
    return order


def turn_toward(arm: ArmModel, q: Array, q_near: Array) -> Array:
    """Turn joints q by whole turns, within their limits, to be nearest to the joints `q_near`."""
    turns = np.round((q_near - q) / (2.0 * np.pi)) * arm.turns
    least, most = np.ceil((arm.limits.lower - q) / (2.0 * np.pi)), np.floor((arm.limits.upper - q) / (2.0 * np.pi))
    turned: Array = q + 2.0 * np.pi * np.clip(turns, np.minimum(least, 0.0), np.maximum(most, 0.0))
    return turned


def configuration_cost(arm: ArmModel, q: Array) -> Array:
    """Return the cost (m,) of being near limits and singularities at joints (m, k), in rad of joint travel."""
    near_limits = np.maximum(0.0, 1.0 - arm.travel_scale * arm.limit_margins(q) / MARGIN_RAD)
    singular = np.maximum(0.0, 1.0 - relative_manipulability(arm, q))
    cost: Array = AT_LIMIT_COST * (near_limits**2).sum(axis=1) + SINGULAR_COST * singular**2
    return cost


def _partial_pose_solutions(arm: ArmModel, T_base_tool: Pose, before: Array) -> Array:
    goal, earlier = to_se3(T_base_tool), distinct(before, EARLIER_PARTIAL, EARLIER_APART_RAD)
    solutions = solve_partial(arm, goal, earlier) + [refine_partial(arm, goal, q) for q in earlier]
    reached = [each for each in solutions if each.reached]
    least = min((each.weighted_rad for each in reached), default=0.0)
    found = np.array([one.q for one in reached if one.weighted_rad <= least + SLACK_RAD]).reshape(-1, before.shape[1])
    found = distinct(found, len(found), SAME_RAD)
    flipped = [refine_partial(arm, goal, q) for q_found in found if (q := flipped_elbow(arm, q_found)) is not None]
    also = [each.q for each in flipped if each.reached and each.weighted_rad <= least + SLACK_RAD]
    found = np.vstack((found, *also))
    return distinct(found, len(found), SAME_RAD)
