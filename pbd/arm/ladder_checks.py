"""Check which moves of a motion's ladder graph are free, and what they cost. Links and moves store the results."""

from collections.abc import Sequence
from importlib.util import find_spec
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pbd.arm.collision.clearance import MARGIN_M
from pbd.arm.collision.scene import CollisionScene, GraspState, Hit
from pbd.arm.ik.branches import configuration_cost
from pbd.arm.ik.cartesian import follow, line, refine
from pbd.arm.ik.partial_pose import is_partial
from pbd.arm.ladder_building import turn_variants, widen
from pbd.arm.ladder_graph import Ladder, joint_travel
from pbd.arm.ladder_state import Link, MoveState, ends_key, remedies_of
from pbd.arm.model import ArmModel
from pbd.arm.motion_request import STRAIGHT, MotionRequest
from pbd.arm.tool_deviation import tool_deviations
from pbd.pose import Array, Pose

CAN_DETOUR = find_spec("ompl") is not None
"""Whether OMPL is installed; for some versions of Python it has no build."""
OTHER_DETOUR_COST = 100.0
"""Extra cost of a second detour on a link, rad, so that it comes last."""
DETOUR_CHECKS, DETOUR_CHECKS_PER_KEYFRAME, CLOSE_CHECKS_SHARE = 6000, 1000, 0.5
"""Collision checks for all detours of a motion: DETOUR_CHECKS, and DETOUR_CHECKS_PER_KEYFRAME for each keyframe. With
the smaller margin CLOSE_M, only this share of the sum."""
WIDE_COST = 2.0 * np.pi
"""Cost of a wide move, rad of joint travel."""
APPROACH_M = 0.08, 0.16
"""Distances of a via point before keyframe 0, m, along the tool's approach axis.

The arm takes the first that is free where the straight move from its start touches something. The retreat does the same
after the last keyframe.
"""


class DetourSearch(NamedTuple):
    """Settings of one search for a detour.

    Attributes:
        most_checks: number of collision checks after which the search gives up; smoothing needs further ones.
        seed: seed of the random search.
        step_rad: longest edge of a tree, as the norm over all joints.
        winding_rad: how far a joint may go beyond the range of all starts and goals.
        variants: largest number of variants of each goal, which differ by whole turns.
    """

    most_checks: int
    seed: int = 1
    step_rad: float = 1.0
    winding_rad: float = np.pi
    variants: int = 1


BETWEEN_TWO = DetourSearch(400)
FROM_ANY_TO_ANY = (
    DetourSearch(1000, winding_rad=0.5 * np.pi),
    DetourSearch(1000, variants=8),
    DetourSearch(1000, winding_rad=0.5 * np.pi, seed=2),
    DetourSearch(1500, winding_rad=0.5 * np.pi, seed=3, step_rad=0.5),
    DetourSearch(1500, seed=4, step_rad=0.5),
)
"""Searches from any configuration to any other, in this order. A search succeeds soon or never, so several short ones
find more than a long one."""


class LinkChecks:
    """The ladder of a motion, with its links and moves: links[j] leads to layer j + 1.

    Without a scene, collisions are ignored.

    Attributes:
        grasps: grasps[i] holds on the way to keyframe i, grasps[n] after the last one.
        moves: moves[i] leads to keyframe i, moves[n] back home.
        checks_left: collision checks that all detour searches of this motion may still use.
        detours: grasp state -> the detours (m, k) that searches between two configurations found.
    """

    def __init__(self, arm: ArmModel, request: MotionRequest, scene: CollisionScene | None, ladder: Ladder) -> None:
        self.arm, self.request, self.scene, self.ladder = arm, request, scene, ladder
        self.obstacles = frozenset() if scene is None else scene.obstacles
        self.grasps = () if scene is None else scene.grasp_states(request.T_base_tool, request.grips)
        self.n = len(request.T_base_tool)
        self.links = [Link(place) for place in range(len(ladder.layers) - 1)]
        may_detour = request.detour and CAN_DETOUR and scene is not None
        self.moves = [
            MoveState(STRAIGHT, remedies_of(request, i, may_detour=may_detour)) for i in range(len(self.links))
        ]
        close = scene is not None and scene.margin_m < MARGIN_M
        self.checks_left = int(
            (CLOSE_CHECKS_SHARE if close else 1.0) * (DETOUR_CHECKS + self.n * DETOUR_CHECKS_PER_KEYFRAME)
        )
        self.detours: dict[GraspState, list[Array]] = {}

    def at(self, place: int) -> tuple[Link, MoveState]:
        """Return the link to a layer, and the move that it is part of."""
        link = self.links[place - 1]
        return link, self.moves[link.keyframe]

    def places_of(self, i: int) -> list[int]:
        """Return the layers on the move to keyframe i, in order; the last is the keyframe's own."""
        return [place for place, link in enumerate(self.links, start=1) if link.keyframe == i]

    def is_free(self, place: int, q: Array) -> bool:
        """Whether the arm is free at joints (k,) in a layer."""
        link, move = self.at(place)
        i = link.keyframe
        if self.scene is None or i == self.n:
            return True
        if not link.at_keyframe:
            return self.scene.is_free(q[None], self.grasps[i])
        grasps = dict.fromkeys(self.grasps[i : i + 2])  # as it arrives and as it leaves, often equal: check once
        if all(self.scene.is_free(q[None], grasp) for grasp in grasps):
            return True
        if move.pose_hit is None:  # keep the first one for the message
            hits = (self.scene.hit(q, grasp) for grasp in grasps)
            move.pose_hit = next((hit for hit in hits if hit), None)
        return False

    def tool_hit(self, i: int, T_base_tool: Sequence[Pose]) -> Hit | None:
        """Return a hit of the tool and its load on poses to keyframe i: it occurs in every configuration of the arm."""
        if self.scene is None or is_partial(self.arm):
            return None
        return self.scene.tool_hit(T_base_tool, self.grasps[i])

    def wide_costs(self, places: Sequence[int], q_before: Array, q: Array) -> list[float]:
        """Return the extra cost of wide moves, rad, for straight moves from rows of joints (n, k) to rows (n, k)."""
        turns, costs = np.abs(q - q_before).max(axis=1) > np.pi, [0.0] * len(places)
        asked = [
            i
            for i, place in enumerate(places)
            if self.is_straight(place)
            # The ladder has already charged for a joint that moves by more than half a turn.
            and not (turns[i] and self.ladder.layers[place].wide_cost > 0.0)
        ]
        for i, deviation in zip(asked, tool_deviations(self.arm, q_before[asked], q[asked]), strict=True):
            costs[i] = WIDE_COST * deviation.wide
        return costs

    def cost(self, place: int, q_before: Array, q: Array) -> float:
        """Return the cost of a move to a layer beyond its straight travel, rad; infinite if it is not free."""
        link, move = self.at(place)
        along, cost = self._free_move(place, q_before, q), 0.0
        if along is None:
            move.barred_pairs, cost = move.barred_pairs + 1, np.inf
        else:
            link.free_moves[ends_key(q_before, q)] = along
            if move.detour:
                scale = self.arm.travel_scale
                cost = joint_travel(np.vstack((q_before, along)), scale) - joint_travel(np.stack((q_before, q)), scale)
                if len(link.free_moves) == 1:
                    self.ladder.set_unchecked_cost(place, OTHER_DETOUR_COST)
        return cost

    def is_straight(self, place: int) -> bool:
        """Whether the link to a layer is a straight move between two keyframes."""
        link, move = self.at(place)
        return link.poses is None and 0 < link.keyframe < self.n and not move.detour

    def connect(self, place: int) -> None:
        """Replace all moves to a layer by one detour from any state of the layer before; bar them if none is found."""
        ladder, link = self.ladder, self.links[place - 1]
        before, layer, i = ladder.layers[place - 1], ladder.layers[place], link.keyframe
        if i < self.n:
            widen(self.arm, self.request.T_base_tool[i], ladder, place)
        starts = before.q[np.isfinite(ladder.travel(place - 1))]
        if place > 1:  # prefer states to which a free move is known
            ends = {along[-1].tobytes() for along in self.links[place - 2].free_moves.values()}
            known = np.array([q.tobytes() in ends for q in starts], dtype=bool)
            starts = starts[known] if known.any() else starts
        goals = np.array([q for q in layer.q[np.isfinite(layer.cost)] if self.is_free(place, q)])
        found = self._detour_between_any(i, starts, goals) if len(starts) and len(goals) else None
        if found is None:
            ladder.keep_only(place, before.q[0], layer.q[0], np.inf)
            return
        if not (layer.q == found[-1]).all(axis=1).any():
            ladder.add(place, found[-1:], configuration_cost(self.arm, found[-1:]))
        link.free_moves[ends_key(found[0], found[-1])] = found[1:]
        ladder.keep_only(place, found[0], found[-1], joint_travel(found, self.arm.travel_scale))

    def _detour_between_any(self, i: int, starts: Array, goals: Array) -> Array | None:
        """Return joints (m, k) of a detour to keyframe i, from any of the starts (s, k) to any of the goals (g, k)."""
        for settings in FROM_ANY_TO_ANY:
            ends = goals if i == self.n else turn_variants(self.arm, goals, starts, settings.variants)
            if (found := self._find_detour(i, starts, ends, settings)) is not None:
                return found
        return None

    def _find_detour(self, i: int, starts: Array, goals: Array, settings: DetourSearch) -> Array | None:
        from pbd.arm.detour import find_detour  # OMPL loads slowly

        assert self.scene is not None
        move, affordable = self.moves[i], settings._replace(most_checks=min(settings.most_checks, self.checks_left))
        found, checks = find_detour(self.scene, self.grasps[i], starts, goals, affordable)
        move.detour_checks, self.checks_left = move.detour_checks + checks, self.checks_left - checks
        return found

    def _detour_between(self, i: int, q_before: Array, q: Array) -> Array | None:
        """Return joints (m, k) of a detour to keyframe i: a known detour bent to these ends, else a new one."""
        from pbd.arm.detour import bend_detour

        assert self.scene is not None
        known = self.detours.setdefault(self.grasps[i], [])
        found = bend_detour(self.scene, self.grasps[i], q_before, q, known)
        if found is None:
            found = self._find_detour(i, q_before[None], q[None], BETWEEN_TWO)
            if found is not None and len(found) > 2:
                known.append(found)
        return None if found is None else found[1:]

    def _free_move(self, place: int, q_before: Array, q: Array) -> Array | None:
        """Return the joints (m, k) along a move to a layer, without the first; None if it is not free."""
        link, move = self.at(place)
        i, scene = link.keyframe, self.scene
        if (scene is None and link.poses is None) or (i == 0 and not self.request.approach):
            return q[None]
        if scene is not None and move.detour:
            return self._detour_between(i, q_before, q)
        if link.poses is not None and (tool_hit := self.tool_hit(i, link.poses)) is not None:
            move.hits[move.kind] = tool_hit  # no configuration of the arm can help
            move.drop_path_remedies()
            self.ladder.layers[place].barred_moves = self.ladder.layers[place].mend_after
            return None
        along = np.stack((q_before, q)) if link.poses is None else follow(self.arm, link.poses, q_before, q)
        if along is None or scene is None or scene.is_free(along, self.grasps[i]):
            return None if along is None else along[1:]
        ends = (q, q_before) if i == 0 else (q_before, q)
        if i in (0, self.n) and (between := self._via_point_on_axis(self.grasps[i], *ends)) is not None:
            return np.stack((between, q))
        if move.kind not in move.hits and (hit := scene.check_path(along, self.grasps[i])):
            move.hits[move.kind] = hit
        return None

    def _via_point_on_axis(self, grasp: GraspState, q: Array, q_away: Array) -> Array | None:
        """Find a via point (k,) on the tool's approach axis, between joints q at a keyframe and q_away; None: none."""
        assert self.scene is not None
        T_base_tool, before = self.arm.forward(q), q
        for near, far in pairwise((0.0, *APPROACH_M)):
            T_near, T_far = (T_base_tool @ Pose.from_rpy((0.0, 0.0, -away), np.zeros(3)) for away in (near, far))
            for pose in line(T_near, T_far)[1:]:
                found = refine(self.arm, pose, before)
                if found is None:
                    return None
                before = found
            if self.scene.is_free(np.stack((q, before, q_away)), grasp):
                return before
        return None
