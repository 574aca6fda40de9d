"""The sensor's orientation in nav, from gyro, accelerometer and, where there is one, magnetometer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pbd.data import Attitude, Recording
from pbd.errors import TrackingError
from pbd.pose import (
    Array,
    quat_canonical,
    quat_exp,
    quat_from_rpy,
    quat_multiply,
)
from pbd.tracking.attitude import heading as heading
from pbd.tracking.attitude import mean_quaternion as mean_quaternion
from pbd.tracking.magnetic import magnetic_heading
from pbd.tracking.preintegration import turns_between_middles as turns_between_middles

TAU_ACC_S = 6.0
"""VQF's time constant for tilt from the accelerometer (its default is 3 s): what a hand does within a second or two is
motion, and the longer the constant, the less of it is mistaken for tilt. From 4 to 12 s recordings hardly differ."""


WARM_UP_S = 2.0
"""So much of the first rest is put before a recording that begins with it."""

VQF = {"tauAcc": TAU_ACC_S, "restThGyr": 1.0, "restThAcc": 0.25}
"""VQF takes rest for the gyro's bias: below 1 degree/s and 0.25 m/s2 (its defaults are twice that, and a hand that
turns slowly and smoothly is below them)."""


def estimate_attitude(recording: Recording, first_rest: slice) -> Attitude:
    """Estimate the attitude at each sample's instant by offline VQF with 6 axes; a magnetometer turns it to north.

    VQF pairs the accelerometer with the orientation *after* a gyro step. A sample is the mean over its interval and
    describes its middle, so what VQF is fed is the turn from one sample's middle to the next one's
    (`turns_between_middles`).

    Args:
        recording: without NaN (`condition`).
        first_rest: samples of the first rest; where there is no magnetometer, nav's heading is taken there.

    Raises:
        TrackingError: neither gyro nor device attitude.

    Source: D. Laidig, T. Seel, VQF, Information Fusion 91 (2023), doi 10.1016/j.inffus.2022.10.014.
    """
    if recording.gyr is None:
        return _device_attitude(recording)
    from vqf import offlineVQF

    interval = 1.0 / recording.rate_hz
    rows, t = _regular(recording.t, interval)
    acc, gyr = _at(t, recording.t, recording.acc), _at(t, recording.t, recording.gyr)
    # VQF learns gravity and bias in its first seconds. It is spared the bias of the rest and, where the recording
    # begins with it, is given more of the rest than there was.
    at_rest = recording.gyr[first_rest].mean(axis=0)
    warm_up = round(WARM_UP_S / interval) if first_rest.start == 0 else 0
    rate = turns_between_middles(t, gyr - at_rest, interval) / interval
    acc_warm = np.tile(recording.acc[first_rest].mean(axis=0), (warm_up, 1))
    result = offlineVQF(np.vstack((np.zeros((warm_up, 3)), rate)), np.vstack((acc_warm, acc)), None, interval, VQF)
    wxyz, bias = quat_canonical(result["quat6D"][warm_up:])[rows], at_rest + result["bias"][warm_up:][rows]
    if recording.mag is None:
        to_nav = np.full(len(recording), -heading(wxyz[first_rest]))
    else:
        to_nav = magnetic_heading(recording.t, recording.mag, wxyz, first_rest)
    wxyz = quat_multiply(quat_exp(np.outer(to_nav, (0.0, 0.0, 1.0))), wxyz)
    return Attitude(quat_canonical(wxyz), bias)


def _device_attitude(recording: Recording) -> Attitude:
    if recording.device_rpy is None:
        raise TrackingError(
            "the recording has neither a gyro nor the device's own attitude, so the orientation is unknown; "
            "record gx, gy, gz, or heading, pitch, roll"
        )
    return Attitude(quat_from_rpy(recording.device_rpy), np.zeros((len(recording), 3)))


def _regular(t: Array, interval: float) -> tuple[NDArray[np.intp], Array]:
    """Instants for a filter that knows one interval only: lost samples put back, repeated ones left out.

    Returns:
        (n,) for each row of `t` its place among the instants, and the instants.
    """
    dt = np.diff(t)
    steps = np.where(dt > 0.0, np.maximum(np.rint(dt / interval), 1.0), 0.0).astype(np.intp)
    rows = np.concatenate(([0], np.cumsum(steps)))
    first_rows = np.concatenate(([True], steps > 0))
    return rows, np.interp(np.arange(rows[-1] + 1), rows[first_rows], t[first_rows])


def _at(instants: Array, t: Array, values: Array) -> Array:
    if len(instants) == len(t):
        return np.ascontiguousarray(values)
    return np.column_stack([np.interp(instants, t, column) for column in values.T])
