"""Collision queries as the choice of a motion asks them: leg i leads to keyframe i, leg n away from the last one.

Where the straight way from the arm's start to the first keyframe is barred, it comes to it along the tool's approach
axis, from APPROACH_M before; where the straight way back from the last is, it leaves it the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from itertools import pairwise

import numpy as np

from pbd.arm.collision.scene import CollisionScene, Hit, Leg
from pbd.arm.ik.cartesian import line, refine
from pbd.arm.ik.partial_pose import is_partial
from pbd.pose import Array, Pose

APPROACH_M = 0.08, 0.16
"""Distances before a keyframe from which the arm comes, where it can't come straight: the first that is free."""


class CollisionQueries:
    """What is free for one arm and the legs of one motion."""

    def __init__(self, scene: CollisionScene, T_base_tool: Sequence[Pose], grips: Sequence[bool | None]) -> None:
        self.arm, self.scene, self.legs = scene.arm, scene, scene.legs(T_base_tool, grips)

    def closer(self) -> CollisionQueries:
        """The same, but things that are CLOSE_M apart don't touch."""
        queries = copy(self)
        queries.scene = self.scene.closer()
        return queries

    def standing(self, i: int, q: Array) -> Hit | None:
        """Return what the arm touches at keyframe i with joints (k,), as it comes there or as it leaves."""
        legs = dict.fromkeys(self.legs[i : i + 2])  # mostly alike
        return next((hit for leg in legs if (hit := self.scene.hit(q, leg))), None)

    def moving(self, i: int, q: Array) -> Hit | None:
        """Return what it touches first on its way to keyframe i, straight from each of joints (m, k) to the next."""
        return self.scene.check_path(q, self.legs[i])

    def stands(self, i: int, q: Array) -> bool:
        """Whether the arm touches nothing at keyframe i with joints (k,), as it comes there or as it leaves."""
        return not any(self.scene.meets(q[None], leg) for leg in dict.fromkeys(self.legs[i : i + 2]))

    def passes(self, i: int, q: Array) -> bool:
        """Whether it touches nothing on its way to keyframe i, straight from each of joints (m, k) to the next."""
        return not self.scene.meets(q, self.legs[i])

    def tool_hit(self, i: int, T_base_tool: Sequence[Pose]) -> Hit | None:
        """Return a hit of what moves with the tool on its way to keyframe i, which is there however the arm is held."""
        return None if is_partial(self.arm) else self.scene.tool_hit(T_base_tool, self.legs[i])

    def by_the_axis(self, i: int, q_before: Array, q: Array) -> Array | None:
        """Return the joints (m, k) from the arm's start to keyframe 0, or back from the last (i = n); or None."""
        if self.passes(i, np.stack((q_before, q))):
            return q[None]
        between = self._before(self.legs[i], *((q, q_before) if i == 0 else (q_before, q)))
        return None if between is None else np.stack((between, q))

    def _before(self, leg: Leg, q: Array, q_away: Array) -> Array | None:
        """Find joints from which the tool goes straight along its axis to joints q at an end of the motion."""
        T_base_tool, before = self.arm.forward(q), q
        for near, far in pairwise((0.0, *APPROACH_M)):
            T_near, T_far = (T_base_tool @ Pose.from_rpy((0.0, 0.0, -away), np.zeros(3)) for away in (near, far))
            for pose in line(T_near, T_far)[1:]:
                found = refine(self.arm, pose, before)
                if found is None:
                    return None
                before = found
            if not self.scene.meets(np.stack((q, before, q_away)), leg):
                return before
        return None
