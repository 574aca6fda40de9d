"""Estimate an accelerometer's bias, scale and misalignment: at rest its reading has the norm g in every orientation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.calibration.rests import Rests, count_orientations, rms
from pbd.data import GRAVITY, LinearErrors
from pbd.data.units import MG
from pbd.errors import CalibrationError, amount
from pbd.pose import Array

FEWEST_ORIENTATIONS = 4
"""Smallest number of orientations. With fewer, bias, scale and misalignment can't be separated."""

NAMES = tuple(f"{what} {axis}" for what in ("bias", "scale") for axis in "xyz") + tuple(
    f"misalignment {axes}" for axes in ("yz", "xz", "xy")
)


@dataclass(frozen=True, eq=False)
class AccelerometerFit:
    """An accelerometer's estimated errors.

    Attributes:
        linear: bias and matrix. The matrix is symmetric, because a common rotation of all axes does not change a norm.
        sigma: (9,) one sigma of each error in NAMES.
        determined: the errors of NAMES that the orientations determine, to 0.3 of the prior sigma. The others stay near
            the prior.
        orientations: number of different orientations.
        rms_before, rms_after: m/s2, rms over the rests of norm minus gravity, without and with the correction.
        misfit: m/s2, rms of the residuals per degree of freedom: nine unknowns hide much of what twelve rests show.
        suspects: indices of the rests of which each alone explains 0.8 of the sum of squares. Opposite sides make the
            same misfit.
    """

    linear: LinearErrors
    sigma: Array
    determined: tuple[str, ...]
    orientations: int
    rms_before: float
    rms_after: float
    misfit: float
    suspects: NDArray[np.intp]

    @property
    def undetermined(self) -> tuple[str, ...]:
        """The errors of NAMES that the orientations do not determine."""
        return tuple(name for name in NAMES if name not in self.determined)


def fit_accelerometer(rests: Rests, gravity: float = GRAVITY) -> AccelerometerFit:
    """Fit |matrix (f - bias)| = gravity over all rests, by least squares with nine unknowns, each with a prior.

    The priors are typical errors by the makers' data sheets. They matter only for errors that the orientations don't
    determine; such errors share the residual. With nine or more well-spread orientations the priors have no effect.

    Source: D. Tedaldi, A. Pretto and E. Menegatti, A robust and easy to implement method for IMU calibration without
    external equipments, ICRA 2014 (there with a triangular matrix: another choice of the free rotation).

    Args:
        rests: with their mean specific force.
        gravity: m/s2, local gravity. Its error looks like an error of scale.

    Raises:
        CalibrationError: too few orientations.
    """
    up = rests.up_sensor
    different = count_orientations(up)
    if different < FEWEST_ORIENTATIONS:
        spread = np.degrees(np.arccos(np.clip((up @ up.T).min(), -1.0, 1.0)))
        orientation = f"orientation{'s' if different > 1 else ''} 15 degrees or more apart (at most {spread:.0f})"
        found = f"{len(rests)} rests show only {different} {orientation}"
        if len(rests) == 1:
            found = "the sensor was put down once"
        if rests.turning:
            found += f", and in {amount(rests.turning, 'other rest')} it turned slowly (lay it down, and let go)"
        raise CalibrationError(
            f"{found}; the accelerometer needs {FEWEST_ORIENTATIONS} orientations, best 12: each of six sides and six "
            "edges up, 2 s each (for the gyro's bias alone: --only gyr)",
            value=different,
            bound=FEWEST_ORIENTATIONS,
        )
    from scipy.optimize import least_squares

    noise = np.hypot(rests.acc_noise / np.sqrt(rests.samples), 0.5 * MG)  # the table yields, and the bias wanders
    prior = np.repeat((50.0 * MG, 0.02, np.radians(1.0)), 3)  # sigma of bias, scale, misalignment of a low-cost part

    def residuals(x: Array) -> Array:
        bias, matrix = _unpack(x * prior)
        norm = np.linalg.norm((rests.acc - bias) @ matrix.T, axis=1)
        return np.concatenate(((norm - gravity) / noise, x))

    result = least_squares(residuals, np.zeros(9), method="lm")
    jacobian = np.asarray(result.jac)
    covariance, of_rests = np.linalg.inv(jacobian.T @ jacobian), jacobian[: len(rests)]
    relative = np.sqrt(np.diagonal(covariance))  # to prior sigma
    squares = result.fun[: len(rests)] ** 2
    free = 1.0 - np.einsum("ki,ij,kj->k", of_rests, covariance, of_rests)  # share of a rest's error in its residual
    chi2 = squares.sum() / max(1.0, free.sum())  # per degree of freedom
    bias, matrix = _unpack(result.x * prior)
    sigma = relative * prior * np.sqrt(max(1.0, chi2))
    return AccelerometerFit(
        linear=LinearErrors(bias, matrix, sigma[:3], float(sigma[3:].max())),
        sigma=sigma,
        determined=tuple(name for name, ratio in zip(NAMES, relative, strict=True) if ratio < 0.3),
        orientations=different,
        rms_before=rms(np.linalg.norm(rests.acc, axis=1) - gravity),
        rms_after=rms(np.linalg.norm((rests.acc - bias) @ matrix.T, axis=1) - gravity),
        misfit=float(np.sqrt(chi2) * rms(noise)),
        suspects=np.flatnonzero(squares > 0.8 * free * squares.sum()),
    )


def up_sigma(acc: LinearErrors | None) -> float:
    """One sigma of the vertical's direction, rad, in the worst attitude, by these errors; 1 degree if without sigma."""
    found = np.nan if acc is None else float(np.hypot(acc.bias_sigma.max() / GRAVITY, acc.matrix_sigma))
    return float(np.radians(1.0)) if np.isnan(found) else found


def _unpack(x: Array) -> tuple[Array, Array]:
    """Return bias and matrix of the nine errors in NAMES."""
    matrix = np.diag(1.0 + x[3:6])
    for value, (i, j) in zip(x[6:], ((1, 2), (0, 2), (0, 1)), strict=True):
        matrix[i, j] = matrix[j, i] = value
    return x[:3], matrix
