"""A way around what bars a straight move: RRT-Connect, then shortcuts, then smooth bends, every part of it checked.

Kuffner and LaValle, "RRT-Connect: An Efficient Approach to Single-Query Path Planning", 2000, as OMPL has it. It
ends after a number of checks rather than a time, and its seed is fixed: what is found depends on nothing else.
"""

from __future__ import annotations

import numpy as np
from ompl import base, geometric, util

from pbd.arm.collision.queries import CollisionQueries
from pbd.arm.timing.path_smoothing import Curve
from pbd.pose import Array

STEP_RAD = 1.0
"""Longest move that is added to a tree, over all joints."""
WINDING_RAD = np.pi
"""How far beyond its start and its end a joint may go."""

_SEED = 1
_SHORTCUTS = 60
_BENDS = 2  # times that the path is divided in two to bend it
_BETWEEN_RAD = 0.05, 0.02, 0.01  # a spline through points so near to each other keeps to the straight lines


def find_detour(queries: CollisionQueries, leg: int, q_start: Array, q_end: Array, most_checks: int) -> Array | None:
    """Return joints (m, k) on a curve to keyframe `leg` that ends at `q_end` (k,); or just that, if it is straight.

    None where none is found by so many checks.
    """
    if not all(queries.passes(leg, q[None]) for q in (q_start, q_end)):
        return None
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(_SEED)
    limits, count = queries.arm.limits, len(q_start)
    space, bounds = base.RealVectorStateSpace(count), base.RealVectorBounds(count)
    lower = np.maximum(limits.lower, np.minimum(q_start, q_end) - WINDING_RAD)
    upper = np.minimum(limits.upper, np.maximum(q_start, q_end) + WINDING_RAD)
    for joint in range(count):
        bounds.setLow(joint, float(lower[joint]))
        bounds.setHigh(joint, float(upper[joint]))
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    checker = _Checker(information, queries, leg, count)
    information.setStateValidityChecker(checker.stands)
    information.setMotionValidator(checker)
    information.setup()
    problem = base.ProblemDefinition(information)
    start, goal = information.allocState(), information.allocState()
    start[0:count], goal[0:count] = q_start.tolist(), q_end.tolist()
    problem.setStartAndGoalStates(start, goal)
    planner = geometric.RRTConnect(information)
    planner.setRange(STEP_RAD)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(lambda: checker.checks >= most_checks))
    if not problem.hasExactSolution():
        return None
    path = problem.getSolutionPath()
    simplifier = geometric.PathSimplifier(information)
    simplifier.partialShortcutPath(path, _SHORTCUTS, _SHORTCUTS)
    simplifier.reduceVertices(path)
    corners = checker.joints(path)
    if len(corners) == 2:
        return corners[1:]
    simplifier.smoothBSpline(path, _BENDS)
    for waypoints in (checker.joints(path), corners):
        for between_rad in _BETWEEN_RAD:
            dense = _divided(waypoints, between_rad)
            curve = Curve.through(dense, limits)
            if curve is not None and queries.passes(leg, curve.q(curve.grid())):
                return dense[1:]
    return None


class _Checker(base.MotionValidator):  # type: ignore[misc]
    """The checks of one leg, as OMPL asks for them."""

    def __init__(self, information: base.SpaceInformation, queries: CollisionQueries, leg: int, count: int) -> None:
        super().__init__(information)
        self.queries, self.leg, self.count, self.checks = queries, leg, count, 0

    def stands(self, state: base.State) -> bool:
        self.checks += 1
        return self.queries.passes(self.leg, self._of(state)[None])

    def checkMotion(self, before: base.State, after: base.State) -> bool:
        self.checks += 1
        return self.queries.passes(self.leg, np.stack((self._of(before), self._of(after))))

    def joints(self, path: geometric.PathGeometric) -> Array:
        return np.array([self._of(state) for state in path.getStates()])

    def _of(self, state: base.State) -> Array:
        return np.array(state[0 : self.count])


def _divided(q: Array, between_rad: float) -> Array:
    """Put points on straight moves (m, k), so near to each other that no joint moves by more from one to the next."""
    steps = np.maximum(np.ceil(np.abs(np.diff(q, axis=0)).max(axis=1) / between_rad).astype(np.int64), 1)
    parts = [a + np.arange(n)[:, None] / n * (b - a) for a, b, n in zip(q[:-1], q[1:], steps, strict=True)]
    return np.vstack((*parts, q[-1:]))
