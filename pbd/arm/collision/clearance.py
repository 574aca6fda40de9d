"""Continuous collision checks along a path, with few distances measured.

This is adaptive dynamic collision checking (Schwarzer, Saha and Latombe, 2005), pair by pair. Two bodies at a distance
d cannot touch before they have moved by d relative to each other; motion_bounds.py bounds that motion. They are
measured again after a motion of d + MARGIN_M, and must then be at least MARGIN_M apart. This covers every instant in
between: if it comes after a motion of a from the first measurement and b before the second, then
a + b <= d + MARGIN_M, hence a < d or b <= MARGIN_M. A step of 2 MARGIN_M is always allowed; most are longer. With a
smaller margin the steps are smaller too.

A search that only asks whether a path is free bisects it: two bodies at distances d and e at its ends cannot touch
between them unless they move by d + e. The middle is measured first, since most contacts are there.

Bodies are convex hulls. If a link's hull is near another body, the hulls of its slabs are measured, then its mesh.
Hulls are checked by distance because coal's `collide` misses some deep contacts (4 in 10^5 pairs of so101). A distance
of NaN counts as a contact.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pbd.arm.collision.geometry import Body, mesh_depth, mesh_distance, shape_of
from pbd.arm.collision.motion_bounds import rates
from pbd.arm.model import ArmModel, to_se3
from pbd.lazy import cached_property
from pbd.pose import Array, Pose

MARGIN_M, CLOSE_M = 2.5e-3, 5e-4
"""Clearance that bodies keep, m; and the smaller one that is tried if no motion keeps that."""
CACHED = 2000
"""Number of coordinates whose distances are cached."""

Pairs = NDArray[np.int64]
AllowedTouches = Mapping[int, Callable[[Pose], bool]]
"""Index of a pair that may touch at some places -> whether it may, with the tool at T_base_tool."""


@dataclass(frozen=True, eq=False)
class JointPath:
    """A path as nodes, so dense that no pair of bodies moves by more than `Clearance.step_m` between two.

    Attributes:
        t: (n,) s, or the share of the path.
        x: (n, k + 1) coordinates; each is monotonic between two nodes.
    """

    t: Array
    x: Array

    @cached_property
    def moved(self) -> Array:
        """(k + 1, n) total travel of each coordinate up to each node."""
        moved = np.zeros_like(self.x.T)
        np.cumsum(np.abs(np.diff(self.x.T)), axis=1, out=moved[:, 1:])
        return moved


@dataclass(frozen=True)
class ContactSpan:
    """A pair that touches from node `first` to node `last` of a path.

    `deepest`: the node of the least distance; `distance`: that distance, m, negative for overlap.
    """

    pair: int
    first: int
    last: int
    deepest: int
    distance: float


class Clearance:
    """Distances between pairs of bodies. Not safe to share between threads: pinocchio computes in its buffers.

    Attributes:
        bodies, pairs: the bodies, and the pairs (p, 2) of their indices to check.
        rates: (p, k + 1), see motion_bounds.py.
        margin_m: bodies closer than this, m, count as touching.
        allowed: pairs of the object and a support, which may touch at some places.
    """

    def __init__(
        self,
        arm: ArmModel,
        bodies: Sequence[Body],
        pairs: Pairs,
        margin_m: float = MARGIN_M,
        allowed: AllowedTouches | None = None,
    ) -> None:
        self.arm, self.bodies, self.margin_m, self.allowed = arm, tuple(bodies), margin_m, allowed or {}
        self.pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
        self.rates = rates(arm, bodies, self.pairs)
        self._pads = np.array([self.bodies[a].pad + self.bodies[b].pad for a, b in self.pairs])
        self._geometry = pin.GeometryModel()
        for i, body in enumerate(self.bodies):
            placement = to_se3(body.T_joint_body)
            self._geometry.addGeometryObject(pin.GeometryObject(str(i), body.joint, placement, shape_of(body)))
        for first, second in self.pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(int(first), int(second)))
        pairs_of = [(self.bodies[a], self.bodies[b]) for a, b in self.pairs]
        self._mesh_depth = np.array([mesh_depth(*pair) for pair in pairs_of], dtype=np.float64)
        self._placed, self._data = self._geometry.createData(), arm.full.createData()
        self._known: dict[bytes, Array] = {}

    @property
    def step_m(self) -> float:
        """Largest motion of two bodies relative to each other between two nodes of a path, m."""
        return 2.0 * self.margin_m

    def distances(self, x: Array) -> Array:
        """Return the distance of each pair (p,) at coordinates (k + 1,), m; negative by the depth of the overlap.

        It is cached, since the same joints are the ends of many moves.
        """
        key = x.tobytes()
        if key not in self._known:
            if len(self._known) == CACHED:
                self._known.clear()
            self._known[key] = self._measured(self.arm.configurations(x))
        return self._known[key]

    def _measured(self, q: Array) -> Array:
        pin.computeDistances(self.arm.full, self._data, self._geometry, self._placed, q)
        measured = [result.min_distance for result in self._placed.distanceResults]
        distances: Array = np.array(measured) - self._pads
        for pair in np.flatnonzero((distances > -self._mesh_depth) & (distances < self.margin_m)):
            distances[pair] = self._by_meshes(int(pair), distances[pair])
        return distances

    def touching(self, x: Array) -> list[tuple[int, float]]:
        """Return the pairs that touch at coordinates (k + 1,) where they may not, and their distances, m."""
        distances = self.distances(x)
        near = np.flatnonzero(~(distances >= self.margin_m)).tolist()
        return [(pair, float(distances[pair])) for pair in near if not self.may_touch(pair, x)]

    def may_touch(self, pair: int, x: Array) -> bool:
        """Whether a pair may touch at coordinates (k + 1,)."""
        return pair in self.allowed and self.allowed[pair](self.arm.forward(x[:-1]))

    def witness(self, x: Array, pair: int) -> Array:
        """Return the point (3,) in base, m, at which a pair touches or is nearest, at coordinates (k + 1,)."""
        self._place(self.arm.configurations(x))
        return self._witness(pair)

    def names(self, pair: int) -> tuple[str, str]:
        """Return the names of a pair's bodies."""
        first, second = self.pairs[pair]
        return self.bodies[first].name, self.bodies[second].name

    def always_touching(self, x: Array, share: float) -> dict[int, int]:
        """Return the pairs that touch in at least a share of the coordinates (n, k + 1), and in how many they do."""
        always = dict.fromkeys(range(len(self.pairs)), len(x))
        for measure in (self._hull_distance, self._distance):  # most pairs need no mesh
            always = dict.fromkeys(always, len(x))
            for q in self.arm.configurations(x):
                self._place(q)
                for pair in always:
                    always[pair] -= not measure(pair) < self.margin_m
                always = {pair: count for pair, count in always.items() if count >= share * len(x)}
        return always

    def first_contact(self, path: JointPath) -> ContactSpan | None:
        """Return the contact of a path that begins first; of several at the same node, the deepest."""
        return min(self.contacts(path), key=lambda contact: (contact.first, contact.distance), default=None)

    def contacts(self, path: JointPath) -> list[ContactSpan]:
        """Return all contacts of a path, pair by pair.

        The path's nodes must be dense enough for `rates`, see path_sampling.py.
        """
        q, at_start = self.arm.configurations(path.x), self.distances(path.x[0])
        near = np.flatnonzero(~(at_start - self.margin_m >= self.rates @ path.moved[:, -1])).tolist()
        return [contact for pair in near for contact in self._contacts_of(pair, path, q, float(at_start[pair]))]

    def _contacts_of(self, pair: int, path: JointPath, q: Array, distance: float) -> Iterator[ContactSpan]:
        """Yield a pair's contacts on a path; one ends where it is allowed, too.

        `q`: (n, nq) pinocchio's configurations at the nodes; `distance`: m, at the first.
        """
        travel, node, end = self.rates[pair] @ path.moved, 0, len(q) - 1
        contact: ContactSpan | None = None
        while True:
            if distance >= self.margin_m or self.may_touch(pair, path.x[node]):
                if contact is not None:
                    yield contact
                contact = None
            elif contact is None:
                contact = ContactSpan(pair, node, node, node, distance)
            elif distance < contact.distance:
                contact = replace(contact, last=node, deepest=node, distance=distance)
            else:
                contact = replace(contact, last=node)
            if node == end or travel[end] - travel[node] <= distance - self.margin_m:
                break
            due = travel[node] + max(self.margin_m, distance) + self.margin_m
            node = min(max(int(travel.searchsorted(due, side="right")) - 1, node + 1), end)
            self._place(q[node])
            distance = self._distance(pair)
        if contact is not None:
            yield contact

    def touches_on(self, path: JointPath) -> bool:
        """Whether any pair touches on a path where it may not; its ends are not checked."""
        q, travel = self.arm.configurations(path.x), self.rates @ path.moved[:, -1]
        at_start, at_end = self.distances(path.x[0]), self.distances(path.x[-1])
        near = np.flatnonzero(~(at_start + at_end > travel) & (travel > 0.0)).tolist()
        return any(self._pair_touches_on(path, q, pair, at_start[pair], at_end[pair]) for pair in near)

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

    def tool_contact(self, T_base_tool: Iterable[Pose], opening: float) -> tuple[int, float, Array] | None:
        """Check what moves with the tool against what does not move, with the tool at given poses.

        Returns:
            The first pair found that touches, its distance, m, and the point (3,) in base, m; or None.
        """
        self._place(self.arm.configurations(np.append(self.arm.robot.home, opening)))
        T_joint_base, pairs = self._data.oMi[self.arm.tool_joint].inverse(), self._pairs_of_tool
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

    @cached_property
    def _pairs_of_tool(self) -> list[int]:
        """The pairs of what moves with the tool and what does not move at all."""
        last = self.arm.full.getJointId(self.arm.robot.joints[-1])
        with_tool = np.array([last in list(self.arm.full.supports[body.joint]) for body in self.bodies], dtype=bool)
        still = np.array([body.joint == 0 for body in self.bodies], dtype=bool)
        return np.flatnonzero((with_tool[self.pairs] & still[self.pairs[:, ::-1]]).any(axis=1)).tolist()

    def _place(self, q: Array) -> None:
        pin.updateGeometryPlacements(self.arm.full, self._data, self._geometry, self._placed, q)

    def _distance(self, pair: int) -> float:
        distance = self._hull_distance(pair)
        return self._by_meshes(pair, distance) if -self._mesh_depth[pair] < distance < self.margin_m else distance

    def _witness(self, pair: int) -> Array:
        result = pin.computeDistance(self._geometry, self._placed, pair)
        point: Array = 0.5 * (result.getNearestPoint1() + result.getNearestPoint2())
        return point

    def _hull_distance(self, pair: int) -> float:
        return float(pin.computeDistance(self._geometry, self._placed, pair).min_distance - self._pads[pair])

    def _by_meshes(self, pair: int, distance: float) -> float:
        """Return a pair's distance by its meshes if that is at least the margin, else `distance`, that of the hulls."""
        one, other = self.pairs[pair].tolist()
        placed = self._placed.oMg[one], self._placed.oMg[other]
        apart = mesh_distance(self.bodies[one], placed[0], self.bodies[other], placed[1], self.margin_m)
        return distance if apart is None else apart
