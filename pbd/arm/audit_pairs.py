"""What the audit looks at: its own list of pairs, made from the URDF, the SRDF and samples of its own."""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from pbd.arm.audit_arm import AuditArm, Frame
from pbd.arm.audit_collision import Pair, near_share
from pbd.arm.audit_grasp import THE_TOOL, Carried, follow_object, gripper_joints, may_rest, tool_rod
from pbd.arm.audit_solids import Solid, floor, link_solids, simple_solid
from pbd.cache import recall, remember
from pbd.data import Calibration, GraspedObject, JointTrajectory

TABLE = "the table"

TRUSTED = ("Adjacent", "Never")
"""The SRDF's reasons that are believed."""
SAMPLES = 200
NEARLY_ALWAYS = 0.95
"""Shapes that are within ALWAYS_M in this share of the samples, or more, are built so: they are left out."""
ALWAYS_M = 1e-3

_VERSION = 1  # part of the cache's keys


class AuditScene:
    """An arm and what stands around it.

    Attributes:
        arm: the audit's own.
        left_out: pairs of links (or a link and the table) that aren't looked at, and why.
    """

    def __init__(self, arm: AuditArm, calibration: Calibration, grasped: GraspedObject | None) -> None:
        self.arm, self._grasped, self._table = arm, grasped, calibration.table_height
        self.links = link_solids(arm)
        rod = tool_rod(arm, self.links)
        self.links += [rod] if rod else []
        self.left_out: dict[tuple[str, str], str] = {}
        obstacles = calibration.obstacles
        self._around = [simple_solid(o.name, 0, Frame.of(o.T_base_obstacle), o.shape, o.size) for o in obstacles]
        always = self._without_what_always_touches(self._own(), "touch in nearly every configuration")
        always += self._against(self.links, self._around)
        if self._table is not None:
            table = floor(TABLE, Frame(np.eye(3), np.array([0.0, 0.0, self._table])))
            on_table = self._against([table], self.links)
            always += self._without_what_always_touches(on_table, "on it in nearly every configuration")
            self._around.append(table)
        self._always = always

    def pairs(self, trajectory: JointTrajectory) -> list[Pair]:
        """All that must not touch during a motion."""
        pairs = list(self._always)
        if self._grasped is not None:
            for carried in follow_object(self.arm, trajectory, self._grasped, self._table):
                pairs += self._with_object(carried, self._grasped)
        return pairs

    def _own(self) -> list[Pair]:
        """The arm against itself, but for what is left out by its names."""
        gripper, ignored = gripper_joints(self.arm), self._ignored()
        next_to = self._next_links(gripper)
        pairs = []
        for first, second in combinations(self.links, 2):
            if not self._move(first, second):
                continue
            names = frozenset((first.name, second.name))
            if first.joint in gripper and second.joint in gripper:
                self.left_out[first.name, second.name] = "both belong to the gripper"
            elif names in next_to:
                self.left_out[first.name, second.name] = "next to each other"
            elif names in ignored:
                self.left_out[first.name, second.name] = f"SRDF: {ignored[names]}"
            else:
                pairs.append(Pair(first, second))
        return pairs

    def _move(self, first: Solid, second: Solid) -> bool:
        """Whether a joint that moves is between two shapes."""
        return self.arm.driven(first.joint) != self.arm.driven(second.joint)

    def _against(self, ones: Sequence[Solid], others: Sequence[Solid]) -> list[Pair]:
        return [Pair(one, other) for one in ones for other in others if self._move(one, other)]

    def _with_object(self, carried: Carried, grasped: GraspedObject) -> list[Pair]:
        """The object against the links but the gripper's, and while it is held against what stands around."""
        name, start, end = f"the {grasped.shape}", carried.start, carried.end
        thing = simple_solid(name, carried.joint, carried.T_joint_object, grasped.shape, grasped.size)
        gripper = gripper_joints(self.arm)
        links = [link for link in self.links if link.joint not in gripper and self._move(link, thing)]
        pairs = [Pair(link, thing, start, end) for link in links]
        if carried.joint > 0:
            rests = [(other, may_rest(self.arm, carried, thing, other)) for other in self._around]
            pairs += [Pair(other, thing, start, end, allowed) for other, allowed in rests]
        return pairs

    def _next_links(self, gripper: frozenset[int]) -> set[frozenset[str]]:
        """Links next to each other, or with nothing solid between; the rod and the link that carries the gripper."""
        before = {}
        for joint in ET.parse(self.arm.robot.urdf).getroot().iterfind("joint"):
            parent, child = joint.find("parent"), joint.find("child")
            if parent is not None and child is not None:
                before[child.get("link", "")] = parent.get("link", "")
        solid = {link.name for link in self.links}
        firm = {link.name for link in self.links if link.joint not in gripper}
        found = set()
        for link in solid:
            other = before.get(self.arm.robot.body if link == THE_TOOL else link)
            while other is not None and other not in (firm if link == THE_TOOL else solid):
                other = before.get(other)
            found |= {frozenset((link, other))} if other is not None else set()
        return found

    def _ignored(self) -> dict[frozenset[str], str]:
        """Links that the SRDF says never touch, each with its reason."""
        if self.arm.robot.srdf is None:
            return {}
        entries = ET.parse(self.arm.robot.srdf).getroot().iterfind("disable_collisions")
        reasons = {frozenset((e.get("link1", ""), e.get("link2", ""))): e.get("reason", "disabled") for e in entries}
        return {names: reason for names, reason in reasons.items() if reason in TRUSTED}

    def _without_what_always_touches(self, pairs: list[Pair], why: str) -> list[Pair]:
        key = self._key(pairs)
        kept = recall("audit", key)
        if kept is None:
            rng, limits = np.random.default_rng(13), self.arm.robot.limits
            lower, upper = np.maximum(limits.lower, -2.0 * np.pi), np.minimum(limits.upper, 2.0 * np.pi)
            x = rng.uniform(np.append(lower, 0.0), np.append(upper, 1.0), (SAMPLES, len(lower) + 1))
            shares = [near_share(self.arm, x, pair, ALWAYS_M) for pair in pairs]
            kept = {"always": np.flatnonzero(np.array(shares) >= NEARLY_ALWAYS)}
            remember("audit", key, kept)
        always = {int(i) for i in kept["always"]}
        self.left_out |= {(pairs[i].first.name, pairs[i].second.name): why for i in always}
        return [pair for i, pair in enumerate(pairs) if i not in always]

    def _key(self, pairs: Sequence[Pair]) -> str:
        """Hash all that decides which pairs always touch."""
        robot = self.arm.robot
        key = hashlib.sha256(repr((_VERSION, SAMPLES, NEARLY_ALWAYS, ALWAYS_M, robot.joints, robot.base)).encode())
        key.update(robot.urdf.read_bytes())
        arrays = [robot.limits.lower, robot.limits.upper]
        if gripper := robot.gripper:
            key.update(repr(gripper.joints).encode())
            arrays += [gripper.open, gripper.closed]
        for pair in pairs:
            for each in (pair.first, pair.second):
                key.update(repr((each.name, each.joint, each.ball, each.disc, each.floor)).encode())
                arrays += [each.T_joint_solid.R, each.T_joint_solid.p, each.corners]
        for array in arrays:
            key.update(np.ascontiguousarray(array).tobytes())
        return key.hexdigest()
