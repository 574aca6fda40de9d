"""Seeds for inverse kinematics: sampled configurations of an arm, looked up by the pose of their tool."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin

from pbd.arm.model import ArmModel, FloatArray
from pbd.arm.reach import sample
from pbd.pose import Array

SAMPLES = 10_000
ROTATION_WEIGHT_M = 0.3
"""A difference of one in the rotation matrix counts as much as this many metres."""
CLUMSY = 0.25
"""Share of configurations that count as nearly singular."""

_MEASURED = 500  # samples from which the manipulability of that share is taken


class Starts:
    """Uniform samples of an arm's configurations, the same ones each time.

    Attributes:
        q: (n, k) rad.
        p: (n, 3) m, the tool's positions.
        clumsy: 25th percentile of manipulability.
    """

    def __init__(self, arm: ArmModel) -> None:
        self.q = sample(arm, SAMPLES)
        self.p, R = arm.forward_many(self.q.astype(np.float32))
        self._features = np.hstack((self.p, ROTATION_WEIGHT_M * R.reshape(-1, 9)))
        self._half_squares = 0.5 * np.einsum("nf,nf->n", self._features, self._features)
        J = np.array([arm.jacobian(q) for q in self.q[:_MEASURED]])
        self.clumsy = float(np.quantile(manipulability(J), CLUMSY))

    def nearest(self, goal: pin.SE3, count: int) -> Array:
        """Return the (count, k) samples whose tool is nearest to a pose, nearest first."""
        wanted = np.concatenate((goal.translation, ROTATION_WEIGHT_M * goal.rotation.ravel())).astype(np.float32)
        # Half the squared distance, without the term common to all samples. A tree in twelve dimensions is no faster.
        return self._least(self._half_squares - self._features @ wanted, count)

    def at(self, p: Array, count: int) -> Array:
        """Return the (count, k) samples whose tool is nearest to a position p (3,) in base, in any rotation."""
        return self._least(np.linalg.norm(self.p - p, axis=1), count)

    def _least(self, distance: FloatArray, count: int) -> Array:
        found = np.argpartition(distance, count)[:count]
        q: Array = self.q[found[np.argsort(distance[found])]]
        return q


starts_of = lru_cache(maxsize=4)(Starts)
"""Samples an arm, once."""


def manipulability(J: Array) -> Array:
    """Return Yoshikawa's measure (n,) of Jacobians (n, 6, k): sqrt(det(J J^T)), zero where an arm is singular.

    ("Manipulability of Robotic Mechanisms", 1985.) Of fewer than six joints, sqrt(det(J^T J)).
    """
    transposed = J.transpose(0, 2, 1)
    square = J @ transposed if J.shape[2] >= 6 else transposed @ J
    measure: Array = np.sqrt(np.maximum(np.linalg.det(square), 0.0))
    return measure
