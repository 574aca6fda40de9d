"""Sums, means, variances and maxima over moving windows."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.frozen_arrays import readonly
from pbd.pose import Array

Rows = NDArray[np.intp]
"""Rows of a recording."""

Spans = list[tuple[int, int]]
"""Half-open ranges of rows, in order."""

MEAN_S, PASSES = 0.0125, 4
"""Length, s, and number of passes of the moving mean before a hand's motion is judged. Of vibration of 60 Hz or more (a
motor, a phone that vibrates, or its alias at a slower rate) less than 1 % passes."""


def rows_of_mean(rate_hz: float) -> int:
    """Number of rows in MEAN_S."""
    return max(1, round(MEAN_S * rate_hz))


def window_moments(values: Array, n: int) -> tuple[Array, Array]:
    """Variance summed over the axes (m,), and mean (m, k), of each window of n samples of values (., k)."""
    # An approximate mean is subtracted first, to keep the difference of squares well conditioned.
    offset = values[:: 1 + len(values) // 1000].mean(axis=0)
    centred = values - offset
    mean = window_sums(centred, n) / n
    variance = window_sums(squares(centred), n) / n - squares(mean)
    return np.maximum(variance, 0.0), mean + offset


def moving_mean_variance(values: Array, n: int, k: int, passes: int = PASSES) -> Array:
    """`window_moments`' variance over n samples, of values `smoothed` by means over k samples."""
    return window_moments(smoothed(values, k, passes), n)[0]


def cumulative(steps: Array) -> Array:
    """Sums (n + 1, ...) of the first 0, 1, ... n of the steps (n, ...)."""
    sums = np.zeros((len(steps) + 1, *steps.shape[1:]), order="F")
    np.cumsum(steps, axis=0, out=sums[1:])
    return sums


def window_sums(values: Array, n: int) -> Array:
    """Sums over each window of n samples: (l,) or (l, k) -> (l - n + 1,) or (l - n + 1, k)."""
    sums = cumulative(values)
    return sums[n:] - sums[:-n]


def smoothed(values: Array, n: int, passes: int = PASSES) -> Array:
    """Moving means over n samples, in an even number of passes: (l, k) -> (l, k). Beyond both ends the values stay."""
    if n == 1:
        return values
    before, after = (np.broadcast_to(end, (passes * (n - 1) // 2, *end.shape)) for end in (values[0], values[-1]))
    return moving_means(np.concatenate((before, values, after)), n, passes)


def moving_means(values: Array, n: int, passes: int) -> Array:
    """Moving means over n samples, in `passes` passes: (l, k) -> (l - passes (n - 1), k)."""
    if n == 1:
        return values
    weights = _weights(n, passes)
    return np.array([np.convolve(column, weights, "valid") for column in values.T]).T


def white_noise_variance(n: int, passes: int = PASSES) -> float:
    """Variance of the `moving_means` of white noise of variance 1."""
    weights = _weights(n, passes)
    return float(weights @ weights)


@lru_cache(maxsize=16)  # the live tracker needs the same few in each block
def _weights(n: int, passes: int) -> Array:
    weights = np.ones(1)
    for _ in range(passes):
        weights = np.convolve(weights, np.full(n, 1.0 / n))
    return readonly(weights)


def window_maxima(values: NDArray[Any], n: int) -> NDArray[Any]:
    """Maximum over each window of n samples, (l,) -> (l - n + 1,). (scipy's takes 0.1 s to load.)"""
    span = 1
    while span < n:
        step = min(span, n - span)
        values, span = np.maximum(values[:-step], values[step:]), span + step
    return values


def squares(vectors: Array) -> Array:
    """Squared lengths of vectors (m, k) -> (m,). With few columns numpy's sum(axis=1) takes ten times as long."""
    total = np.zeros(len(vectors))
    for column in vectors.T:
        total += column * column
    return total
