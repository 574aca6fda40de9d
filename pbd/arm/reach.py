"""An arm's reach: the largest distance of its tool from base's z axis."""

from __future__ import annotations

import numpy as np

from pbd.arm.ik.starts import sample_joints
from pbd.arm.model import ArmModel
from pbd.pose import Array

_SAMPLES = 20_000
_STARTS = 4  # best samples from which the distance is maximized
_ON_AXIS_M = 1e-9  # keeps the gradient finite for a tool on the axis


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
