"""The errors of a device as several takes show them, as a calibration has them."""

from __future__ import annotations

import numpy as np

from pbd.data import HandPath, Linear, SensorErrors
from pbd.data.units import MG
from pbd.errors import CalibrationError
from pbd.pose import Array


def device_errors(path: HandPath) -> tuple[SensorErrors, dict[str, float]]:
    """What the first take's device reads wrongly, for `pbd.calibration.sensor.corrected`; and figures of the fit.

    What an earlier calibration takes out is in it again. The lag is not: no calibration has one.

    Raises:
        CalibrationError: no gyro, so that the errors were not estimated.
    """
    found, tracking = path.sensor, path.tracking
    if found is None or tracking is None or path.fusion is None:
        raise CalibrationError("the sensor's errors were not estimated: it has no gyro; leave out --save-calibration")
    one = np.eye(3)
    gyr = _linear(one - found.gyr_matrix.value, found.gyr_bias.value, found.gyr_bias.sigma, turned=False)
    acc = _linear(one - found.acc_matrix.value, found.acc_bias.value, found.acc_bias.sigma, turned=True)
    gravity = float(np.linalg.norm(acc.correct(tracking.recording.acc[slice(*tracking.rest)].mean(axis=0))))
    before = None if tracking.calibration is None else tracking.calibration.sensor
    errors = SensorErrors(tracking.recording.info.sensor, gyr, acc, gravity=gravity)
    if before is not None:
        errors = SensorErrors(
            errors.sensor,
            _after(before.gyr, gyr),
            _after(before.acc, acc),
            before.mag,
            gravity,
            before.field,
            before.dip,
            before.temperature_c,
        )
    figures = {
        "takes": sum(not take.left_out and take.device == 0 for take in path.fusion.takes),  # the first take's
        "acc_bias_sigma_mg": round(float(found.acc_bias.sigma.max()) / MG, 2),
        "gyr_scale_sigma_pct": round(100.0 * float(np.diagonal(found.gyr_matrix.sigma).max()), 3),
    }
    return errors, figures


def _linear(matrix: Array, bias: Array, sigma: Array, turned: bool) -> Linear:
    """matrix (read - bias); the smoother's accelerometer bias comes after its matrix."""
    raw: Array = np.asarray(np.linalg.solve(matrix, bias), dtype=np.float64) if turned else bias
    return Linear(raw, matrix, sigma)


def _after(before: Linear | None, own: Linear) -> Linear:
    """Both one after the other: own.correct(before.correct(read))."""
    if before is None:
        return own
    return Linear(before.bias + np.linalg.solve(before.matrix, own.bias), own.matrix @ before.matrix, own.bias_sigma)
