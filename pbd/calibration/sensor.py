"""Calibrate a sensor's errors from one recording in which it is put down in several orientations."""

import shlex
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

import numpy as np

from pbd.calibration.accelerometer import AccelerometerFit, fit_accelerometer, up_sigma
from pbd.calibration.field_uniformity import DISTURBED_HEADING
from pbd.calibration.gyro import fit_gyro
from pbd.calibration.magnetometer import MagnetometerFit, fit_magnetometer
from pbd.calibration.rests import Rests, find_rests
from pbd.data import GRAVITY, Recording, SensorErrors
from pbd.data.units import GRAVITY_ON_EARTH, GRAVITY_SIGMA, MG
from pbd.errors import CalibrationError, UsageError, amount, in_degrees, require_kind
from pbd.pose import Array

KINDS = ("gyr", "acc", "mag")

TRUSTED_ACC = 2.0 * MG
"""Smallest error of a calibrated accelerometer, one sigma, m/s2, for tracking (CALIBRATED in pbd/tracking/noise.py)."""

WARNED_MISFIT = 1.5
"""Misfit of the accelerometer's rests above which there is a warning, in TRUSTED_ACC. With twelve rests (three degrees
of freedom) a sensor as good as TRUSTED_ACC exceeds it once in twelve times."""


@dataclass(frozen=True, eq=False)
class SensorFit:
    """A sensor's estimated errors, and how well they fit.

    Attributes:
        errors: the sensor's errors, those that were known before included.
        rests: the rests in which it was measured.
        acc, mag: details of these fits; None for what was not fitted.
        remarks: lines for the user.
    """

    errors: SensorErrors
    rests: Rests
    acc: AccelerometerFit | None
    mag: MagnetometerFit | None
    remarks: tuple[str, ...]


def calibrate_sensor(
    recording: Recording,
    *,
    gravity: float | None = None,
    only: Collection[str] = (),
    known: SensorErrors | None = None,
    temperature_c: float | None = None,
) -> SensorFit:
    """Estimate the errors of gyro, accelerometer and magnetometer.

    Args:
        recording: without NaN, of a sensor that is put down in several orientations.
        gravity: m/s2, local gravity; None: it is unknown, GRAVITY to GRAVITY_SIGMA.
        only: those of gyr, acc, mag to fit, which must succeed. Empty: all that the sensor has; then a magnetometer
            that was not turned far enough is left out with a remark.
        known: earlier errors of the same sensor. Those that are not fitted now are kept.
        temperature_c: the sensor's temperature, noted in the result.

    Raises:
        CalibrationError: the sensor was never still, its orientations are too similar, it was not turned far enough, or
            it lacks what `only` names, or readings are missing.
        UsageError: `only` names something else, or gravity is none on Earth.
        WrongTypeError: `recording` is no Recording.
    """
    gravity, unknown = (GRAVITY, GRAVITY_SIGMA) if gravity is None else (gravity, 0.0)
    _refuse_arguments(recording, gravity, only)
    wanted = only or recording.channels
    known = known or SensorErrors(recording.info.sensor)
    refuse_other_sensor(f"'{recording.info.name}'", recording.info.sensor, known)
    rests = find_rests(recording)
    name = known.sensor if recording.info.sensor == "unknown" else recording.info.sensor
    errors = replace(known, sensor=name, temperature_c=temperature_c)
    acc = fit_accelerometer(rests, gravity) if "acc" in wanted else None
    if acc is not None:
        errors = replace(errors, acc=acc.linear, gravity=gravity)
    force = rests.acc if errors.acc is None else errors.acc.correct(rests.acc)
    up: Array = force / np.linalg.norm(force, axis=1, keepdims=True)  # best available vertical
    leaning = up_sigma(errors.acc)
    if "gyr" in wanted:
        gyr = fit_gyro(recording, rests, None if errors.acc is None else up, leaning)
        if known.gyr and acc is None and not gyr.matrix_sigma < np.nan_to_num(known.gyr.matrix_sigma, nan=np.inf):
            gyr = replace(gyr, matrix=known.gyr.matrix, matrix_sigma=known.gyr.matrix_sigma)
        errors = replace(errors, gyr=gyr)
    mag, left_out = None, list[str]()
    if "mag" in wanted:
        if recording.mag is None:
            raise CalibrationError("the recording has no magnetometer; record one, or leave it out of --only")
        try:
            mag = fit_magnetometer(recording.mag, rests, up, leaning)
            errors = replace(errors, mag=mag.linear, field=mag.field, dip=mag.dip)
        except CalibrationError as reason:
            if "mag" in only:
                raise
            left_out = [f"the magnetometer is left out: {reason}"]
    if acc is not None:  # an error of gravity scales all axes alike: the vertical's direction does not show it
        matrix_sigma = float(np.hypot(acc.linear.matrix_sigma, unknown / gravity))
        errors = replace(errors, acc=replace(acc.linear, matrix_sigma=matrix_sigma))
    return SensorFit(errors, rests, acc, mag, (*_remarks(recording, rests, acc, mag), *left_out))


def _refuse_arguments(recording: Recording, gravity: float, only: Collection[str]) -> None:
    """Refuse wrong arguments of `calibrate_sensor`, and a recording that lacks readings."""
    require_kind("recording", recording, "a Recording", isinstance(recording, Recording))
    if isinstance(only, str) or not set(only) <= set(KINDS):
        raise UsageError(f"only must be a tuple of some of {', '.join(KINDS)}, got {only!r:.60}", value=only)
    least, most = GRAVITY_ON_EARTH
    if not least <= gravity <= most:
        raise UsageError(f"gravity must be from {least} to {most} m/s2, got {gravity:g}", value=gravity)
    if lost := [name for name, read in recording.channels.items() if name != "mag" and not np.isfinite(read).all()]:
        what = f"'{recording.info.name}' lacks readings of {', '.join(lost)}"
        raise CalibrationError(f"{what}; fill them (pbd.tracking.repair.repair_recording), or record again")


def _remarks(
    recording: Recording, rests: Rests, acc: AccelerometerFit | None, mag: MagnetometerFit | None
) -> Iterator[str]:
    if rests.turning:
        yield (
            f"{amount(rests.turning, 'rest')} of {len(rests) + rests.turning} left out: the gyro's reading differs by "
            "more than 0.3 degrees/s from that at most rests; the sensor turned slowly, or the gyro's bias drifts: let "
            "it warm up, and record again"
        )
    if acc is not None and acc.misfit > WARNED_MISFIT * TRUSTED_ACC:
        at = " or ".join(f"{recording.t[row]:.1f} s" for row in rests.start[acc.suspects])
        yield (
            f"the rests contradict each other by {acc.misfit / MG:.0f} mg (rms): the sensor was not still in a "
            f"rest{f' (that at {at} alone would explain it)' if at else ''}, or its bias drifted; let it warm up, "
            "lay it on a table, and record again"
        )
    if acc is not None and acc.undetermined:
        yield (
            f"{amount(acc.orientations, 'orientation')} can't determine {', '.join(acc.undetermined)}: they are "
            "kept near zero; to measure all of them, put each of the six sides up, and an edge between the two axes of "
            "each misalignment"
        )
    if mag is not None and (mag.uneven > 0.05 or mag.heading > DISTURBED_HEADING):
        yield (
            f"the corrected magnetic field varies by {100.0 * mag.uneven:.0f} % in strength and by "
            f"{np.degrees(mag.dip_uneven):.1f} degrees in dip, so headings will be wrong: check the axes and "
            "signs of mx, my, mz, move away from iron and motors, and turn every side up; calibrate again"
        )
    elif mag is not None and mag.axes_turn > np.radians(45.0):  # half-way between axes as named and axes exchanged
        yield (
            f"the magnetometer's axes are turned by {in_degrees(mag.axes_turn)} against the accelerometer's: mx, "
            "my, mz have wrong names or signs; this is corrected, but north may be south; to mend it, name its "
            "columns when you import, and calibrate again"
        )


def corrected(recording: Recording, errors: SensorErrors | None) -> Recording:
    """Return the recording with the sensor's errors removed. The sensor's own attitude output stays as it is.

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
    """Refuse errors that are not of the sensor with which `what` was made. A sensor without a name matches any.

    Raises:
        CalibrationError: names both sensors.
    """
    if "unknown" not in (sensor, errors.sensor) and sensor != errors.sensor:
        raise CalibrationError(
            f"{what} is of the sensor '{sensor}', but the calibration's [sensor] is of '{errors.sensor}'; name a "
            "calibration of that sensor, or remove [sensor]; if they are one device, import its recordings with "
            f"--sensor {shlex.quote(errors.sensor)}",
            value=sensor,
            bound=errors.sensor,
        )
