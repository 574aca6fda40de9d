"""Where inverse kinematics starts from: sampled configurations of an arm, found by where they put its tool.

A hundred thousand samples are sorted by tool pose into leaves of eight neighbours, halving the lot again and
again. Each leaf keeps two: the one that is farthest from singularities and joint limits, from which a descent mostly
arrives, and the one that is nearest to them, for poses that can be reached in no other way. That takes about a second
and follows from the arm's kinematics alone, so it is kept in the user's cache folder.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.arm.model import ArmModel, FloatArray
from pbd.arm.reach import sample
from pbd.arm.tool import Target
from pbd.cache import recall, remember
from pbd.pose import Array

VERSION = 1
"""Part of the cache's key: raise it when the same arm would get other seeds."""
SAMPLES = 2**17
LEAF = 8
ROTATION_WEIGHT_M = 0.3
"""A difference of one in the rotation matrix counts as much as this many metres."""
CLUMSY = 0.25
"""The share of configurations that are clumsy: nearer to singular than the others."""
MARGIN_RAD = 0.3
"""Farther from its limits than this a joint is far enough."""

_BLOCK = 64  # seeds that are neighbours, looked through together
_BLOCKS = 8  # are looked through for one pose
_AT_ONCE = 4096  # poses, so that the work stays in the processor's cache
_STEP_RAD = 1e-6


@lru_cache(maxsize=4)
def seed_map(arm: ArmModel) -> SeedMap:
    """Sample an arm, or take its samples from the cache."""
    key = hashlib.sha256(repr((VERSION, SAMPLES, LEAF, ROTATION_WEIGHT_M, CLUMSY, MARGIN_RAD)).encode())
    links = np.array([np.vstack((step.offset, step.turn)) for step in arm.steps])
    slides = np.array([step.joint == "slides" for step in arm.steps[:-1]])
    for constants in (links, slides, arm.limits.lower, arm.limits.upper):
        key.update(constants.tobytes())
    kept = recall("seeds", key.hexdigest())
    if kept is None:
        kept = _build(arm)
        remember("seeds", key.hexdigest(), kept)
    return SeedMap(kept["q"], kept["features"], float(kept["clumsy"]))


class SeedMap:
    """An arm's seeds.

    Attributes:
        q: (2, n, k) rad: of each leaf the best placed configuration, and the worst.
        features: (2, n, 12): where they put the tool, p and 0.3 R, m.
        clumsy: the manipulability that one configuration in four hasn't.
    """

    def __init__(self, q: Array, features: FloatArray, clumsy: float) -> None:
        self.q, self.features, self.clumsy = q, features, clumsy
        self._blocks = features.reshape(2, -1, _BLOCK, 12)
        self._centres = self._blocks.mean(axis=2)
        self._half_squares = 0.5 * np.einsum("lbif,lbif->lbi", self._blocks, self._blocks)
        self._half_centres = 0.5 * np.einsum("lbf,lbf->lb", self._centres, self._centres)

    def nearest(self, target: Target, count: int, *, worst: bool = False) -> Array:
        """Return the (count, k) well placed seeds, or the `worst` placed, whose tool is nearest to a pose.

        Nearest first; of those in the neighbourhood: one farther off may be nearer.
        """
        wanted, side = _wanted(target), int(worst)
        blocks = self._near(side, wanted)
        # Half the squared distance, less what is the same for all.
        distance = (self._half_squares[side][blocks] - self._blocks[side][blocks] @ wanted).ravel()
        order = np.argsort(distance)[:count]
        q: Array = self.q[side][blocks[order // _BLOCK] * _BLOCK + order % _BLOCK]
        return q

    def around(self, target: Target) -> Array:
        """Return all well placed seeds (m, k) in the neighbourhood of a pose."""
        blocks = self._near(0, _wanted(target))
        k = self.q.shape[2]
        q: Array = self.q[0].reshape(-1, _BLOCK, k)[blocks].reshape(-1, k)
        return q

    def at(self, p: Array, count: int) -> Array:
        """Return the (count, k) seeds of both kinds whose tool is nearest to a place p (3,) in base, however turned."""
        off = self.features[:, :, :3] - p.astype(np.float32)
        distance = np.einsum("lif,lif->li", off, off).ravel()
        found = np.argpartition(distance, count)[:count]
        q: Array = self.q.reshape(-1, self.q.shape[2])[found[np.argsort(distance[found])]]
        return q

    def _near(self, side: int, wanted: FloatArray) -> NDArray[np.int64]:
        """Say which blocks have the nearest centres."""
        to_centre = self._half_centres[side] - self._centres[side] @ wanted
        blocks: NDArray[np.int64] = np.argpartition(to_centre, _BLOCKS)[:_BLOCKS]
        return blocks

    def anywhere(self, count: int) -> Array:
        """Return (count, k) seeds from all over, the same ones each time."""
        seeds = self.q.reshape(-1, self.q.shape[2])
        chosen: Array = seeds[np.random.default_rng(seed=1).integers(len(seeds), size=count)]
        return chosen


def manipulability(J: Array) -> Array:
    """Return Yoshikawa's measure (n,) of Jacobians (n, 6, k): sqrt(det(J J^T)), zero where an arm is singular.

    ("Manipulability of Robotic Mechanisms", 1985.) Of fewer than six joints, sqrt(det(J^T J)).
    """
    transposed = J.transpose(0, 2, 1)
    square = J @ transposed if J.shape[2] >= 6 else transposed @ J
    measure: Array = np.sqrt(np.maximum(np.linalg.det(square), 0.0))
    return measure


def _build(arm: ArmModel) -> dict[str, NDArray[Any]]:
    q = sample(arm, SAMPLES)
    features, dexterity = np.empty((SAMPLES, 12), np.float32), np.empty(SAMPLES)
    for start in range(0, SAMPLES, _AT_ONCE):
        block = slice(start, start + _AT_ONCE)
        features[block], dexterity[block] = _look(arm, q[block])
    margin = np.minimum(q - arm.limits.lower, arm.limits.upper - q).min(axis=1)
    placed = np.minimum(dexterity / np.median(dexterity), 1.0) + np.minimum(margin / MARGIN_RAD, 1.0)
    leaves = _leaves(features)
    each = np.take_along_axis(leaves, np.stack((placed[leaves].argmax(1), placed[leaves].argmin(1)), axis=1), axis=1)
    return {
        "q": q[each.T],
        "features": features[each.T],
        "clumsy": np.array(np.quantile(dexterity, CLUMSY)),
    }


def _wanted(target: Target) -> FloatArray:
    wanted = np.empty(12, np.float32)
    wanted[:3], wanted[3:] = target.p, ROTATION_WEIGHT_M * target.R.ravel()
    return wanted


def _look(arm: ArmModel, q: Array) -> tuple[FloatArray, Array]:
    """Return the features (n, 12) of configurations (n, k), and their manipulability (n,); J by differences."""
    p, R = arm.forward_many(q)
    J = np.empty((len(q), 6, q.shape[1]))
    for joint in range(q.shape[1]):
        moved = q.copy()
        moved[:, joint] += _STEP_RAD
        p_moved, R_moved = arm.forward_many(moved)
        turn = (R_moved - R) @ R.transpose(0, 2, 1) / _STEP_RAD
        J[:, :3, joint] = (p_moved - p) / _STEP_RAD
        J[:, 3, joint], J[:, 4, joint], J[:, 5, joint] = turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]
    return np.hstack((p, ROTATION_WEIGHT_M * R.reshape(-1, 9))).astype(np.float32), manipulability(J)


def _leaves(features: FloatArray) -> NDArray[np.int64]:
    """Sort samples into (n, LEAF) neighbours, and leaves beside each other: halve at the median where they spread."""
    groups = np.arange(len(features))[None]
    while groups.shape[1] > LEAF:
        half = groups.shape[1] // 2
        split = np.empty((2 * len(groups), half), np.int64)
        for i, group in enumerate(groups):
            members = features[group]
            widest = members[:, members.var(axis=0).argmax()]
            split[2 * i : 2 * i + 2] = group[np.argpartition(widest, half)].reshape(2, half)
        groups = split
    return groups
