"""Calibrate a sensor's errors from one recording in which it is put down in several orientations."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from pbd.calibration.accelerometer import AccelerometerFit, fit_accelerometer
from pbd.calibration.gyro import fit_gyro
from pbd.calibration.magnetometer import MagnetometerFit, fit_magnetometer
from pbd.calibration.rests import Rests, find_rests
from pbd.data import GRAVITY, Recording, SensorErrors
from pbd.errors import CalibrationError
from pbd.pose import Array

KINDS = ("gyr", "acc", "mag")

UNEVEN_FIELD = 0.05
"""Relative rms variation of the field's strength over a recording above which the field is disturbed."""


@dataclass(frozen=True, eq=False)
class SensorFit:
    """What was found, and how well it fits.

    Attributes:
        acc, mag: how well; None where it was not fitted.
        remarks: what a person should know, a line each.
    """

    errors: SensorErrors
    rests: Rests
    acc: AccelerometerFit | None
    mag: MagnetometerFit | None
    remarks: tuple[str, ...]


def calibrate_sensor(
    recording: Recording,
    *,
    gravity: float = GRAVITY,
    only: Collection[str] = (),
    known: SensorErrors | None = None,
    temperature_c: float | None = None,
) -> SensorFit:
    """Find gyro, accelerometer and magnetometer errors.

    Args:
        recording: without NaN, of a sensor that is put down in several orientations.
        gravity: m/s2, of the place.
        only: some of KINDS, which must then succeed; none: what the sensor has, and a magnetometer that was not turned
            far enough is left out with a remark.
        known: earlier errors of the same sensor; those that are not fitted now stay.

    Raises:
        CalibrationError: never still, orientations too alike, not turned far enough, no such channel.
    """
    known = SensorErrors(recording.info.sensor) if known is None else known
    refuse_other_sensor(f"'{recording.info.name}'", recording.info.sensor, known)
    wanted = only or KINDS
    rests = find_rests(recording)
    errors = replace(known, sensor=recording.info.sensor, temperature_c=temperature_c)
    remarks: list[str] = []
    acc = fit_accelerometer(rests, gravity) if "acc" in wanted else None
    if acc is not None:
        errors = replace(errors, acc=acc.linear, gravity=gravity)
        if acc.undetermined:
            remarks.append(
                f"{acc.orientations} orientations do not determine {', '.join(acc.undetermined)}: typical values are "
                "kept; to measure all of them, put each of the six sides and six edges up"
            )
    force = rests.acc if errors.acc is None else errors.acc.correct(rests.acc)
    up: Array = force / np.linalg.norm(force, axis=1, keepdims=True)  # the vertical, as well as it is known
    up_sigma = np.radians(1.0) if acc is None else acc.up_sigma
    if "gyr" in wanted and (recording.gyr is not None or "gyr" in only):
        gyr = fit_gyro(recording, rests, None if acc is None else up, up_sigma)
        if acc is None and known.gyr is not None:
            gyr = replace(gyr, matrix=known.gyr.matrix)
        errors = replace(errors, gyr=gyr)
    mag = None
    if "mag" in wanted and (recording.mag is not None or "mag" in only):
        if recording.mag is None:
            raise CalibrationError("the recording has no magnetometer; record one, or leave it out of --only")
        try:
            mag = fit_magnetometer(recording.mag, rests, up, up_sigma)
        except CalibrationError as reason:
            if "mag" in only:
                raise
            remarks.append(f"the magnetometer is left out: {reason}")
        else:
            errors = replace(errors, mag=mag.linear, field=mag.field, dip=mag.dip)
            if mag.uneven > UNEVEN_FIELD:
                remarks.append(
                    f"the magnetic field varies by {100.0 * mag.uneven:.0f} % over the recording: move away from iron "
                    "and motors, and calibrate the magnetometer again where you will demonstrate"
                )
    return SensorFit(errors, rests, acc, mag, tuple(remarks))


def corrected(recording: Recording, errors: SensorErrors | None) -> Recording:
    """The recording as a sensor without these errors would have made it. Its own attitude stays as it is.

    Raises:
        CalibrationError: the errors are those of another sensor.
    """
    if errors is None:
        return recording
    refuse_other_sensor(f"'{recording.info.name}'", recording.info.sensor, errors)
    given = ((kind, getattr(errors, kind), getattr(recording, kind)) for kind in KINDS)
    return replace(
        recording, **{kind: e.correct(read) for kind, e, read in given if e is not None and read is not None}
    )


def refuse_other_sensor(what: str, sensor: str, errors: SensorErrors) -> None:
    """Refuse errors of another sensor than the one `what` was made with. A sensor without a name fits all.

    Raises:
        CalibrationError: names both.
    """
    if "unknown" not in (sensor, errors.sensor) and sensor != errors.sensor:
        raise CalibrationError(
            f"{what} is of the sensor '{sensor}', but the calibration's [sensor] is of '{errors.sensor}'; name a "
            "calibration of that sensor, or remove [sensor]",
            value=sensor,
            bound=errors.sensor,
        )
