"""Whether anything touches on a path, for searches that check many paths: not which two bodies do first.

A path is halved: two bodies that are d and e apart at its ends can't touch on it unless they move by d + e. The middle,
where most moves are barred, is measured first; and before it the pairs that touched lately.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from pbd.arm.collision.clearance import MARGIN_M, NOWHERE, Clearance, JointPath, Pairs, Rests, Walk
from pbd.arm.collision.geometry import Body, moves_with_tool
from pbd.arm.gripper import tool_on_joint
from pbd.arm.model import ArmModel, to_se3
from pbd.pose import Array, Pose

RECENT, REMEMBERED = 4, 2000
"""Pairs that touched lately and are measured first; coordinates whose distances are cached."""

LIKELY = 0.5, 0.25, 0.75
"""Where a straight move is measured first, as shares of it."""


class QuickClearance(Clearance):
    """Distances between pairs of bodies, cached, and the pairs that touched lately."""

    def __init__(
        self, arm: ArmModel, bodies: Sequence[Body], pairs: Pairs, margin_m: float = MARGIN_M, rests: Rests = NOWHERE
    ) -> None:
        super().__init__(arm, bodies, pairs, margin_m, rests)
        of_pairs = ((self.bodies[a], self.bodies[b]) for a, b in self.pairs)
        self._of_tool = np.array([moves_with_tool(arm, *pair) for pair in of_pairs], dtype=bool)
        self._even = arm.full.nq == arm.full.nv  # no endless joint: pinocchio's configurations lie on a straight line
        self._lately: list[int] = []  # pairs that touched, the last one first: the likeliest to touch next
        self._known: dict[bytes, Array] = {}

    def touches(self, x: Array) -> bool:
        """Whether any pair touches but may not at coordinates (k + 1,)."""
        if x.tobytes() not in self._known:
            self._place(self.arm.configurations(x))
            if self._touch_again(x):
                return True
        for pair in np.flatnonzero(~(self._remembered(x) >= self.margin_m)).tolist():
            if not self.may_touch(pair, x):
                return self._touched(pair)
        return False

    def meets(self, x: Array) -> bool:
        """Whether any pair touches on a straight move from coordinates to others, x (2, k + 1), but not at these."""
        step, q = x[1] - x[0], self.arm.configurations(x)
        way = q[1] - q[0]

        def place(t: float) -> None:
            self._place(q[0] + t * way if self._even else self.arm.configurations(x[0] + t * step))

        for t in LIKELY:
            place(t)
            if self._touch_again(x[0] + t * step):
                return True
        at_start, at_end, speed = self._remembered(x[0]), self._remembered(x[1]), self.rates @ np.abs(step)
        for pair in self._in_reach(at_start, at_end, speed):
            v = float(speed[pair])
            gaps = [(max(self.margin_m, at_start[pair]) / v, 1.0 - max(self.margin_m, at_end[pair]) / v)]
            for since, until in gaps:
                if since > until:
                    continue
                t = 0.5 * (since + until)
                place(t)
                distance = self._distance(pair)
                if not distance >= self.margin_m:
                    if not self.may_touch(pair, x[0] + t * step):
                        return self._touched(pair)
                    distance = self.margin_m
                gaps += ((since, t - distance / v), (t + distance / v, until))
        return False

    def meets_along(self, path: JointPath) -> bool:
        """Whether any pair touches on a path, but not at its ends."""
        walk, at_start, at_end = self._walk(path), self._remembered(path.x[0]), self._remembered(path.x[-1])
        near = self._in_reach(at_start, at_end, self.rates @ walk.moved[:, -1])
        return any(self._halve(walk, pair, at_start[pair], at_end[pair]) and self._touched(pair) for pair in near)

    def tool_contact(self, T_base_tool: Iterable[Pose], opening: float) -> tuple[int, float, Array] | None:
        """Return what moves with the tool and touches what stands still, with the tool at some poses.

        Returns:
            The first pair that was found, its distance in m, and where (3,) m in base.
        """
        joint, T_joint_tool = tool_on_joint(self.arm)
        self._place(self.arm.configurations(np.append(self.arm.robot.home, opening)))
        T_joint_base, pairs = self._data.oMi[joint].inverse(), np.flatnonzero(self._of_tool).tolist()
        carried = {int(i) for i in self.pairs[pairs].ravel() if self.bodies[i].joint > 0}
        T_joint_body = {i: T_joint_base * self._placed.oMg[i] for i in carried}
        T_tool_joint = to_se3(T_joint_tool.inverse())
        for pose in T_base_tool:
            T_base_joint = to_se3(pose) * T_tool_joint
            for i, T in T_joint_body.items():
                self._placed.oMg[i] = T_base_joint * T
            for pair in pairs:
                distance = self._distance(pair)
                if not distance >= self.margin_m and not (pair in self.rests and self.rests[pair](pose)):
                    return pair, distance, self._witness(pair)
        return None

    def _in_reach(self, at_start: Array, at_end: Array, travel: Array) -> list[int]:
        """Return the pairs that may touch on a path, those that touched lately first; from distances at its ends."""
        open_ = ~(at_start + at_end > travel) & (travel > 0.0)
        near = np.flatnonzero(open_).tolist()
        near.sort(key=lambda pair: self._lately.index(pair) if pair in self._lately else RECENT)
        return near

    def _halve(self, walk: Walk, pair: int, at_start: float, at_end: float) -> bool:
        """Whether a pair touches inside a path; given their distances at its ends, where they may."""
        travel = self.rates[pair] @ walk.moved
        parts = [(0, max(self.margin_m, at_start), len(travel) - 1, max(self.margin_m, at_end))]
        for first, before, last, after in parts:
            if last - first < 2 or before + after > travel[last] - travel[first]:
                continue
            # The middle of the part that the two distances don't cover.
            middle = 0.5 * (travel[first] + before + travel[last] - after)
            node = min(max(int(travel.searchsorted(middle)), first + 1), last - 1)
            self._place(walk.q[node])
            distance = self._distance(pair)
            if not distance >= self.margin_m:
                if not self.may_touch(pair, walk.path.x[node]):
                    return True
                distance = self.margin_m
            parts += ((first, before, node, distance), (node, distance, last, after))
        return False

    def _remembered(self, x: Array) -> Array:
        """Measure all distances, cached: the same joints are the ends of many moves."""
        key = x.tobytes()
        if key not in self._known:
            if len(self._known) == REMEMBERED:
                self._known.clear()
            self._known[key] = self.distances(x)
        return self._known[key]

    def _touch_again(self, x: Array) -> bool:
        """Whether any of the pairs that touched lately touches, with all placed at coordinates (k + 1,)."""
        near = (pair for pair in self._lately if not self._distance(pair) >= self.margin_m)
        return any(not self.may_touch(pair, x) for pair in near)

    def _touched(self, pair: int) -> bool:
        """Remember a pair that touched."""
        self._lately = [pair, *(each for each in self._lately if each != pair)][:RECENT]
        return True
