"""Inverse kinematics of one pose: descents from the given joints and then from many seeds, until one arrives.

An arm of six joints or more brings its tool to a pose exactly or not at all; one of fewer comes near it by the rule in
relax.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd.arm.descent import SOLVED, UNTIL_IT_STOPS, descend_each, miss
from pbd.arm.model import ArmModel
from pbd.arm.relax import is_relaxed, solve_relaxed
from pbd.arm.seeds import seed_map
from pbd.arm.tool import Target, target
from pbd.pose import Array, Pose

TOLERANCE_M = 1e-5
TOLERANCE_RAD = 1e-5

WELL_PLACED, WORST_PLACED = 8, 16
"""How many of the nearest seeds of each kind are tried, in this order."""
NEAR_MISS, NEARLY_THERE = 0.2, 0.005
"""Where these end within such |e| (m, rad), it may be the wrong branch of a pose that can be reached."""
ANYWHERE, EVERYWHERE = 48, 400
"""How many random restarts follow a near miss (20 ms in all), and one that is nearly there."""
RESUMED = 3, 2
"""So many of the descents that came nearest are followed to their very end, before those and after."""


@dataclass(frozen=True, eq=False)
class IkResult:
    """The joints that bring the tool to a pose, or else the nearest to it that was found.

    Attributes:
        q: (k,) rad, within the limits.
        position_error_m, rotation_error_rad: what is left between the tool and the pose, by forward kinematics.
        relaxed: the arm has too few joints for any pose: its tool's rotation need only be near (relax.py).
    """

    q: Array
    position_error_m: float
    rotation_error_rad: float
    relaxed: bool = False

    @property
    def reached(self) -> bool:
        """Whether both errors are within tolerance, or the position's where that is all that is asked for."""
        return self.position_error_m <= TOLERANCE_M and (self.relaxed or self.rotation_error_rad <= TOLERANCE_RAD)


def solve(arm: ArmModel, T_base_tool: Pose, q_seed: Array | None = None) -> IkResult:
    """Find joints for a tool pose; the same question gets the same answer each time.

    Args:
        arm: the arm.
        T_base_tool: the tool's pose in base.
        q_seed: (k,) rad, tried first, where one is known that should be near; then the arm's own seeds.

    Returns:
        The first solution, or, where `reached` is false, the joints with the smallest |e| that were found. Of an arm
        with too few joints the nearest by its rule.
    """
    goal = target(T_base_tool)
    q = _search_relaxed(arm, goal, q_seed) if is_relaxed(arm) else _search(arm, goal, q_seed)
    return _result(arm, goal, q)


def check(arm: ArmModel, T_base_tool: Pose, q: Array) -> IkResult:
    """Say how far the tool is from a pose at joints q (k,), by forward kinematics."""
    return _result(arm, target(T_base_tool), q)


def _result(arm: ArmModel, goal: Target, q: Array) -> IkResult:
    return IkResult(q, *miss(arm, goal, q), is_relaxed(arm))


def _search_relaxed(arm: ArmModel, goal: Target, q_seed: Array | None) -> Array:
    attempts = _Attempts(arm, goal)
    if attempts.follow(seed_map(arm).nearest(goal, WELL_PLACED)):
        return attempts.best  # for once the whole pose can be met
    q_seeds = np.empty((0, len(arm.limits.lower))) if q_seed is None else q_seed[None]
    return solve_relaxed(arm, goal, q_seeds)[0].q


def _search(arm: ArmModel, goal: Target, q_seed: Array | None) -> Array:
    seeds, attempts = seed_map(arm), _Attempts(arm, goal)
    arrived = (
        (q_seed is not None and attempts.follow(q_seed[None]))
        or attempts.follow(seeds.nearest(goal, WELL_PLACED))
        or attempts.follow(seeds.nearest(goal, WORST_PLACED, worst=True))
        or attempts.resume(RESUMED[0])
    )
    if not arrived and attempts.least < NEAR_MISS**2:
        restarts = EVERYWHERE if attempts.least < NEARLY_THERE**2 else ANYWHERE
        if not attempts.follow(seeds.anywhere(restarts)):
            attempts.resume(RESUMED[1])
    return attempts.best


class _Attempts:
    """Where descents to one goal ended."""

    def __init__(self, arm: ArmModel, goal: Target) -> None:
        self.arm, self.goal = arm, goal
        self._q, self._squares = np.empty((0, len(arm.limits.lower))), np.empty(0)

    @property
    def best(self) -> Array:
        """(k,) rad, those with the smallest |e|."""
        q: Array = self._q[self._squares.argmin()]
        return q

    @property
    def least(self) -> float:
        """The smallest |e|^2."""
        return float(self._squares.min())

    def follow(self, q_seeds: Array) -> bool:
        """Descend from each seed until one arrives; say whether one did."""
        q, squares = descend_each(self.arm, self.goal, q_seeds)
        self._q, self._squares = np.vstack((self._q, q)), np.append(self._squares, squares)
        return bool(squares[-1] < SOLVED)

    def resume(self, count: int) -> bool:
        """Go on from the nearest: at the edge of what can be reached steps are small, and all may be given up early."""
        for i in np.argsort(self._squares)[:count]:
            q, square = descend_each(self.arm, self.goal, self._q[i : i + 1], patience=UNTIL_IT_STOPS)
            self._q[i], self._squares[i] = q[0], square[0]
            if square[0] < SOLVED:
                return True
        return False
