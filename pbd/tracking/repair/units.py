"""Readings that are likely in another unit than the one that was given, or assumed because none was given."""

from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording
from pbd.data.source_columns import NO_UNIT, SourceColumns
from pbd.data.units import DEG, UNITS
from pbd.errors import RecordingError, warn
from pbd.pose import Array
from pbd.tracking.first_rest import likely_unit

LARGEST_READING = 1e5
"""Largest possible reading of any sensor, in its SI unit or uT. A larger one counts as missing."""

EARTH_FIELD = (22.0, 67.0)
"""Weakest and strongest field of the Earth at any place, uT (World Magnetic Model 2020)."""

FIELD_UNITS = ("uT", "gauss", "nT")
"""Units of a magnetometer that its strength tells apart. A part's own field (hard iron) changes it several times over,
so mgauss, which are a tenth of a uT, can't be told."""

FASTEST_GYRO = 4000.0 * DEG
"""Largest range of a usual gyro, rad/s. A count is smaller than a rad/s at any range."""


def refuse_other_units(recording: Recording) -> None:
    """Refuse a field, an attitude or a turn rate that can only be in another unit; warn of an unlikely field.

    Raises:
        RecordingError: with the options of `pbd import` that correct it.
    """
    if recording.mag is not None:
        _refuse_field_unit(recording.mag, recording.info.source)
    if recording.gyr is not None:
        _refuse_gyro_counts(recording.gyr, recording.acc, recording.info.source)
    if recording.device_rpy is not None:
        _refuse_degrees(recording.device_rpy)


def _refuse_field_unit(mag: Array, source: SourceColumns) -> None:
    """Refuse a field (n, 3) that can only be in another unit than uT or the Earth's field (a.u.).

    If its unit was assumed, warn of a field that is more likely in another of FIELD_UNITS.
    """
    known = np.hypot.reduce(mag[(np.abs(mag) < 1e9).all(axis=1)], axis=1)  # no square underflows; without NaN
    usual = float(np.median(known)) if len(known) else 0.0
    earth = f"the Earth's field is {EARTH_FIELD[0]:.0f} to {EARTH_FIELD[1]:.0f} uT"
    if 0.0 < usual < 0.01 or usual > LARGEST_READING:  # less is lost in the four decimals of imu.csv
        raise RecordingError(
            f"the magnetometer reads {usual:.2g} uT, but {earth}: its unit is another; "
            "import the file with --unit mag=T, gauss, mgauss, nT or uT",
            value=usual,
        )
    if usual > 0.0 and _is_assumed(source, "mag"):
        likely = min(FIELD_UNITS, key=lambda unit: abs(log(usual * UNITS["mag"][unit] / sqrt(np.prod(EARTH_FIELD)))))
        if likely != "uT":
            warn(
                f"the magnetometer's columns {source.names('mag')} have no unit, and are taken as uT, but read "
                f"{usual:.2g}, and {earth}: they are likely in {likely}; import the file with --unit mag={likely}, or "
                "with mag=uT (mag=a.u. for multiples of the Earth's field) if that is right"
            )


def _refuse_gyro_counts(gyr: Array, acc: Array, source: SourceColumns) -> None:
    """Refuse a gyro (n, 3) of whole numbers that are too large for rad/s, if its unit was assumed."""
    largest = float(np.abs(gyr, where=np.isfinite(gyr), out=np.zeros_like(gyr)).max())
    if not largest > FASTEST_GYRO or not _is_assumed(source, "gyr") or not _is_whole(gyr):
        return
    also = ""
    if _is_assumed(source, "acc") and _is_whole(acc):
        also = f", and --unit acc={likely_unit(float(np.nanmedian(np.linalg.norm(acc, axis=1))), 1.0) or 'NUMBERg'}"
    raise RecordingError(
        f"the gyro's columns {source.names('gyr')} have no unit, and hold whole numbers up to {largest:.6g}: they are "
        "likely raw counts, not rad/s; import the file with the size of a count by the sensor's data sheet, --unit "
        f"gyr=NUMBERdeg/s (0.0076336 for an MPU-6050 at 250 deg/s){also}",
        value=largest,
        bound=FASTEST_GYRO,
    )


def _refuse_degrees(rpy: Array) -> None:
    """Refuse the device's own attitude (n, 3) if it can only be in degrees.

    Single wild values are no sign of it, nor is a heading that counts on after a turn.
    """
    largest = np.abs(rpy).max(axis=1)
    good = largest[largest < LARGEST_READING]
    if len(good) and (angle := float(np.percentile(good, 95.0))) > 4.0 * np.pi:
        what = f"the device's own attitude has angles up to {angle:.3g} rad: they are in degrees"
        raise RecordingError(f"{what}; import the file with --unit angle=deg", value=angle)


def _is_assumed(source: SourceColumns, channel: str) -> bool:
    return any(column.unit_by == NO_UNIT for column in source.of(channel))


def _is_whole(values: Array) -> bool:
    known: NDArray[np.float64] = values[np.isfinite(values)]
    return bool(len(known) and (known == np.rint(known)).all())
