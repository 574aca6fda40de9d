"""Which way the arm takes from keyframe to keyframe: straight in joint space, along a line, or as the hand went.

Where a straight move would touch something, other ways to hold the arm are tried at all keyframes (sequence.py), then
the hand's own path for that move; only then is it refused. A line or the hand's path must lead on continuously: where
it doesn't from the joints that suit the keyframes best, joints are sought for all of it at once.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NoReturn

import numpy as np

from pbd.arm.collision import describe
from pbd.arm.follow import follow, line, off_line
from pbd.arm.model import ArmModel
from pbd.arm.passage import Passage
from pbd.arm.scene import Hit
from pbd.arm.sequence import BarredError, solve_sequence
from pbd.arm.wish import DEMO, LINE, STRAIGHT, Way, Ways, Wish
from pbd.errors import PbdWarning, PlanError
from pbd.pose import Array, Pose

COARSE = 4
"""Where a path is sought as a whole, every so many of its poses are looked at."""
CONTINUOUS_RAD = 0.5
"""Between two of these a joint moves by less."""

_LOOKS = 33


def choose_ways(arm: ArmModel, wish: Wish, passage: Passage | None) -> Ways:
    """Choose joints at the keyframes and the ways between them.

    Args:
        arm: the arm.
        wish: what the motion is to be.
        passage: says what is free; None: nothing is looked at.

    Raises:
        PlanError: a keyframe is out of reach; or nothing that leads to one is free, its fields are those of
            `Passage.refuse`; or the tool can't follow its path, its fields are keyframe and way (LINE or DEMO).

    Warns:
        PbdWarning: the way back is left out.
    """
    choice = _Choice(arm, wish, passage)
    made = choice.made()
    if choice.no_way_back is not None:  # of what was not made in the end nothing is told
        warnings.warn(
            "no collision-free way back from the last keyframe was found "
            f"({describe(choice.no_way_back)}): the motion ends there",
            PbdWarning,
            stacklevel=2,
        )
    return made


class _NoWayBackError(Exception):
    """The way back was left out: what was found so far was for a motion with one."""


@dataclass
class _Choice:
    """What has been found out so far: the kind of each move, and what stands in the way of some.

    `avoided`: what a straight move would touch; `touched`: what a path would, followed from the joints that suit the
    keyframes best; `no_way_back`: what bars the way back, where that was left out.
    """

    arm: ArmModel
    wish: Wish
    passage: Passage | None
    kinds: list[str] = field(init=False)
    no_way_back: Hit | None = None
    avoided: dict[int, Hit] = field(default_factory=dict)
    touched: dict[int, Hit] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.n = len(self.wish.T_base_tool)
        self.kinds = [STRAIGHT, *(self.n - 1) * [self.wish.kind]]

    def made(self) -> Ways:
        try:
            return self._made()
        except _NoWayBackError:
            self.touched.clear()  # from joints that led back
            return self._made()

    def _made(self) -> Ways:
        while True:
            try:
                q = self._joints({})
                break
            except BarredError as barred:
                self._go_round(barred)
        self._keep_to_lines(q)
        ways = {}
        for i in range(1, self.n):
            if self.kinds[i] != STRAIGHT and (followed := self._follow(i, q)) is not None:
                ways[i] = followed
        if any(kind != STRAIGHT and i not in ways for i, kind in enumerate(self.kinds)):
            q, known = self._sought_whole()
            for i in known:
                ways[i] = self._follow_known(i, known[i])
        return Ways(q, tuple(self._way(i, q, ways) for i in range(self.n)), self._back(q))

    def _joints(self, between: Mapping[int, Sequence[Pose]]) -> Array:
        """Solve for all keyframes, and for poses between them: those on the way to keyframe i."""
        wish, passage = self.wish, self.passage
        poses, owners, stops = [], [], []
        for i, pose in enumerate(wish.T_base_tool):
            inner = between.get(i, ())
            poses += [*inner, pose]
            owners += [i] * (len(inner) + 1)
            stops += [False] * len(inner) + [True]
        owners.append(self.n)

        def allowed(place: int, q: Array) -> bool:
            if passage is None:
                return True
            return (passage.allowed if stops[place] else passage.passable)(owners[place], q)

        def clear(place: int, q_before: Array, q: Array) -> bool:
            i = owners[place]
            if i in between and i > 0:
                continuous = np.abs(q - q_before).max() < CONTINUOUS_RAD
                return bool(continuous) and (passage is None or passage.clear(i, q_before, q))
            if passage is None or (i == 0 and not wish.approach) or (0 < i < self.n and self.kinds[i] != STRAIGHT):
                return True
            return passage.clear(i, q_before, q)

        return solve_sequence(self.arm, poses, wish.q_start, q_end=wish.q_back, allowed=allowed, clear=clear)

    def _go_round(self, barred: BarredError) -> None:
        """Take the hand's path, or a line, where no straight move is free."""
        i, passage = barred.keyframe, self.passage
        q = barred.path[i] if i < self.n else self.wish.q_back
        if passage is None or q is None:
            raise barred
        hit = passage.standing(i, q) if i < self.n else None
        stands = hit is None
        if hit is None:
            hit = passage.moving(i, barred.path[i - 1] if i > 0 else self.wish.q_start, q)
        if hit is None:
            raise barred
        if i == self.n:
            self._end_there(hit)
            return
        if not stands or i == 0 or self.kinds[i] != STRAIGHT:
            passage.refuse(i, stands, {STRAIGHT: hit})
        self.kinds[i] = DEMO if self.wish.hand else LINE
        self.avoided[i] = hit

    def _end_there(self, hit: Hit) -> None:
        """Leave out the way back."""
        self.wish, self.no_way_back = replace(self.wish, q_back=None), hit

    def _keep_to_lines(self, q: Array) -> None:
        tolerance = self.wish.tolerance_m
        for i in range(1, self.n):
            if tolerance is not None and self.kinds[i] == STRAIGHT and self._off_line(q[i - 1], q[i]) > tolerance:
                self.kinds[i] = LINE

    def _off_line(self, q_before: Array, q: Array) -> float:
        return off_line(self.arm, q_before + np.linspace(0.0, 1.0, _LOOKS)[:, None] * (q - q_before))

    def _poses(self, i: int) -> Sequence[Pose]:
        if self.kinds[i] == DEMO and self.wish.hand:
            return self.wish.hand()[i - 1]
        return line(self.wish.T_base_tool[i - 1], self.wish.T_base_tool[i])

    def _follow(self, i: int, q: Array) -> Array | None:
        """Follow a path between two keyframes; None where that isn't free, or joints can't lead on to the other."""
        poses = self._poses(i)
        followed = follow(self.arm, poses, {0: q[i - 1], len(poses) - 1: q[i]})
        if followed is not None and self.passage and (hit := self.passage.hit_along(i, followed)):
            self.touched[i] = hit
            return None
        return followed

    def _sought_whole(self) -> tuple[Array, dict[int, Mapping[int, Array]]]:
        """Seek joints along all paths at once; return those at the keyframes, and those on the way to each."""
        paths = {i: self._poses(i) for i in range(1, self.n) if self.kinds[i] != STRAIGHT}
        inner = {i: range(COARSE, len(poses) - 1, COARSE) for i, poses in paths.items()}
        try:
            found = self._joints({i: [poses[j] for j in inner[i]] for i, poses in paths.items()})
        except PlanError as error:
            self._refuse(error, inner)
        at, q, known = 0, list[Array](), dict[int, Mapping[int, Array]]()
        for i in range(self.n):
            places = inner.get(i, range(0))
            on_the_way = {j: found[at + step] for step, j in enumerate(places)}
            at += len(places)
            if i in paths:
                known[i] = {0: q[-1], **on_the_way, len(paths[i]) - 1: found[at]}
            q.append(found[at])
            at += 1
        return np.array(q), known

    def _follow_known(self, i: int, known: Mapping[int, Array]) -> Array:
        followed = follow(self.arm, self._poses(i), known)
        if followed is None:
            self._tell_what_bars()
            raise self._broken(i)
        if self.passage and (hit := self.passage.hit_along(i, followed)):
            self._refuse_hit(i, self.touched.get(i, hit))
        return followed

    def _refuse(self, error: PlanError, inner: Mapping[int, range]) -> NoReturn:
        """Tell why paths can't be followed, however the arm is held; the error counts all poses on them."""
        for i, hit in self.touched.items():
            self._refuse_hit(i, hit)
        self._tell_what_bars()
        ends = np.cumsum([len(inner.get(i, ())) + 1 for i in range(self.n)])
        place = error.fields.get("keyframe")
        reached = int(np.searchsorted(ends, place, side="right")) if isinstance(place, int) else self.n
        raise self._broken(max((i for i in inner if i <= reached), default=min(inner))) from None

    def _tell_what_bars(self) -> None:
        """Tell what is in the way, where the paths could be followed if nothing were.

        Raises:
            PlanError: that, see `Passage.refuse`; or the arm can't follow, whatever is in the way.
            _NoWayBackError: it is the way back alone, which is left out from now on.
        """
        passage, wish = self.passage, self.wish
        if passage is None:
            return
        unwatched = _Choice(self.arm, wish, None)
        unwatched.kinds = self.kinds
        made = unwatched.made()
        paths = [np.vstack((made.q[max(0, i - 1)], way.q)) for i, way in enumerate(made.ways)]
        found = passage.first_bar(paths, wish.q_start if wish.approach else None, wish.q_back)
        if found is None:
            return
        i, stands, hit = found
        if i == self.n:
            self._end_there(hit)
            raise _NoWayBackError
        if stands and i > 0:
            self._refuse_hit(i, hit)
        passage.refuse(i, stands, {STRAIGHT: hit})

    def _broken(self, i: int) -> PlanError:
        what = "the demonstrated path" if self.kinds[i] == DEMO else "the straight line"
        return PlanError(
            f"the arm can't follow {what} from keyframe {i - 1} to keyframe {i}: it would have to flip its elbow or "
            "wrist on the way, or exceed its joint limits or reach; move the dock",
            keyframe=i,
            way=self.kinds[i],
        )

    def _refuse_hit(self, i: int, hit: Hit) -> None:
        if self.passage:
            hits = {STRAIGHT: self.avoided[i]} if i in self.avoided else {}
            self.passage.refuse(i, True, {**hits, self.kinds[i]: hit})

    def _way(self, i: int, q: Array, ways: Mapping[int, Array]) -> Way:
        if i in ways:
            return Way(self.kinds[i], ways[i][1:], avoided=self.avoided.get(i))
        if i > 0:
            return Way(STRAIGHT, q[i][None], self._off_line(q[i - 1], q[i]))
        if self.passage and self.wish.approach:
            return Way(STRAIGHT, self.passage.approach(self.wish.q_start, q[0]))
        return Way(STRAIGHT, q[0][None])

    def _back(self, q: Array) -> Array | None:
        if self.wish.q_back is None:
            return None
        return self.passage.back(q[-1], self.wish.q_back) if self.passage else self.wish.q_back[None]
