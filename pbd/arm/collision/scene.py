"""The collision scene: an arm with itself, the table, obstacles, and the object that it grasps.

The gripper (all links that the arm's last joint carries) may touch the object. A held object may touch its support, the
table or an obstacle, within NEAR_SUPPORT_M of where it is gripped or released. If the model has no gripper, a rod
stands for it (gripper.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import partial
from weakref import WeakKeyDictionary

import numpy as np

from pbd.arm.collision.allowed_collisions import NEARLY_ALWAYS, link_pairs, sample_coordinates
from pbd.arm.collision.clearance import CLOSE_M, MARGIN_M, Clearance, Pairs
from pbd.arm.collision.geometry import Body, body_distance
from pbd.arm.collision.motion_bounds import moving_pairs
from pbd.arm.gripper import arm_bodies, gripper_links
from pbd.arm.model import ArmModel
from pbd.arm.path_sampling import sample_polyline
from pbd.data import GraspedObject, Obstacle
from pbd.data.world import TABLE, THE_TOOL, ObjectPhase, gripped_spans, object_phases
from pbd.pose import Array, Pose

NEAR_SUPPORT_M = 0.03
"""Distance from where it is gripped or released, m, within which a held object may touch its support."""

LEAST_NORMAL_Z = float(np.cos(np.radians(45.0)))
"""Smallest z component of a supporting surface's normal: within 45 degrees of the vertical."""

MOST_TOOL_CHECKS = 32
"""Largest number of poses of a path at which `tool_hit` checks the tool."""


@dataclass(frozen=True, eq=False)
class Hit:
    """Two bodies that touch, or are closer than the margin.

    Attributes:
        first, second: names of links or obstacles, TABLE, THE_TOOL, or the grasped object ("the cylinder").
        distance: m, negative by the depth of the overlap.
        p_base: (3,) m, the point of contact in base.
    """

    first: str
    second: str
    distance: float
    p_base: Array

    @property
    def depth(self) -> float:
        """Depth of the overlap, m; 0 if they are only near."""
        return max(0.0, -self.distance)

    @property
    def fields(self) -> dict[str, object]:
        """The fields of an error about it: bodies, value (depth, m), p_base (m)."""
        return {"bodies": (self.first, self.second), "value": self.depth, "p_base": self.p_base}

    def __str__(self) -> str:
        if self.depth == 0.0:
            return f"{self.first} would come within {1000.0 * self.distance:.1f} mm of {self.second}"
        deep = f"{1000.0 * self.depth:.1f} mm" if self.depth < 0.01 else f"{100.0 * self.depth:.1f} cm"
        return f"{self.first} would touch {self.second}, {deep} deep"


@dataclass(frozen=True)
class GraspState:
    """The state of the gripper and the object during a move: the gripper's opening, and where the object is."""

    opening: float = 1.0
    phase: ObjectPhase | None = None


class CollisionScene:
    """The bodies that can touch, for one arm and its surroundings. Not safe to share between threads, as the arm.

    Attributes:
        obstacles: names of the obstacles.
        sunk: links that are not checked against the table, since they nearly always touch it.
        links: names of the links that have a body.
        margin_m: bodies closer than this, m, count as touching.
        always: the arm against itself, the table and the obstacles.
    """

    def __init__(
        self,
        arm: ArmModel,
        table_height: float | None = None,
        obstacles: Iterable[Obstacle] = (),
        grasped: GraspedObject | None = None,
    ) -> None:
        self.arm, self.table_height, self._grasped = arm, table_height, grasped
        obstacles, self.margin_m = tuple(obstacles), MARGIN_M
        self.obstacles = frozenset(obstacle.name for obstacle in obstacles)
        self._links, (pairs, _) = arm_bodies(arm), link_pairs(arm)
        self.links = frozenset(link.name for link in self._links) - {THE_TOOL}
        world = [Body(o.name, 0, o.T_base_obstacle, o.shape, o.size) for o in obstacles]
        if table_height is not None:
            T_base_table = Pose.from_rpy((0.0, 0.0, table_height), np.zeros(3))
            world.insert(0, Body(TABLE, 0, T_base_table, "floor"))
        self._bodies = (*self._links, *world)
        around = self._pairs_between(self._bodies, range(len(self._links)), range(len(self._links), len(self._bodies)))
        on_table = np.flatnonzero([self._bodies[second].name == TABLE for _, second in around])
        clearance = Clearance(arm, self._bodies, around[on_table])
        sunk = on_table[list(clearance.always_touching(sample_coordinates(arm), NEARLY_ALWAYS))]
        self.sunk = tuple(dict.fromkeys(self._bodies[link].name for link, _ in around[sunk]))
        self.always = Clearance(arm, self._bodies, np.concatenate((pairs, np.delete(around, sunk, axis=0))))
        self._with_object = WeakKeyDictionary[ObjectPhase, Clearance]()

    def closer(self) -> CollisionScene:
        """Return the same scene with the margin CLOSE_M."""
        scene = copy(self)
        scene.margin_m, scene._with_object = CLOSE_M, WeakKeyDictionary()
        scene.always = Clearance(self.arm, self._bodies, self.always.pairs, CLOSE_M)
        return scene

    def hit(self, q: Array, grasp: GraspState | None = None) -> Hit | None:
        """Return the deepest hit at joints q (k,); by default the gripper is open and there is no object."""
        grasp = grasp or GraspState()
        x, worst = np.append(q, grasp.opening), None
        for each in self.clearances(grasp.phase):
            for pair, distance in each.touching(x):
                if worst is None or distance < worst.distance:
                    worst = self.as_hit(each, pair, x, distance)
        return worst

    def is_free(self, q: Array, grasp: GraspState) -> bool:
        """Whether the arm is free at joints (1, k), or along the polyline in joint space through joints (m, k).

        It measures at other points than `check_path`, so a distance just below the margin may be found by only one of
        the two.
        """
        x = np.column_stack((q[[0, -1]], (grasp.opening, grasp.opening)))[: len(q)]
        for each in self.clearances(grasp.phase):
            if any(each.touching(end) for end in x):
                return False
            if len(q) > 1 and each.touches_on(sample_polyline(q, grasp.opening, each.rates, each.step_m)):
                return False
        return True

    def tool_hit(self, T_base_tool: Sequence[Pose], grasp: GraspState) -> Hit | None:
        """Return a hit of what moves with the tool, with the tool at given poses, whatever the arm's configuration."""
        count = len(T_base_tool)
        middle_first = sorted(range(0, count, count // MOST_TOOL_CHECKS + 1), key=lambda i: abs(2 * i - count))
        for each in self.clearances(grasp.phase):
            met = each.tool_contact((T_base_tool[i] for i in middle_first), grasp.opening)
            if met is not None:
                pair, distance, p_base = met
                return Hit(*each.names(pair), distance, p_base)
        return None

    def check_path(self, q: Array, grasp: GraspState | None = None) -> Hit | None:
        """Return the first hit along the polyline in joint space through joints (m, k)."""
        grasp = grasp or GraspState()
        begins, first = np.inf, None
        for each in self.clearances(grasp.phase):
            path = sample_polyline(q, grasp.opening, each.rates, each.step_m)
            met = each.first_contact(path)
            if met is not None and path.t[met.first] < begins:
                begins, first = path.t[met.first], self.as_hit(each, met.pair, path.x[met.deepest], met.distance)
        return first

    def grasp_states(self, T_base_tool: Sequence[Pose], grips: Sequence[bool | None]) -> tuple[GraspState, ...]:
        """Return the states during a motion through n keyframes: [i] on the way to keyframe i, [n] after the last one.

        Args:
            T_base_tool: the tool's poses at the keyframes.
            grips: for each, True if the gripper closes, False if it opens, None if it does not move; it begins open.
        """
        t, opening = [-1.0], [1.0]
        for keyframe, closes in enumerate(grips if self.arm.robot.gripper else ()):
            if closes is not None:
                t += [keyframe, keyframe]
                opening += [opening[-1], float(not closes)]
        last = len(T_base_tool) - 1
        spans = gripped_spans(np.array(t), np.array(opening))
        found = self.phases(spans, lambda keyframe: T_base_tool[int(min(keyframe, last))])
        grasps = []
        for i in range(last + 2):
            phase = next((phase for phase in found if phase.start < i <= phase.end), None)
            grasps.append(GraspState(opening[int(np.searchsorted(t, i - 1, side="right")) - 1], phase))
        return tuple(grasps)

    def phases(self, spans: Sequence[tuple[float, float]], tool: Callable[[float], Pose]) -> tuple[ObjectPhase, ...]:
        """Return where the object is over time: see `pbd.data.world.object_phases`; empty if there is no object."""
        return () if self._grasped is None else object_phases(self._grasped, spans, tool, self.table_height)

    def clearances(self, phase: ObjectPhase | None) -> list[Clearance]:
        """Return all clearances to check while the object is where `phase` says; None: there is no object."""
        return [self.always] if phase is None else [self.always, self.object_clearance(phase)]

    def object_clearance(self, phase: ObjectPhase) -> Clearance:
        """Return the clearance of the object: to the arm, and while it is held also to the world; cached."""
        if phase not in self._with_object:
            self._with_object[phase] = self._object_pairs(phase)
        return self._with_object[phase]

    def as_hit(self, clearance: Clearance, pair: int, x: Array, distance: float) -> Hit:
        """Make the hit of a pair that touches at coordinates x (k + 1,)."""
        return Hit(*clearance.names(pair), distance, clearance.witness(x, pair))

    def _object_pairs(self, phase: ObjectPhase) -> Clearance:
        thing = self._grasped
        assert thing is not None  # `phases` returns none without an object
        placed = (self.arm.tool_joint, self.arm.T_joint_tool @ phase.pose) if phase.held else (0, phase.pose)
        bodies = (*self._bodies, Body(f"the {thing.shape}", *placed, thing.shape, thing.size))
        this, gripper = len(self._bodies), gripper_links(self.arm, self._links)
        others = [i for i, link in enumerate(self._links) if link.name not in gripper]
        pairs = self._pairs_between(bodies, others, (this,))
        around = self._pairs_between(bodies, (this,), range(len(self._links), this))

        def near(places: Sequence[Array], T_tool_object: Pose, T_base_tool: Pose) -> bool:
            p = (T_base_tool @ T_tool_object).p
            return any(np.linalg.norm(p - place) <= NEAR_SUPPORT_M for place in places)

        allowed = {}
        for pair, (_, second) in enumerate(around, start=len(pairs)):
            if places := [rest.p for rest in phase.rests if self._stands_on(bodies[this], rest, bodies[second])]:
                allowed[pair] = partial(near, places, phase.pose)
        return Clearance(self.arm, bodies, np.concatenate((pairs, around)), self.margin_m, allowed)

    def _stands_on(self, thing: Body, T_base_thing: Pose, support: Body) -> bool:
        distance, _, normal = body_distance(thing, T_base_thing, support, support.T_joint_body)
        return bool(abs(distance) <= NEAR_SUPPORT_M and -normal[2] >= LEAST_NORMAL_Z)

    def _pairs_between(self, bodies: Sequence[Body], ones: Iterable[int], others: Iterable[int]) -> Pairs:
        """Return all pairs of bodies, except those that no joint moves relative to each other."""
        others = tuple(others)
        pairs = np.array([(a, b) for a in ones for b in others], dtype=np.int64).reshape(-1, 2)
        return moving_pairs(self.arm, bodies, pairs)
