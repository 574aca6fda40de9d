"""The audit's own list of pairs to check for collision, from the URDF, the SRDF and random configurations."""

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pinocchio as pin

from pbd.audit.arm import AuditArm, se3
from pbd.audit.contact import Pair, Placement
from pbd.audit.grasp import follow_object, gripper_joints, resting_contact, tool_rod
from pbd.audit.solids import Solid, clearance, half_space, hull_distance, link_solids, one_encloses_other, simple_solid
from pbd.data import Calibration, GraspedObject, JointTrajectory
from pbd.data.world import TABLE, THE_TOOL, ObjectPhase
from pbd.io.urdf import read_urdf_xml, read_xml

SAMPLES = 200
"""Number of random configurations that show which solids touch nearly always."""

NEARLY_ALWAYS = 0.95
"""Solids that touch in at least this share of the samples touch by design and are not checked."""


class AuditScene:
    """An arm and the objects around it.

    Attributes:
        always_touching: pairs of links (or the table and a link) that touch nearly always and are not checked.
    """

    def __init__(self, arm: AuditArm, calibration: Calibration, grasped: GraspedObject | None) -> None:
        self.arm, self._grasped, self._table = arm, grasped, calibration.table_height
        rod = tool_rod(arm, link_solids(arm))
        self.links = [*link_solids(arm), *([rod] if rod else ())]
        self._gripper = gripper_joints(arm)
        self.always_touching: list[Pair] = []
        self._around = [
            simple_solid(each.name, 0, arm.T_universe_base * se3(each.T_base_obstacle), each.shape, each.size)
            for each in calibration.obstacles
        ]
        self._fixed_pairs = self._drop_always_touching(self._self_pairs())
        self._fixed_pairs += self._moving_pairs(self.links, self._around)
        if self._table is not None:
            T_base_table = pin.SE3(np.eye(3), np.array([0.0, 0.0, self._table]))
            table = half_space(TABLE, arm.T_universe_base * T_base_table)
            self._fixed_pairs += self._drop_always_touching(self._moving_pairs([table], self.links))
            self._around.append(table)

    def pairs(self, trajectory: JointTrajectory) -> list[Pair]:
        """Return all pairs that must not touch during a motion."""
        pairs = list(self._fixed_pairs)
        if self._grasped is not None:
            for phase in follow_object(self.arm, trajectory, self._grasped, self._table):
                pairs += self._object_pairs(phase, self._grasped)
        return pairs

    def _self_pairs(self) -> list[Pair]:
        """Pair the arm's solids with each other, except within the gripper and pairs allowed to touch."""
        may_touch = self._adjacent_links() | self._trusted_pairs()
        return [
            Pair(first, second)
            for first, second in combinations(self.links, 2)
            if self._can_move(first, second)
            and not self._gripper.issuperset((first.joint, second.joint))
            and frozenset((first.name, second.name)) not in may_touch
        ]

    def _can_move(self, first: Solid, second: Solid) -> bool:
        """Say whether two solids can move relative to each other, by a driven joint."""
        return self.arm.driven_ancestors(first.joint) != self.arm.driven_ancestors(second.joint)

    def _moving_pairs(self, ones: Sequence[Solid], others: Sequence[Solid]) -> list[Pair]:
        return [Pair(one, other) for one in ones for other in others if self._can_move(one, other)]

    def _object_pairs(self, phase: ObjectPhase, grasped: GraspedObject) -> list[Pair]:
        """Pair the object with the links, except the gripper's; while it is held, also with obstacles and table."""
        in_tool, standing = self.arm.T_joint_tool * se3(phase.pose), self.arm.T_universe_base * se3(phase.pose)
        placed = (self.arm.tool_joint, in_tool) if phase.held else (0, standing)
        held = simple_solid(f"the {grasped.shape}", *placed, grasped.shape, grasped.size)
        links = [link for link in self.links if link.joint not in self._gripper and self._can_move(link, held)]
        pairs = [Pair(link, held, phase.start, phase.end) for link in links]
        for other in self._around if phase.held else []:
            allowed = resting_contact(self.arm, phase, held, other)
            pairs.append(Pair(other, held, phase.start, phase.end, allowed))
        return pairs

    def _adjacent_links(self) -> set[frozenset[str]]:
        """Return pairs of links with no solid link between them."""
        joints = read_urdf_xml(self.arm.robot.urdf).iterfind("joint")
        parent = {j.find("child").get("link"): j.find("parent").get("link") for j in joints}  # type: ignore[union-attr]
        solid = {link.name for link in self.links}
        found = set()
        for link in solid:
            other = parent.get(self.arm.robot.body if link == THE_TOOL else link)
            while other is not None and other not in solid:
                other = parent.get(other)
            found |= {frozenset((link, other))} if other is not None else set()
        return found

    def _trusted_pairs(self) -> set[frozenset[str]]:
        """Return pairs of links that the robot's TOML lets touch, or that the SRDF excludes for a trusted reason."""
        robot = self.arm.robot
        entries = [] if robot.srdf is None else read_xml(robot.srdf).iterfind("disable_collisions")
        trusted = [entry for entry in entries if entry.get("reason") in ("Adjacent", "Never")]
        by_srdf = {frozenset((entry.get("link1", ""), entry.get("link2", ""))) for entry in trusted}
        return by_srdf | set(map(frozenset, robot.may_touch))

    def _drop_always_touching(self, pairs: list[Pair]) -> list[Pair]:
        """Return the pairs without those that touch nearly always; a joint is sampled up to a turn from 0, or from the
        limit nearest to it."""
        limits, turn = self.arm.robot.limits, 2.0 * np.pi
        lower = np.append(np.maximum(limits.lower, limits.upper.clip(None, 0.0) - turn), 0.0)
        upper = np.append(np.minimum(limits.upper, limits.lower.clip(0.0) + turn), 1.0)
        touching = pairs
        for separate in (_hulls_separate, _separate):  # most pairs need no mesh
            apart = dict.fromkeys(touching, 0)
            for x in np.random.default_rng(13).uniform(lower, upper, (SAMPLES, len(lower))):
                placement = Placement(self.arm.joint_poses(x))
                for pair in apart:
                    apart[pair] += separate(*pair.placed(placement))
                apart = {pair: count for pair, count in apart.items() if count <= (1.0 - NEARLY_ALWAYS) * SAMPLES}
            touching = list(apart)
        self.always_touching += touching
        return [pair for pair in pairs if pair not in touching]


def _hulls_separate(*placed: Any) -> bool:
    return hull_distance(*placed) > 0.0


def _separate(*placed: Any) -> bool:
    """Say whether two solids neither touch nor enclose each other."""
    return clearance(*placed) > 0.0 and not one_encloses_other(*placed)
