"""The sensor's own errors, as estimated from a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd.pose import Array, readonly

LEARNED_SHARE = 0.25
"""Share of the prior's variance that must be learned. With less, the error can't be told from others."""


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """Numbers of one shape: the estimate, its sigma, and what was expected before, with its sigma (or one for all)."""

    value: Array
    sigma: Array
    expected: Array
    prior: Array

    def __post_init__(self) -> None:
        for name in ("value", "sigma", "expected", "prior"):
            object.__setattr__(self, name, readonly(np.broadcast_to(getattr(self, name), np.shape(self.value))))

    @property
    def surprise(self) -> Array:
        """How far the estimate is from what was expected, in sigmas of how far it would be by chance.

        An estimate that knows nothing stays where it was; one that knows all varies as the prior says.
        """
        learned = 1.0 - (self.sigma / self.prior) ** 2
        chance = self.prior * np.sqrt(np.maximum(learned, LEARNED_SHARE))
        return np.where(learned > LEARNED_SHARE, (self.value - self.expected) / chance, 0.0)


@dataclass(frozen=True, eq=False)
class SensorEstimate:
    """A sensor's errors, as a recording shows them.

    Attributes:
        gyr_bias: (3,) rad/s, at the first stop.
        gyr_matrix: (3, 3) share by which each axis reads too high (the diagonal), or leans towards another.
        acc_bias: (3,) m/s2, at the first stop.
        acc_matrix: (3, 3), lower triangle: as of the gyro.
        lag: () s, by which the gyro is late behind the accelerometer.
    """

    gyr_bias: ErrorEstimate
    gyr_matrix: ErrorEstimate
    acc_bias: ErrorEstimate
    acc_matrix: ErrorEstimate
    lag: ErrorEstimate
