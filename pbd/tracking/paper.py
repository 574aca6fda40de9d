"""The chain of Neto, Pires and Moreira (2013), to the equation: `--method paper`.

Roll and pitch are the device's, yaw is a Kalman filter's; gravity is projected out (2-4), acceleration summed twice
(5-6) while Algorithm 1 finds motion in the variance of the resulting acceleration (7-9). Where it leaves a choice:

- lambda_m has no printed value: 10 samples (the shortest rest of its Table I has 14);
- the mean in (9) is that of the window of (8);
- `updated` is set at each beginning too, else an isolated detection would end before it began;
- the velocity is zero at each beginning;
- read to the letter with tilt taken from the same accelerometer sample, the horizontal acceleration would be zero: the
  paper's compass low-passes its tilt. Where a device gives none, so do we, with the OS5000's time constant.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from pbd.data import Recording, Stop
from pbd.data.covariance import PoseCovariance
from pbd.errors import TrackingError, warn
from pbd.pose import Array, quat_from_rpy, quat_inverse, quat_rotate
from pbd.tracking.estimate import NEVER_STILL, Estimate
from pbd.tracking.first_rest import Rest
from pbd.tracking.smoother.path import Path
from pbd.tracking.zero_velocity import runs

WINDOW = 2
"""n of equations 8 and 9, samples."""

LAMBDA_V = 0.01
"""Variance of the resulting acceleration above which the hand moves, (m/s2)^2."""

LAMBDA_M = 10
"""Samples without a detection after which a motion has ended."""

TILT_LOWPASS_S = 0.3
"""s: time constant of the tilt from the accelerometer, where the device gives no attitude."""

YAW_SIGMA = np.radians(1.0)
"""rad: one sigma of the compass."""

GYRO_SIGMA, BIAS_WALK = np.radians(0.3), np.radians(0.01)
"""rad/s per sample: one sigma of the gyro; step of its bias' random walk."""


def track_as_paper(recording: Recording, rest: Rest) -> Estimate:
    """The whole chain, on a repaired recording.

    Raises:
        TrackingError: no compass; the hand never stands still.
    """
    wxyz = paper_attitude(recording)
    a_nav = paper_acceleration(recording, wxyz, rest.gravity)
    stops = paper_stops(recording.t, a_nav)
    if not stops:
        raise TrackingError(NEVER_STILL)
    p, v, closure = paper_path(recording.t, a_nav, stops)
    covariance = PoseCovariance.chained(paper_covariance(recording.t, stops, closure))
    return Estimate(Path(wxyz, v, p, a_nav), stops, closure, covariance)


def paper_attitude(recording: Recording) -> Array:
    """The sensor's orientation in nav, (n, 4) wxyz.

    Roll and pitch come from the device, or from its low-passed accelerometer; yaw from `filter_yaw`.

    Raises:
        TrackingError: neither the device's attitude nor a magnetometer, so there is no compass.
    """
    if recording.device_rpy is not None:
        roll, pitch, compass = recording.device_rpy.T
    elif recording.mag is not None:
        roll, pitch = _tilt(recording)
        # The field, laid level; without declination y is where it points.
        level = quat_from_rpy(np.column_stack((roll, pitch, np.zeros_like(roll))))
        east, north, _ = quat_rotate(level, recording.mag).T
        compass = np.arctan2(east, north)
    else:
        raise TrackingError(
            "the paper's method needs a compass: the device's own attitude or a magnetometer; use --method default"
        )
    rate = np.zeros(len(recording))
    if recording.gyr is not None:
        _, wy, wz = recording.gyr.T
        rate = (wy * np.sin(roll) + wz * np.cos(roll)) / np.maximum(np.cos(pitch), 0.1)
    yaw, _ = filter_yaw(recording.t, rate, compass, with_gyro=recording.gyr is not None)
    return quat_from_rpy(np.column_stack((roll, pitch, yaw)))


def filter_yaw(t: Array, rate: Array, compass: Array, with_gyro: bool = True) -> tuple[Array, Array]:
    """Kalman filter: state yaw and gyro bias, the gyro as input, the compass as measurement (innovations wrapped).

    Args:
        t: (n,) s.
        rate: (n,) rad/s, the yaw's rate by the gyro.
        compass: (n,) rad.
        with_gyro: False: the rate is unknown, and the filter follows the compass.

    Returns:
        yaw (n,) rad and bias (n,) rad/s.
    """
    from filterpy.kalman import KalmanFilter

    kalman = KalmanFilter(dim_x=2, dim_z=1, dim_u=1)
    kalman.x = np.array([compass[0], 0.0])
    kalman.P = np.diag([YAW_SIGMA**2, np.radians(1.0) ** 2 if with_gyro else 0.0])
    kalman.H = np.array([[1.0, 0.0]])
    kalman.R = np.array([[YAW_SIGMA**2]])
    rate_sigma = GYRO_SIGMA if with_gyro else np.radians(200.0)
    yaw, bias = np.empty(len(t)), np.empty(len(t))
    for i, dt in enumerate(np.diff(t, prepend=t[0])):
        kalman.F = np.array([[1.0, -dt], [0.0, 1.0]])
        kalman.B = np.array([[dt], [0.0]])
        kalman.Q = np.diag([(rate_sigma * dt) ** 2, (BIAS_WALK * dt) ** 2 if with_gyro else 0.0])
        kalman.predict(u=np.array([rate[i]]))
        innovation = np.arctan2(np.sin(compass[i] - kalman.x[0]), np.cos(compass[i] - kalman.x[0]))
        kalman.update(np.array([kalman.x[0] + innovation]))
        yaw[i], bias[i] = kalman.x
    return yaw, bias


def paper_acceleration(recording: Recording, wxyz: Array, gravity: float) -> Array:
    """Equations 2-4: gravity projected into the sensor's axes and taken out, the rest turned into nav; (n, 3) m/s2."""
    g_sensor = quat_rotate(quat_inverse(wxyz), (0.0, 0.0, gravity))  # (2), (3)
    return quat_rotate(wxyz, recording.acc - g_sensor)  # (4)


def paper_stops(t: Array, a_nav: Array) -> tuple[Stop, ...]:
    """Algorithm 1: the rests between the motions found in the variance of the resulting acceleration."""
    variance = resulting_variance(a_nav)
    moving = np.zeros(len(t), dtype=bool)
    begun: int | None = None
    updated = 0
    for i in np.flatnonzero(variance > LAMBDA_V).tolist():
        if begun is None or i - updated > LAMBDA_M:
            begun = i
        updated = i
        moving[begun : updated + 1] = True
    return tuple(Stop(start, stop, float(t[stop - 1] - t[start])) for start, stop in runs(~moving))


def resulting_variance(a_nav: Array) -> Array:
    """Equations 7-9: (n,) variance over the last WINDOW samples of the resulting acceleration, (m/s2)^2."""
    resulting = np.linalg.norm(a_nav, axis=1)  # (7)
    padded = np.concatenate((np.full(WINDOW - 1, resulting[0]), resulting))
    window = np.lib.stride_tricks.sliding_window_view(padded, WINDOW)
    mean = window.mean(axis=1, keepdims=True)  # (8)
    variance: Array = ((window - mean) ** 2).mean(axis=1)  # (9)
    return variance


def paper_path(t: Array, a_nav: Array, stops: tuple[Stop, ...]) -> tuple[Array, Array, Array]:
    """Equations 5-6 while the hand moves; at rest the velocity is zero. Returns position, velocity and closures.

    Where the threshold, which is the paper's for its own sensor, shows a single stop, there is a warning.
    """
    if len(stops) == 1:
        _warn_of_threshold(a_nav, stops[0])
    dt = np.diff(t, prepend=t[0])[:, None]
    v = np.zeros_like(a_nav)
    bounds = sorted({0, len(t), *(i for stop in stops for i in (stop.start, stop.stop))})
    rests = {stop.start for stop in stops}
    closure = []
    for start, stop in pairwise(bounds):
        if start in rests:
            continue
        v[start:stop] = np.cumsum(a_nav[start:stop] * dt[start:stop], axis=0)  # (5)
        if stops and stops[0].stop <= start and stop <= stops[-1].start:
            closure.append(v[stop - 1])
    p = np.cumsum(v * dt, axis=0)  # (6)
    origin = p[stops[0].start] if stops else p[0]
    return p - origin, v, np.array(closure).reshape(-1, 3)


def _warn_of_threshold(a_nav: Array, stop: Stop) -> None:
    largest = float(resulting_variance(a_nav).max())
    seen = "no motion" if stop.stop - stop.start == len(a_nav) else "a single stop"
    warn(
        f"--method paper finds {seen} in this sensor's data: the variance of its acceleration is at most "
        f"{largest:.2g}, and the paper's threshold lambda_v = {LAMBDA_V:g} (m/s2)^2 is for its own sensor at 40 Hz; "
        "use --method default"
    )


def paper_covariance(t: Array, stops: tuple[Stop, ...], closure: Array) -> Array:
    """Covariance (len(stops), 6, 6): the velocity left over at a move's end was built up in it and stays in it."""
    cov = np.zeros((len(stops), 6, 6))
    for k in range(1, len(stops)):
        duration = t[stops[k].start] - t[stops[k - 1].stop - 1]
        cov[k, :3, :3] = cov[k - 1, :3, :3] + np.diag((0.5 * duration * closure[k - 1]) ** 2 + 1e-6)
    cov[:, 3:, 3:] = np.eye(3) * YAW_SIGMA**2
    return cov


def _tilt(recording: Recording) -> tuple[Array, Array]:
    """Roll and pitch (n,) of the low-passed accelerometer, starting settled."""
    from scipy.signal import lfilter

    keep = np.exp(-1.0 / (TILT_LOWPASS_S * recording.rate_hz))
    start = keep * recording.acc[:1].T
    slow = np.column_stack(
        [lfilter([1.0 - keep], [1.0, -keep], axis, zi=zi)[0] for axis, zi in zip(recording.acc.T, start, strict=True)]
    )
    x, y, z = slow.T
    return np.arctan2(y, z), np.arctan2(-x, np.hypot(y, z))
