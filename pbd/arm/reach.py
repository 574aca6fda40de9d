"""Random configurations of an arm, and its reach: the largest distance of its tool from base's z axis."""

from __future__ import annotations

import numpy as np

from pbd.arm.model import ArmModel
from pbd.pose import Array

_SAMPLES = 20_000
_STARTS = 4  # best samples from which the distance is maximized
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


def reach(arm: ArmModel) -> float:
    """Return the largest distance of the tool from base's z axis, m, optimized from the best samples."""
    from scipy.optimize import Bounds, minimize  # loads slowly

    def minus_distance(q: Array) -> tuple[float, Array]:
        p, _, J = arm.tool(q)
        distance = max(float(np.hypot(p[0], p[1])), _ON_AXIS_M)
        return -distance, -(p[:2] / distance) @ J[:2]

    q = sample_joints(arm, _SAMPLES)
    p, _ = arm.forward_many(q)
    best = q[np.argsort(-np.hypot(p[:, 0], p[:, 1]))[:_STARTS]]
    bounds = Bounds(arm.limits.lower, arm.limits.upper)
    return max(-float(minimize(minus_distance, each, jac=True, bounds=bounds, method="L-BFGS-B").fun) for each in best)
