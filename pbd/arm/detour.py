"""A detour around what bars a straight move: RRT-Connect, then shortcuts, then smooth bends, every part of it checked.

Kuffner and LaValle, "RRT-Connect: An Efficient Approach to Single-Query Path Planning", 2000, as OMPL implements it.
The result is the same each time: the search ends after a number of checks, not after a time, and its seed is fixed.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from operator import itemgetter

import numpy as np
from ompl import base, geometric, util

from pbd.arm.collision.scene import CollisionScene, Leg
from pbd.arm.ladder_links import DetourSearch
from pbd.arm.timing.path_smoothing import Curve
from pbd.pose import Array

_THINNED = 20  # every so many points of a known path one begins a tree
_SHORTCUTS = 40
_WARPED = 8  # known detours that are bent and checked, the shortest first
_WORSE = 1.2  # largest growth of a bent detour's length, relative to the straight move
_NEARER = 0.5, 0.7, 0.85  # shares of its offset from the straight move that a bent detour keeps: the first that is free
_BENDS = 2  # halvings of the path when OMPL smooths it
_BETWEEN_RAD = 0.05, 0.02, 0.01  # spacing of points on straight lines at which a spline through them is tried


def find_detour(
    scene: CollisionScene,
    leg: Leg,
    starts: Array,
    goals: Array,
    effort: DetourSearch,
    most_checks: int,
    known: Sequence[Array] = (),
) -> tuple[Array | None, int]:
    """Find a collision-free path from one of the starts (s, k) to one of the goals (g, k).

    Args:
        most_checks: collision checks before the search is given up; smoothing comes on top.
        known: free paths (m, k) of the same leg; the detour may follow part of one, in either direction.

    Returns:
        Joints (m, k) on a curve from a start to a goal, only these two if it is straight, or None. And the number of
        checks.
    """
    starts = np.array([q for q in starts if scene.is_free(q[None], leg)]).reshape(-1, goals.shape[1])
    goals = np.array([q for q in goals if scene.is_free(q[None], leg)]).reshape(-1, goals.shape[1])
    if not len(starts) or not len(goals) or most_checks <= 0:
        return None, 0
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(effort.seed)
    search = _Search(scene, leg, np.vstack((starts, goals)), effort.winding_rad)
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


def warp_detour(scene: CollisionScene, leg: Leg, start: Array, goal: Array, known: Sequence[Array]) -> Array | None:
    """Bend a known detour (m, k) of the same leg to other ends (k,).

    Most detours around one obstacle are similar: this takes a check or two, a search about fifty.

    Returns:
        Joints (m, k): only the ends if the straight move is free, else the shortest free detour, or None.
    """
    straight: Array = np.stack((start, goal))
    if scene.is_free(straight, leg):
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
        if _is_free_curve(scene, leg, way):
            direct = start + np.linspace(0.0, 1.0, len(way))[:, None] * (goal - start)
            nearer = (direct + share * (way - direct) for share in _NEARER)
            return next((each for each in nearer if _is_free_curve(scene, leg, each)), way)
    return None


def _length(q: Array) -> float:
    step = q[1:] - q[:-1]
    return float(np.sqrt(np.einsum("ij,ij->i", step, step)).sum())


def _ways_from(starts: Array, known: Sequence[Array]) -> dict[bytes, Array]:
    """Return a path (m, k) to each end that known paths reach from starts (s, k), by the end's bytes; starts first."""
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


def _is_free_curve(scene: CollisionScene, leg: Leg, q: Array) -> bool:
    """Whether the curve through joints (m, k) is free."""
    limits = scene.arm.limits
    if (q < limits.lower).any() or (q > limits.upper).any() or (curve := Curve.through(q, limits)) is None:
        return False
    return scene.is_free(curve.q(curve.grid()), leg)


class _Search:
    """A search by OMPL in the joint space around ends (m, k) of one leg."""

    def __init__(self, scene: CollisionScene, leg: Leg, ends: Array, winding_rad: float) -> None:
        limits, count = scene.arm.limits, ends.shape[1]
        space, bounds = base.RealVectorStateSpace(count), base.RealVectorBounds(count)
        lower = np.maximum(limits.lower, ends.min(axis=0) - winding_rad)
        upper = np.minimum(limits.upper, ends.max(axis=0) + winding_rad)
        for joint in range(count):
            bounds.setLow(joint, float(lower[joint]))
            bounds.setHigh(joint, float(upper[joint]))
        space.setBounds(bounds)
        self.information = base.SpaceInformation(space)
        self.checker = _Checker(self.information, scene, leg, count)
        self.information.setStateValidityChecker(self.checker.stands)
        self.information.setMotionValidator(self.checker)
        self.information.setup()

    def connect(self, starts: Array, goals: Array, step_rad: float, most_checks: int) -> Array | None:
        """Return the corners (m, k) of a path from a start to a goal, None where the checks are used up first."""
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
        """Shorten and smooth a path of corners (l, k): joints (m, k) on a curve, or two ends if it is straight."""
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
                if _is_free_curve(self.checker.scene, self.checker.leg, dense):
                    return dense
        return None

    def _state(self, q: Array) -> base.State:
        state = self.information.allocState()
        state[0 : len(q)] = q.tolist()
        return state


class _Checker(base.MotionValidator):  # type: ignore[misc]
    """The checks of one leg, as OMPL calls them. It must not refer to the search: OMPL can't free reference cycles."""

    def __init__(self, information: base.SpaceInformation, scene: CollisionScene, leg: Leg, count: int) -> None:
        super().__init__(information)
        self.scene, self.leg, self.count, self.checks = scene, leg, count, 0

    def stands(self, state: base.State) -> bool:
        self.checks += 1
        return self.scene.is_free(self._of(state)[None], self.leg)

    def checkMotion(self, before: base.State, after: base.State) -> bool:
        self.checks += 1
        return self.scene.is_free(np.stack((self._of(before), self._of(after))), self.leg)

    def joints(self, path: geometric.PathGeometric) -> Array:
        return np.array([self._of(state) for state in path.getStates()])

    def _of(self, state: base.State) -> Array:
        return np.array(state[0 : self.count])


def _divided(q: Array, between_rad: float) -> Array:
    """Put points on straight moves (m, k) so that no joint moves by more than `between_rad` from one to the next."""
    steps = np.maximum(np.ceil(np.abs(np.diff(q, axis=0)).max(axis=1) / between_rad).astype(np.int64), 1)
    parts = [a + np.arange(n)[:, None] / n * (b - a) for a, b, n in zip(q[:-1], q[1:], steps, strict=True)]
    return np.vstack((*parts, q[-1:]))
