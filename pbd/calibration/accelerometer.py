"""Bias, scale and misalignment of an accelerometer: at rest the norm of its reading is g in every orientation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd.calibration.rests import Rests, orientations, rms
from pbd.data import GRAVITY, Linear
from pbd.errors import CalibrationError
from pbd.pose import Array

PRIOR_BIAS, PRIOR_SCALE, PRIOR_LEAN = 0.05 * GRAVITY, 0.02, np.radians(1.0)
"""Prior sigma of bias (m/s2), scale (a share) and misalignment (rad) of a low-cost part."""

MEAN_SIGMA = 0.0005 * GRAVITY
"""m/s2: least sigma of the mean over a rest. The table gives, the bias wanders."""

DETERMINED = 0.3
"""An error is determined by the data if its sigma shrinks below this share of the prior's."""

FEWEST_ORIENTATIONS = 4
"""Least number of orientations: with fewer, bias, scale and misalignment can't be separated."""

NAMES = tuple(f"{what} {axis}" for what in ("bias", "scale") for axis in "xyz") + tuple(
    f"misalignment {axes}" for axes in ("yz", "xz", "xy")
)


@dataclass(frozen=True, eq=False)
class AccelerometerFit:
    """What was found.

    Attributes:
        linear: bias and matrix; the matrix is symmetric, as a rotation of all axes together does not change a norm.
        sigma: (9,) of NAMES, one sigma.
        determined: those of NAMES that the orientations determine. The others are assumed to be small.
        before, after: m/s2, rms of the norm less gravity over the rests.
    """

    linear: Linear
    sigma: Array
    determined: tuple[str, ...]
    orientations: int
    before: float
    after: float

    @property
    def up_sigma(self) -> float:
        """rad, how far the vertical may be off in some attitude, by what the data leave open."""
        return float(np.hypot(self.sigma[:3].max() / GRAVITY, self.sigma[3:].max()))

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Those of NAMES that the orientations do not determine."""
        return tuple(name for name in NAMES if name not in self.determined)


def fit_accelerometer(rests: Rests, gravity: float = GRAVITY) -> AccelerometerFit:
    """Least squares of |matrix (f - bias)| = gravity over all rests, nine unknowns, each held by a prior.

    The prior is what the parts' makers let expect. It decides only what the orientations leave open: with nine or more
    that are well spread the effect is nil. With fewer, errors that can't be separated share the residual.

    Source: D. Tedaldi, A. Pretto and E. Menegatti, A robust and easy to implement method for IMU calibration without
    external equipments, ICRA 2014 (there with a triangular matrix: another choice of the free rotation).

    Args:
        gravity: m/s2, of the place. A wrong one is taken for scale.

    Raises:
        CalibrationError: too few orientations.
    """
    up = rests.up_sensor
    different = orientations(up)
    if different < FEWEST_ORIENTATIONS:
        spread = np.degrees(np.arccos(np.clip((up @ up.T).min(), -1.0, 1.0)))
        orientation = f"orientation{'s' if different > 1 else ''} 15 degrees or more apart (at most {spread:.0f})"
        found = f"{len(rests)} rests show only {different} {orientation}"
        if len(rests) == 1:
            found = "the sensor was put down once"
        raise CalibrationError(
            f"{found}; the accelerometer needs {FEWEST_ORIENTATIONS} orientations, best 12: each of six sides and six "
            "edges up, 2 s each (for the gyro's bias alone: --only gyr)",
            value=different,
            bound=FEWEST_ORIENTATIONS,
        )
    from scipy.optimize import least_squares

    noise = np.hypot(rests.acc_noise / np.sqrt(rests.samples), MEAN_SIGMA)
    prior = np.repeat((PRIOR_BIAS, PRIOR_SCALE, PRIOR_LEAN), 3)

    def left(x: Array) -> Array:
        bias, matrix = _unpack(x * prior)
        norm = np.linalg.norm((rests.acc - bias) @ matrix.T, axis=1)
        return np.concatenate(((norm - gravity) / noise, x))

    result = least_squares(left, np.zeros(9), method="lm")
    jacobian = np.asarray(result.jac)
    share = np.sqrt(np.diagonal(np.linalg.inv(jacobian.T @ jacobian)))
    bias, matrix = _unpack(result.x * prior)
    sigma = share * prior
    return AccelerometerFit(
        linear=Linear(bias, matrix, sigma[:3]),
        sigma=sigma,
        determined=tuple(name for name, left_over in zip(NAMES, share, strict=True) if left_over < DETERMINED),
        orientations=different,
        before=rms(np.linalg.norm(rests.acc, axis=1) - gravity),
        after=rms(np.linalg.norm((rests.acc - bias) @ matrix.T, axis=1) - gravity),
    )


def _unpack(x: Array) -> tuple[Array, Array]:
    matrix = np.diag(1.0 + x[3:6])
    for value, (i, j) in zip(x[6:], ((1, 2), (0, 2), (0, 1)), strict=True):
        matrix[i, j] = matrix[j, i] = value
    return x[:3], matrix
