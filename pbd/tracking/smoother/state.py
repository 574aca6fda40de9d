"""The smoother's state, its priors, and what the iterations hold fixed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd.pose import Array, cross, quat_exp, quat_rotate, quat_to_matrix
from pbd.tracking.smoother.normal_equations import STATE_ACC_BIAS, STATE_GYR_BIAS, Solved
from pbd.tracking.smoother.preintegration import LOWER, POS, ROT, VEL

SHARED_GRAVITY, SHARED_PIVOT = slice(16, 17), slice(17, 20)
SHARED = SHARED_PIVOT.stop
"""Shared unknowns: lag (s) and the matrices M of the gyro and N of the accelerometer, in the order of `Legs.J`; then
gravity (m/s2) and the lever from the pivot to the sensor (m, in sensor axes)."""


@dataclass(frozen=True, eq=False)
class State:
    """An estimate at all m knots.

    Attributes:
        E: (m, 3, 3), nav <- gyro frame.
        v, p: (m, 3) m/s and m, in nav.
        gyr_bias, acc_bias: (m, 3) rad/s and m/s2, in sensor axes.
        shared: (SHARED,) unknowns common to all knots.
    """

    E: Array
    v: Array
    p: Array
    gyr_bias: Array
    acc_bias: Array
    shared: Array

    def moved(self, step: Solved) -> State:
        """The state after a Gauss-Newton step."""
        d = step.d
        turn = quat_exp(d[:, ROT])
        return State(
            quat_to_matrix(turn) @ self.E,
            quat_rotate(turn, self.v) + d[:, VEL] - cross(d[:, ROT], self.v),
            quat_rotate(turn, self.p) + d[:, POS] - cross(d[:, ROT], self.p),
            self.gyr_bias + d[:, STATE_GYR_BIAS],
            self.acc_bias + d[:, STATE_ACC_BIAS],
            self.shared + step.d_shared,
        )


@dataclass(frozen=True)
class Prior:
    """Prior of the lag (s, mean and sigma), and sigma of a relative scale error common to the gyro's axes."""

    lag: float
    lag_sigma: float
    common_scale: float = 0.0


@dataclass(frozen=True, eq=False)
class Fixed:
    """What the iterations hold fixed.

    Attributes:
        origin: index of the knot whose position, and without a compass whose heading, is fixed.
        strength, dip: the field's at the first rest, in the unit of `Problem.field` and in rad; pi/2 without a field.
        azimuth: where the usual field points in nav, rad east of y, which is where it points at the first rest.
        prior: prior of lag and common scale.
        components: (6,) factors on variances: the three parts of the legs' noise, the walks of the gyro's and the
            accelerometer's bias, the velocity at a stop.
    """

    origin: int
    strength: float
    dip: float
    azimuth: float
    prior: Prior
    components: Array


def lower_matrix(values: Array, elsewhere: Array | float = 0.0) -> Array:
    """Lower triangular matrix (3, 3) from its entries (6,), with `elsewhere` above the diagonal."""
    matrix = np.array(np.broadcast_to(elsewhere, (3, 3)), dtype=np.float64)
    matrix[LOWER] = values
    return matrix
