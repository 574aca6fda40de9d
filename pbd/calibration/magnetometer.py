"""Estimate a magnetometer's hard and soft iron: in every orientation the field has the same strength and dip."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.calibration.rests import Rests, rms
from pbd.data import LinearErrors
from pbd.data.calibration import LEAST_DETERMINANT
from pbd.errors import CalibrationError
from pbd.pose import Array

FIELD_SIGMA_UT = 0.1
"""Smallest sigma of the field, uT, because a room's field is uneven."""

LEAST_SPREAD_SIGMAS = 10.0
"""Smallest standard deviation of the readings along any axis, in units of their noise."""

LEAST_COVER = 0.04
"""Smallest mean square of the field's unit directions along any axis: 1/3 if they cover the sphere, 0 if they lie in a
plane."""

TURN_IT = "turn the sensor slowly in all directions, each side up and down once, or leave it out with --only acc"

ROBUST_SIGMAS = 3.0
"""A misfit of more sigmas counts linearly (soft L1), because iron disturbs the field in places."""


@dataclass(frozen=True, eq=False)
class MagnetometerFit:
    """A magnetometer's estimated errors and the field.

    Attributes:
        linear: bias (hard iron) and matrix (soft iron). The determinant is 1, because the true strength is not known.
        field: uT, strength of the field.
        dip: rad, angle of the field below the horizon.
        uneven: relative rms variation of the corrected strength over the recording.
        dip_uneven: rad, rms variation of the dip over the rests.
        heading: rad, rms turn of a heading by the variation of strength or dip over the rests. Only the field's level
            part shows the heading; a disturbance has no preferred direction, and the fit takes a part of it.
        uneven_before: relative rms variation of the strength without the correction.
        axes_turn: rad, angle of the rotation in `linear`: large where the axes have other names or signs than the
            accelerometer's. Of mirrored axes it is half a turn, because the reversed field fits as well.
    """

    linear: LinearErrors
    field: float
    dip: float
    uneven: float
    dip_uneven: float
    heading: float
    uneven_before: float
    axes_turn: float


def fit_ellipsoid(points: Array) -> tuple[Array, Array]:
    """Fit the ellipsoid |matrix (x - centre)| = 1 to points (n, 3) by linear least squares of the algebraic distance.

    Source: Q. Li and J. G. Griffiths, Least squares ellipsoid specific fitting, GMP 2004; without their constraint,
    because points on all sides admit no other quadric.

    Returns:
        centre (3,), symmetric matrix (3, 3).

    Raises:
        CalibrationError: no ellipsoid fits, because the points don't lie on all sides.
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


def _fit_well_turned(mag: Array, noise: float) -> tuple[Array, Array, float]:
    """Fit an ellipsoid to readings (n, 3) uT, of sigma `noise`, of a sensor that must have been turned to all sides.

    Returns:
        centre (3,) uT, matrix (3, 3) of determinant 1, and the field's strength, uT.

    Raises:
        CalibrationError: the sensor was not turned far enough.
    """
    spread = float(np.sqrt(np.linalg.eigvalsh(np.cov(mag.T))[0]))
    if spread < LEAST_SPREAD_SIGMAS * noise:
        raise CalibrationError(
            "the magnetometer was not turned far enough: along one axis its readings vary by only "
            f"{spread:.1f} uT; {TURN_IT}",
            value=spread,
            bound=LEAST_SPREAD_SIGMAS * noise,
        )
    centre, root = fit_ellipsoid(mag)
    scale = float(np.cbrt(np.linalg.det(root)))
    directions = (mag - centre) @ root.T
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cover = float(np.linalg.eigvalsh(directions.T @ directions / len(directions))[0])
    if cover < LEAST_COVER:
        raise CalibrationError(
            f"the magnetometer was not turned far enough (its directions cover {100.0 * 3.0 * cover:.0f} % of what "
            f"they could along one axis); {TURN_IT}",
            value=cover,
            bound=LEAST_COVER,
        )
    return centre, root / scale, 1.0 / scale


def _sigmas(jacobian: Array, residuals: Array, place: NDArray[np.intp]) -> Array:
    """Return the sigmas (p,) of robust least squares: by the curvature, or by the jackknife over places if larger.

    The field differs from place to place, so all residuals (n,) of a place are off alike: each place in turn is left
    out, and the estimate moves. Source: J. G. MacKinnon and H. White, Some heteroskedasticity-consistent covariance
    matrix estimators, J. Econometrics 29, 1985. `place` (n,) counts from 0; residuals of place -1 are never left out.
    """
    # scipy scales the Jacobian's rows for the robust loss, but returns the residuals as they are
    scaled = residuals * (1.0 + (residuals / ROBUST_SIGMAS) ** 2) ** 0.25
    normal, moved = jacobian.T @ jacobian, []
    for k in range(place.max() + 1):
        own, off = jacobian[place == k], scaled[place == k]
        moved.append(np.linalg.lstsq(normal - own.T @ own, own.T @ off)[0])
    curvature = np.linalg.norm(np.linalg.pinv(jacobian), axis=1)
    return np.asarray(np.maximum(curvature, np.sqrt(np.square(moved).sum(axis=0))))


def fit_magnetometer(mag: Array, rests: Rests, up_sensor: Array, up_sigma: float = 0.0) -> MagnetometerFit:
    """Fit hard and soft iron: an ellipsoid first, then least squares of strength and dip.

    The strength alone determines neither the rotation of the magnetometer's axes relative to the accelerometer's nor
    the heading. The dip does: at all rests, where the vertical is known, the field's vertical part must be the same.

    Source: M. Kok and T. Schön, Magnetometer calibration using inertial sensors, IEEE Sensors Journal 16(14), 2016
    (there by maximum likelihood, with the attitude at all times).

    Args:
        mag: (n, 3) uT, all samples while the sensor is turned.
        rests: their `mag` is not None.
        up_sensor: (k, 3) unit vertical at the rests, by a calibrated accelerometer.
        up_sigma: rad, one sigma of the vertical's direction.

    Raises:
        CalibrationError: the sensor was not turned far enough, or there is no field.
    """
    from scipy.optimize import least_squares

    assert rests.mag is not None
    at_rest: Array = rests.mag
    rows = np.linspace(0, len(mag) - 1, min(1500, len(mag))).astype(np.intp)  # for speed
    used = mag[rows]
    noise = float(np.hypot(rests.mag_noise, FIELD_SIGMA_UT))
    centre, start, field = _fit_well_turned(used, noise)
    noise_at_rest = np.hypot(np.hypot(rests.mag_noise / np.sqrt(rests.samples), FIELD_SIGMA_UT), up_sigma * field)

    def vertical_part(bias: Array, matrix: Array) -> Array:
        """Return the field's upward part at the rests, (k,) uT."""
        return np.asarray(np.einsum("ki,ki->k", (at_rest - bias) @ matrix.T, up_sensor))

    down = -np.average(vertical_part(centre, start))

    def unpack(x: Array) -> tuple[Array, Array, float]:
        return centre + x[:3], start @ (np.eye(3) + x[3:12].reshape(3, 3)), float(down + x[12])

    def residuals(x: Array) -> Array:
        bias, matrix, vertical = unpack(x)
        strength = np.linalg.norm((used - bias) @ matrix.T, axis=1) - field
        # A prior on the rotation, of sigma 0.05 rad, because few orientations do not determine it.
        turn = (x[3:12].reshape(3, 3) - x[3:12].reshape(3, 3).T)[np.triu_indices(3, 1)]
        dip = vertical_part(bias, matrix) + vertical
        return np.concatenate((strength / noise, dip / noise_at_rest, turn / (2.0 * 0.05)))

    result = least_squares(residuals, np.zeros(13), loss="soft_l1", f_scale=ROBUST_SIGMAS, x_scale="jac")
    bias, matrix, vertical = unpack(result.x)
    if np.linalg.det(matrix) < LEAST_DETERMINANT:  # as beside a magnet
        raise CalibrationError(
            "the field differs too much from rest to rest; move away from iron and motors, check the axes and signs of "
            "mx, my, mz, and calibrate again"
        )
    nearest = np.searchsorted(0.5 * (rests.stop[:-1] + rests.start[1:]), rows)  # in a move the field changes gradually
    place = np.concatenate((nearest, np.arange(len(at_rest)), np.full(3, -1)))
    sigma = _sigmas(np.asarray(result.jac), result.fun, place)[:3]
    dip = float(np.arcsin(np.clip(vertical / field, -1.0, 1.0)))
    strength = np.linalg.norm((used - bias) @ matrix.T, axis=1) / field
    each_dip = np.arcsin(np.clip(-vertical_part(bias, matrix) / field, -1.0, 1.0))
    dip_uneven = rms(each_dip - dip)
    freedom = max(len(each_dip) - 4, 1)  # the dips alone determine the vertical part and the rotation of the axes
    of_dip = dip_uneven * np.sqrt(len(each_dip) / freedom)
    strength_at_rest = np.linalg.norm((at_rest - bias) @ matrix.T, axis=1) / field
    as_read = np.linalg.norm(used, axis=1)
    unit = float(np.cbrt(np.linalg.det(matrix)))
    left, _, right = np.linalg.svd(matrix)
    return MagnetometerFit(
        linear=LinearErrors(bias, matrix / unit, sigma),
        field=field / unit,
        dip=dip,
        uneven=rms(strength - 1.0),
        dip_uneven=dip_uneven,
        heading=float(max(of_dip, rms(strength_at_rest - 1.0)) / np.cos(dip)),
        uneven_before=float(as_read.std() / as_read.mean()),
        axes_turn=float(np.arccos(np.clip((np.trace(left @ right) - 1.0) / 2.0, -1.0, 1.0))),
    )
