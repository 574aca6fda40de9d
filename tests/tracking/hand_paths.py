"""Hand paths from given stops and given covariances of the moves."""

import numpy as np

from pbd.data import HandPath, Stop
from pbd.data.covariance import PoseCovariance
from pbd.pose import Array

DT, REST, MOVE = 0.05, 10, 20
"""Sampling interval, s, and number of samples in a stop and in a move of the paths below."""


def mid(stop: int) -> float:
    """A time in the middle of a stop of `hand_path`, s."""
    return DT * (stop * (REST + MOVE) + REST // 2)


def hand_path(p_stop: Array, moves: Array, wxyz: Array | None = None) -> HandPath:
    """A hand that stops at positions (k, 3) m with attitudes (k, 4), from its moves' covariances (k - 1, 3, 3)."""
    k = len(p_stop)
    stops = tuple(Stop(i * (REST + MOVE), i * (REST + MOVE) + REST, REST * DT) for i in range(k))
    n = stops[-1].stop
    t = DT * np.arange(n, dtype=np.float64)
    held = np.concatenate([[stop.start, stop.stop - 1] for stop in stops])
    p = np.column_stack([np.interp(t, t[held], np.repeat(axis, 2)) for axis in np.transpose(p_stop)])
    cov = np.zeros((k, 6, 6))
    cov[1:, :3, :3] = np.cumsum(moves, axis=0)
    attitude = np.tile((1.0, 0.0, 0.0, 0.0), (k, 1)) if wxyz is None else wxyz
    of_stop = np.minimum(np.arange(n) // (REST + MOVE), k - 1)
    return HandPath(t, p, np.zeros((n, 3)), attitude[of_stop], stops, np.zeros((k - 1, 3)), PoseCovariance.chained(cov))


def at_stops(path: HandPath) -> Array:
    return path.p_nav_sensor[[stop.start for stop in path.stops]]


def covariances(rng: np.random.Generator, k: int, sigma: float) -> Array:
    """Random covariances (k, 3, 3); some moves are far less certain than others."""
    root = sigma * rng.uniform(0.03, 1.0, (k, 1, 1)) * rng.normal(size=(k, 3, 3))
    return np.array(root @ root.transpose(0, 2, 1))
