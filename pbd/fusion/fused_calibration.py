"""Convert the sensor errors that several takes show into those of a calibration."""

from dataclasses import replace

import numpy as np

from pbd.data import HandPath, LinearErrors, SensorErrors
from pbd.data.units import MG
from pbd.errors import CalibrationError
from pbd.pose import Array


def device_errors(path: HandPath) -> tuple[SensorErrors, dict[str, float]]:
    """Return the errors of the first take's device, for `pbd.calibration.sensor.corrected`, and figures of the fit.

    They include what an earlier calibration corrects. They don't include the lag, which no calibration has.

    Raises:
        CalibrationError: the sensor has no gyro, so its errors were not estimated.
    """
    found, tracking = path.sensor, path.tracking
    if found is None or tracking is None or path.fusion is None:
        raise CalibrationError("the sensor's errors were not estimated: it has no gyro; leave out --save-calibration")
    gyr_sigma, acc_sigma = float(found.gyr_matrix.sigma.max()), float(np.tril(found.acc_matrix.sigma).max())
    gyr = LinearErrors(found.gyr_bias.value, np.eye(3) - found.gyr_matrix.value, found.gyr_bias.sigma, gyr_sigma)
    matrix = np.eye(3) - found.acc_matrix.value
    # The smoother subtracts the accelerometer's bias after the matrix, a calibration before it.
    bias: Array = np.asarray(np.linalg.solve(matrix, found.acc_bias.value), dtype=np.float64)
    acc = LinearErrors(bias, matrix, found.acc_bias.sigma, acc_sigma)
    gravity = float(np.linalg.norm(acc.correct(tracking.recording.acc[slice(*tracking.rest)].mean(axis=0))))
    sensor = tracking.recording.info.sensor
    earlier = (tracking.calibration and tracking.calibration.sensor) or SensorErrors(sensor)
    gyr, acc = _composed(earlier.gyr, gyr), _composed(earlier.acc, acc)
    errors = replace(earlier, sensor=sensor, gyr=gyr, acc=acc, gravity=gravity)
    figures = {
        "takes": sum(not take.left_out and take.device == 0 for take in path.fusion.takes),  # 0: the first take's
        "acc_bias_sigma_mg": round(float(found.acc_bias.sigma.max()) / MG, 2),
        "gyr_scale_sigma_pct": round(100.0 * float(np.diagonal(found.gyr_matrix.sigma).max()), 3),
    }
    return errors, figures


def _composed(first: LinearErrors | None, second: LinearErrors) -> LinearErrors:
    """Return the correction second.true(first.true(reading))."""
    if first is None:
        return second
    bias = first.bias + np.linalg.solve(first.matrix, second.bias)
    return replace(second, bias=bias, matrix=second.matrix @ first.matrix)
