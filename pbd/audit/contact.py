"""Whether two solids touch during a motion, by conservative advancement (Mirtich, 1996; Tang, Kim and Manocha, 2009).

Where two solids are a distance apart, they can't touch before they have moved by as much against each other. So the
next look is due then. How far they move is bounded by how far the joints turn, times how far the solids reach. Where
the balls around them are too far apart for that, nobody looks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
from numpy.typing import NDArray

from pbd.audit.arm import AuditArm
from pbd.audit.solids import NEARER_M, Solid, balls_apart, clearance, one_in_the_other
from pbd.data import JointTrajectory
from pbd.pose import Array

GRID_S = 4e-3
"""For how long one value bounds the joints' speeds, s."""

SHARED = 16
"""Instants of the grid from one to the next at which balls are placed, and looks are taken where they may be."""

MOST_GRID = 200_000
"""No more instants than these bound a motion's speeds, however slow it is."""


class Placed:
    """Where solids are while the joints are at some places: each is asked once for all its pairs.

    Attributes:
        T_universe_joint: of all joints, as pinocchio lists them.
    """

    def __init__(self, T_universe_joint: Any) -> None:
        self.T_universe_joint, self._of = T_universe_joint, dict[Solid, Any]()

    def of(self, solid: Solid) -> Any:
        """A solid's place in the universe as coal takes it."""
        if solid not in self._of:
            T = self.T_universe_joint[solid.joint] * solid.T_joint_solid
            self._of[solid] = coal.Transform3s(T.rotation, T.translation)
        return self._of[solid]


@dataclass(frozen=True, eq=False)
class Pair:
    """Two solids that must not touch from `start` to `end` (s), unless `allowed` says so of T_universe_joint."""

    first: Solid
    second: Solid
    start: float = -np.inf
    end: float = np.inf
    allowed: Callable[[Any], bool] | None = None

    def at(self, placed: Placed) -> tuple[Solid, Any, Solid, Any]:
        """Both solids, each with its place."""
        return self.first, placed.of(self.first), self.second, placed.of(self.second)


@dataclass(frozen=True, eq=False)
class Touch:
    """Two solids that touch at t (s)."""

    pair: Pair
    t: float

    @property
    def bodies(self) -> tuple[str, str]:
        """Their names; what stands around comes last."""
        ordered = sorted((self.pair.first, self.pair.second), key=lambda solid: solid.joint == 0)
        return ordered[0].name, ordered[1].name


class Motion:
    """A trajectory on a grid of n instants.

    Attributes:
        t: (n,) s.
        moved: (n, k + 1) how far each coordinate has gone at most since the start, to and fro.
    """

    def __init__(self, arm: AuditArm, trajectory: JointTrajectory) -> None:
        self.arm, self.trajectory = arm, trajectory
        count = min(int(trajectory.duration / GRID_S) + 2, MOST_GRID)
        even = np.linspace(0.0, trajectory.duration, count)
        t = np.unique(np.concatenate((even, trajectory.knots, trajectory.gripper_t)))
        self.t = t[(t >= 0.0) & (t <= trajectory.duration)]
        self.moved = self._moved()
        self._q = arm.configurations(coordinates(trajectory, self.t))
        self._shared = np.append(np.arange(0, len(self.t), SHARED), len(self.t) - 1)
        self._placed, self._bounds = dict[int, Placed](), dict[Solid, dict[int, Array]]()
        self._centers = dict[Solid, Array]()
        # T_universe_joint (n, joints, 4, 4) at the beginnings of spans and the end.
        placed = (self.at(row).T_universe_joint for row in self._shared.tolist())
        self._places = np.array([[T.homogeneous for T in joints] for joints in placed])

    def at(self, row: int, share: float = 0.0) -> Placed:
        """Where the arm is at a row, or a share of the time to the next one later."""
        if share > 0.0:
            t = self.time(row, share)
            return Placed(self.arm.place(coordinates(self.trajectory, np.array([t]))[0]))
        if row not in self._placed:
            self._placed[row] = Placed(self.arm.place_at(self._q[row]))
        return self._placed[row]

    def time(self, row: int, share: float) -> float:
        """The instant (s) a share of the time after a row."""
        return float(self.t[row] + share * (self.t[min(row + 1, len(self.t) - 1)] - self.t[row]))

    def travel(self, pair: Pair) -> Array:
        """How far two solids have moved against each other at most (n,), m, until each instant of the grid."""
        for each in (pair.first, pair.second):
            if each not in self._bounds:
                self._bounds[each] = self.arm.motion(each.joint, each.reach)
        one, other = self._bounds[pair.first], self._bounds[pair.second]
        # Joints that carry both move neither against the other.
        rates = [(one | other)[joint] for joint in one.keys() ^ other.keys()]
        return np.asarray(self.moved @ np.sum(rates, axis=0))

    def near(self, pair: Pair, travel: Array) -> NDArray[np.int64]:
        """Spans in which two solids may touch for all that their balls say: number i begins at row i SHARED."""
        one, other = (self._centers_of(each) for each in (pair.first, pair.second))
        apart, moved = balls_apart(pair.first, one, pair.second, other), np.diff(travel[self._shared])
        # To touch in between they would have to move by what they are apart at the beginning, and at the end.
        return np.flatnonzero(np.maximum(apart[:-1], 0.0) + np.maximum(apart[1:], 0.0) <= moved)

    def _centers_of(self, solid: Solid) -> Array:
        """Where the center of a solid's ball is in the universe (n, 3), m, at the beginnings of spans and the end."""
        if solid not in self._centers:
            T = self._places[:, solid.joint]
            self._centers[solid] = T[:, :3, :3] @ solid.ball[0] + T[:, :3, 3]
        return self._centers[solid]

    def _moved(self) -> Array:
        """How far each coordinate has gone at most (n, k + 1) since the start, to and fro."""
        trajectory, step = self.trajectory, np.diff(self.t)[:, None]
        piece = np.searchsorted(trajectory.knots, 0.5 * (self.t[:-1] + self.t[1:])) - 1
        (_, qd, qdd), (_, qd_end, qdd_end) = (_motion(trajectory, piece, t) for t in (self.t[:-1], self.t[1:]))
        # The acceleration changes evenly, and no instant is farther than half a step from one of the two.
        speed = np.maximum(np.abs(qd), np.abs(qd_end)) + 0.5 * step * np.maximum(np.abs(qdd), np.abs(qdd_end))
        opening = np.abs(np.diff(np.interp(self.t, trajectory.gripper_t, trajectory.gripper_opening)))
        return np.vstack((np.zeros(speed.shape[1] + 1), np.cumsum(np.column_stack((step * speed, opening)), axis=0)))


def find_touch(arm: AuditArm, trajectory: JointTrajectory, pairs: Sequence[Pair]) -> Touch | None:
    """Return the first touch of a motion, or None."""
    motion, first = Motion(arm, trajectory), None
    for pair in pairs:
        t = _first_touch(motion, pair, min(pair.end, first.t if first else np.inf))
        if t is not None:
            first = Touch(pair, t)
    return first


def _first_touch(motion: Motion, pair: Pair, end: float) -> float | None:
    """When two solids touch first, s, until `end`."""
    travel, looked = motion.travel(pair), False
    near = motion.near(pair, travel)
    row, share = int(motion.t.searchsorted(pair.start)), 0.0
    while (span := int(near.searchsorted(row // SHARED))) < len(near):
        row = max(row, int(near[span]) * SHARED)
        if (t := motion.time(row, share)) > end:
            return None
        at, apart = motion.at(row, share), 0.0
        if pair.allowed is None or not pair.allowed(at.T_universe_joint):
            placed = pair.at(at)
            apart = clearance(*placed)
            # What isn't inside at first can't come there without touching the surface.
            if apart == 0.0 or (not looked and apart <= NEARER_M[0] and one_in_the_other(*placed)):
                return t
            looked = True
        if travel[-1] - travel[row] <= apart:  # so too where the motion ends
            return None
        step = travel[row + 1] - travel[row]
        if 0.0 < apart < (1.0 - share) * step:
            share += apart / step
            continue
        due = int(travel.searchsorted(travel[row] + share * step + apart, side="right")) - 1
        row, share = max(due - due % SHARED, row + 1), 0.0
    return None


def coordinates(trajectory: JointTrajectory, t: Array) -> Array:
    """Return joints and opening (n, k + 1) at instants (n,), s."""
    q, _, _ = _motion(trajectory, np.searchsorted(trajectory.knots, t) - 1, t)
    return np.column_stack((q, np.interp(t, trajectory.gripper_t, trajectory.gripper_opening)))


def _motion(trajectory: JointTrajectory, piece: NDArray[np.int64], t: Array) -> tuple[Array, Array, Array]:
    """Return q, qd, qdd (n, k) of pieces (n,) at instants (n,)."""
    piece = piece.clip(0, len(trajectory.coefficients) - 1)
    s = (t - trajectory.knots[piece])[:, None]
    c0, c1, c2, c3 = np.moveaxis(trajectory.coefficients[piece], 1, 0)
    return c0 + s * (c1 + s * (c2 + s * c3)), c1 + s * (2.0 * c2 + s * 3.0 * c3), 2.0 * c2 + 6.0 * s * c3
