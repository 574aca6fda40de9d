"""Where the smoother starts: the attitude by VQF's six axes, or the device's own."""

from __future__ import annotations

import numpy as np

from pbd.data import Recording
from pbd.errors import TrackingError
from pbd.pose import Array, quat_canonical, quat_from_rpy, quat_inverse, quat_log, quat_multiply, quat_rotate
from pbd.tracking.preintegration import GyroFrame, Rows, gyro_frame

STEP_S = 0.04
"""s: VQF is fed means over this long; the gyro frame has the rest."""

WARM_UP_S = 2.0
"""s: so much of the first rest is put before a recording that begins with it."""

VQF = {"tauAcc": 6.0, "restThGyr": 1.0, "restThAcc": 0.25}
"""VQF's time constant for tilt is longer than a hand's motion (s); rest is below 1 degree/s and 0.25 m/s2."""


def frame_of(recording: Recording, gyro_bias: Array) -> GyroFrame:
    """The gyro frame of a recording; without a gyro that of the device's own attitude.

    Raises:
        TrackingError: neither.
    """
    t, interval = recording.t, 1.0 / recording.rate_hz
    if recording.gyr is not None:
        return gyro_frame(t, recording.gyr - gyro_bias, recording.acc, interval)
    if recording.device_rpy is None:
        raise TrackingError(
            "the recording has neither a gyro nor the device's own attitude, so the orientation is unknown; "
            "record gx, gy, gz, or heading, pitch, roll"
        )
    wxyz = quat_from_rpy(recording.device_rpy)
    dt, turns = np.diff(t)[:, None], quat_log(quat_multiply(quat_inverse(wxyz[:-1]), wxyz[1:]))
    turns = np.divide(turns, dt, out=np.zeros_like(turns), where=dt > 0.0)
    gyr = 0.5 * (np.vstack((turns, turns[-1:])) + np.vstack((turns[:1], turns)))
    return gyro_frame(t, gyr, recording.acc, interval, wxyz)


def steadiness(frame: GyroFrame, device: bool) -> tuple[Array, Array]:
    """What tells that a sensor stands still: specific force (n, 3) m/s2, which is constant, and rate (n, 3) rad/s.

    A device's own attitude follows a turn late; without a gyro it is specific force in sensor axes alone.
    """
    return (frame.acc, np.zeros_like(frame.acc)) if device else (frame.u, frame.gyr)


def first_guess(frame: GyroFrame, rows: Rows, first_rest: slice) -> Array:
    """The gyro frame in a level frame, (k, 4) wxyz at some rows, by offline VQF with 6 axes.

    Source: D. Laidig, T. Seel, VQF, Information Fusion 91 (2023), doi 10.1016/j.inffus.2022.10.014.
    """
    from vqf import offlineVQF

    n, interval = len(frame.t), float(np.median(np.diff(frame.t)))
    every = max(1, min(round(STEP_S / interval), n))
    k = n // every
    acc, gyr = (values[: k * every].reshape(k, every, 3).mean(axis=1) for values in (frame.acc, frame.gyr))
    warm_up = round(WARM_UP_S / (every * interval)) if first_rest.start < every else 0
    at_rest = np.tile(frame.acc[first_rest].mean(axis=0), (warm_up, 1))
    gyr, acc = np.vstack((np.zeros((warm_up, 3)), gyr)), np.vstack((at_rest, acc))
    wxyz = offlineVQF(gyr, acc, None, every * interval, VQF)["quat6D"][warm_up:]
    middle = np.arange(k) * every + every // 2
    nearest = np.clip(np.searchsorted(middle, rows), 0, k - 1)
    return quat_multiply(wxyz[nearest], quat_inverse(frame.wxyz[middle[nearest]]))


def mean_quaternion(wxyz: Array) -> Array:
    """Average unit quaternions (n, 4) that lie close together -> (4,)."""
    aligned = np.where((wxyz @ wxyz[0])[:, None] < 0.0, -wxyz, wxyz)
    return quat_canonical(aligned.mean(axis=0))


def heading(wxyz: Array) -> float:
    """Heading of the sensor's x axis laid level, or of its y axis where x is within 30 degrees of vertical."""
    q = mean_quaternion(wxyz)
    axis = quat_rotate(q, (1.0, 0.0, 0.0))
    if abs(axis[2]) > np.cos(np.radians(30.0)):
        axis = quat_rotate(q, (0.0, 1.0, 0.0))
    return float(np.arctan2(axis[1], axis[0]))
