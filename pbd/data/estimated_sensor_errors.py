"""A sensor's errors as estimated from a recording."""

from dataclasses import dataclass

import numpy as np

from pbd.data.one_line_repr import brief
from pbd.frozen_arrays import readonly
from pbd.pose import Array

LEAST_LEARNED_SHARE = 0.25
"""Smallest reduction of the prior's variance, as a share of it, for which an estimate can count as a surprise. With
less, the recording does not separate this error from others."""


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """An estimate and its sigma, and the prior's mean (`expected`) and sigma (`prior`). All get the estimate's
    shape."""

    value: Array
    sigma: Array
    expected: Array
    prior: Array

    def __post_init__(self) -> None:
        for name in ("value", "sigma", "expected", "prior"):
            object.__setattr__(self, name, readonly(np.broadcast_to(getattr(self, name), np.shape(self.value))))

    @property
    def surprise(self) -> Array:
        """Difference between estimate and prior mean, in its sigmas; 0 where the recording taught too little.

        The variance of that difference is the prior's variance minus the estimate's.
        """
        learned = 1.0 - (self.sigma / self.prior) ** 2
        chance = self.prior * np.sqrt(np.maximum(learned, LEAST_LEARNED_SHARE))
        return np.where(learned > LEAST_LEARNED_SHARE, (self.value - self.expected) / chance, 0.0)


@dataclass(frozen=True, eq=False)
class SensorEstimate:
    """A sensor's errors as estimated from a recording.

    Attributes:
        gyr_bias: (3,) at the first stop, rad/s.
        gyr_matrix: (3, 3) relative scale errors on the diagonal, misalignment off it.
        acc_bias: (3,) at the first stop, m/s2.
        acc_matrix: (3, 3) as gyr_matrix, lower triangle only.
        lag: () delay of the gyro behind the accelerometer, s.
    """

    gyr_bias: ErrorEstimate
    gyr_matrix: ErrorEstimate
    acc_bias: ErrorEstimate
    acc_matrix: ErrorEstimate
    lag: ErrorEstimate

    def __repr__(self) -> str:
        biases = (("gyr", self.gyr_bias, "rad/s"), ("acc", self.acc_bias, "m/s2"))
        shown = [f"{name} bias ({', '.join(f'{x:.2g}' for x in each.value)}) {unit}" for name, each, unit in biases]
        return brief(self, *shown, f"lag {1e3 * float(self.lag.value):.2g} ms")
