"""Check a recording before anything is computed from it. What can't be repaired is refused, with its row and time."""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording
from pbd.errors import RecordingError, warn
from pbd.tracking.repair.channel_faults import WITHOUT_FIELD, frozen_rows, magnetometer_is_dead, refuse_dead
from pbd.tracking.repair.clock import with_checked_times
from pbd.tracking.repair.gaps import BRIDGED_S, FROZEN, Gap, bridged, find_gaps, warn_of_gaps
from pbd.tracking.repair.gyro_consistency import refuse_disagreement
from pbd.tracking.repair.splices import in_order, refuse_doubled, without_wild
from pbd.tracking.repair.tilt_compass import warn_of_tilt_compass
from pbd.tracking.repair.units import LARGEST_READING, refuse_other_units


def repair_recording(recording: Recording) -> tuple[Recording, tuple[Gap, ...]]:
    """Check a recording; interpolate missing and wild samples, exchange swapped blocks, even out coarse time stamps.

    Returns the recording without NaN and with the same rows, and the gaps that are too long to be bridged. Whether
    these matter depends on whether the hand moved (`refuse_gaps`).

    Raises:
        RecordingError: it is too short, time runs backwards or jumps, a channel is empty, stuck or in another unit, a
            block came twice, or the gyro contradicts gravity.
    """
    # Contiguous columns: numpy is several times as fast with them.
    columns: dict[str, Any] = {name: np.asfortranarray(values) for name, values in recording.channels.items()}
    recording = with_checked_times(dataclasses.replace(recording, **columns))
    t, interval = recording.t, 1.0 / recording.rate_hz
    refuse_other_units(recording)
    recording, missing = _fill_missing(recording)
    refuse_dead(recording)
    refuse_doubled(recording)
    if magnetometer_is_dead(recording):
        recording = dataclasses.replace(recording, mag=None)
    recording = in_order(without_wild(recording))
    frozen = frozen_rows(recording, missing)
    missing |= frozen
    if missing.all():
        raise RecordingError(
            "no row has a reading of both accelerometer and gyro; interpolate them to common times (numpy.interp)"
        )
    gaps = find_gaps(t, missing, interval)
    gaps = [dataclasses.replace(gap, fault=FROZEN) if frozen[gap.before : gap.after + 1].any() else gap for gap in gaps]
    warn_of_gaps(gaps, t, interval)
    if missing.any():
        gyr = None if recording.gyr is None else bridged(t, recording.gyr, ~missing)
        recording = dataclasses.replace(recording, acc=bridged(t, recording.acc, ~missing), gyr=gyr)
    long = tuple(gap for gap in gaps if gap.missing_s > BRIDGED_S + 1e-6)
    part = _longest_unbroken(recording, long)
    if part is not None:
        refuse_disagreement(part)
    warn_of_tilt_compass(recording)
    return recording, long


def _longest_unbroken(recording: Recording, gaps: tuple[Gap, ...]) -> Recording | None:
    """The longest part between gaps, in which gyro and gravity can be compared. None if it is shorter than a second."""
    if not gaps:
        return recording
    begins, ends = [0, *(gap.after for gap in gaps)], [*(gap.before + 1 for gap in gaps), len(recording)]
    start, stop = max(zip(begins, ends, strict=True), key=lambda part: part[1] - part[0])
    if stop - start < recording.rate_hz or np.median(np.diff(recording.t[start:stop])) <= 0.0:
        return None
    part = slice(start, stop)
    gyr = None if recording.gyr is None else recording.gyr[part]
    return Recording(recording.t[part], recording.acc[part], gyr, info=recording.info)


def _fill_missing(recording: Recording) -> tuple[Recording, NDArray[np.bool_]]:
    """Interpolate missing readings. Also returns the rows (n,) without a reading of accelerometer or gyro."""
    missing = np.zeros(len(recording), dtype=bool)
    filled: dict[str, Any] = {}
    for name, values in recording.channels.items():
        good = np.asarray((np.abs(values) < LARGEST_READING).all(axis=1))  # False for NaN
        if not good.any() and name == "mag":
            warn(f"the magnetometer has no number in any row {WITHOUT_FIELD}")
            filled[name] = None
            continue
        if not good.any():
            raise RecordingError(f"'{name}' has no number in any row; leave the column out or record again")
        # A magnetometer is often sampled more slowly: rows without it are no gap.
        missing |= ~good if name in ("acc", "gyr") else False
        filled[name] = bridged(recording.t, values, good)
    return dataclasses.replace(recording, **filled), missing
