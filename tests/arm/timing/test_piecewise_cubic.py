"""The peaks of cubic pieces, on which every slowing down relies, are those of the finely sampled polynomials."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from pbd.arm.timing.piecewise_cubic import PiecewiseCubic


@pytest.mark.parametrize("seed", range(10))
def test_peaks_are_those_of_the_sampled_polynomial(seed: int) -> None:
    rng = np.random.default_rng(seed)
    duration, coefficients = rng.uniform(0.1, 2.0, 1), rng.normal(size=(1, 4, 5))
    sampled = np.linspace(0.0, duration[0], 2001)
    joints = [Polynomial(one) for one in coefficients[0].T]
    for order, peaks in enumerate(PiecewiseCubic(duration, coefficients).peaks(), start=1):
        expected = [np.abs(joint.deriv(order)(sampled)).max() for joint in joints]
        np.testing.assert_allclose(peaks, expected, rtol=1e-3)
