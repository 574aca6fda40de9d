"""Hard and soft iron of a magnetometer: in every orientation the field has the same strength and dip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd.calibration.rests import Rests, rms
from pbd.data import Linear
from pbd.errors import CalibrationError
from pbd.pose import Array

SAMPLES_USED = 1500
"""Number of samples in the fit, spread evenly over the recording."""

FIELD_SIGMA_UT = 0.1
"""uT: least sigma of the field, as rooms are uneven."""

LEAST_SPREAD = 10.0
"""Least rms of the readings along each axis, in units of their noise, while the sensor is turned."""

LEAST_COVER = 0.04
"""Least mean square of the field's directions along any axis. It is 1/3 where they point all over, 0 where one is
missing."""

PRIOR_TURN = 0.05
"""rad: prior sigma of the rotation between the magnetometer's axes and the accelerometer's."""

TURN_IT = "turn the sensor slowly in all directions, each side up and down once, or leave it out with --only acc"

ROBUST_SIGMAS = 3.0
"""Sigmas beyond which a misfit counts linearly (soft L1), as the field is disturbed near iron."""


@dataclass(frozen=True, eq=False)
class MagnetometerFit:
    """What was found.

    Attributes:
        linear: bias (hard iron) and matrix (soft iron, of determinant 1: no strength is known).
        field: uT, the strength.
        dip: rad, below the horizon.
        uneven: share, rms by which the strength differs over the recording.
        dip_uneven: rad, rms by which the dip differs over the rests.
        before: share, rms by which the strength as read differs.
    """

    linear: Linear
    field: float
    dip: float
    uneven: float
    dip_uneven: float
    before: float


def fit_ellipsoid(points: Array) -> tuple[Array, Array]:
    """The ellipsoid |matrix (x - centre)| = 1 nearest to points (n, 3), in the algebraic sense: one linear solution.

    Source: Q. Li and J. G. Griffiths, Least squares ellipsoid specific fitting, GMP 2004; without their constraint, as
    points all around leave nothing but an ellipsoid.

    Returns:
        centre (3,), symmetric matrix (3, 3).

    Raises:
        CalibrationError: no ellipsoid fits: the points don't lie all around.
    """
    middle = points.mean(axis=0)
    size = rms(np.linalg.norm(points - middle, axis=1))
    x, y, z = ((points - middle) / size).T
    design = np.column_stack((x * x, y * y, z * z, 2 * y * z, 2 * x * z, 2 * x * y, 2 * x, 2 * y, 2 * z))
    xx, yy, zz, yz, xz, xy, *linear = np.linalg.lstsq(design, np.ones(len(points)), rcond=None)[0].tolist()
    quadric = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if np.linalg.eigvalsh(quadric).min() <= 1e-3 * np.linalg.eigvalsh(quadric).max():
        raise CalibrationError(f"the magnetometer was not turned far enough: its readings fit no ellipsoid; {TURN_IT}")
    centre = -np.linalg.solve(quadric, linear)
    values, axes = np.linalg.eigh(quadric / (1.0 + centre @ quadric @ centre))
    return middle + size * centre, np.asarray((axes * np.sqrt(values)) @ axes.T / size)


def fit_magnetometer(mag: Array, rests: Rests, up_sensor: Array, up_sigma: float = 0.0) -> MagnetometerFit:
    """Hard and soft iron: the ellipsoid, then least squares with the dip, which turns it into the accelerometer's axes.

    The strength alone leaves a rotation open, and with it the heading. At the rests the vertical is known: there the
    field's vertical part is the same (M. Kok and T. Schön, Magnetometer calibration using inertial sensors, IEEE
    Sensors Journal 16(14), 2016, as maximum likelihood; here with the attitude at the rests only).

    Args:
        mag: (n, 3) uT, all samples while the sensor is turned.
        rests: with `mag`.
        up_sensor: (k, 3) unit, the vertical at the rests, by a calibrated accelerometer.
        up_sigma: rad, how well that shows it.

    Raises:
        CalibrationError: it was not turned far enough, or there is no field.
    """
    from scipy.optimize import least_squares

    assert rests.mag is not None
    at_rest: Array = rests.mag
    used = mag[np.linspace(0, len(mag) - 1, min(SAMPLES_USED, len(mag))).astype(np.intp)]
    noise = float(np.hypot(rests.mag_noise, FIELD_SIGMA_UT))
    spread = float(np.sqrt(np.linalg.eigvalsh(np.cov(used.T))[0]))
    if spread < LEAST_SPREAD * noise:
        raise CalibrationError(
            "the magnetometer was not turned far enough: along one axis its readings vary by only "
            f"{spread:.1f} uT; {TURN_IT}",
            value=spread,
            bound=LEAST_SPREAD * noise,
        )
    centre, root = fit_ellipsoid(used)
    scale = float(np.cbrt(np.linalg.det(root)))
    start, field = root / scale, 1.0 / scale
    directions = (used - centre) @ root.T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cover = float(np.linalg.eigvalsh(directions.T @ directions / len(directions))[0])
    if cover < LEAST_COVER:
        raise CalibrationError(
            f"the magnetometer was not turned far enough (its directions cover {100.0 * 3.0 * cover:.0f} % of what "
            f"they could along one axis); {TURN_IT}",
            value=cover,
            bound=LEAST_COVER,
        )
    noise_at_rest = np.hypot(np.hypot(rests.mag_noise / np.sqrt(rests.samples), FIELD_SIGMA_UT), up_sigma * field)

    def vertical_part(bias: Array, matrix: Array) -> Array:
        """Upwards, (k,) uT."""
        return np.asarray(np.einsum("ki,ki->k", (at_rest - bias) @ matrix.T, up_sensor))

    down = -np.average(vertical_part(centre, start))

    def unpack(x: Array) -> tuple[Array, Array, float]:
        return centre + x[:3], start @ (np.eye(3) + x[3:12].reshape(3, 3)), float(down + x[12])

    def left(x: Array) -> Array:
        bias, matrix, vertical = unpack(x)
        strength = np.linalg.norm((used - bias) @ matrix.T, axis=1) - field
        # Few orientations leave the rotation open: it is held near none.
        turn = (x[3:12].reshape(3, 3) - x[3:12].reshape(3, 3).T)[np.triu_indices(3, 1)]
        dip = vertical_part(bias, matrix) + vertical
        return np.concatenate((strength / noise, dip / noise_at_rest, turn / (2.0 * PRIOR_TURN)))

    result = least_squares(left, np.zeros(13), loss="soft_l1", f_scale=ROBUST_SIGMAS, x_scale="jac")
    bias, matrix, vertical = unpack(result.x)
    jacobian = np.asarray(result.jac)
    sigma = np.sqrt(np.diagonal(np.linalg.pinv(jacobian.T @ jacobian)))[:3]
    dip = float(np.arcsin(np.clip(vertical / field, -1.0, 1.0)))
    strength = np.linalg.norm((used - bias) @ matrix.T, axis=1) / field
    each_dip = np.arcsin(np.clip(-vertical_part(bias, matrix) / field, -1.0, 1.0))
    as_read = np.linalg.norm(used, axis=1)
    unit = float(np.cbrt(np.linalg.det(matrix)))
    return MagnetometerFit(
        linear=Linear(bias, matrix / unit, sigma),
        field=field / unit,
        dip=dip,
        uneven=rms(strength - 1.0),
        dip_uneven=rms(each_dip - dip),
        before=float(as_read.std() / as_read.mean()),
    )
