"""Sums, means and variances over windows that slide along a recording."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array

MEAN_S, MEANS = 0.0125, 4
"""A hand's motion is judged by moving means over MEAN_S s, taken MEANS times. Shaking of 60 Hz and more (a motor, a
phone that vibrates, or what a slower sampling makes of them) moves the hand nowhere; these means keep less than 1 % of
it. The mean over a sample of a sensor of 40 Hz, which finds the same stops, is two such means."""


def rows_of_mean(rate_hz: float) -> int:
    """Rows in MEAN_S."""
    return max(1, round(MEAN_S * rate_hz))


def window_moments(values: Array, n: int) -> tuple[Array, Array]:
    """Variance summed over the axes (m,) and mean (m, k) of each window of n samples (., k)."""
    # About the mean is taken out, which keeps the difference of squares well conditioned.
    offset = values[:: 1 + len(values) // 1000].mean(axis=0)
    centred = values - offset
    mean = window_sums(centred, n) / n
    variance = window_sums(squares(centred), n) / n - squares(mean)
    return np.maximum(variance, 0.0), mean + offset


def calm_variance(values: Array, n: int, k: int) -> Array:
    """That variance of what `calmed` leaves, by means over k samples, in each window of n samples."""
    return window_moments(calmed(values, k), n - MEANS * (k - 1))[0]


def cumulative(steps: Array) -> Array:
    """Sums of the first 0, 1, ... n steps (n, ...)."""
    sums = np.zeros((len(steps) + 1, *steps.shape[1:]))
    np.cumsum(steps, axis=0, out=sums[1:])
    return sums


def window_sums(values: Array, n: int) -> Array:
    """Sums over each window of n samples: (l,) or (l, k) -> (l - n + 1,) or (l - n + 1, k)."""
    sums = cumulative(values)
    windows: Array = sums[n:] - sums[:-n]
    return windows


def calmed(values: Array, n: int, means: int = MEANS) -> Array:
    """Moving means over n samples, taken `means` times: (l, k) -> (l - means (n - 1), k)."""
    if n == 1:
        return values
    weights = _weights(n, means)
    return np.stack([np.convolve(column, weights, "valid") for column in values.T], axis=1)


def whiteness(n: int, means: int = MEANS) -> float:
    """Variance of `calmed` white noise, whose own is 1."""
    weights = _weights(n, means)
    return float(weights @ weights)


def _weights(n: int, means: int) -> Array:
    weights = np.ones(1)
    for _ in range(means):
        weights = np.convolve(weights, np.full(n, 1.0 / n))
    return weights


def window_maxima(values: NDArray[Any], n: int) -> NDArray[Any]:
    """Largest of each window of n samples (l,) -> (l - n + 1,), from windows half as long (scipy's loads for 0.1 s)."""
    span = 1
    while span < n:
        step = min(span, n - span)
        values, span = np.maximum(values[:-step], values[step:]), span + step
    return values


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
