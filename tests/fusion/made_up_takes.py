"""Marginals of takes of a made-up task, without recordings."""

from dataclasses import dataclass

import numpy as np

from pbd.fusion.joint_estimate import Observations, TaskState
from pbd.fusion.marginals import DEVICE_ERRORS, Marginal
from pbd.pose import Array, quat_about_z, quat_exp, quat_to_matrix

PRIOR = np.diag(np.concatenate((np.full(16, 1e4), [1e3], np.full(3, 25.0))))


@dataclass(frozen=True, eq=False)
class Truth:
    """A task's keyframes m, A, and how each take differs from the first: see `pbd.fusion.joint_estimate`."""

    m: Array
    A: Array
    yaw: Array
    c: Array
    Q: Array
    lever: Array


def rotations(vectors: Array) -> Array:
    """Return rotation matrices (..., 3, 3) of rotation vectors."""
    return quat_to_matrix(quat_exp(vectors))


def truth(takes: int, seed: int = 0, count: int = 6) -> Truth:
    """Draw a task of `count` keyframes; the first take defines the frame."""
    rng = np.random.default_rng(seed)
    moved = (np.arange(takes) > 0)[:, None]
    return Truth(
        rng.uniform(-0.2, 0.2, (count, 3)),
        rotations(0.8 * rng.normal(size=(count, 3))),
        moved[:, 0] * rng.uniform(-3.0, 3.0, takes),
        moved * rng.normal(size=(takes, 3)),
        rotations(moved * rng.normal(size=(takes, 3))),
        moved * 0.01 * rng.normal(size=(takes, 3)),
    )


def observations(true: Truth, hand: Array, sigma: float, seed: int = 0, off: Array | None = None) -> Observations:
    """Return what takes of a task show, if the device's errors are known.

    Args:
        hand: m, one sigma by which the hand misses a keyframe.
        sigma: m, one sigma of tracking; in rotation it is a hundredth of that in rad.
        off: (K, J, 3) m, added to the positions.
    """
    rng, marginals = np.random.default_rng(seed), []
    takes, count = len(true.yaw), len(true.m)
    for k in range(takes):
        back = quat_to_matrix(quat_about_z(-float(true.yaw[k])))
        p = true.m + hand * rng.normal(size=(count, 3)) + true.A @ true.lever[k] - true.c[k]
        p = p + (0.0 if off is None else off[k]) + sigma * rng.normal(size=(count, 3))
        R = back @ true.A @ true.Q[k].T
        cov = np.diag(np.tile(np.repeat((sigma**2, (0.01 * sigma) ** 2), 3), count)) + 1e-14 * np.eye(6 * count)
        none, zero = np.zeros(DEVICE_ERRORS), np.zeros((DEVICE_ERRORS, DEVICE_ERRORS))
        by_device = np.zeros((6 * count, DEVICE_ERRORS))
        marginals.append(Marginal(p @ back.T, R, by_device, cov, none, zero, none, PRIOR, none))
    take, at = np.divmod(np.arange(takes * count), count)
    return Observations(tuple(marginals), take, at, at, (0,) * takes, np.zeros(count, dtype=np.intp))


def initial_state(true: Truth) -> TaskState:
    """Return an initial state near the truth, such as alignment gives."""
    return TaskState(
        true.m + 0.003,
        rotations(np.full(3, 0.02)) @ true.A,
        (true.yaw + 0.02 * (true.yaw != 0.0))[None],
        true.c[None],
        true.Q,
        np.tile(np.eye(3), (len(true.Q), 1, 1)),
        np.zeros_like(true.lever),
        np.zeros((1, DEVICE_ERRORS)),
    )
