"""What is free on the links of a motion's ladder graph, and what it costs; what was found stays with link and move."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pbd.arm.collision.clearance import MARGIN_M
from pbd.arm.collision.queries import CollisionQueries
from pbd.arm.collision.scene import Leg
from pbd.arm.ik.branches import configuration_cost
from pbd.arm.ik.cartesian import follow
from pbd.arm.joint_path import turned, widen
from pbd.arm.ladder_graph import Ladder
from pbd.arm.ladder_links import (
    ANY_OTHER,
    BETWEEN_TWO,
    CHECKS,
    CHECKS_CLOSE,
    CHECKS_EACH,
    ENOUGH_DETOURS,
    FROM_ANY_TO_ANY,
    DetourSearch,
    Link,
    Move,
    remedies_of,
)
from pbd.arm.model import ArmModel
from pbd.arm.motion_request import STRAIGHT, MotionRequest
from pbd.arm.tool_deviation import tool_deviations
from pbd.pose import Array

WIDE_COST, MOST_WIDE = 2.0 * np.pi, 40
"""Cost of a wide move, in rad of joint travel; and after how many between two keyframes nobody asks any more."""


class LinkChecks:
    """The ladder of a motion, and what each of its links and moves is: link j leads to layer j + 1.

    Without `queries` collisions are ignored.
    """

    def __init__(self, arm: ArmModel, request: MotionRequest, queries: CollisionQueries | None, ladder: Ladder) -> None:
        self.arm, self.request, self.queries, self.ladder = arm, request, queries, ladder
        self.n = len(request.T_base_tool)
        self.links = [Link(place) for place in range(len(ladder.layers) - 1)]
        may_detour = request.detour and queries is not None
        self.moves = [Move(STRAIGHT, remedies_of(request, i, may_detour=may_detour)) for i in range(len(self.links))]
        self.checks_left = CHECKS + self.n * CHECKS_EACH
        self.detours: dict[Leg, list[Array]] = {}  # that were searched for
        self.close = queries is not None and queries.scene.margin_m < MARGIN_M
        if self.close:
            self.checks_left = int(CHECKS_CLOSE * self.checks_left)

    def at(self, place: int) -> tuple[Link, Move]:
        """Return what leads to a layer, and the move that it is part of."""
        link = self.links[place - 1]
        return link, self.moves[link.keyframe]

    def stands(self, place: int, q: Array) -> bool:
        """Whether the arm may stand at joints (k,) in a layer."""
        (link, move), queries = self.at(place), self.queries
        i = link.keyframe
        if queries is None or i == self.n:
            return True
        if not link.at_keyframe:
            return queries.passes(i, q[None])
        if queries.stands(i, q):
            return True
        if move.pose_hit is None:  # only of the first it is kept what touches
            move.pose_hit = queries.standing(i, q)
        return False

    def wide_costs(self, places: Sequence[int], q_before: Array, q: Array) -> list[float]:
        """What moves to layers cost for being wide, rad, each from one of joints (n, k) to the other in its place."""
        turns, costs = np.abs(q - q_before).max(axis=1) > np.pi, [0.0] * len(places)
        asked = [
            i
            for i, place in enumerate(places)
            if self.straight(place)
            and self.at(place)[1].found_wide < MOST_WIDE
            # The ladder charges a move for a joint that turns by more than half a turn already.
            and not (turns[i] and self.ladder.layers[place].wide_cost > 0.0)
        ]
        for i, deviation in zip(asked, tool_deviations(self.arm, q_before[asked], q[asked]), strict=True):
            self.at(places[i])[1].found_wide += deviation.wide
            costs[i] = WIDE_COST * deviation.wide
        return costs

    def cost(self, place: int, q_before: Array, q: Array) -> float:
        """What else a move to a layer costs beside its travel, rad; infinite where it isn't free."""
        link, move = self.at(place)
        along, cost = self._along(link, move, q_before, q), 0.0
        if along is None:
            move.tried, cost = move.tried + 1, np.inf
        else:
            link.found[q_before.tobytes() + q.tobytes()] = along
            if move.detour:
                path = np.vstack((q_before, along))
                cost = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum() - np.linalg.norm(q - q_before))
                if len(link.found) == ENOUGH_DETOURS:
                    self.ladder.doubt(place, ANY_OTHER)
        if move.tool_barred:  # it does however the arm is held
            layer = self.ladder.layers[place]
            layer.refused = layer.most_refused
            move.leave_path()
        return cost

    def straight(self, place: int) -> bool:
        """Whether a layer is come to by a straight move between two keyframes."""
        link, move = self.at(place)
        return link.poses is None and 0 < link.keyframe < self.n and not move.detour

    def connect(self, place: int) -> None:
        """Replace all moves to a layer by one detour, from any joints of the layer before; bar them if there is none.

        What is known to be free on any of the links whose leg is alike may be part of it.
        """
        ladder, (link, move) = self.ladder, self.at(place)
        before, layer, i = ladder.layers[place - 1], ladder.layers[place], link.keyframe
        if i < self.n:
            widen(self.arm, self.request.T_base_tool[i], ladder, place)
        starts = before.q[np.isfinite(ladder.travel(place - 1))]
        if place > 1:  # from where the arm is known to get to, if it is
            ends = {along[-1].tobytes() for along in self.links[place - 2].found.values()}
            known = np.array([q.tobytes() in ends for q in starts], dtype=bool)
            starts = starts[known] if known.any() else starts
        goals = np.array([q for q in layer.q[np.isfinite(layer.cost)] if self.stands(place, q)])
        found = self._connect(i, move, starts, goals) if len(starts) and len(goals) else None
        if found is None:
            ladder.settle(place, before.q[0], layer.q[0], np.inf)
            return
        if not (layer.q == found[-1]).all(axis=1).any():
            ladder.add(place, found[-1:], configuration_cost(self.arm, found[-1:]))
        link.found[found[0].tobytes() + found[-1].tobytes()] = found[1:]
        ladder.settle(place, found[0], found[-1], float(np.linalg.norm(np.diff(found, axis=0), axis=1).sum()))

    def _connect(self, i: int, move: Move, starts: Array, goals: Array) -> Array | None:
        """Return joints (m, k) of a detour to keyframe i from one of some joints (s, k) to one of others (g, k)."""
        if self.queries is None:
            return None
        legs, count = self.queries.legs, starts.shape[1]
        known = [
            np.vstack((np.frombuffer(ends)[:count], along))
            for link in self.links
            if legs[link.keyframe] == legs[i]
            for ends, along in link.found.items()
        ]
        for effort in FROM_ANY_TO_ANY:
            ends = goals if i == self.n else turned(self.arm, goals, starts, effort.turned)
            if (found := self._find_detour(i, move, starts, ends, effort, known)) is not None:
                return found
        return None

    def _find_detour(
        self, i: int, move: Move, starts: Array, goals: Array, effort: DetourSearch, known: Sequence[Array] = ()
    ) -> Array | None:
        from pbd.arm.detour import find_detour  # OMPL takes its time to load

        assert self.queries is not None
        most_checks = min(effort.most_checks, self.checks_left)
        found, checks = find_detour(self.queries, i, starts, goals, effort, most_checks, known)
        move.searched, self.checks_left = move.searched + checks, self.checks_left - checks
        return found

    def _around(self, i: int, move: Move, q_before: Array, q: Array) -> Array | None:
        """Return the joints (m, k) of a detour to keyframe i: as one that is known goes, else any."""
        from pbd.arm.detour import warp_detour

        assert self.queries is not None
        known = self.detours.setdefault(self.queries.legs[i], [])
        found = warp_detour(self.queries, i, q_before, q, known)
        if found is None:
            found = self._find_detour(i, move, q_before[None], q[None], BETWEEN_TWO)
            if found is not None and len(found) > 2:
                known.append(found)
        return None if found is None else found[1:]

    def _along(self, link: Link, move: Move, q_before: Array, q: Array) -> Array | None:
        """Return the joints (m, k) by which the arm moves from some to others; None where it can't."""
        i, queries = link.keyframe, self.queries
        if (queries is None and link.poses is None) or (i == 0 and not self.request.approach):
            return q[None]
        if queries is not None and move.detour:
            return self._around(i, move, q_before, q)
        if queries is not None and i in (0, self.n):
            found = queries.by_the_axis(i, q_before, q)
            if found is None and move.kind not in move.hits and (hit := queries.moving(i, np.stack((q_before, q)))):
                move.hits[move.kind] = hit
            return found
        if queries is not None and link.poses is not None and not link.tool_free:
            tool_hit = queries.tool_hit(i, link.poses)
            link.tool_free, move.tool_barred = tool_hit is None, tool_hit is not None
            if tool_hit is not None:
                move.hits[move.kind] = tool_hit
                return None
        along = np.stack((q_before, q)) if link.poses is None else follow(self.arm, link.poses, q_before, q)
        if along is None or queries is None or queries.passes(i, along):
            return None if along is None else along[1:]
        if move.kind not in move.hits and (hit := queries.moving(i, along)):
            move.hits[move.kind] = hit
        return None
