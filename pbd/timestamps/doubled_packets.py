"""Packets that a link delivered twice, told from readings that a sensor repeats."""

from math import log

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array
from pbd.timestamps.straighten import WITHIN_BATCH


def came_twice(arrival: Array, repeats: NDArray[np.bool_]) -> bool:
    """Whether the samples (n,) that repeat all readings of the one before are packets that came twice; arrival (n,) s.

    Such a packet takes no time: without it, the time between two batches fits the number of samples better. A reading
    that is repeated, because the sensor is coarse or is read too often, takes an interval as any other.
    """
    new = np.flatnonzero(~repeats)
    if len(new) < 2:
        return False
    steps = np.diff(arrival[new])
    ends = np.flatnonzero(steps > WITHIN_BATCH * steps.mean())
    if len(ends) < 2:
        return False
    spans, counts = np.diff(arrival[new[ends]]), np.diff((new[ends], ends), axis=1)
    usual = spans < 4.0 * spans.mean()  # a longer one is a gap or a stall, and tells nothing
    spans, counts = spans[usual], counts[:, usual]
    intervals = spans.sum() / counts.sum(axis=1)
    misfits = (spans - intervals[:, None] * counts) ** 2
    # Gaussian delays: the log-likelihood of each hypothesis is its misfit over twice the variance, that of repeats.
    # Doubled packets are believed if repeated readings are less likely by the factor 1e-5.
    return bool((misfits[0] - misfits[1]).sum() > -2.0 * log(1e-5) * misfits[0].mean())
