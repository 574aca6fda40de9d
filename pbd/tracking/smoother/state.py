"""What the smoother estimates, and what each linearisation starts from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd.pose import Array, quat_exp, quat_to_matrix
from pbd.tracking.smoother.normal_equations import ACC_BIAS, GYR_BIAS, Solved
from pbd.tracking.smoother.preintegration import LOWER, POS, ROT, VEL

GRAVITY, PIVOT = slice(16, 17), slice(17, 20)
SHARED = PIVOT.stop
"""Shared unknowns: lag (s), the matrices of gyro (M) and accelerometer (N) as a leg's columns have them; gravity
(m/s2), the pivot (m)."""


@dataclass(frozen=True, eq=False)
class State:
    """An estimate at all knots.

    Attributes:
        E: (m, 3, 3), nav <- gyro frame.
        v, p: (m, 3) m/s, m, in nav.
        gyr_bias, acc_bias: (m, 3) rad/s, m/s2, in sensor axes.
        shared: (SHARED,).
    """

    E: Array
    v: Array
    p: Array
    gyr_bias: Array
    acc_bias: Array
    shared: Array

    def moved(self, step: Solved) -> State:
        """The state a step further."""
        d = step.d
        return State(
            quat_to_matrix(quat_exp(d[:, ROT])) @ self.E,
            self.v + d[:, VEL],
            self.p + d[:, POS],
            self.gyr_bias + d[:, GYR_BIAS],
            self.acc_bias + d[:, ACC_BIAS],
            self.shared + step.d_shared,
        )


@dataclass(frozen=True)
class Prior:
    """Prior of the sensor-wide errors: lag in s, a scale common to the gyro's axes (share)."""

    lag: float
    lag_sigma: float
    common_scale: float = 0.0


@dataclass(frozen=True, eq=False)
class Local:
    """What each linearisation shares: origin and heading, the undisturbed field, the scale of each part of the noise.

    Attributes:
        origin: index of the knot whose position, and without a compass heading, is given.
        strength, dip: of the field at the first rest, its unit and rad.
        prior: of the sensor-wide errors.
        components: (6,) factors on the noise: the legs' three parts, the biases' walks, the speed of what stands still.
    """

    origin: int
    strength: float
    dip: float
    prior: Prior
    components: Array


def lower_matrix(values: Array, elsewhere: Array | float = 0.0) -> Array:
    """N (3, 3) of its entries (6,), and what stands above its diagonal."""
    matrix = np.array(np.broadcast_to(elsewhere, (3, 3)), dtype=np.float64)
    matrix[tuple(np.transpose(LOWER))] = values
    return matrix
