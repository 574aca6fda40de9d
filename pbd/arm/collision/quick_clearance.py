"""Fast continuous collision checks for searches that check many paths: free or not, without the first contact.

A path is bisected: two bodies at distances d and e at its ends cannot touch between them unless they move by d + e. The
middle is measured first, since most contacts are there. Pairs that touched recently are measured before others.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from pbd.arm.collision.clearance import MARGIN_M, NONE_ALLOWED, AllowedTouches, Clearance, JointPath, Pairs
from pbd.arm.collision.geometry import Body
from pbd.arm.model import ArmModel, to_se3
from pbd.pose import Array, Pose

RECENT, CACHED = 4, 2000
"""Number of recently touching pairs that are measured first; number of coordinates whose distances are cached."""


class QuickClearance(Clearance):
    """Clearance with cached distances and a list of the pairs that touched recently."""

    def __init__(
        self,
        arm: ArmModel,
        bodies: Sequence[Body],
        pairs: Pairs,
        margin_m: float = MARGIN_M,
        allowed: AllowedTouches = NONE_ALLOWED,
    ) -> None:
        super().__init__(arm, bodies, pairs)
        self.margin_m, self.allowed = margin_m, allowed
        # Pairs of what moves with the tool and what does not move at all.
        last = arm.full.getJointId(arm.robot.joints[-1])
        with_tool = np.array([last in list(arm.full.supports[body.joint]) for body in self.bodies], dtype=bool)
        still = np.array([body.joint == 0 for body in self.bodies], dtype=bool)
        self._of_tool = (with_tool[self.pairs] & still[self.pairs[:, ::-1]]).any(axis=1)
        self._recent: list[int] = []  # pairs that touched recently, the last one first
        self._known: dict[bytes, Array] = {}

    def touches(self, x: Array) -> bool:
        """Whether any pair touches at coordinates (k + 1,) where it may not."""
        if x.tobytes() not in self._known:
            self._place(self.arm.configurations(x))
            if self._recent_pair_touches(x):
                return True
        for pair in np.flatnonzero(~(self._cached_distances(x) >= self.margin_m)).tolist():
            if not self.may_touch(pair, x):
                return self._remember_touch(pair)
        return False

    def touches_on_path(self, path: JointPath) -> bool:
        """Whether any pair touches on a path; its ends are not checked."""
        q = self.arm.configurations(path.x)
        at_start, at_end = self._cached_distances(path.x[0]), self._cached_distances(path.x[-1])
        near = self._may_touch_on_way(at_start, at_end, self.rates @ path.moved[:, -1])
        return any(
            self._pair_touches_on(path, q, pair, at_start[pair], at_end[pair]) and self._remember_touch(pair)
            for pair in near
        )

    def tool_contact(self, T_base_tool: Iterable[Pose], opening: float) -> tuple[int, float, Array] | None:
        """Check what moves with the tool against what does not move, with the tool at given poses.

        Returns:
            The first pair found that touches, its distance, m, and the point (3,) in base, m; or None.
        """
        self._place(self.arm.configurations(np.append(self.arm.robot.home, opening)))
        T_joint_base, pairs = self._data.oMi[self.arm.tool_joint].inverse(), np.flatnonzero(self._of_tool).tolist()
        carried = {int(i) for i in self.pairs[pairs].ravel() if self.bodies[i].joint > 0}
        T_joint_body = {i: T_joint_base * self._placed.oMg[i] for i in carried}
        T_tool_joint = to_se3(self.arm.T_joint_tool.inverse())
        for pose in T_base_tool:
            T_base_joint = to_se3(pose) * T_tool_joint
            for i, T in T_joint_body.items():
                self._placed.oMg[i] = T_base_joint * T
            for pair in pairs:
                distance = self._distance(pair)
                if not distance >= self.margin_m and not (pair in self.allowed and self.allowed[pair](pose)):
                    return pair, distance, self._witness(pair)
        return None

    def _may_touch_on_way(self, at_start: Array, at_end: Array, travel: Array) -> list[int]:
        """Return the pairs that may touch between the ends of a path, recent ones first.

        `at_start`, `at_end`: their distances at the ends, m; `travel`: the bound (p,) of their motion, m.
        """
        near = np.flatnonzero(~(at_start + at_end > travel) & (travel > 0.0)).tolist()
        near.sort(key=lambda pair: self._recent.index(pair) if pair in self._recent else RECENT)
        return near

    def _pair_touches_on(self, path: JointPath, q: Array, pair: int, at_start: float, at_end: float) -> bool:
        """Whether a pair touches on a path where it may not; `at_start`, `at_end`: its distances at the ends, m."""
        travel = self.rates[pair] @ path.moved
        parts = [(0, max(self.margin_m, at_start), len(travel) - 1, max(self.margin_m, at_end))]
        for first, before, last, after in parts:
            if last - first < 2 or before + after > travel[last] - travel[first]:
                continue
            # Take the middle of the part that the distances at the two ends do not cover.
            middle = 0.5 * (travel[first] + before + travel[last] - after)
            node = min(max(int(travel.searchsorted(middle)), first + 1), last - 1)
            self._place(q[node])
            distance = self._distance(pair)
            if not distance >= self.margin_m:
                if not self.may_touch(pair, path.x[node]):
                    return True
                distance = self.margin_m
            parts += ((first, before, node, distance), (node, distance, last, after))
        return False

    def _cached_distances(self, x: Array) -> Array:
        """Return all distances; cached, since the same joints are the ends of many moves."""
        key = x.tobytes()
        if key not in self._known:
            if len(self._known) == CACHED:
                self._known.clear()
            self._known[key] = self.distances(x)
        return self._known[key]

    def _recent_pair_touches(self, x: Array) -> bool:
        """Whether any pair that touched recently touches now; all bodies are placed at coordinates x (k + 1,)."""
        near = (pair for pair in self._recent if not self._distance(pair) >= self.margin_m)
        return any(not self.may_touch(pair, x) for pair in near)

    def _remember_touch(self, pair: int) -> bool:
        self._recent = [pair, *(each for each in self._recent if each != pair)][:RECENT]
        return True
