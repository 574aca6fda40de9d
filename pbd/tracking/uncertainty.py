"""How sure the tracker is of the pose at each stop: what the sensor's noise and the moves' closures imply."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from pbd.data import Recording, Stop
from pbd.errors import TrackingError
from pbd.pose import Array, lengths, quat_from_rpy, quat_inverse, quat_log, quat_multiply
from pbd.tracking.conditioning import Gap
from pbd.tracking.rest import Rest
from pbd.tracking.stops import GYR_FLOOR, REST_FACTOR, STEADY_ACC, WINDOW_S

TILT_SIGMA = np.radians(0.3)
"""rad, of VQF while moving: 0.2 to 0.4 degrees over the real recordings of the benchmark."""

HEADING_SIGMA = np.radians(0.4)
"""rad, with a magnetometer or over the first seconds without one."""

TURN_TILT, MOTION_DRIFT = 0.0007, 0.001
"""Rad per square root of a radian turned; and per root hertz, a share of the acceleration."""

DEVICE_LAG = 0.3
"""Of a turn, the share by which a device's own attitude lags behind it: a compass low-passes its tilt over about as
many seconds, and a hand turns by a radian in one."""

DEVICE_STEP = np.radians(0.5)
"""rad: a device's attitude that changes by less from one sample to the next may as well be its noise."""

TREMOR_HZ = 8.0
"""What shakes a hand that stands still is no slower than this: physiological tremor has 8 to 12 Hz."""

ACC_LEVEL, ACC_LEVEL_WEIGHT = 0.05, 0.3
"""m/s2, the accelerometer's bias and scale as long as the rests don't show more; and how much it takes to show it."""

LEVEL_DOUBT, LEVEL_TURNED = 1.4, 0.1
"""The rests are few: two sigma of Student's t with four degrees of freedom are 1.4 times those of a normal. And the
share of the level by which a bias may be wrong on the way, that turns by a radian from the one rest to the other."""

UNSEEN_HAND = 0.1
"""m/s: how fast a hand may move on average while the data have a hole."""

GYRO_WALK = np.radians(0.02)
"""rad/s: what is left of the gyro's bias after its estimation; heading without a magnetometer drifts by it."""

_TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True)
class MoveFigures:
    """What the covariance of a move follows from.

    Attributes:
        duration: s.
        closure: m/s, the velocity left over at its end.
        turned: rad, all turning on the way, whichever way.
        energy: m2/s3, the integral of the squared motion acceleration.
        distance: m, from its beginning to its end.
        shaken: m/s along each axis, how fast the sensor is at the stops on either hand (`shaking_speed`), rms.
        lag: rad, by how much the attitude may lag behind on the way, where it is a device's own.
    """

    duration: float
    closure: float
    turned: float
    energy: float
    distance: float
    shaken: float = 0.0
    lag: float = 0.0


def move_figures(
    t: Array, a_nav: Array, gyr: Array | None, closure: Array, gone: Array, shaken: float = 0.0, lag: float = 0.0
) -> MoveFigures:
    """Take the figures of one move from its samples: (n,) s, (n, 3) m/s2, (n, 3) rad/s, (3,) m/s, (3,) m, m/s, rad."""
    duration = float(t[-1] - t[0])
    rate = 0.0 if gyr is None else float(np.linalg.norm(gyr, axis=1).mean())
    energy = float((a_nav**2).sum(axis=1).mean()) * duration
    speed, distance = float(np.linalg.norm(closure)), float(np.linalg.norm(gone))
    return MoveFigures(duration, speed, rate * duration, energy, distance, shaken, lag)


def shaking_speed(a_nav: Array) -> float:
    """How fast a sensor is, m/s along each axis, that stands still but is shaken: (n, 3) m/s2 of one stop."""
    return float(np.sqrt(a_nav.var(axis=0).mean())) / (2.0 * np.pi * TREMOR_HZ)


def stop_speed(figures: MoveFigures, rest: Rest, rate_hz: float) -> float:
    """How fast a hand may be, m/s along each axis, where the one stop seems to end or the next one to begin.

    It is shaken, by no less than the rest's noise implies. And it sets out and arrives unseen: a minimum-jerk move of
    length D and duration T (Flash and Hogan, 1985) begins with jerk J = 60 D / T^3, which is sqrt(210) a_rms / T, and
    is seen once its acceleration is over what `find_stops` takes for steady, or its rate of turn over what it takes for
    quiet: after u seconds, at the velocity J u^2 / 2. For quick moves that is next to nothing.
    """
    T = max(figures.duration, 1.0 / rate_hz)
    shaken = max(figures.shaken, rest.acc_rms / np.sqrt(3.0) / (2.0 * np.pi * TREMOR_HZ))
    jerk = np.sqrt(210.0 * max(figures.energy, _TINY) / T) / T
    # Steady to this at first and, within a window, by as much again.
    unseen_acc = 2.0 * STEADY_ACC + 3.0 * rest.acc_rms / np.sqrt(WINDOW_S * rate_hz)
    unseen_rate = max(GYR_FLOOR, np.sqrt(REST_FACTOR) * rest.gyr_rms)
    u = min(unseen_acc / jerk, T * np.sqrt(unseen_rate * T / (30.0 * max(figures.turned, _TINY))), 0.5 * T)
    return float(np.hypot(shaken, 0.5 * jerk * u**2 / np.sqrt(3.0)))


def stop_covariance(
    recording: Recording, a_nav: Array, p_nav_sensor: Array, stops: tuple[Stop, ...], closure: Array, rest: Rest
) -> Array:
    """Covariance (len(stops), 6, 6) of position (m) and rotation vector (rad) in nav at each stop.

    The first stop is the origin and certain; each move adds its own.
    """
    t, cov = recording.t, np.zeros((len(stops), 6, 6))
    level = accelerometer_level(recording, stops, rest)
    speed = [shaking_speed(a_nav[stop.start : stop.stop]) for stop in stops]
    turned = None if recording.gyr is not None else _turned_by_device(recording)
    for k in range(1, len(stops)):
        move = slice(stops[k - 1].stop - 1, stops[k].start + 1)
        gyr = None if recording.gyr is None else recording.gyr[move] - rest.gyro_bias
        gone = p_nav_sensor[stops[k].start] - p_nav_sensor[stops[k - 1].start]
        shaken = float(np.hypot(speed[k - 1], speed[k])) / np.sqrt(2.0)
        lag = 0.0 if turned is None else DEVICE_LAG * float(turned[move.stop - 1] - turned[move.start])
        figures = move_figures(t[move], a_nav[move], gyr, closure[k - 1], gone, shaken, lag)
        cov[k, :3, :3] = cov[k - 1, :3, :3] + move_covariance(figures, rest, recording.rate_hz, level)
    for k, stop in enumerate(stops):
        heading = HEADING_SIGMA
        if recording.mag is None:
            heading = np.hypot(heading, GYRO_WALK * (t[stop.start] - t[stops[0].start]))
        cov[k, 3:, 3:] = np.diag([TILT_SIGMA**2, TILT_SIGMA**2, heading**2])
    return cov


def _turned_by_device(recording: Recording) -> Array | None:
    """All turning up to each sample by the device's own attitude, (n,) rad; its noise is none."""
    if recording.device_rpy is None:
        return None
    wxyz = quat_from_rpy(recording.device_rpy)
    steps = lengths(quat_log(quat_multiply(quat_inverse(wxyz[:-1]), wxyz[1:])))
    return np.concatenate(([0.0], np.cumsum(np.where(steps > DEVICE_STEP, steps, 0.0))))


def unseen_covariance(gaps: tuple[Gap, ...], stops: tuple[Stop, ...]) -> Array:
    """Covariance (len(stops), 3, 3) m2 for long gaps within stops: the hand may have moved while nothing was seen."""
    variance, starts = np.zeros(len(stops)), [stop.start for stop in stops]
    for gap in gaps:
        k = bisect_right(starts, gap.before) - 1
        if k >= 0 and gap.after < stops[k].stop:
            variance[k] += (UNSEEN_HAND * gap.missing_s) ** 2
    return np.cumsum(variance)[:, None, None] * np.eye(3)


def stretch_covariance(p_nav_sensor: Array, stops: tuple[Stop, ...], share: float) -> Array:
    """Covariance (len(stops), 3, 3) m2 where each move may be longer or shorter by this share of it."""
    at = p_nav_sensor[[stop.start for stop in stops]]
    moves = lengths(np.diff(at, axis=0, prepend=at[:1]))
    return np.cumsum((share * moves) ** 2)[:, None, None] * np.eye(3)


def accelerometer_level(recording: Recording, stops: tuple[Stop, ...], rest: Rest) -> float:
    """How large the accelerometer's errors are, m/s2: bias and scale, seen where rests differ in their attitude.

    With u the vertical in sensor axes, a bias b makes gravity look different by (u_k - u_0) b.

    Raises:
        TrackingError: at a stop there is no gravity.
    """
    squares, seen = ACC_LEVEL_WEIGHT * ACC_LEVEL**2, ACC_LEVEL_WEIGHT
    for stop in stops:
        f = recording.acc[stop.start : stop.stop].mean(axis=0)
        norm = float(np.linalg.norm(f))
        if norm < 0.5 * rest.gravity:
            t = float(recording.t[stop.start])
            raise TrackingError(
                f"at the stop at {t:.2f} s the accelerometer reads {norm:.2f} m/s2, far less than gravity; check the "
                "sensor and record again",
                t=t,
                value=norm,
                bound=rest.gravity,
            )
        squares += (norm - rest.gravity) ** 2
        seen += float(((f / norm - rest.up_sensor) ** 2).sum())
    return float(np.sqrt(squares / seen))


def move_covariance(
    figures: MoveFigures, rest: Rest, rate_hz: float, level: float = ACC_LEVEL, end_speed: float | None = None
) -> Array:
    """Covariance (3, 3) m2 of a move's displacement, its velocity being known at both ends.

    It is known to `end_speed`, m/s along each axis; where none is given the ends are stops (`stop_speed`).

    With T its duration and the drift of velocity taken out, eight parts:

    - white noise of density N m/s2/rtHz: N^2 T^3 / 12 (double integral of white noise, its end velocity removed);
    - tilt that changes evenly by d leaves g d T^2 / 12: by the gyro's own noise, and by TURN_TILT for each square root
      of a radian that the hand turns (scale, misalignment);
    - the same for an attitude that lags behind: g lag T^2 / 12;
    - errors that grow with the acceleration, MOTION_DRIFT of it as white noise: MOTION_DRIFT^2 energy T^2 / 12;
    - what the closure c betrays of acceleration errors that wander: (|c| T)^2 / 120 along each axis (for a random walk
      of intensity q, var(v_end) = q T^3 / 3 and, de-drifted, var(p_end) = q T^5 / 120; c has three axes);
    - velocities e and f that were not quite known at the ends: T (e + f) / 2;
    - what turns or stretches the whole path, a tilted vertical and the accelerometer's scale: LEVEL_DOUBT level / g of
      the distance;
    - the accelerometer's bias, which turns with the hand: LEVEL_TURNED level for each radian up to two, as a change
      of tilt.

    The constants are set on all recordings of the benchmark together, which prints the share of truth inside one and
    two sigma for each group of windows (tests/benchmarks/tracking.py).
    """
    T, g = figures.duration, rest.gravity
    if end_speed is None:
        end_speed = stop_speed(figures, rest, rate_hz)
    white = rest.acc_rms**2 / (3.0 * rate_hz) * T**3 / 12.0
    turned = rest.gyr_rms**2 / (3.0 * rate_hz) * T + TURN_TILT**2 * figures.turned
    variance = white + (g * T**2 / 12.0) ** 2 * (turned + figures.lag**2)
    variance += MOTION_DRIFT**2 * figures.energy * T**2 / 12.0
    variance += (figures.closure * T) ** 2 / 120.0 + 0.5 * (end_speed * T) ** 2
    variance += (LEVEL_DOUBT * level / g * figures.distance) ** 2
    variance += (LEVEL_TURNED * level * min(figures.turned, 2.0) * T**2 / 12.0) ** 2
    return np.asarray(variance * np.eye(3))
