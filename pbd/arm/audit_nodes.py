"""The instants at which the audit looks at a motion, and how far joints go at most from one to the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pbd.arm.audit_arm import AuditArm, Placements
from pbd.arm.audit_solids import Solid
from pbd.data import JointTrajectory
from pbd.pose import Array

GRID_S = 4e-3
"""For how long one value bounds the joints' speeds, s."""
MOST_GRID = 200_000
"""No more instants than these bound a motion's speeds, however slow it is."""


@dataclass(frozen=True, eq=False)
class Nodes:
    """A motion, or a part of it, at n instants.

    Attributes:
        t: (n,) s.
        x: (n, k + 1) coordinates (audit_arm.py).
        moved: (n, k + 1) how far each coordinate has gone at most since the first instant, to and fro.
        placed: where the joints are.
    """

    t: Array
    x: Array
    moved: Array
    placed: Placements
    _middles: dict[Solid, Array] = field(default_factory=dict)

    def middles(self, solid: Solid) -> Array:
        """Where the middle of the ball around a shape is: (n, 3)."""
        if solid not in self._middles:
            self._middles[solid] = self.placed.points(solid.joint, solid.around[0])
        return self._middles[solid]


def nodes_at(arm: AuditArm, trajectory: JointTrajectory, t: Array) -> Nodes:
    """Work out a motion at increasing instants (n,), s."""
    fine = _grid(trajectory, t[0], t[-1], t)
    x = coordinates(trajectory, t)
    return Nodes(t, x, _moved(trajectory, fine)[np.searchsorted(fine, t)], arm.placements(x))


def node_times(trajectory: JointTrajectory, fastest: Array, step_m: float, marks: Sequence[float]) -> Array:
    """Choose instants (n,), s, from start to end, `marks` among them.

    What moves by at most `fastest` (k + 1,) m per unit of each coordinate moves by at most `step_m` from one to the
    next.
    """
    grid = _grid(trajectory, 0.0, trajectory.duration, np.array(marks))
    way = _moved(trajectory, grid) @ fastest  # its speed is even from one instant of the grid to the next
    steps = np.linspace(0.0, way[-1], int(np.ceil(way[-1] / step_m)) + 1)
    return np.unique(np.concatenate((np.interp(steps, way, grid), (0.0, trajectory.duration), marks)))


def _grid(trajectory: JointTrajectory, start: float, end: float, also: Array) -> Array:
    """Return instants from start to end (s), no knot between two of them."""
    even = np.linspace(start, end, min(int((end - start) / GRID_S) + 2, MOST_GRID))
    every = (even, trajectory.knots, trajectory.gripper_t, also)
    t = np.unique(np.concatenate(every))
    return t[(t >= start) & (t <= end)]


def coordinates(trajectory: JointTrajectory, t: Array) -> Array:
    """Return joints and opening (n, k + 1) at instants (n,), s."""
    q, _, _ = _motion(trajectory, np.searchsorted(trajectory.knots, t) - 1, t)
    return np.column_stack((q, np.interp(t, trajectory.gripper_t, trajectory.gripper_opening)))


def _moved(trajectory: JointTrajectory, t: Array) -> Array:
    """How far each coordinate has gone at most (n, k + 1) since the first of instants (n,) with no knot between."""
    step = np.diff(t)[:, None]
    piece = np.searchsorted(trajectory.knots, 0.5 * (t[:-1] + t[1:])) - 1
    _, qd_start, qdd_start = _motion(trajectory, piece, t[:-1])
    _, qd_end, qdd_end = _motion(trajectory, piece, t[1:])
    # The acceleration changes evenly, and no instant is farther than half a step from one of the two.
    speed = np.maximum(np.abs(qd_start), np.abs(qd_end)) + 0.5 * step * np.maximum(np.abs(qdd_start), np.abs(qdd_end))
    opening = np.abs(np.diff(np.interp(t, trajectory.gripper_t, trajectory.gripper_opening)))
    moved = np.zeros((len(t), speed.shape[1] + 1))
    np.cumsum(np.column_stack((step * speed, opening)), axis=0, out=moved[1:])
    return moved


def _motion(trajectory: JointTrajectory, piece: NDArray[np.int64], t: Array) -> tuple[Array, Array, Array]:
    """Return q, qd, qdd (n, k) of pieces (n,) at instants (n,)."""
    piece = piece.clip(0, len(trajectory.coefficients) - 1)
    s = (t - trajectory.knots[piece])[:, None]
    c0, c1, c2, c3 = np.moveaxis(trajectory.coefficients[piece], 1, 0)
    return c0 + s * (c1 + s * (c2 + s * c3)), c1 + s * (2.0 * c2 + s * 3.0 * c3), 2.0 * c2 + 6.0 * s * c3
