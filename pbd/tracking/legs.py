"""The legs of a path, each from the middle of one stop to that of the next, and how sure each sensor is on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.data import Attitude, Recording, Stop
from pbd.pose import Array, lengths
from pbd.tracking.integration import edge, integral_of_means
from pbd.tracking.orientation import TAU_ACC_S
from pbd.tracking.rest import Rest

GYRO_BIAS, GYRO_SCALE = np.radians(0.02), 0.005
"""rad/s, of what is left of the bias; and, per square root of a radian, of what turning adds (scale, misalignment)."""

VQF_FLOOR = np.radians(0.2)
"""rad: how sure VQF's tilt is at best. It takes the mean acceleration over its time constant for the vertical: a hand
that changes its velocity by dv within a second tilts it by up to dv / (g TAU_ACC_S) more."""

STILL_SPEED, STILL_S = 0.005, 0.1
"""m/s: what the best of stops may hide; and for how long at most what shakes a stop goes one way."""


@dataclass(frozen=True, eq=False)
class Legs:
    """All legs of a recording; k stops make k - 1 legs.

    Attributes:
        middles: (k,) the rows at which legs meet.
        of_row: (n,) the leg of each row; what comes before the first or after the last middle belongs to the nearest.
        share: (n,) from 0 to 1, of the gyro's variance on the leg, what has arisen by each row.
        gyro: (k - 1,) rad^2, variance of the turn over the leg by the gyro, about each axis.
        vqf: (k - 1,) rad^2, variance of VQF's tilt.
        turned: (n,) rad, all turning up to each row, whichever way.
        speed: (k,) m/s, of the velocity at each stop, by how much it is shaken.
    """

    middles: NDArray[np.intp]
    of_row: NDArray[np.intp]
    share: Array
    gyro: Array
    vqf: Array
    turned: Array
    speed: Array


def find_legs(recording: Recording, attitude: Attitude, a_nav: Array, stops: tuple[Stop, ...], rest: Rest) -> Legs:
    """Find the legs of at least one stop; a_nav (n, 3) m/s2 and attitude are those that the stops were found with."""
    t = recording.t
    middles = np.array([(stop.start + stop.stop - 1) // 2 for stop in stops], dtype=np.intp)
    of_row = np.clip(np.searchsorted(middles, np.arange(len(t)), side="right") - 1, 0, max(len(stops) - 2, 0))

    turned = np.zeros(len(t))
    if recording.gyr is not None:
        turned = np.cumsum(lengths(recording.gyr - attitude.gyro_bias) * np.diff(t, prepend=t[0]))
    density = rest.gyr_rms / np.sqrt(3.0 * recording.rate_hz)
    duration, angle = np.diff(t[middles]), np.diff(turned[middles])
    by_time, by_angle = GYRO_BIAS**2 * duration + density**2, GYRO_SCALE**2
    gyro = by_time * duration + by_angle * angle
    share = np.zeros(len(t))
    if len(stops) > 1:
        start = middles[of_row]
        share = by_time[of_row] * (t - t[start]) + by_angle * (turned - turned[start])
        share = np.clip(share / gyro[of_row], 0.0, 1.0)

    velocity, second = integral_of_means(t, a_nav), round(recording.rate_hz)
    change = np.zeros(len(t))
    change[second:] = ((velocity[second:] - velocity[:-second]) ** 2).sum(axis=1)
    mean_change = np.diff(np.cumsum(change)[middles]) / np.maximum(np.diff(middles), 1)
    return Legs(
        middles,
        of_row,
        share,
        gyro,
        vqf=VQF_FLOOR**2 + mean_change / (rest.gravity * TAU_ACC_S) ** 2,
        turned=turned,
        speed=np.array([_speed(a_nav[stop.start : stop.stop], stop) for stop in stops]),
    )


def inside(stop: Stop, t: Array) -> slice:
    """The samples of a stop between its edges."""
    rows = edge(stop, t, 2.0)
    return slice(stop.start + rows, stop.stop - rows)


def _speed(a_nav: Array, stop: Stop) -> float:
    shaken = float(np.sqrt(a_nav.var(axis=0).mean()))
    return float(np.hypot(STILL_SPEED, 0.5 * shaken * min(stop.dwell_s, STILL_S)))
