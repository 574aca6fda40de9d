"""Seeds for inverse kinematics: sampled configurations of an arm, searched by their tool pose."""

from functools import lru_cache

import numpy as np
import pinocchio as pin

from pbd.arm.model import ArmModel, FloatArray
from pbd.pose import Array

SAMPLES = 10_000
ROTATION_WEIGHT_M = 0.3
"""Weight of a difference of 1 in an element of the rotation matrix, m."""
STILL = 1e-3
"""Singular value of a Jacobian, m or rad per rad, below which the joints don't move the tool in that direction. The
bundled arms reach 0.08 or more; axes that are parallel but for a URDF's rounded angles (1.571) stay below 3e-4."""

_MEASURED = 500  # samples of which that percentile of manipulability is computed
_REACH_STARTS = 4  # number of samples, the farthest, from which the reach is maximized
_ON_AXIS_M = 1e-9  # keeps the gradient finite for a tool on the axis


def sample_joints(arm: ArmModel, count: int) -> Array:
    """Draw configurations (count, k) uniformly between the joint limits, with a fixed seed.

    A joint with a range of more than one turn is sampled over one turn; ladder_building.py chooses whole turns later.
    """
    lower, upper = arm.limits.lower, arm.limits.upper
    endless = upper - lower > 2.0 * np.pi
    middle = np.clip(0.0, lower + np.pi, np.maximum(lower, upper - np.pi))
    lower, upper = np.where(endless, middle - np.pi, lower), np.where(endless, middle + np.pi, upper)
    return np.random.default_rng(seed=0).uniform(lower, upper, (count, len(lower)))


class Starts:
    """Uniform samples of an arm's configurations, with a fixed seed.

    Attributes:
        q: (n, k) rad.
        p: (n, 3) m, the tool's positions.
        low_manipulability: 25th percentile of manipulability; rounding errors or zero for an arm that is singular in
            every configuration, for example with two joints on one axis.
        directions: number of directions in which the joints can move the tool, 6 for most arms of six joints or more.
    """

    def __init__(self, arm: ArmModel) -> None:
        self.q = sample_joints(arm, SAMPLES)
        self.p, R = arm.forward_many(self.q.astype(np.float32))
        self._features = np.hstack((self.p, ROTATION_WEIGHT_M * R.reshape(-1, 9)))
        self._half_squares = 0.5 * np.einsum("nf,nf->n", self._features, self._features)
        J = np.array([arm.jacobian(q) for q in self.q[:_MEASURED]])
        self.low_manipulability = float(np.quantile(manipulability(J), 0.25))
        self.directions = int(np.linalg.matrix_rank(J, tol=STILL).max())

    def nearest(self, goal: pin.SE3, count: int) -> Array:
        """Return the (count, k) samples whose tool is nearest to a pose, nearest first."""
        wanted = np.concatenate((goal.translation, ROTATION_WEIGHT_M * goal.rotation.ravel())).astype(np.float32)
        # Half the squared distance, without the term common to all samples; a k-d tree in 12 dimensions is no faster.
        return self._least(self._half_squares - self._features @ wanted, count)

    def at(self, p: Array, count: int) -> Array:
        """Return the (count, k) samples whose tool is nearest to a position p (3,) in base, in any rotation."""
        return self._least(np.linalg.norm(self.p - p, axis=1), count)

    def _least(self, distance: FloatArray, count: int) -> Array:
        found = np.argpartition(distance, count)[:count]
        q: Array = self.q[found[np.argsort(distance[found])]]
        return q


starts_of = lru_cache(maxsize=16)(Starts)
"""Returns an arm's samples, cached."""


def distinct(q: Array, most: int, distance: float) -> Array:
    """Keep the first `most` configurations of q (m, k) that differ from all others kept by more than `distance`, rad,
    in some joint."""
    left, kept = q, list[Array]()
    while len(left) and len(kept) < most:
        kept.append(left[0])
        left = left[np.abs(left - left[0]).max(axis=1) > distance]
    return np.array(kept).reshape(-1, q.shape[1])


def relative_manipulability(arm: ArmModel, q: Array) -> Array:
    """Return the manipulability (m,) at joints (m, k) relative to the arm's own 25th percentile.

    For an arm that is singular in every configuration it is 1: none is worse than another.
    """
    starts = starts_of(arm)
    if starts.directions < min(6, q.shape[1]):
        return np.ones(len(q))
    return manipulability(np.array([arm.jacobian(each) for each in q])) / starts.low_manipulability


def manipulability(J: Array) -> Array:
    """Return Yoshikawa's manipulability (n,) of Jacobians (n, 6, k): sqrt(det(J J^T)), zero for a singular arm.

    For fewer than six joints it is sqrt(det(J^T J)). ("Manipulability of Robotic Mechanisms", 1985.)
    """
    transposed = J.transpose(0, 2, 1)
    square = J @ transposed if J.shape[2] >= 6 else transposed @ J
    measure: Array = np.sqrt(np.maximum(np.linalg.det(square), 0.0))
    return measure


def reach(arm: ArmModel) -> float:
    """Return the largest distance of the tool from base's z axis, m, optimized from the best samples."""
    from scipy.optimize import Bounds, minimize  # loads slowly

    def minus_distance(q: Array) -> tuple[float, Array]:
        p, _, J = arm.tool_with_jacobian(q)
        distance = max(float(np.hypot(p[0], p[1])), _ON_AXIS_M)
        return -distance, -(p[:2] / distance) @ J[:2]

    samples = starts_of(arm)
    best = samples.q[np.argsort(-np.hypot(samples.p[:, 0], samples.p[:, 1]))[:_REACH_STARTS]]
    bounds = Bounds(arm.limits.lower, arm.limits.upper)
    return max(-float(minimize(minus_distance, each, jac=True, bounds=bounds, method="L-BFGS-B").fun) for each in best)
