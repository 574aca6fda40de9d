"""A way around what bars a straight move: RRT-Connect, then shortcuts, then smooth bends, every part of it checked.

Kuffner and LaValle, "RRT-Connect: An Efficient Approach to Single-Query Path Planning", 2000, as OMPL has it. It
ends after a number of checks rather than a time, and its seed is fixed: what is found depends on nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from operator import itemgetter

import numpy as np
from ompl import base, geometric, util

from pbd.arm.collision.queries import CollisionQueries
from pbd.arm.ladder_links import DetourSearch
from pbd.arm.timing.path_smoothing import Curve
from pbd.pose import Array

_THINNED = 20  # of a known way's points one in so many begins a tree
_SHORTCUTS = 40
_WARPED = 8  # of known detours so many are bent and checked, the shortest first
_WORSE = 1.2  # and no longer, beside the straight move, than so many times what they were
_NEARER = 0.5, 0.7, 0.85  # shares of its offset from the straight move that a bent detour keeps: the first that is free
_BENDS = 2  # times that the path is divided in two to bend it
_BETWEEN_RAD = 0.05, 0.02, 0.01  # a spline through points so near to each other keeps to the straight lines


def find_detour(
    queries: CollisionQueries,
    leg: int,
    starts: Array,
    goals: Array,
    effort: DetourSearch,
    most_checks: int,
    known: Sequence[Array] = (),
) -> tuple[Array | None, int]:
    """Find a way to keyframe `leg` from one of the starts (s, k) to one of the goals (g, k).

    Args:
        most_checks: how many checks to make at most, before the way is made smooth.
        known: free paths (m, k) of legs alike; the detour may follow part of one, in either direction.

    Returns:
        Joints (m, k) on a curve from a start to a goal, or just these two if it is straight; None where none is found
        by so many checks. And how many checks were made.
    """
    starts = np.array([q for q in starts if queries.passes(leg, q[None])]).reshape(-1, goals.shape[1])
    goals = np.array([q for q in goals if queries.passes(leg, q[None])]).reshape(-1, goals.shape[1])
    if not len(starts) or not len(goals) or most_checks <= 0:
        return None, 0
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(effort.seed)
    search = _Search(queries, leg, np.vstack((starts, goals)), effort.winding_rad)
    ways = _ways_from(starts, known)
    there = next((ways[q.tobytes()] for q in goals if q.tobytes() in ways), None)
    if there is None:
        marks = {q.tobytes() for way in known for q in (*way[::_THINNED], way[-1])}
        begun = np.array([*starts, *(way[-1] for way in [*ways.values()][len(starts) :] if way[-1].tobytes() in marks)])
        corners = search.connect(begun, goals, effort.step_rad, most_checks)
        if corners is None:
            return None, search.checker.checks
        there = np.vstack((ways[corners[0].tobytes()], corners[1:]))
    return search.smooth(there), search.checker.checks


def warp_detour(queries: CollisionQueries, leg: int, start: Array, goal: Array, known: Sequence[Array]) -> Array | None:
    """Bend one of known detours (m, k) of legs alike, so that it leads from joints (k,) to others.

    Most ways around one obstacle are alike: this takes a check or two, a search some fifty.

    Returns:
        Joints (m, k): just the ends if the straight move is free, else the shortest of what is tried and free, or None.
    """
    straight: Array = np.stack((start, goal))
    if queries.passes(leg, straight):
        return straight
    ways: list[tuple[float, Array]] = []
    for way in known:
        share = np.linspace(0.0, 1.0, len(way))[:, None]
        most = _WORSE * _length(straight) * _length(way) / max(_length(way[[0, -1]]), 1e-9)
        for there in (way, way[::-1]):
            warped: Array = there + (1.0 - share) * (start - there[0]) + share * (goal - there[-1])
            warped[0], warped[-1] = start, goal
            if (length := _length(warped)) < most:
                ways.append((length, warped))
    ways.sort(key=itemgetter(0))
    for _, way in ways[:_WARPED]:
        if _curve_passes(queries, leg, way):
            direct = start + np.linspace(0.0, 1.0, len(way))[:, None] * (goal - start)
            nearer = (direct + share * (way - direct) for share in _NEARER)
            return next((each for each in nearer if _curve_passes(queries, leg, each)), way)
    return None


def _length(q: Array) -> float:
    step = q[1:] - q[:-1]
    return float(np.sqrt(np.einsum("ij,ij->i", step, step)).sum())


def _ways_from(starts: Array, known: Sequence[Array]) -> dict[bytes, Array]:
    """Return a path (m, k) to each end that known paths lead to from starts (s, k), by that end: the starts first."""
    beside: dict[bytes, list[Array]] = {}
    for way in known:
        for before, after in pairwise(way):
            beside.setdefault(before.tobytes(), []).append(after)
            beside.setdefault(after.tobytes(), []).append(before)
    ways = {q.tobytes(): q[None] for q in starts}
    ends = list(starts)
    for q in ends:
        for after in beside.get(q.tobytes(), ()):
            if after.tobytes() not in ways:
                ways[after.tobytes()] = np.vstack((ways[q.tobytes()], after))
                ends.append(after)
    return ways


def _curve_passes(queries: CollisionQueries, leg: int, q: Array) -> bool:
    """Whether the curve through joints (m, k) is free."""
    limits = queries.arm.limits
    if (q < limits.lower).any() or (q > limits.upper).any() or (curve := Curve.through(q, limits)) is None:
        return False
    return queries.passes(leg, curve.q(curve.grid()))


class _Search:
    """A search by OMPL among the joints around ends (m, k) of one leg."""

    def __init__(self, queries: CollisionQueries, leg: int, ends: Array, winding_rad: float) -> None:
        limits, count = queries.arm.limits, ends.shape[1]
        space, bounds = base.RealVectorStateSpace(count), base.RealVectorBounds(count)
        lower = np.maximum(limits.lower, ends.min(axis=0) - winding_rad)
        upper = np.minimum(limits.upper, ends.max(axis=0) + winding_rad)
        for joint in range(count):
            bounds.setLow(joint, float(lower[joint]))
            bounds.setHigh(joint, float(upper[joint]))
        space.setBounds(bounds)
        self.information = base.SpaceInformation(space)
        self.checker = _Checker(self.information, queries, leg, count)
        self.information.setStateValidityChecker(self.checker.stands)
        self.information.setMotionValidator(self.checker)
        self.information.setup()

    def connect(self, starts: Array, goals: Array, step_rad: float, most_checks: int) -> Array | None:
        """Return the corners (m, k) of a way from a start to a goal, None where none is found by so many checks."""
        problem, ends = base.ProblemDefinition(self.information), base.GoalStates(self.information)
        for q in starts:
            problem.addStartState(self._state(q))
        for q in goals:
            ends.addState(self._state(q))
        problem.setGoal(ends)
        planner = geometric.RRTConnect(self.information)
        planner.setRange(step_rad)
        planner.setProblemDefinition(problem)
        planner.setup()
        planner.solve(base.PlannerTerminationCondition(lambda: self.checker.checks >= most_checks))
        return self.checker.joints(problem.getSolutionPath()) if problem.hasExactSolution() else None

    def smooth(self, q: Array) -> Array | None:
        """Return joints (m, k) on a curve by a shorter way than corners (l, k); or its two ends, if straight."""
        path = geometric.PathGeometric(self.information)
        for each in q:
            path.append(self._state(each))
        simplifier = geometric.PathSimplifier(self.information)
        simplifier.reduceVertices(path)  # first: its checks are between corners, whose distances are known
        simplifier.partialShortcutPath(path, _SHORTCUTS, _SHORTCUTS)
        simplifier.reduceVertices(path)
        corners = self.checker.joints(path)
        if len(corners) == 2:
            return corners
        simplifier.smoothBSpline(path, _BENDS)
        for waypoints in (self.checker.joints(path), corners):
            for between_rad in _BETWEEN_RAD:
                dense = _divided(waypoints, between_rad)
                if _curve_passes(self.checker.queries, self.checker.leg, dense):
                    return dense
        return None

    def _state(self, q: Array) -> base.State:
        state = self.information.allocState()
        state[0 : len(q)] = q.tolist()
        return state


class _Checker(base.MotionValidator):  # type: ignore[misc]
    """The checks of one leg, as OMPL asks for them. It knows no search: OMPL could not free a circle."""

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
