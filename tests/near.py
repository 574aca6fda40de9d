"""Compares large arrays at once. pytest.approx compares number by number, which takes a thousand times as long."""

import numpy as np
from numpy.typing import ArrayLike

from pbd.pose import Array


def assert_near(found: Array, wanted: ArrayLike, within: float) -> None:
    """As `found == pytest.approx(wanted, abs=within)`; `wanted` has the shape of `found`, or is a number. NaN fails."""
    expected: Array = np.asarray(wanted, dtype=np.float64)
    assert expected.shape in ((), found.shape)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=within, equal_nan=False)
