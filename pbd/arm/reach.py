"""Sampled configurations of an arm and where they put its tool: where inverse kinematics starts from.

Taking 20,000 samples at once takes a few milliseconds, so nothing is kept on disk. Nor is there a search tree: a plan
asks for a few dozen neighbourhoods, and a matrix product answers each in a fraction of a millisecond.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pbd.arm.model import ArmModel
from pbd.pose import Array, Pose, quat_to_matrix

SAMPLES = 20_000
ROTATION_WEIGHT_M = 0.3
"""A difference of one in the rotation matrix counts as much as this many metres."""

_CLIMBERS = 4
_ENOUGH_M = 1e-5
_BLOCK = 2_000  # poses at a time, so that the work stays in the processor's cache


@lru_cache(maxsize=4)
def reach_map(arm: ArmModel) -> ReachMap:
    """Sample an arm, once per model."""
    return ReachMap(arm)


def farthest(arm: ArmModel) -> float:
    """How far from the z axis of base, in m, the arm brings its tool: sampled, then climbed from the best samples."""
    q = reach_map(arm).q
    p, _ = arm.forward_many(q)
    best = q[np.argsort(-np.hypot(p[:, 0], p[:, 1]))[:_CLIMBERS]].astype(np.float64)
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


class ReachMap:
    """Configurations drawn uniformly between the joint limits, the same ones each time.

    Attributes:
        q: (SAMPLES, k) rad, in no order.
    """

    def __init__(self, arm: ArmModel) -> None:
        lower, upper = arm.limits.lower, arm.limits.upper
        # A joint that can turn further repeats itself; the turn to stand at is chosen later (sequence.py).
        turn_and_more = upper - lower > 2.0 * np.pi
        middle = np.clip(0.0, lower + np.pi, np.maximum(lower, upper - np.pi))
        lower = np.where(turn_and_more, middle - np.pi, lower)
        upper = np.where(turn_and_more, middle + np.pi, upper)
        unit = np.random.default_rng(seed=0).random((SAMPLES, len(lower)), dtype=np.float32)
        self.q = lower.astype(np.float32) + unit * (upper - lower).astype(np.float32)
        self._features = np.empty((SAMPLES, 12), np.float32)
        for start in range(0, SAMPLES, _BLOCK):
            block = slice(start, start + _BLOCK)
            p, R = arm.forward_many(self.q[block])
            self._features[block, :3] = p
            self._features[block, 3:] = ROTATION_WEIGHT_M * R.reshape(-1, 9)
        self._half_square = 0.5 * np.einsum("ij,ij->i", self._features, self._features)

    def nearest(self, T_base_tool: Pose, count: int) -> Array:
        """Return the (count, k) configurations whose tool is nearest to a pose, nearest first."""
        rotation = ROTATION_WEIGHT_M * quat_to_matrix(T_base_tool.wxyz)
        wanted = np.concatenate((T_base_tool.p, rotation.ravel())).astype(np.float32)
        # Half the squared distance, less what is the same for all.
        distance = self._half_square - self._features @ wanted
        found = np.argpartition(distance, count)[:count]
        return self.q[found[np.argsort(distance[found])]].astype(np.float64)
