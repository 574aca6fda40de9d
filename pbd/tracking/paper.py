"""`--method paper`: the method of Neto, Pires and Moreira (2013), equation by equation.

Source: P. Neto, J. N. Pires, A. P. Moreira, 3-D position estimation from inertial sensing: minimizing the error from
the process of double integration of accelerations, IECON 2013.

Roll and pitch come from the device, yaw from a Kalman filter. Gravity is removed (2-4). Algorithm 1 detects motion in
the variance of the resulting acceleration (7-9). In motion, acceleration is summed twice (5-6). Our choices where the
paper leaves one:

- lambda_m has no printed value. We take 10 samples; the shortest rest in its Table I has 14.
- The mean in (9) is that of the window of (8).
- `updated` is also set when a motion begins. Otherwise an isolated detection would end before it began.
- The velocity is zero when a motion begins.
- With tilt from the same accelerometer sample, horizontal acceleration would be zero. The paper's compass low-passes
  its tilt. For a device without an attitude of its own we do the same, with the OS5000's time constant.
"""

import numpy as np

from pbd.data import Recording, Stop
from pbd.data.covariance import PoseCovariance
from pbd.errors import TrackingError, warn
from pbd.pose import Array, quat_from_rpy, quat_inverse, quat_rotate
from pbd.tracking.estimate import Estimate
from pbd.tracking.first_rest import Rest
from pbd.tracking.smoother.path import SensorPath
from pbd.tracking.zero_velocity import runs

WINDOW = 2
"""Samples in the window of equations 8 and 9 (n)."""

LAMBDA_V = 0.01
"""Variance of the resulting acceleration above which the hand moves, (m/s2)^2."""

LAMBDA_M = 10
"""Number of samples without a detection after which a motion has ended."""

YAW_SIGMA = np.radians(1.0)
"""rad: one sigma of the compass' heading."""


def track_as_paper(recording: Recording, rest: Rest) -> Estimate:
    """Estimate the path from a repaired recording by the paper's method.

    Raises:
        TrackingError: there is no compass.
    """
    wxyz = paper_attitude(recording)
    a_nav = paper_acceleration(recording, wxyz, rest.gravity)
    stops = paper_stops(recording.t, a_nav)
    p, v, closure = paper_path(recording.t, a_nav, stops)
    covariance = PoseCovariance.chained(paper_covariance(recording.t, stops, closure))
    return Estimate(SensorPath(wxyz, v, p, a_nav), stops, closure, covariance)


def paper_attitude(recording: Recording) -> Array:
    """Orientation of the sensor in nav, (n, 4) wxyz: roll and pitch from the device, or from its low-passed
    accelerometer; yaw from `filter_yaw`.

    Raises:
        TrackingError: there is no compass: neither the device's attitude nor a magnetometer.
    """
    if recording.device_rpy is not None:
        roll, pitch, compass = recording.device_rpy.T
    elif recording.mag is not None:
        roll, pitch = _tilt(recording)
        # Magnetic heading, without declination: y points along the field's horizontal part.
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


def filter_yaw(t: Array, rate: Array, compass: Array, *, with_gyro: bool) -> tuple[Array, Array]:
    """Kalman filter of yaw and gyro bias: the gyro is the input, the compass the measurement (wrapped innovations).

    Takes t (n,) s, the yaw rate by the gyro (n,) rad/s, and the compass (n,) rad; without a gyro the rate is unknown,
    and the filter follows the compass. Returns yaw (n,) rad and bias (n,) rad/s.
    """
    from filterpy.kalman import KalmanFilter

    kalman = KalmanFilter(dim_x=2, dim_z=1, dim_u=1)
    kalman.x = np.array([compass[0], 0.0])
    kalman.P = np.diag([YAW_SIGMA**2, np.radians(1.0) ** 2 if with_gyro else 0.0])
    kalman.H = np.array([[1.0, 0.0]])
    kalman.R = np.array([[YAW_SIGMA**2]])
    # One sigma of a gyro sample, rad/s, and of the rate at which its bias changes in a sample, rad/s2.
    rate_sigma, bias_walk = np.radians((0.3, 0.01) if with_gyro else (200.0, 0.0))
    yaw, bias = np.empty(len(t)), np.empty(len(t))
    for i, dt in enumerate(np.diff(t, prepend=t[0])):
        kalman.F = np.array([[1.0, -dt], [0.0, 1.0]])
        kalman.B = np.array([[dt], [0.0]])
        kalman.Q = np.diag([(rate_sigma * dt) ** 2, (bias_walk * dt) ** 2])
        kalman.predict(u=np.array([rate[i]]))
        innovation = np.arctan2(np.sin(compass[i] - kalman.x[0]), np.cos(compass[i] - kalman.x[0]))
        kalman.update(np.array([kalman.x[0] + innovation]))
        yaw[i], bias[i] = kalman.x
    return yaw, bias


def paper_acceleration(recording: Recording, wxyz: Array, gravity: float) -> Array:
    """Equations 2-4: subtract gravity in sensor axes and rotate the rest to nav, (n, 3) m/s2."""
    g_sensor = quat_rotate(quat_inverse(wxyz), (0.0, 0.0, gravity))  # (2), (3)
    return quat_rotate(wxyz, recording.acc - g_sensor)  # (4)


def paper_stops(t: Array, a_nav: Array) -> tuple[Stop, ...]:
    """Algorithm 1: the rests between the motions that the variance of the resulting acceleration shows."""
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
    """Equations 7-9: variance (n,) of the resulting acceleration over the last WINDOW samples, (m/s2)^2."""
    resulting = np.linalg.norm(a_nav, axis=1)  # (7)
    padded = np.concatenate((np.full(WINDOW - 1, resulting[0]), resulting))
    variance: Array = np.lib.stride_tricks.sliding_window_view(padded, WINDOW).var(axis=1)  # (8), (9)
    return variance


def paper_path(t: Array, a_nav: Array, stops: tuple[Stop, ...]) -> tuple[Array, Array, Array]:
    """Equations 5-6 while the hand moves; at rest the velocity is zero. Returns position, velocity and misclosures.

    The threshold is for the paper's own sensor. If it leaves a single stop, there is a warning.
    """
    if len(stops) == 1:
        found = "no motion" if stops[0].stop - stops[0].start == len(a_nav) else "a single stop"
        warn(
            f"--method paper finds {found} in this sensor's data: the variance of its acceleration is at most "
            f"{resulting_variance(a_nav).max():.2g}, and the paper's threshold lambda_v = {LAMBDA_V:g} (m/s2)^2 is "
            "for its own sensor at 40 Hz; use --method default"
        )
    dt = np.diff(t, prepend=t[0])[:, None]
    v = np.zeros_like(a_nav)
    # The first stop begins at row 0: the variance of a single sample is zero. So each move follows a stop.
    arrivals = [stop.start for stop in stops[1:]]
    for stop, end in zip(stops, [*arrivals, len(t)], strict=True):
        move = slice(stop.stop, end)
        v[move] = np.cumsum(a_nav[move] * dt[move], axis=0)  # (5)
    p: Array = np.cumsum(v * dt, axis=0)  # (6)
    return p, v, v[np.array(arrivals, dtype=np.intp) - 1]


def paper_covariance(t: Array, stops: tuple[Stop, ...], closure: Array) -> Array:
    """Covariance (k, 6, 6) at the stops. A velocity error that grows linearly to the misclosure shifts a move's end."""
    cov = np.zeros((len(stops), 6, 6))
    for k in range(1, len(stops)):
        duration = t[stops[k].start] - t[stops[k - 1].stop - 1]
        cov[k, :3, :3] = cov[k - 1, :3, :3] + np.diag((0.5 * duration * closure[k - 1]) ** 2 + 1e-6)
    cov[:, 3:, 3:] = np.eye(3) * YAW_SIGMA**2
    return cov


def _tilt(recording: Recording) -> tuple[Array, Array]:
    """Roll and pitch (n,) rad by the low-passed accelerometer; the filter starts settled."""
    from scipy.signal import lfilter

    keep = np.exp(-1.0 / (0.3 * recording.rate_hz))  # 0.3 s: the OS5000's time constant
    start = keep * recording.acc[:1].T
    slow = np.column_stack(
        [lfilter([1.0 - keep], [1.0, -keep], axis, zi=zi)[0] for axis, zi in zip(recording.acc.T, start, strict=True)]
    )
    x, y, z = slow.T
    return np.arctan2(y, z), np.arctan2(-x, np.hypot(y, z))
