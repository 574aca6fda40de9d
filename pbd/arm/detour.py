"""A detour where a straight move is barred: RRT-Connect, then shortcuts, then a smooth curve, all of it checked.

Kuffner and LaValle, "RRT-Connect: An Efficient Approach to Single-Query Path Planning", 2000, as OMPL implements it.
The search is reproducible: its seed is fixed, and it ends after a number of collision checks, not after a time.
"""

from collections.abc import Sequence
from functools import partial
from operator import itemgetter

import numpy as np
from ompl import base, geometric, util

from pbd.arm.collision.scene import CollisionScene, GraspState
from pbd.arm.ladder_checks import DetourSearch
from pbd.arm.ladder_graph import joint_travel
from pbd.arm.timing.path_smoothing import Curve
from pbd.pose import Array

_SHORTCUTS = 40  # largest number of attempts to shorten a path
_MOST_BENT = 8  # largest number of bent detours that are checked, the shortest first
_MOST_GROWTH = 1.2  # largest growth of a bent detour's length, relative to that of the straight move
_OFFSET_SHARES = 0.5, 0.7, 0.85  # a bent detour keeps the first share of its offset from the straight move that is free
_SMOOTHING_STEPS = 2  # steps of OMPL's B-spline smoothing; each halves the segments
_SPACINGS_RAD = 0.05, 0.02, 0.01  # largest joint step between the points of a polyline through which a spline is tried


def find_detour(
    scene: CollisionScene, grasp: GraspState, starts: Array, goals: Array, settings: DetourSearch
) -> tuple[Array | None, int]:
    """Find a collision-free path from one of the starts (s, k) to one of the goals (g, k).

    Returns:
        Joints (m, k) on a smooth curve from a start to a goal, or only these two if the straight move is free, or None
        if nothing was found; and the number of collision checks.
    """
    starts, goals = (np.array([q for q in ends if scene.is_free(q[None], grasp)]) for ends in (starts, goals))
    if not len(starts) or not len(goals) or settings.most_checks <= 0:
        return None, 0
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(settings.seed)
    search = _Search(scene, grasp, np.vstack((starts, goals)), settings.winding_rad)
    corners = search.connect(starts, goals, settings)
    return None if corners is None else search.smooth(corners), search.checker.checks


def bend_detour(
    scene: CollisionScene, grasp: GraspState, start: Array, goal: Array, known: Sequence[Array]
) -> Array | None:
    """Bend a known detour (m, k) in the same grasp state to new ends (k,).

    Most detours around one obstacle are similar. This needs one or two collision checks, a search about fifty.

    Returns:
        Joints (m, k): only the ends if the straight move is free, else the shortest free detour; None if none is free.
    """
    straight: Array = np.stack((start, goal))
    travel = partial(joint_travel, travel_scale=scene.arm.travel_scale)
    if scene.is_free(straight, grasp):
        return straight
    detours: list[tuple[float, Array]] = []
    for path in known:
        share = np.linspace(0.0, 1.0, len(path))[:, None]
        most = _MOST_GROWTH * travel(straight) * travel(path) / max(travel(path[[0, -1]]), 1e-9)
        for directed in (path, path[::-1]):
            bent: Array = directed + (1.0 - share) * (start - directed[0]) + share * (goal - directed[-1])
            bent[0], bent[-1] = start, goal
            if (length := travel(bent)) < most:
                detours.append((length, bent))
    detours.sort(key=itemgetter(0))
    for _, bent in detours[:_MOST_BENT]:
        if _is_free_curve(scene, grasp, bent):
            direct = start + np.linspace(0.0, 1.0, len(bent))[:, None] * (goal - start)
            nearer = (direct + share * (bent - direct) for share in _OFFSET_SHARES)
            return next((each for each in nearer if _is_free_curve(scene, grasp, each)), bent)
    return None


def _is_free_curve(scene: CollisionScene, grasp: GraspState, q: Array) -> bool:
    """Whether the smooth curve through joints (m, k) is free and within the limits."""
    limits = scene.arm.limits
    if (q < limits.lower).any() or (q > limits.upper).any() or (curve := Curve.through(q, limits)) is None:
        return False
    return scene.is_free(curve.q(curve.grid()), grasp)


class _Search:
    """An OMPL problem in one grasp state; its joint space reaches `winding_rad` beyond the range of the ends (m, k)."""

    def __init__(self, scene: CollisionScene, grasp: GraspState, ends: Array, winding_rad: float) -> None:
        limits, count = scene.arm.limits, ends.shape[1]
        space, bounds = base.RealVectorStateSpace(count), base.RealVectorBounds(count)
        lower = np.maximum(limits.lower, ends.min(axis=0) - winding_rad)
        upper = np.minimum(limits.upper, ends.max(axis=0) + winding_rad)
        for joint in range(count):
            bounds.setLow(joint, float(lower[joint]))
            bounds.setHigh(joint, float(upper[joint]))
        space.setBounds(bounds)
        self.information = base.SpaceInformation(space)
        self.checker = _Checker(self.information, scene, grasp, count)
        self.information.setStateValidityChecker(self.checker.is_free_state)
        self.information.setMotionValidator(self.checker)
        self.information.setup()

    def connect(self, starts: Array, goals: Array, settings: DetourSearch) -> Array | None:
        """Return the corners (m, k) of a path from a start to a goal; None if the checks are used up first."""
        problem, ends = base.ProblemDefinition(self.information), base.GoalStates(self.information)
        for q in starts:
            problem.addStartState(self._state(q))
        for q in goals:
            ends.addState(self._state(q))
        problem.setGoal(ends)
        planner = geometric.RRTConnect(self.information)
        planner.setRange(settings.step_rad)
        planner.setProblemDefinition(problem)
        planner.setup()
        planner.solve(base.PlannerTerminationCondition(lambda: self.checker.checks >= settings.most_checks))
        return self.checker.joints(problem.getSolutionPath()) if problem.hasExactSolution() else None

    def smooth(self, q: Array) -> Array | None:
        """Shorten and smooth a path of corners (l, k).

        Returns:
            Joints (m, k) on a free curve, just the two ends if the straight move is free, or None.
        """
        path = geometric.PathGeometric(self.information)
        for each in q:
            path.append(self._state(each))
        simplifier = geometric.PathSimplifier(self.information)
        simplifier.reduceVertices(path)  # first: it checks moves between corners, whose distances are cached
        simplifier.partialShortcutPath(path, _SHORTCUTS, _SHORTCUTS)
        simplifier.reduceVertices(path)
        corners = self.checker.joints(path)
        if len(corners) == 2:
            return corners
        simplifier.smoothBSpline(path, _SMOOTHING_STEPS)
        for waypoints in (self.checker.joints(path), corners):
            for between_rad in _SPACINGS_RAD:
                dense = _subdivided(waypoints, between_rad)
                if _is_free_curve(self.checker.scene, self.checker.grasp, dense):
                    return dense
        return None

    def _state(self, q: Array) -> base.State:
        state = self.information.allocState()
        state[0 : len(q)] = q.tolist()
        return state


class _Checker(base.MotionValidator):  # type: ignore[misc]
    """The collision checks in one grasp state, as OMPL calls them.

    It must not refer to `_Search`: OMPL cannot free reference cycles.
    """

    def __init__(
        self, information: base.SpaceInformation, scene: CollisionScene, grasp: GraspState, count: int
    ) -> None:
        super().__init__(information)
        self.scene, self.grasp, self.count, self.checks = scene, grasp, count, 0

    def is_free_state(self, state: base.State) -> bool:
        self.checks += 1
        return self.scene.is_free(self._joints_of(state)[None], self.grasp)

    def checkMotion(self, before: base.State, after: base.State) -> bool:
        self.checks += 1
        return self.scene.is_free(np.stack((self._joints_of(before), self._joints_of(after))), self.grasp)

    def joints(self, path: geometric.PathGeometric) -> Array:
        return np.array([self._joints_of(state) for state in path.getStates()])

    def _joints_of(self, state: base.State) -> Array:
        return np.array(state[0 : self.count])


def _subdivided(q: Array, between_rad: float) -> Array:
    """Add points to a polyline (m, k) so that no joint moves by more than `between_rad` from one to the next."""
    steps = np.maximum(np.ceil(np.abs(np.diff(q, axis=0)).max(axis=1) / between_rad).astype(np.int64), 1)
    parts = [a + np.arange(n)[:, None] / n * (b - a) for a, b, n in zip(q[:-1], q[1:], steps, strict=True)]
    return np.vstack((*parts, q[-1:]))
