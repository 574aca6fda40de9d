"""Initial attitude: the gyro frame levelled at the stops, or the device's own attitude."""

import numpy as np

from pbd.data import Recording
from pbd.errors import TrackingError
from pbd.pose import (
    Array,
    lengths,
    quat_canonical,
    quat_exp,
    quat_from_rpy,
    quat_inverse,
    quat_log,
    quat_multiply,
    quat_rotate,
    quat_to_rpy,
)
from pbd.tracking.moving_windows import Rows, Spans
from pbd.tracking.smoother.preintegration import GyroFrame, gyro_frame

NO_ORIENTATION = (
    "there is neither a gyro nor the device's own attitude, so the orientation is unknown; "
    "record gx, gy, gz, or heading, pitch, roll"
)


def gyro_frame_of(recording: Recording, gyro_bias: Array) -> GyroFrame:
    """The gyro frame of a recording; without a gyro, integrated in the device's own attitude.

    Raises:
        TrackingError: the recording has neither.
    """
    t, interval = recording.t, 1.0 / recording.rate_hz
    if recording.gyr is not None:
        return gyro_frame(t, recording.gyr - gyro_bias, recording.acc, interval)
    if recording.device_rpy is None:
        raise TrackingError(NO_ORIENTATION)
    wxyz = quat_from_rpy(recording.device_rpy)
    return gyro_frame(t, _rates(t, wxyz), recording.acc, interval, wxyz)


def _rates(t: Array, wxyz: Array) -> Array:
    """Turn rate (n, 3) rad/s, in sensor axes, at each attitude (n, 4)."""
    dt, turns = np.diff(t)[:, None], quat_log(quat_multiply(quat_inverse(wxyz[:-1]), wxyz[1:]))
    turns = np.divide(turns, dt, out=np.zeros_like(turns), where=dt > 0.0)
    return 0.5 * (np.vstack((turns, turns[-1:])) + np.vstack((turns[:1], turns)))


def without_low_pass(t: Array, rpy: Array, time_constant: float) -> Array:
    """Roll, pitch and yaw (n, 3) rad before a first-order low-pass: it lags by its rate times its time constant, s."""
    wxyz = quat_from_rpy(rpy)
    return quat_to_rpy(quat_multiply(wxyz, quat_exp(time_constant * _rates(t, wxyz))))


def level_at_stops(frame: GyroFrame, rows: Rows, stops: Spans) -> Array:
    """Rotation from the gyro frame to a frame with z up, (k, 4) wxyz at some rows, each from the nearest stop.

    Mean specific force at a stop is vertical. Each stop adds the shortest turn to the rotation of the stop before.
    """
    start, stop = np.transpose(stops)
    gained = frame.U[stop - 1] - frame.U[start]
    levels, level = [], np.array([1.0, 0.0, 0.0, 0.0])
    for up in gained / np.maximum(lengths(gained), 1e-9)[:, None]:
        level = quat_canonical(quat_multiply(quat_to_vertical(quat_rotate(level, up)), level))
        levels.append(level)
    return np.array(levels)[np.searchsorted(0.5 * (stop[:-1] + start[1:]), rows)]


def quat_to_vertical(up: Array) -> Array:
    """The shortest turn of a unit vector (3,) to the vertical (any half turn if it points down): wxyz, unnormalised."""
    x, y, z = up
    return np.array((1.0 + z, y, 1e-12 - x, 0.0))


def mean_quaternion(wxyz: Array) -> Array:
    """Mean (4,) of unit quaternions (n, 4) that are close together."""
    aligned = np.where((wxyz @ wxyz[0])[:, None] < 0.0, -wxyz, wxyz)
    return quat_canonical(aligned.mean(axis=0))


def heading(wxyz: Array) -> float:
    """Mean heading, rad, of the sensor's x axis laid level, or of its y axis if x is within 30 degrees of vertical."""
    q = mean_quaternion(wxyz)
    axis = quat_rotate(q, (1.0, 0.0, 0.0))
    if abs(axis[2]) > np.cos(np.radians(30.0)):
        axis = quat_rotate(q, (0.0, 1.0, 0.0))
    return float(np.arctan2(axis[1], axis[0]))
