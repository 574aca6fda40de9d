"""Whether bodies keep clear of each other along a whole path, with few distances asked for.

A path is followed pair by pair. Where two bodies are a distance d apart, no joint motion that moves them by less than d
against each other can make them touch (levers.py bounds that), so the next look is due only after a motion of
d + MARGIN_M, where they must be at least MARGIN_M apart again. In between they can't touch: an instant that lies a
motion of a after the one look and b before the next has a + b <= d + MARGIN_M, so that a < d or b <= MARGIN_M. As every
look finds at least MARGIN_M, a step of STEP_M = 2 MARGIN_M is always allowed; most are far longer.

Distances, not coal's verdicts: `collide` overlooks some deep contacts of hulls (4 in 10^5 pairs of so101).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pbd.arm.hulls import Body
from pbd.arm.levers import rates
from pbd.arm.model import ArmModel, to_se3
from pbd.pose import Array

MARGIN_M = 2.5e-3
STEP_M = 2.0 * MARGIN_M

Pairs = NDArray[np.int64]
Allowed = Callable[[int, Array], bool]
"""Whether a pair may touch at coordinates (k + 1,)."""


@dataclass(frozen=True, eq=False)
class JointPath:
    """A path as nodes so close that no pair of bodies moves by more than STEP_M against each other in between.

    Attributes:
        t: (n,) s, or the share of a straight move.
        x: (n, k + 1) coordinates (levers.py); between nodes each goes up, goes down or stands still.
    """

    t: Array
    x: Array


@dataclass(frozen=True)
class Contact:
    """A pair that touches from node `first` to node `last` of a path, deepest at `deepest`: `distance` m, signed."""

    pair: int
    first: int
    last: int
    deepest: int
    distance: float


class Clearance:
    """Distances between pairs of bodies. Not to be shared between threads: pinocchio keeps its workings in it.

    Attributes:
        bodies, pairs: what is watched; pairs (p, 2) index the bodies.
        rates: (p, k + 1), see levers.py.
    """

    def __init__(self, arm: ArmModel, bodies: Sequence[Body], pairs: Pairs) -> None:
        self.arm, self.bodies, self.pairs = arm, tuple(bodies), np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
        self.rates = rates(arm, bodies, self.pairs)
        self._pads = np.array([self.bodies[a].pad + self.bodies[b].pad for a, b in self.pairs])
        self._geometry = pin.GeometryModel()
        for i, body in enumerate(self.bodies):
            placement = to_se3(body.T_joint_body)
            self._geometry.addGeometryObject(pin.GeometryObject(str(i), body.joint, placement, shape_of(body)))
        for first, second in self.pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(int(first), int(second)))
        self._placed, self._data = self._geometry.createData(), arm.full.createData()

    def distances(self, x: Array) -> Array:
        """Return the distance of each pair (p,) in m, negative as deep as they overlap, at coordinates (k + 1,)."""
        q = configurations(self.arm, x[None])[0]
        pin.computeDistances(self.arm.full, self._data, self._geometry, self._placed, q)
        nearest = [result.min_distance for result in self._placed.distanceResults]
        distances: Array = np.array(nearest, dtype=np.float64) - self._pads
        return distances

    def witness(self, x: Array, pair: int) -> Array:
        """Where a pair is nearest or touches (3,), in pinocchio's world, at coordinates (k + 1,)."""
        self._place(configurations(self.arm, x[None])[0])
        result = pin.computeDistance(self._geometry, self._placed, pair)
        point: Array = 0.5 * (result.getNearestPoint1() + result.getNearestPoint2())
        return point

    def always_touching(self, x: Array) -> list[int]:
        """Return the pairs that are nearer than MARGIN_M at each of the coordinates (n, k + 1)."""
        touching = list(range(len(self.pairs)))
        for q in configurations(self.arm, x):
            self._place(q)
            touching = [pair for pair in touching if self._distance(pair) < MARGIN_M]
            if not touching:
                break
        return touching

    def first_contact(self, path: JointPath, allowed: Allowed | None = None) -> Contact | None:
        """Follow a path; return the first contact: the one that begins first, of several the deepest."""
        q = configurations(self.arm, path.x)
        moved = np.zeros_like(path.x.T)  # (k + 1, n), how far each coordinate has gone, to and fro, up to each node
        np.cumsum(np.abs(np.diff(path.x.T)), axis=1, out=moved[:, 1:])
        found: Contact | None = None
        stop = len(q) - 1
        for pair, rate in enumerate(self.rates):
            met = self._follow(path, q, rate @ moved, pair, stop, allowed)
            if met is not None and (found is None or met[0] < stop or met[1] < found.distance):
                stop = met[0]
                found = Contact(pair, stop, stop, stop, met[1])
        return found and self._until_clear(path, q, self.rates[found.pair] @ moved, found, allowed)

    def _follow(
        self, path: JointPath, q: Array, travel: Array, pair: int, stop: int, allowed: Allowed | None
    ) -> tuple[int, float] | None:
        """Return the first node up to `stop` at which a pair touches, and their distance."""
        node, end = 0, travel[stop]
        while True:
            self._place(q[node])
            distance = self._distance(pair)
            if distance < MARGIN_M and not (allowed and allowed(pair, path.x[node])):
                return node, distance
            if node == stop or end - travel[node] <= distance - MARGIN_M:
                return None
            node = min(self._next(travel, node, distance), stop)

    def _until_clear(
        self, path: JointPath, q: Array, travel: Array, contact: Contact, allowed: Allowed | None
    ) -> Contact:
        """Follow a contact to its end, or to where it is allowed."""
        last = deepest = node = contact.first
        least = contact.distance
        while node < len(q) - 1:
            node = min(self._next(travel, node, MARGIN_M), len(q) - 1)
            self._place(q[node])
            distance = self._distance(contact.pair)
            if distance >= MARGIN_M or (allowed and allowed(contact.pair, path.x[node])):
                break
            last = node
            if distance < least:
                deepest, least = node, distance
        return Contact(contact.pair, contact.first, last, deepest, least)

    @staticmethod
    def _next(travel: Array, node: int, distance: float) -> int:
        due = travel[node] + max(distance, MARGIN_M) + MARGIN_M
        return max(int(travel.searchsorted(due, side="right")) - 1, node + 1)

    def _place(self, q: Array) -> None:
        pin.updateGeometryPlacements(self.arm.full, self._data, self._geometry, self._placed, q)

    def _distance(self, pair: int) -> float:
        return float(pin.computeDistance(self._geometry, self._placed, pair).min_distance - self._pads[pair])


def configurations(arm: ArmModel, x: Array) -> Array:
    """Return pinocchio's configurations (n, nq) of the whole model at coordinates (n, k + 1); see `ArmModel.full_q`."""
    full, robot = arm.full, arm.robot
    q = np.tile(arm.full_q(robot.home, 1.0), (len(x), 1))
    values = dict(zip(robot.joints, x.T[:-1], strict=True))
    if gripper := robot.gripper:
        fingers = gripper.closed[:, None] + x.T[-1] * (gripper.open - gripper.closed)[:, None]
        values |= dict(zip(gripper.joints, fingers, strict=True))
    for name, value in values.items():
        joint = full.joints[full.getJointId(name)]
        if joint.nq == 1:
            q[:, joint.idx_q] = value
        else:  # continuous: cosine and sine
            q[:, joint.idx_q], q[:, joint.idx_q + 1] = np.cos(value), np.sin(value)
    return q


@lru_cache(maxsize=1024)
def shape_of(body: Body) -> Any:
    """Return a body as coal takes it, without its pad."""
    if body.shape == "hull":
        points = coal.StdVec_Vec3s()
        points.extend(list(body.points))
        return coal.Convex.convexHull(points, True, "Qt")
    if body.shape == "box":
        return coal.Box(*body.size)
    if body.shape == "cylinder":
        return coal.Cylinder(0.5 * body.size[0], body.size[1])
    if body.shape == "sphere":
        return coal.Sphere(0.5 * body.size[0])
    if body.shape == "floor":
        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    raise ValueError(f"{body.shape!r} is none of hull, box, cylinder, sphere, floor")
