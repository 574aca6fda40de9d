"""Motion choice: which way the arm takes from keyframe to keyframe, mended where something bars it.

All keyframes lie on one ladder graph; its links are straight moves in joint space, or paths of the tool. A link that is
barred is mended on its own, and all else that is known is kept: first the hand's path is tried there (or a line, where
no hand is known), then more ways to hold the arm at both ends, then joints along the path (a link of its own for every
few poses), then any way around (detour.py). So the cost grows with the keyframes, and with the barred links.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from pbd.arm.collision.queries import CollisionQueries
from pbd.arm.collision.scene import Hit
from pbd.arm.ik.cartesian import line
from pbd.arm.ik.unreachable import out_of_reach
from pbd.arm.joint_path import (
    CONTINUOUS_RAD,
    MOST_STEPS,
    STARTS,
    Unreachable,
    add_turns,
    build_ladder,
    layers_along,
    turnable,
    widen,
)
from pbd.arm.ladder_graph import Barred, Ladder
from pbd.arm.ladder_links import (
    ANY_OTHER,
    ENOUGH_DETOURS,
    MOST_PATHS,
    Link,
    Move,
    motion_of,
    remedies_of,
    reopen_for_detours,
)
from pbd.arm.link_checks import WIDE_COST, LinkChecks
from pbd.arm.model import ArmModel
from pbd.arm.motion_request import DEMO, LINE, STRAIGHT, Motion, MotionRequest
from pbd.arm.refusal import COLLISION, UNREACHABLE, Refusal, refuse_move, refuse_pose, tell, warn_of_closeness
from pbd.arm.tool_deviation import ToolDeviation, tool_deviation
from pbd.pose import Array, Pose

MOST_STRAIGHT, MOST_STRAIGHT_WIDE = 36, 150
"""Refused straight moves between two keyframes before the link is mended: at first, and among more branches."""
COARSE = 4
"""Poses from one layer to the next where joints are sought along a path."""
LOOK_BACK = 8
"""Paths before a barred one along which joints are sought with it."""


def choose_motion(arm: ArmModel, request: MotionRequest, queries: CollisionQueries | None) -> Motion | Refusal:
    """Choose joints at the keyframes and the segments between them; without `queries` whatever is in the way.

    Warns:
        PbdWarning: the way back is left out, the arm makes a detour, or only a motion close to something is free.
    """
    poses, wide_cost = request.T_base_tool, WIDE_COST if request.kind == STRAIGHT else 0.0
    ladder = build_ladder(arm, poses, request.q_start, request.q_back, MOST_STRAIGHT, wide_cost)
    if isinstance(ladder, Unreachable):
        return Refusal(UNREACHABLE, out_of_reach(arm, ladder.keyframe, poses[ladder.keyframe], ladder.q_seed))
    search = _Search(arm, request, queries, ladder.copy())
    found = search.run()
    if queries is not None and isinstance(found, Refusal) and found.why == COLLISION:
        close = _Search(arm, request, queries.closer(), ladder)
        if isinstance(closer := close.run(), Motion):
            warn_of_closeness(found.error)
            search, found = close, closer
    if isinstance(found, Motion):
        tell(found, search.no_way_back)
    return found


class _Search:
    """The ladder with what each of its links is: link j leads to layer j + 1."""

    def __init__(self, arm: ArmModel, request: MotionRequest, queries: CollisionQueries | None, ladder: Ladder) -> None:
        self.arm, self.request, self.queries, self.ladder = arm, request, queries, ladder
        self.checks = LinkChecks(arm, request, queries)
        self.n = len(request.T_base_tool)
        self.no_way_back: Hit | None = None
        self.before_line: tuple[Ladder, list[Link], list[Move], Hit | None] | None = None
        self.unwound: set[int] = set()
        self.links = [Link(place) for place in range(len(ladder.layers) - 1)]
        may_detour = request.detour and queries is not None
        self.moves = [Move(STRAIGHT, remedies_of(request, i, may_detour=may_detour)) for i in range(len(self.links))]
        for i in range(1, self.n if request.kind != STRAIGHT else 1):
            self._follow_path(i + 1, request.kind)

    def run(self) -> Motion | Refusal:
        while True:
            path = self.ladder.search(self._stands, self._free)
            if isinstance(path, Barred):
                refusal = self._mend_all(path)
                if refusal is not None and self.before_line is None:
                    return refusal
                if refusal is not None and self.before_line is not None:
                    (self.ladder, self.links, self.moves, self.no_way_back), self.before_line = self.before_line, None
            elif not self._make_lines(path):
                return motion_of(self.arm, self.links, self.moves, self.ladder.joints(path), self.n)

    def _stands(self, place: int, q: Array) -> bool:
        return self.checks.stands(self.links[place - 1], self.moves[self.links[place - 1].keyframe], q)

    def _free(self, place: int, q_before: Array, q: Array) -> float:
        link, layer = self.links[place - 1], self.ladder.layers[place]
        move = self.moves[link.keyframe]
        cost = self.checks.cost(link, move, q_before, q, wide_known=layer.wide_cost > 0.0)
        if move.detour and cost < np.inf and len(link.found) == ENOUGH_DETOURS:
            self.ladder.doubt(place, ANY_OTHER)
        if move.tool_barred:  # it does however the arm is held
            layer.refused = layer.most_refused
            move.leave_path()
        return cost

    def _mend_all(self, barred: Barred) -> Refusal | None:
        """Mend what is barred, from the last on; where that puts in layers, the search tells anew what else is."""
        refusal, count = None, len(self.ladder.layers)
        for place, standing in reversed([*zip(barred.layers, barred.standing, strict=True)]):
            refusal = self._mend(place, standing) or refusal
            if len(self.ladder.layers) != count:
                break
        return refusal

    def _mend(self, place: int, standing: bool) -> Refusal | None:
        """Change how a layer is come to, if there is another way; else say what was tried."""
        i = self.links[place - 1].keyframe
        move = self.moves[i]
        if standing and self.links[place - 1].found and move.detour and self.ladder.layers[place].unseen < np.inf:
            self.ladder.doubt(place, np.inf)  # one of those that were found, or none
            return None
        if not standing and not move.widened and {"widen", "connect"} & {*move.remedies}:
            move.widened, move.remedies = True, [each for each in move.remedies if each != "widen"]
            widen(self.arm, self._pose(place), self.ladder, place)
            return None
        if not standing and move.pose_hit is not None and self.links[place - 1].at_keyframe:
            return refuse_pose(i, len(self.ladder.layers[place].q), move.pose_hit)
        if not (move.remedies if standing else move.last_resort()):
            if i < self.n:
                return self._refuse(i)
            self.no_way_back = move.hits[STRAIGHT]
            self.ladder.drop(place, place + 1)
            del self.links[-1]
            return None
        remedy = move.remedies.pop(0)
        if remedy == "follow":
            self._follow_path(place)
        elif remedy == "widen":
            self._widen(i)
        elif remedy == "detour":
            self._detour(i)
        elif remedy == "connect":
            self.checks.connect(self.ladder, self.links, place, move)
        elif not self._split(place):
            return None if move.last_resort() else self._refuse(i)
        return None

    def _follow_path(self, place: int, kind: str | None = None) -> None:
        """Let the tool follow a path to a layer, from end to end: by default as the hand went, where that is known."""
        link = self.links[place - 1]
        i, T_base_tool = link.keyframe, self.request.T_base_tool
        hand = self.request.hand if kind != LINE else None
        self.moves[i].kind = DEMO if hand else LINE
        link.poses = tuple(hand()[i - 1]) if hand else line(T_base_tool[i - 1], T_base_tool[i])
        self.ladder.layers[place].wide_cost = 0.0
        self.ladder.reopen(place, MOST_PATHS, costly=True)

    def _detour(self, i: int) -> None:
        """Let the arm go any way from keyframe to keyframe, whatever the tool does."""
        places = [place for place, link in enumerate(self.links, start=1) if link.keyframe == i]
        self.moves[i].detour = True
        self.ladder.drop(places[0], places[-1])
        self.links[places[0] - 1 : places[-1]] = [Link(i)]
        reopen_for_detours(self.ladder, places[0])

    def _widen(self, i: int) -> None:
        """Look for more ways to hold the arm all along a move; where it followed a path straight moves are tried."""
        places = [place for place, link in enumerate(self.links, start=1) if link.keyframe == i]
        for place in (places[0] - 1, *places):
            if place > 0 and self.links[place - 1].keyframe < self.n:
                widen(self.arm, self._pose(place), self.ladder, place)
        if len(places) == 1:
            self.links[places[0] - 1].poses, self.moves[i].kind = None, STRAIGHT
        for place in places:
            self.ladder.reopen(place, MOST_STRAIGHT_WIDE, costly=len(places) > 1)

    def _split(self, place: int) -> bool:
        """Seek joints along a path, and along the paths just before it: those decide how the arm comes to it."""
        if self.links[place - 1].poses is None:  # widening made it straight
            self._follow_path(place)
        first = place
        while first > 1 and place - first < LOOK_BACK and self._whole(first - 1):
            first -= 1
        end = place
        while first <= end:
            move = self.moves[self.links[first - 1].keyframe]
            move.remedies = [each for each in move.remedies if each != "split"]
            added = self._split_one(first)
            if added is None:
                return False
            first, end = first + added + 1, end + added
        return True

    def _whole(self, place: int) -> bool:
        """Whether a layer is come to by a path of the tool from end to end."""
        link, before = self.links[place - 1], self.links[place - 2]
        return link.poses is not None and link.at_keyframe and before.keyframe != link.keyframe

    def _split_one(self, place: int) -> int | None:
        """Put a layer at every few poses of a path; return how many, None where a pose has no solution."""
        link = self.links[place - 1]
        poses = link.poses or ()
        marks = [0, *range(COARSE, len(poses) - 1, COARSE), len(poses) - 1]
        layers = layers_along(self.arm, self.ladder, place - 1, [poses[mark] for mark in marks[1:-1]])
        if layers is None:
            return None
        last = self.ladder.layers[place]
        last.most_refused, last.most_step = MOST_STEPS, CONTINUOUS_RAD
        self.ladder.insert(place, layers)
        self.links[place - 1 : place] = [
            Link(link.keyframe, poses[a : b + 1], b == len(poses) - 1) for a, b in pairwise(marks)
        ]
        widen(self.arm, poses[-1], self.ladder, place + len(layers), STARTS)
        return len(layers)

    def _pose(self, place: int) -> Pose:
        link = self.links[place - 1]
        return self.request.T_base_tool[link.keyframe] if link.poses is None else link.poses[-1]

    def _make_lines(self, path: Sequence[int]) -> bool:
        """Let the tool follow a line where a straight move leaves it too far, or is wide; say whether any does."""
        tolerance, wide, made = self.request.tolerance_m, dict[int, ToolDeviation](), False
        q = self.ladder.joints(path)
        for place, link in enumerate(self.links, start=1):
            if self.checks.straight(link, self.moves[link.keyframe]):
                deviation = tool_deviation(self.arm, q[place - 1], q[place])
                if tolerance is not None and deviation.off_line_m > tolerance:
                    self._follow_path(place, LINE)
                    self.moves[link.keyframe].remedies = ["split", "widen"]
                    made = True
                elif deviation.wide and self.moves[link.keyframe].wide is None:
                    wide[place] = deviation
        if made:
            return True
        self.before_line = None
        for place, deviation in wide.items():
            i = self.links[place - 1].keyframe
            if not self._unwind(i, q[place - 1], q[place]):
                self.moves[i].wide = deviation
                straight = line(*self.request.T_base_tool[i - 1 : i + 1])
                barred = self.checks.tool_barred(i, straight, q[place - 1], q[place])
                if barred and self.request.hand is None:
                    continue
                self.before_line = self._copy()
                self._follow_path(place, DEMO if barred else LINE)
                self.moves[i].remedies = []
            return True
        return False

    def _unwind(self, i: int, q_before: Array, q: Array) -> bool:
        """Let a joint that turned back, or that a direct move leads over its limit, be a whole turn elsewhere."""
        joints = turnable(self.arm, self.request.T_base_tool[i], q_before, q) - self.unwound
        self.unwound |= joints
        places = [place for place, link in enumerate(self.links, start=1) if link.keyframe < self.n]
        return sum(add_turns(self.arm, self.ladder, place, joint) for joint in joints for place in places) > 0

    def _copy(self) -> tuple[Ladder, list[Link], list[Move], Hit | None]:
        links = [replace(link, found=dict(link.found)) for link in self.links]
        moves = [replace(move, remedies=list(move.remedies), hits=dict(move.hits)) for move in self.moves]
        return self.ladder.copy(), links, moves, self.no_way_back

    def _refuse(self, i: int) -> Refusal:
        move, unfollowed = self.moves[i], None
        if move.kind not in move.hits and move.kind != STRAIGHT:
            if (hit := self._alone(i)) is not None:
                move.hits[move.kind] = hit
            else:
                unfollowed = move.kind
        return refuse_move(i, move.tried, move.hits, unfollowed, move.searched)

    def _alone(self, i: int) -> Hit | None:
        """Return what the tool's path to keyframe i touches where nothing else holds the arm back."""
        if self.queries is None:
            return None
        ends, move = self.request.T_base_tool[i - 1 : i + 1], self.moves[i]
        before = next(place for place, link in enumerate(self.links) if link.keyframe == i)
        hand = self.request.hand
        q_start = self.ladder.layers[before].q[0]
        alone = MotionRequest(ends, q_start, False, None, move.kind, hand and (lambda: hand()[i - 1 : i]))
        found = choose_motion(self.arm, alone, None)
        if not isinstance(found, Motion):
            return None
        return self.queries.moving(i, np.vstack((found.q[:1], found.segments[1].q)))
