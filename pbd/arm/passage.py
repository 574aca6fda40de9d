"""Where the arm may pass: a collision scene as the choice of ways asks it, and what is told where it may not.

Where the straight way from the arm's start to the first keyframe is barred, it comes to it along the tool's approach
axis, from APPROACH_M before; where the straight way back from the last is, it leaves it the same way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NoReturn

import numpy as np

from pbd.arm.collision import describe
from pbd.arm.follow import line, settle
from pbd.arm.model import ArmModel
from pbd.arm.scene import TABLE, CollisionScene, Hit
from pbd.errors import PlanError
from pbd.pose import Array, Pose

APPROACH_M = 0.08, 0.16
"""How far before a keyframe the arm comes from, where it can't come straight: the first that is free."""

_WAYS = {
    "straight": "Straight in joint space",
    "line": "Straight line of the tool",
    "demo": "Demonstrated path",
}


class Passage:
    """What is free for one arm, one motion: leg i leads to keyframe i, leg n away from the last."""

    def __init__(
        self, arm: ArmModel, scene: CollisionScene, T_base_tool: Sequence[Pose], grips: Sequence[bool | None]
    ) -> None:
        self.arm, self.scene, self.T_base_tool = arm, scene, T_base_tool
        self.legs = scene.legs(T_base_tool, grips)
        self._round: dict[tuple[int, bytes], Array | None] = {}

    def allowed(self, i: int, q: Array) -> bool:
        """Whether the arm may stand at keyframe i with joints (k,): as it comes there, and as it leaves."""
        return self.standing(i, q) is None

    def passable(self, i: int, q: Array) -> bool:
        """Whether the arm may pass through joints (k,) on its way to keyframe i: as it comes there alone."""
        return self.scene.hit(q, self.legs[i]) is None

    def clear(self, i: int, q_before: Array, q: Array) -> bool:
        """Whether the arm may move to keyframe i from joints (k,) to others: straight, at the ends by the approach."""
        if self.scene.check_move(q_before, q, self.legs[i]) is None:
            return True
        if i == 0:
            return self._by_approach(0, q, q_before) is not None
        return i == len(self.T_base_tool) and self._by_approach(i, q_before, q) is not None

    def approach(self, q_start: Array, q: Array) -> Array:
        """Return the joints (m, k) by which the arm comes to keyframe 0, with joints (k,)."""
        if self.scene.check_move(q_start, q, self.legs[0]) is None:
            return q[None]
        before = self._by_approach(0, q, q_start)
        return q[None] if before is None else np.stack((before, q))

    def back(self, q: Array, q_back: Array) -> Array:
        """Return the joints (m, k) by which the arm goes back from the last keyframe."""
        last = len(self.T_base_tool)
        if self.scene.check_move(q, q_back, self.legs[last]) is None:
            return q_back[None]
        before = self._by_approach(last, q, q_back)
        return q_back[None] if before is None else np.stack((before, q_back))

    def standing(self, i: int, q: Array) -> Hit | None:
        """Return what the arm touches at keyframe i with joints (k,)."""
        legs = dict.fromkeys(self.legs[i : i + 2])  # mostly alike
        return next((hit for leg in legs if (hit := self.scene.hit(q, leg))), None)

    def moving(self, i: int, q_before: Array, q: Array) -> Hit | None:
        """Return what it touches on its straight way to keyframe i."""
        return self.scene.check_move(q_before, q, self.legs[i])

    def hit_along(self, i: int, q: Array) -> Hit | None:
        """Return the deepest of what a path (m, k) to keyframe i touches."""
        hits = [hit for a, b in pairwise(q) if (hit := self.scene.check_move(a, b, self.legs[i]))]
        return min(hits, key=lambda hit: hit.distance, default=None)

    def first_bar(
        self, paths: Sequence[Array], q_start: Array | None, q_back: Array | None
    ) -> tuple[int, bool, Hit] | None:
        """Find what bars a motion: keyframe, whether the arm can stand there so that it is the way to it, and the hit.

        Args:
            paths: joints (m, k) from each keyframe to the next, both included; of the first, those at keyframe 0.
            q_start: where the arm comes from, or None.
            q_back: where it goes after the last, or None: asked last of all.
        """
        for i, path in enumerate(paths):
            if hit := self.standing(i, path[-1]):
                return i, False, hit
            if i == 0 and q_start is not None and not self.clear(0, q_start, path[-1]):
                hit = self.moving(0, q_start, path[-1])
            elif i > 0:
                hit = self.hit_along(i, path)
            if hit:
                return i, True, hit
        n, q_last = len(paths), paths[-1][-1]
        if q_back is not None and not self.clear(n, q_last, q_back) and (hit := self.moving(n, q_last, q_back)):
            return n, True, hit
        return None

    def refuse(self, i: int, stands: bool, hits: Mapping[str, Hit]) -> NoReturn:
        """Tell what bars every way to keyframe i, by the kind of way.

        Raises:
            PlanError: its fields are keyframe, bodies, value (m, how deep) and p_base (m) of what came closest, and
                closest (the kind of way).
        """
        kind = max(hits, key=lambda kind: hits[kind].distance)
        hit, n = hits[kind], len(self.T_base_tool)
        where = f"from keyframe {i - 1} to keyframe {i}"
        if i == 0:
            where = "to keyframe 0"
        elif i == n:
            where = f"back from keyframe {n - 1}"
        tried = ". ".join(
            f"{_WAYS[each]}{' (closest)' if len(hits) > 1 and each == kind else ''}: {describe(hits[each])}"
            for each in hits
        )
        what = f"motion {where}. {tried}" if stands else f"arm pose at keyframe {i}: {describe(hit)}"
        advice = "raise the keyframe or the dock" if hit.second == TABLE else "move the dock or the obstacle"
        raise PlanError(
            f"no collision-free {what}; {advice}",
            keyframe=i,
            bodies=(hit.first, hit.second),
            value=hit.depth,
            p_base=hit.p_base,
            closest=kind,
        )

    def _by_approach(self, i: int, q: Array, q_away: Array) -> Array | None:
        """Find joints from which the tool goes straight along its axis to joints q at an end of the motion."""
        key = (i, q.tobytes())
        if key not in self._round:
            self._round[key] = self._sought(i, q, q_away)
        return self._round[key]

    def _sought(self, i: int, q: Array, q_away: Array) -> Array | None:
        leg, T_base_tool = self.legs[i], self.arm.forward(q)
        for distance in APPROACH_M:
            T_before = T_base_tool @ Pose(np.array([0.0, 0.0, -distance]), np.array([1.0, 0.0, 0.0, 0.0]))
            before: Array | None = q
            for pose in line(T_base_tool, T_before)[1:]:
                before = None if before is None else settle(self.arm, pose, before)
            if before is None:
                continue
            if all(self.scene.check_move(before, end, leg) is None for end in (q, q_away)):
                return before
        return None
