"""How far an arm reaches: sampled configurations, and the one that brings its tool farthest."""

from __future__ import annotations

import numpy as np

from pbd.arm.model import ArmModel
from pbd.pose import Array, quat_to_matrix

_SAMPLES = 20_000
_CLIMBERS = 4
_ENOUGH_M = 1e-5


def sample(arm: ArmModel, count: int) -> Array:
    """Draw configurations (count, k) uniformly between the joint limits, the same ones each time.

    A joint that can turn further is sampled over one turn, as the rest repeats it; which turn is chosen later
    (joint_path.py).
    """
    lower, upper = arm.limits.lower, arm.limits.upper
    further = upper - lower > 2.0 * np.pi
    middle = np.clip(0.0, lower + np.pi, np.maximum(lower, upper - np.pi))
    lower, upper = np.where(further, middle - np.pi, lower), np.where(further, middle + np.pi, upper)
    return np.random.default_rng(seed=0).uniform(lower, upper, (count, len(lower)))


def farthest(arm: ArmModel) -> float:
    """How far from the z axis of base, in m, the arm brings its tool: sampled, then climbed from the best samples."""
    q = sample(arm, _SAMPLES)
    p, _ = arm.forward_many(q)
    best = q[np.argsort(-np.hypot(p[:, 0], p[:, 1]))[:_CLIMBERS]]
    return max(_climb(arm, start) for start in best)


def _climb(arm: ArmModel, q: Array) -> float:
    """Follow the gradient of the tool's distance from base's z axis, in longer steps as long as they lead up."""
    pose, gained, step = arm.forward(q), np.inf, 1.0
    distance = float(np.hypot(*pose.p[:2]))
    while gained > _ENOUGH_M:
        outward = np.array([*pose.p[:2], 0.0]) / max(distance, _ENOUGH_M)
        gradient = outward @ quat_to_matrix(pose.wxyz) @ arm.jacobian(q)[:3]
        while True:
            q_next = np.clip(q + step * gradient, arm.limits.lower, arm.limits.upper)
            pose = arm.forward(q_next)
            gained = float(np.hypot(*pose.p[:2])) - distance
            if gained > 0.0 or step < 1e-3:
                break
            step *= 0.5
        q, distance, step = q_next, distance + max(gained, 0.0), 2.0 * step
    return distance
