"""How sure the tracker is of the pose at each stop: what the sensor's noise and the moves' closures imply."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd.data import Recording, Stop
from pbd.errors import TrackingError
from pbd.pose import Array
from pbd.tracking.conditioning import Gap
from pbd.tracking.rest import Rest

TILT_SIGMA = np.radians(0.3)
"""rad, of VQF while moving: 0.2 to 0.4 degrees over the real recordings of the benchmark."""

HEADING_SIGMA = np.radians(0.4)
"""rad, with a magnetometer or over the first seconds without one."""

WANDER, UNSEEN_SPEED = 0.11, 0.0022
"""Of `move_covariance`: a share, and m/s."""

TURN_TILT, MOTION_DRIFT = 0.001, 0.001
"""Rad per square root of a radian turned; and per root hertz, a share of the acceleration."""

ACC_LEVEL, ACC_LEVEL_WEIGHT = 0.05, 0.3
"""m/s2, the accelerometer's bias and scale as long as the rests don't show more; and how much it takes to show it."""

UNSEEN_HAND = 0.1
"""m/s: how fast a hand may move on average while the data have a hole."""

GYRO_WALK = np.radians(0.02)
"""rad/s: what is left of the gyro's bias after its estimation; heading without a magnetometer drifts by it."""


@dataclass(frozen=True)
class MoveFigures:
    """What the covariance of a move follows from.

    Attributes:
        duration: s.
        closure: m/s, the velocity left over at its end.
        turned: rad, all turning on the way, whichever way.
        energy: m2/s3, the integral of the squared motion acceleration.
        distance: m, from its beginning to its end.
    """

    duration: float
    closure: float
    turned: float
    energy: float
    distance: float


def move_figures(t: Array, a_nav: Array, gyr: Array | None, closure: Array, gone: Array) -> MoveFigures:
    """Take the figures of one move from its samples: (n,) s, (n, 3) m/s2, (n, 3) rad/s, (3,) m/s and (3,) m."""
    duration = float(t[-1] - t[0])
    rate = 0.0 if gyr is None else float(np.linalg.norm(gyr, axis=1).mean())
    energy = float((a_nav**2).sum(axis=1).mean()) * duration
    return MoveFigures(duration, float(np.linalg.norm(closure)), rate * duration, energy, float(np.linalg.norm(gone)))


def stop_covariance(
    recording: Recording, a_nav: Array, p_nav_sensor: Array, stops: tuple[Stop, ...], closure: Array, rest: Rest
) -> Array:
    """Covariance (len(stops), 6, 6) of position (m) and rotation vector (rad) in nav at each stop.

    The first stop is the origin and certain; each move adds its own.
    """
    t, cov = recording.t, np.zeros((len(stops), 6, 6))
    level = accelerometer_level(recording, stops, rest)
    for k in range(1, len(stops)):
        move = slice(stops[k - 1].stop - 1, stops[k].start + 1)
        gyr = None if recording.gyr is None else recording.gyr[move] - rest.gyro_bias
        gone = p_nav_sensor[stops[k].start] - p_nav_sensor[stops[k - 1].start]
        figures = move_figures(t[move], a_nav[move], gyr, closure[k - 1], gone)
        cov[k, :3, :3] = cov[k - 1, :3, :3] + move_covariance(figures, rest, recording.rate_hz, level)
    for k, stop in enumerate(stops):
        heading = HEADING_SIGMA
        if recording.mag is None:
            heading = np.hypot(heading, GYRO_WALK * (t[stop.start] - t[stops[0].start]))
        cov[k, 3:, 3:] = np.diag([TILT_SIGMA**2, TILT_SIGMA**2, heading**2])
    return cov


def unseen_covariance(gaps: tuple[Gap, ...], stops: tuple[Stop, ...]) -> Array:
    """Covariance (len(stops), 3, 3) m2 for long gaps within stops: the hand may have moved while nothing was seen."""
    variance = np.zeros(len(stops))
    for gap in gaps:
        for k, stop in enumerate(stops):
            if stop.start <= gap.before and gap.after < stop.stop:
                variance[k:] += (UNSEEN_HAND * gap.missing_s) ** 2
    return variance[:, None, None] * np.eye(3)


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
                f"at the stop at {t:.2f} s the accelerometer reads {norm:.2f} m/s2, though gravity is there; check the "
                "sensor and record again",
                t=t,
                value=norm,
                bound=rest.gravity,
            )
        squares += (norm - rest.gravity) ** 2
        seen += float(((f / norm - rest.up_sensor) ** 2).sum())
    return float(np.sqrt(squares / seen))


def move_covariance(figures: MoveFigures, rest: Rest, rate_hz: float, level: float = ACC_LEVEL) -> Array:
    """Covariance (3, 3) m2 of a move's displacement, its velocity being known at both ends.

    With T its duration and the drift of velocity taken out, six parts:

    - white noise of density N m/s2/rtHz: N^2 T^3 / 12 (double integral of white noise, its end velocity removed);
    - tilt that changes evenly by d leaves g d T^2 / 12: by the gyro's own noise, and by TURN_TILT for each square root
      of a radian that the hand turns (scale, misalignment);
    - errors that grow with the acceleration, MOTION_DRIFT of it as white noise: MOTION_DRIFT^2 energy T^2 / 12;
    - what the closure c betrays of acceleration errors that wander: (WANDER |c| / sqrt(3) T)^2 along each axis (for a
      random walk of intensity q, var(v_end) = q T^3 / 3 and, de-drifted, var(p_end) = q T^5 / 120, so that WANDER would
      be sqrt(3 / 120) = 0.16);
    - what it doesn't betray: (UNSEEN_SPEED T)^2;
    - what turns or stretches the whole path, a tilted vertical and the accelerometer's scale: level / g of the
      distance.

    The constants are set on all recordings of the benchmark together, which prints the share of truth inside one and
    two sigma for each group of windows (tests/benchmarks/tracking.py).
    """
    T, g = figures.duration, rest.gravity
    white = rest.acc_rms**2 / (3.0 * rate_hz) * T**3 / 12.0
    turned = rest.gyr_rms**2 / (3.0 * rate_hz) * T + TURN_TILT**2 * figures.turned
    variance = white + (g * T**2 / 12.0) ** 2 * turned
    variance += MOTION_DRIFT**2 * figures.energy * T**2 / 12.0
    variance += (WANDER * figures.closure * T) ** 2 / 3.0 + (UNSEEN_SPEED * T) ** 2
    variance += (level / g * figures.distance) ** 2
    return np.asarray(variance * np.eye(3))


def sigmas(cov: Array) -> tuple[Array, Array]:
    """One sigma along nav's axes of a (6, 6) covariance: (3,) m, (3,) degrees."""
    sigma = np.sqrt(np.diagonal(cov))
    return sigma[:3], np.degrees(sigma[3:])
