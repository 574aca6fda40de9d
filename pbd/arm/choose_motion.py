"""Choose the arm's motion from keyframe to keyframe, and mend it where a collision or the kinematics bar it.

All keyframes lie on one ladder graph. Its links are straight moves in joint space, or paths of the tool. Each barred
link is mended on its own, and the results for all other links are kept. The remedies, in this order: the hand's path
(a straight line of the tool if the hand's path is unknown), more configurations at both ends, configurations along the
path (one link for every few poses), a detour (detour.py). The run time grows linearly with the keyframes and the barred
links.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pbd.arm.collision.scene import CollisionScene, Hit
from pbd.arm.ik.cartesian import line
from pbd.arm.ladder_building import add_turns, build_ladder, joints_to_unwind, widen
from pbd.arm.ladder_checks import CAN_DETOUR, WIDE_COST
from pbd.arm.ladder_graph import Barred, Ladder
from pbd.arm.ladder_mending import Mending
from pbd.arm.ladder_state import Link, MoveState, ends_key, remedies_of
from pbd.arm.model import ArmModel
from pbd.arm.motion_request import DEMO, LINE, STRAIGHT, Motion, MotionRequest
from pbd.arm.refusal import (
    COLLISION,
    UNREACHABLE,
    Refusal,
    refuse_move,
    refuse_pose,
    warn_about_motion,
    warn_of_closeness,
)
from pbd.arm.tool_deviation import ToolDeviation, tool_deviations
from pbd.errors import PlanError
from pbd.pose import Array

MEND_AFTER_STRAIGHT, MEND_AFTER_ONLY_STRAIGHT = 12, 36
"""Number of barred straight moves after which a link is mended: the first if detours are allowed, else the second."""
WINDOW, OVERLAP = 64, 32
"""Number of layers in one search window; of these, the last OVERLAP are searched again in the next window."""


def choose_motion(arm: ArmModel, request: MotionRequest, scene: CollisionScene | None) -> Motion | Refusal:
    """Choose the joints at the keyframes and the segments between them; without a scene, collisions are ignored.

    Warns:
        PbdWarning: the retreat is left out, the arm makes a detour, or the motion only keeps the margin CLOSE_M.
    """
    wide_cost = WIDE_COST if request.kind == STRAIGHT else 0.0
    mend_after = MEND_AFTER_STRAIGHT if request.detour and CAN_DETOUR else MEND_AFTER_ONLY_STRAIGHT
    try:
        ladder = build_ladder(arm, request.T_base_tool, request.q_start, request.q_retreat, mend_after, wide_cost)
    except PlanError as error:
        return Refusal(UNREACHABLE, error)
    search = _Search(arm, request, scene, ladder.copy())
    found = search.run()
    if scene is not None and isinstance(found, Refusal) and found.why == COLLISION:
        close = _Search(arm, request, scene.closer(), ladder)
        if isinstance(closer := close.run(), Motion):
            warn_of_closeness(found.error)
        search, found = close, closer  # a refusal names what bars the motion, not what is only near
    if isinstance(found, Motion):
        warn_about_motion(found, search.retreat_hit)
    return found


class _Search(Mending):
    """The search for a motion: find the shortest path, mend the links that are barred, and repeat until it is free."""

    def __init__(self, arm: ArmModel, request: MotionRequest, scene: CollisionScene | None, ladder: Ladder) -> None:
        super().__init__(arm, request, scene, ladder)
        ladder.end = min(WINDOW, len(ladder.layers))
        self.retreat_hit: Hit | None = None
        self.before_trial: tuple[Ladder, list[Link], list[MoveState], Hit | None] | None = None
        self.most_cost = np.inf
        self.unwound: set[int] = set()
        for i in range(1, self.n if request.kind != STRAIGHT else 1):
            self._follow_path(i + 1, request.kind)

    def run(self) -> Motion | Refusal:
        while True:
            path = self.ladder.search(self.is_free, self.cost, self.wide_costs)
            if isinstance(path, Barred):
                if (refused := self._mend_all(path)) is None:
                    continue
                if self.before_trial is not None:
                    self._restore()
                elif self.ladder.first > 0:
                    self.ladder.release()
                else:
                    return refused()
            elif self._make_lines(path):
                continue
            elif self.ladder.end < len(self.ladder.layers):
                self._advance(path)
            else:
                return self._motion(self.ladder.joints(path))

    def _advance(self, path: Sequence[int]) -> None:
        """Move the window; it begins at a keyframe, so that no move is partly final and partly open to remedies."""
        before, kept = self.ladder.first, self.ladder.end - OVERLAP
        first = next((place for place in range(kept, before, -1) if self.links[place - 1].at_keyframe), before)
        self.ladder.advance(path, first, kept + WINDOW)

    def _mend_all(self, barred: Barred) -> Callable[[], Refusal] | None:
        """Mend the barred layers, from the last to the first.

        Stop once a remedy has inserted or removed layers, since the other indices are then stale. Return None, or a
        function that makes the refusal if a layer has no remedy left.
        """
        refused, count = None, len(self.ladder.layers)
        for place, has_free_state in reversed([*zip(barred.layers, barred.has_free_state, strict=True)]):
            refused = self._mend(place, has_free_state) or refused
            if len(self.ladder.layers) != count:
                break
        return refused

    def _mend(self, place: int, has_free_state: bool) -> Callable[[], Refusal] | None:
        """Apply the next remedy to the link to a layer; if none is left, return a function that makes the refusal.

        `has_free_state`: the layer has a free configuration, so the moves to it are barred.
        """
        link, move = self.at(place)
        i = link.keyframe
        if has_free_state and link.free_moves and move.detour and self.ladder.layers[place].unchecked_cost < np.inf:
            self.ladder.set_unchecked_cost(place, np.inf)  # use the known detours; search for no more
            return None
        if not has_free_state and not move.widened and {"widen", "connect"} & {*move.remedies}:
            move.widened = True
            move.drop_remedy("widen")
            widen(self.arm, self._pose(place), self.ladder, place)
            return None
        if not has_free_state and move.pose_hit is not None and link.at_keyframe:
            return partial(refuse_pose, i, len(self.ladder.layers[place].q), move.pose_hit, self.obstacles)
        if not (move.remedies if has_free_state else move.keep_detours_only()):
            if i < self.n:
                return partial(self._refuse, i)
            self.retreat_hit = move.hits[STRAIGHT]
            self.ladder.drop(place, place + 1)
            del self.links[-1]
            return None
        match move.remedies.pop(0):
            case "follow":
                self._follow_path(place)
            case "widen":
                self._widen(i)
            case "detour":
                self._detour(i)
            case "connect":
                self.connect(place)
            case "split":
                if (stuck := self._split(place)) is not None and not move.keep_detours_only():
                    return partial(self._refuse, stuck)
        return None

    def _make_lines(self, path: Sequence[int]) -> bool:
        """Replace straight moves on which the tool leaves the tolerance, or the move is wide, by lines of the tool.

        Return whether the ladder changed. A line for a wide move is a trial: if it cannot be made, `before_trial` is
        restored.
        """
        tolerance, wide, made = self.request.tolerance_m, dict[int, ToolDeviation](), False
        q, within = self.ladder.joints(path), range(self.ladder.first + 1, self.ladder.end)
        at = [place for place in within if self.is_straight(place)]
        deviations = tool_deviations(self.arm, q[[place - 1 for place in at]], q[at])
        for place, deviation in zip(at, deviations, strict=True):
            _, move = self.at(place)
            if tolerance is not None and deviation.off_line_m > tolerance:
                self._follow_path(place, LINE)
                move.remedies = ["split", "widen"]
                made = True
            elif deviation.wide and not move.tried_around:
                wide[place] = deviation
        if made:
            return True
        if self.before_trial is not None:
            if self._cost() > self.most_cost:
                self._restore()
                return True
            for move, before in zip(self.moves, self.before_trial[2], strict=True):
                move.remedies = move.remedies or [*before.remedies]  # the trial works: give its move its remedies back
            self.before_trial = None
        for place, deviation in wide.items():
            i = self.links[place - 1].keyframe
            if self._unwind(i, q[place - 1], q[place]) or self._try_other(place, self.moves[i], deviation):
                return True
        return False

    def _try_other(self, place: int, move: MoveState, deviation: ToolDeviation) -> bool:
        """Try another path instead of a wide move: a line or the hand's path, then a detour; return whether one is.

        A detour can be shorter only if something was in the way of other straight moves.
        """
        i = self.links[place - 1].keyframe
        kind, around = LINE, move.wide is not None
        if not around and self.tool_hit(i, line(*self.request.T_base_tool[i - 1 : i + 1])) is not None:
            kind, around = DEMO, self.request.hand_paths is None
        move.wide, move.tried_around = deviation, around
        if around and not (STRAIGHT in move.hits and "detour" in move.remedies):
            return False
        self.before_trial, self.most_cost = self._snapshot(), self._cost() - WIDE_COST if around else np.inf
        if around:
            self._detour(i)
        else:
            self._follow_path(place, kind)
        self.moves[i].remedies = []
        return True

    def _cost(self) -> float:
        """Return the cost of the shortest path, rad."""
        return float(self.ladder.travel(self.ladder.end - 1).min())

    def _restore(self) -> None:
        assert self.before_trial is not None
        (self.ladder, self.links, self.moves, self.retreat_hit), self.before_trial = self.before_trial, None

    def _unwind(self, i: int, q_before: Array, q: Array) -> bool:
        """Add configurations with a whole turn more or less of each joint to unwind; return whether any was added."""
        joints = joints_to_unwind(self.arm, self.request.T_base_tool[i], q_before, q) - self.unwound
        self.unwound |= joints
        places = [place for place, link in enumerate(self.links, start=1) if link.keyframe < self.n]
        return sum(add_turns(self.arm, self.ladder, place, joint) for joint in joints for place in places) > 0

    def _snapshot(self) -> tuple[Ladder, list[Link], list[MoveState], Hit | None]:
        links, moves, within = [*self.links], [*self.moves], slice(self.ladder.first, self.ladder.end)
        links[within] = [replace(link, free_moves=dict(link.free_moves)) for link in links[within]]
        for i in {link.keyframe for link in links[within]}:
            moves[i] = replace(moves[i], remedies=list(moves[i].remedies), hits=dict(moves[i].hits))
        return self.ladder.copy(), links, moves, self.retreat_hit

    def _motion(self, q: Array) -> Motion:
        """Assemble the motion from the free moves of the l links; q (l + 1, k) are the joints chosen."""
        parts: list[list[Array]] = [[] for _ in self.moves]
        ends = [q[0]] * self.n
        for place, link in enumerate(self.links, start=1):
            parts[link.keyframe].append(link.free_moves[ends_key(q[place - 1], q[place])])
            if link.keyframe < self.n:
                ends[link.keyframe] = q[place]
        segments = [move.segment(np.vstack(part)) for move, part in zip(self.moves, parts, strict=True) if part]
        for i, segment in enumerate(segments[1 : self.n], start=1):
            if segment.kind == STRAIGHT:
                (deviation,) = tool_deviations(self.arm, ends[i - 1][None], ends[i][None])
                wide = deviation if deviation.wide else None
                segments[i] = replace(segment, off_line_m=deviation.off_line_m, wide=wide)
        return Motion(np.array(ends), tuple(segments[: self.n]), segments[self.n] if len(segments) > self.n else None)

    def _refuse(self, i: int) -> Refusal:
        move, infeasible_kind = self.moves[i], None
        if move.kind not in move.hits and move.kind != STRAIGHT:
            if (hit := self._hit_on_path(i)) is not None:
                move.hits[move.kind] = hit
            else:
                infeasible_kind = move.kind
        with_ompl = remedies_of(self.request, i, may_detour=self.request.detour)
        no_ompl = "detour" in with_ompl and not CAN_DETOUR
        return refuse_move(i, move, infeasible_kind, self.obstacles, no_ompl=no_ompl)

    def _hit_on_path(self, i: int) -> Hit | None:
        """Return what the arm touches on the tool's path to keyframe i; None if it cannot follow that path at all."""
        if self.scene is None:
            return None
        ends, move = self.request.T_base_tool[i - 1 : i + 1], self.moves[i]
        hand = self.request.hand_paths
        q_start = self.ladder.layers[self.places_of(i)[0] - 1].q[0]
        alone = MotionRequest(ends, q_start, False, kind=move.kind, hand_paths=hand and (lambda: hand()[i - 1 : i]))
        found = choose_motion(self.arm, alone, None)
        if not isinstance(found, Motion):
            return None
        return self.scene.check_path(np.vstack((found.q[:1], found.segments[1].q)), self.grasps[i])
