"""What the audit checks: its own list of pairs, made from the URDF, the SRDF and samples of its own."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pinocchio as pin

from pbd.audit.arm import AuditArm, se3
from pbd.audit.contact import Pair, Placed
from pbd.audit.grasp import THE_TOOL, follow_object, gripper_joints, may_rest, object_solid, tool_rod
from pbd.audit.solids import Solid, clearance, floor, hull_distance, link_solids, one_in_the_other, simple_solid
from pbd.data import Calibration, GraspedObject, JointTrajectory
from pbd.data.world import Stay
from pbd.io.urdf import read_urdf_xml
from pbd.io.xml import read_xml

TABLE = "the table"

TRUSTED = ("Adjacent", "Never")
"""The SRDF's reasons that are believed."""

SAMPLES = 200
"""Random configurations by which it is decided what always touches."""

NEARLY_ALWAYS = 0.95
"""Solids that touch in this share of the samples, or more, are built so: they are left out."""


class AuditScene:
    """An arm and what stands around it.

    Attributes:
        left_out: pairs of links (or a link and the table) that aren't checked, and why.
    """

    def __init__(self, arm: AuditArm, calibration: Calibration, grasped: GraspedObject | None) -> None:
        self.arm, self._grasped, self._table = arm, grasped, calibration.table_height
        self.links = link_solids(arm)
        rod = tool_rod(arm, self.links)
        self.links += [rod] if rod else []
        self._gripper = gripper_joints(arm)
        self.left_out: dict[tuple[str, str], str] = {}
        self._around = [
            simple_solid(each.name, 0, arm.T_universe_base * se3(each.T_base_obstacle), each.shape, each.size)
            for each in calibration.obstacles
        ]
        always = self._without_what_always_touches(self._own(), "touch in nearly every configuration")
        always += self._against(self.links, self._around)
        if self._table is not None:
            T_base_table = pin.SE3(np.eye(3), np.array([0.0, 0.0, self._table]))
            table = floor(TABLE, arm.T_universe_base * T_base_table)
            on_table = self._against([table], self.links)
            always += self._without_what_always_touches(on_table, "on it in nearly every configuration")
            self._around.append(table)
        self._always = always

    def pairs(self, trajectory: JointTrajectory) -> list[Pair]:
        """All that must not touch during a motion."""
        pairs = list(self._always)
        if self._grasped is not None:
            for stay in follow_object(self.arm, trajectory, self._grasped, self._table):
                pairs += self._with_object(stay, self._grasped)
        return pairs

    def _own(self) -> list[Pair]:
        """The arm against itself, but for what is left out by its names."""
        trusted, next_to = self._trusted(), self._next_links()
        pairs = []
        for first, second in combinations(self.links, 2):
            names = frozenset((first.name, second.name))
            if not self._move(first, second):
                continue
            if first.joint in self._gripper and second.joint in self._gripper:
                self.left_out[first.name, second.name] = "both belong to the gripper"
            elif names in next_to:
                self.left_out[first.name, second.name] = "next to each other"
            elif names in trusted:
                self.left_out[first.name, second.name] = trusted[names]
            else:
                pairs.append(Pair(first, second))
        return pairs

    def _move(self, first: Solid, second: Solid) -> bool:
        """Whether a joint that moves is between two solids."""
        return self.arm.driven(first.joint) != self.arm.driven(second.joint)

    def _against(self, ones: Sequence[Solid], others: Sequence[Solid]) -> list[Pair]:
        return [Pair(one, other) for one in ones for other in others if self._move(one, other)]

    def _with_object(self, stay: Stay, grasped: GraspedObject) -> list[Pair]:
        """The object against the links but the gripper's, and while it is held against what stands around."""
        thing = object_solid(self.arm, stay, grasped)
        links = [link for link in self.links if link.joint not in self._gripper and self._move(link, thing)]
        pairs = [Pair(link, thing, stay.start, stay.end) for link in links]
        around = self._around if stay.held else []
        rests = [(other, may_rest(self.arm, stay, thing, other)) for other in around]
        return pairs + [Pair(other, thing, stay.start, stay.end, allowed) for other, allowed in rests]

    def _next_links(self) -> set[frozenset[str]]:
        """Links next to each other, or with nothing solid between; the rod and the link that carries the gripper."""
        joints = read_urdf_xml(self.arm.robot.urdf).iterfind("joint")
        before = {j.find("child").get("link"): j.find("parent").get("link") for j in joints}  # type: ignore[union-attr]
        solid = {link.name for link in self.links}
        firm = {link.name for link in self.links if link.joint not in self._gripper}
        found = set()
        for link in solid:
            other = before.get(self.arm.robot.body if link == THE_TOOL else link)
            while other is not None and other not in (firm if link == THE_TOOL else solid):
                other = before.get(other)
            found |= {frozenset((link, other))} if other is not None else set()
        return found

    def _trusted(self) -> dict[frozenset[str], str]:
        """Links that the robot's TOML lets touch, or the SRDF says never do, each with its reason."""
        robot, trusted = self.arm.robot, dict[frozenset[str], str]()
        for entry in [] if robot.srdf is None else read_xml(robot.srdf).iterfind("disable_collisions"):
            if (reason := entry.get("reason")) in TRUSTED:
                trusted[frozenset((entry.get("link1", ""), entry.get("link2", "")))] = f"SRDF: {reason}"
        return trusted | {frozenset(pair): "may_touch in the robot's TOML" for pair in robot.may_touch}

    def _without_what_always_touches(self, pairs: list[Pair], why: str) -> list[Pair]:
        limits = self.arm.robot.limits
        lower, upper = np.maximum(limits.lower, -2.0 * np.pi), np.minimum(limits.upper, 2.0 * np.pi)
        x = np.random.default_rng(13).uniform(np.append(lower, 0.0), np.append(upper, 1.0), (SAMPLES, len(lower) + 1))
        always = pairs
        for separate in (_hulls_separate, _separate):  # most pairs need no mesh
            apart = dict.fromkeys(always, 0)
            for each in x:
                placed = Placed(self.arm.place(each))
                for pair in apart:
                    apart[pair] += separate(*pair.at(placed))
                apart = {pair: count for pair, count in apart.items() if count <= (1.0 - NEARLY_ALWAYS) * SAMPLES}
            always = list(apart)
        self.left_out |= {(pair.first.name, pair.second.name): why for pair in always}
        return [pair for pair in pairs if pair not in always]


def _hulls_separate(*placed: Any) -> bool:
    return hull_distance(*placed) > 0.0


def _separate(*placed: Any) -> bool:
    """Whether two solids don't touch, nor is one inside the other."""
    return clearance(*placed) > 0.0 and not one_in_the_other(*placed)
