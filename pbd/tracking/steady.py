"""Moments at which the accelerometer sees gravity and next to nothing else: the gyro can be held against it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array, quat_cumulative, quat_exp

WINDOW_S = 0.2
"""A moment lasts this long ..."""

STEADY_ACC, STEADY_NORM = 0.05, 0.02
"""... over which specific force varies by less than this (rms, as a share of g) and is g to this share."""

QUIET = 4.0
"""Of the seconds in which specific force varies by up to so many times the least variance, the one that turns least is
the quietest."""


@dataclass(frozen=True, eq=False)
class Steady:
    """Steady moments of a recording.

    Attributes:
        rows: (m,) the first row of each moment's second half.
        up_sensor: (m, 3) unit, the vertical in sensor axes at each.
        turning: (m,) rad/s, how fast the sensor turns meanwhile, by the gyro (rms).
        gyro_bias: (3,) rad/s, the gyro's mean over the quietest second.
    """

    rows: NDArray[np.intp]
    up_sensor: Array
    turning: Array
    gyro_bias: Array


def find_steady(acc: Array, gyr: Array, rate_hz: float) -> Steady:
    """Find the steady moments of acc (n, 3) and gyr (n, 3) rad/s, without NaN; g is taken from the quietest second."""
    second, half = max(2, round(rate_hz)), max(1, round(0.5 * WINDOW_S * rate_hz))
    if len(acc) < max(second, 2 * half):
        return Steady(np.zeros(0, dtype=np.intp), np.zeros((0, 3)), np.zeros(0), np.zeros(3))
    variance, mean = window_moments(acc, second)
    # A turn about the vertical leaves the accelerometer as quiet as a rest.
    rate = np.where(variance <= QUIET * variance.min(), window_sums(squares(gyr), second), np.inf)
    quietest = int(np.argmin(rate))
    g = float(np.linalg.norm(mean[quietest]))
    variance, mean = window_moments(acc, 2 * half)
    norm = np.linalg.norm(mean, axis=1)
    steady = np.flatnonzero((np.abs(norm - g) < STEADY_NORM * g) & (variance < (STEADY_ACC * g) ** 2) & (norm > 0.0))
    bias = gyr[quietest : quietest + second].mean(axis=0)
    spread, rate = window_moments(gyr - bias, 2 * half)
    turning = np.sqrt(spread + (rate**2).sum(axis=1))
    return Steady(steady + half, mean[steady] / norm[steady, None], turning[steady], bias)


def carried(gyr: Array, dt: float) -> Array:
    """Attitudes (n + 1, 4) at the edges of samples of gyr (n, 3) rad/s, the first edge's being the identity."""
    return np.vstack(((1.0, 0.0, 0.0, 0.0), quat_cumulative(quat_exp(gyr * dt))))


def window_moments(values: Array, n: int) -> tuple[Array, Array]:
    """Variance summed over the axes (m,) and mean (m, k) of each window of n samples (., k)."""
    offset = values.mean(axis=0)  # taken out, which keeps the difference of squares well conditioned
    centred = values - offset
    mean = window_sums(centred, n) / n
    variance = window_sums(squares(centred), n) / n - squares(mean)
    return np.maximum(variance, 0.0), mean + offset


def window_sums(values: Array, n: int) -> Array:
    """Sums over each window of n samples: (l,) or (l, k) -> (l - n + 1,) or (l - n + 1, k)."""
    sums = np.zeros((len(values) + 1, *values.shape[1:]))
    np.cumsum(values, axis=0, out=sums[1:])
    windows: Array = sums[n:] - sums[:-n]
    return windows


def median(values: Array) -> Array:
    """Along the first axis; of a short one numpy's own takes ten times as long."""
    low, high = (len(values) - 1) // 2, len(values) // 2
    parted = np.partition(values, (low, high), axis=0)
    middle: Array = 0.5 * (parted[low] + parted[high])
    return middle


def squares(vectors: Array) -> Array:
    """Squared lengths of vectors (m, k) -> (m,); of many short ones numpy's sum(axis=1) takes ten times as long."""
    total = np.zeros(len(vectors))
    for column in vectors.T:
        total += column * column
    return total
