"""Find the first contact of two solids during a motion, by conservative advancement.

Two solids can't touch before they have moved by their distance relative to each other, so the distance is measured
again only then. The relative motion is bounded by how far the joints turn, times how far the solids reach. Where
bounding spheres are too far apart for a contact, the distance is not measured at all.

Sources: B. Mirtich, Impulse-based dynamic simulation of rigid body systems, 1996; M. Tang, Y. J. Kim and D. Manocha,
C2A: controlled conservative advancement, ICRA 2009.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
from numpy.typing import NDArray

from pbd.audit.arm import AuditArm
from pbd.audit.limits import derivatives
from pbd.audit.solids import MESH_DISTANCES_M, Solid, clearance, one_encloses_other, sphere_distances
from pbd.data import JointTrajectory
from pbd.pose import Array

GRID_S = 4e-3
"""Spacing, s, of the time grid. In each interval one bound holds for the joints' speeds."""

SPAN = 16
"""Number of intervals of the time grid that share one test of the bounding spheres."""

MAX_GRID = 200_000
"""Largest number of instants in the time grid, however slow the motion is."""


class Placement:
    """Poses of the solids at one configuration of the arm, each computed once for all its pairs.

    Attributes:
        T_universe_joint: poses of all joints, in pinocchio's order.
    """

    def __init__(self, T_universe_joint: Any) -> None:
        self.T_universe_joint, self._transforms = T_universe_joint, dict[Solid, Any]()

    def transform(self, solid: Solid) -> Any:
        """Return the pose of a solid in the universe, as coal's transform."""
        if solid not in self._transforms:
            T = self.T_universe_joint[solid.joint] * solid.T_joint_solid
            self._transforms[solid] = coal.Transform3s(T.rotation, T.translation)
        return self._transforms[solid]


@dataclass(frozen=True, eq=False)
class Pair:
    """Two solids that must not touch from `start` to `end` (s), except where `allowed`(T_universe_joint) is true."""

    first: Solid
    second: Solid
    start: float = -np.inf
    end: float = np.inf
    allowed: Callable[[Any], bool] | None = None

    def placed(self, placement: Placement) -> tuple[Solid, Any, Solid, Any]:
        """Return both solids, each followed by its pose."""
        return self.first, placement.transform(self.first), self.second, placement.transform(self.second)


@dataclass(frozen=True, eq=False)
class Touch:
    """Two solids that touch at t (s)."""

    pair: Pair
    t: float

    @property
    def bodies(self) -> tuple[str, str]:
        """Names of both; one that never moves comes last."""
        ordered = sorted((self.pair.first, self.pair.second), key=lambda solid: solid.joint == 0)
        return ordered[0].name, ordered[1].name


class SampledMotion:
    """A trajectory on a time grid of n instants, in spans of SPAN intervals.

    Attributes:
        t: (n,) s.
        travelled: (n, k + 1), upper bound of the path length of each coordinate since the start.
    """

    def __init__(self, arm: AuditArm, trajectory: JointTrajectory) -> None:
        self.arm, self.trajectory = arm, trajectory
        t = np.union1d(time_grid(trajectory, GRID_S, MAX_GRID), trajectory.gripper_t)
        self.t = t[(t >= 0.0) & (t <= trajectory.duration)]
        self.travelled = self._travelled()
        self._q = arm.configurations(coordinates(trajectory, self.t))
        self._span_rows = np.append(np.arange(0, len(self.t), SPAN), len(self.t) - 1)
        self._placements, self._bounds = dict[int, Placement](), dict[Solid, dict[int, Array]]()
        self._centers = dict[Solid, Array]()
        # T_universe_joint (spans + 1, joints, 4, 4) at the start of each span and at the end.
        placed = (self.placement(row).T_universe_joint for row in self._span_rows.tolist())
        self._joint_poses = np.array([[T.homogeneous for T in joints] for joints in placed])

    def placement(self, row: int, share: float = 0.0) -> Placement:
        """Return the placement at instant `row`, or a share of the interval later."""
        if share > 0.0:
            t = self.time(row, share)
            return Placement(self.arm.joint_poses(coordinates(self.trajectory, np.array([t]))[0]))
        if row not in self._placements:
            self._placements[row] = Placement(self.arm.joint_poses_at(self._q[row]))
        return self._placements[row]

    def time(self, row: int, share: float) -> float:
        """Return the time (s) of instant `row`, or a share of the interval later."""
        return float(self.t[row] + share * (self.t[min(row + 1, len(self.t) - 1)] - self.t[row]))

    def travel(self, pair: Pair) -> Array:
        """Bound how far two solids have moved relative to each other since the start: (n,) m."""
        for solid in (pair.first, pair.second):
            if solid not in self._bounds:
                self._bounds[solid] = self.arm.motion_bounds(solid.joint, solid.reach)
        one, other = self._bounds[pair.first], self._bounds[pair.second]
        # A joint that carries both does not change their relative pose.
        rates = [(one | other)[joint] for joint in one.keys() ^ other.keys()]
        return np.asarray(self.travelled @ np.sum(rates, axis=0))

    def close_spans(self, pair: Pair, travel: Array) -> NDArray[np.int64]:
        """Return the spans in which the bounding spheres allow a contact. Span i begins at row i * SPAN."""
        one, other = (self._sphere_centers(solid) for solid in (pair.first, pair.second))
        apart, moved = sphere_distances(pair.first, one, pair.second, other), np.diff(travel[self._span_rows])
        # To touch within a span, they must cover the distance at its start, and then the distance at its end.
        return np.flatnonzero(np.maximum(apart[:-1], 0.0) + np.maximum(apart[1:], 0.0) <= moved)

    def _sphere_centers(self, solid: Solid) -> Array:
        """Return the bounding sphere's center in the universe, (spans + 1, 3) m, at the start of each span and at the
        end."""
        if solid not in self._centers:
            T = self._joint_poses[:, solid.joint]
            self._centers[solid] = T[:, :3, :3] @ solid.bounding_sphere[0] + T[:, :3, 3]
        return self._centers[solid]

    def _travelled(self) -> Array:
        trajectory, step = self.trajectory, np.diff(self.t)[:, None]
        piece = np.searchsorted(trajectory.knots, 0.5 * (self.t[:-1] + self.t[1:])) - 1
        start, end = (np.abs(_derivatives(trajectory, piece, t)) for t in (self.t[:-1], self.t[1:]))
        # The acceleration is linear in time, and each instant is within half an interval of one of its ends.
        speed = np.maximum(start[1], end[1]) + 0.5 * step * np.maximum(start[2], end[2])
        opening = np.abs(np.diff(np.interp(self.t, trajectory.gripper_t, trajectory.gripper_opening)))
        return np.vstack((np.zeros(speed.shape[1] + 1), np.cumsum(np.column_stack((step * speed, opening)), axis=0)))


def find_touch(arm: AuditArm, trajectory: JointTrajectory, pairs: Sequence[Pair]) -> Touch | None:
    """Return the first contact of a motion, or None."""
    motion, first = SampledMotion(arm, trajectory), None
    for pair in pairs:
        t = _first_touch(motion, pair, min(pair.end, first.t if first else np.inf))
        if t is not None:
            first = Touch(pair, t)
    return first


def _first_touch(motion: SampledMotion, pair: Pair, end: float) -> float | None:
    """Return the time (s) at which two solids first touch, or None if they don't touch until `end`."""
    travel, measured = motion.travel(pair), False
    spans = motion.close_spans(pair, travel)
    row, share = int(motion.t.searchsorted(pair.start)), 0.0
    while (span := int(spans.searchsorted(row // SPAN))) < len(spans):
        row = max(row, int(spans[span]) * SPAN)
        if (t := motion.time(row, share)) > end:
            return None
        placement, apart = motion.placement(row, share), 0.0
        if pair.allowed is None or not pair.allowed(placement.T_universe_joint):
            placed = pair.placed(placement)
            apart = clearance(*placed)
            # A solid that starts outside can't get inside without touching the surface.
            if apart == 0.0 or (not measured and apart <= MESH_DISTANCES_M[0] and one_encloses_other(*placed)):
                return t
            measured = True
        if travel[-1] - travel[row] <= apart:  # also true at the last row, which ends the loop
            return None
        step = travel[row + 1] - travel[row]
        if 0.0 < apart < (1.0 - share) * step:
            share += apart / step
            continue
        due = int(travel.searchsorted(travel[row] + share * step + apart, side="right")) - 1
        row, share = max(due - due % SPAN, row + 1), 0.0
    return None


def time_grid(trajectory: JointTrajectory, step_s: float, most: int) -> Array:
    """Return the knots and evenly spaced instants, s: at most `step_s` apart, but not more than `most`."""
    even = np.linspace(0.0, trajectory.duration, min(int(trajectory.duration / step_s) + 2, most))
    return np.union1d(even, trajectory.knots)


def coordinates(trajectory: JointTrajectory, t: Array) -> Array:
    """Return joint positions and gripper opening (n, k + 1) at times t (n,) s."""
    q = joint_motion(trajectory, t)[0]
    return np.column_stack((q, np.interp(t, trajectory.gripper_t, trajectory.gripper_opening)))


def joint_motion(trajectory: JointTrajectory, t: Array) -> Array:
    """Return q, qd, qdd, qddd (4, n, k) at times t (n,) s."""
    return _derivatives(trajectory, np.searchsorted(trajectory.knots, t) - 1, t)


def _derivatives(trajectory: JointTrajectory, piece: NDArray[np.int64], t: Array) -> Array:
    piece = piece.clip(0, len(trajectory.coefficients) - 1)
    return derivatives(trajectory.coefficients[piece], (t - trajectory.knots[piece])[:, None])
