"""A hand that moves from rest to rest, as closed formulas: its pose and the derivatives that an inertial sensor feels.

Each move follows the minimum-jerk law of human reaching (Flash and Hogan 1985, "The coordination of arm movements",
J. Neuroscience 5(7)), in position along a straight line and in rotation about one axis fixed in the sensor. So
velocity, acceleration and angular rate are exact at every instant; nothing here is differentiated numerically.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from pbd.pose import Array, quat_exp, quat_from_rpy, quat_multiply, quat_rotate


@dataclass(frozen=True)
class Waypoint:
    """A place where the hand stands still, and how it gets there.

    Attributes:
        p: m, the sensor's position in world (x east, y magnetic north, z up).
        turn: rotation vector in rad in the sensor's axes, by which the hand turns on its way here.
        move_s: how long the way here takes; 0 for the first waypoint and above 0 for every other.
        rest_s: how long the hand then stands still.
        grip: True where the grip closes in the middle of the rest, False where it opens, None where nothing changes.
    """

    p: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    move_s: float = 0.0
    rest_s: float = 0.0
    grip: bool | None = None


@dataclass(frozen=True, eq=False)
class HandState:
    """The sensor at n instants: p, v, a (n, 3) in world, m, m/s, m/s2; wxyz (n, 4), sensor to world; w (n, 3), rad/s
    in the sensor's axes. Quaternions are continuous in time (not canonical)."""

    p: Array
    v: Array
    a: Array
    wxyz: Array
    w: Array


SWAY_HZ, SWAY_WAVES = (0.05, 1.0), 16
"""Hz: band of a hand's slow wandering, below its tremor, evenly by octaves; waves that stand for it on each axis."""


class Sway:
    """How a hand wanders that means to stand still: a sum of sines, so that its derivatives are exact too."""

    def __init__(self, speed: float, rng: np.random.Generator) -> None:
        """Draw it, with an rms of `speed` m/s along each axis."""
        low, high = SWAY_HZ
        self._rate = 2.0 * np.pi * np.exp(rng.uniform(np.log(low), np.log(high), (SWAY_WAVES, 3)))
        self._phase = rng.uniform(0.0, 2.0 * np.pi, (SWAY_WAVES, 3))
        rate_rms = 2.0 * np.pi * np.sqrt((high**2 - low**2) / (2.0 * np.log(high / low)))
        self._size = speed / rate_rms * np.sqrt(2.0 / SWAY_WAVES)

    def added_to(self, state: HandState, t: Array) -> HandState:
        """The state at instants (n,) in s, with the sway."""
        at, rate = t[:, None, None] * self._rate + self._phase, self._rate
        sine, cosine = self._size * np.sin(at), self._size * np.cos(at)
        p, v = state.p + sine.sum(axis=1), state.v + (rate * cosine).sum(axis=1)
        return replace(state, p=p, v=v, a=state.a - (rate**2 * sine).sum(axis=1))


def minimum_jerk(u: ArrayLike) -> tuple[Array, Array, Array]:
    """Fraction of the way, and its first and second derivative by u, at fractions u in 0..1 of the time."""
    u = np.asarray(u, dtype=np.float64)
    rest = 1.0 - u
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * (u * rest) ** 2, 60.0 * u * rest * (1.0 - 2.0 * u)


class HandMotion:
    """The motion through waypoints, from t = 0, when the rest at the first begins. Before and after, the hand rests."""

    def __init__(
        self,
        waypoints: Sequence[Waypoint],
        start_rpy: ArrayLike = (0.0, 0.0, 0.0),
        p_sensor_point: ArrayLike = (0.0, 0.0, 0.0),
        sway: Sway | None = None,
    ) -> None:
        """Put the moves one after the other.

        Args:
            waypoints: at least one.
            start_rpy: (3,) rad, the attitude of the sensor in world at the first waypoint.
            p_sensor_point: (3,) m in sensor axes, the point of the hand that the waypoints' `p` are of.
            sway: what the hand does beside; None: it stands perfectly still.
        """
        self._sway = sway
        self._lever = np.asarray(p_sensor_point, dtype=np.float64)
        p = np.array([w.p for w in waypoints], dtype=np.float64)
        rest = np.array([w.rest_s for w in waypoints], dtype=np.float64)
        move = np.array([w.move_s for w in waypoints], dtype=np.float64)
        wxyz = [quat_from_rpy(start_rpy)]
        for waypoint in waypoints[1:]:
            wxyz.append(quat_multiply(wxyz[-1], quat_exp(waypoint.turn)))
        # Row k is the move that ends at waypoint k. Row 0 goes nowhere, so that every instant lies in or after a move.
        self._begin = np.concatenate(([0.0], np.cumsum(move + rest)[:-1]))
        self._duration = np.concatenate(([1.0], move[1:]))
        self._p_from = np.concatenate((p[:1], p[:-1]))
        self._way = np.diff(p, axis=0, prepend=p[:1])
        self._wxyz_from = np.array([wxyz[0], *wxyz[:-1]])
        self._turn = np.array([np.zeros(3), *(w.turn for w in waypoints[1:])], dtype=np.float64)

    @property
    def knots(self) -> Array:
        """The instants in s at which a move begins or ends, in order: between them everything is smooth."""
        return np.stack((self._begin, self._begin + self._duration), axis=-1)[1:].ravel()

    def at(self, t: ArrayLike) -> HandState:
        """The state at instants (n,) in s."""
        t = np.asarray(t, dtype=np.float64)
        k = np.maximum(np.searchsorted(self._begin, t, side="right") - 1, 0)
        duration = self._duration[k][:, None]
        s, ds, dds = minimum_jerk(np.clip((t - self._begin[k])[:, None] / duration, 0.0, 1.0))
        wxyz = quat_multiply(self._wxyz_from[k], quat_exp(s * self._turn[k]))
        w, alpha = ds / duration * self._turn[k], dds / duration**2 * self._turn[k]
        way = self._way[k]
        p, v, a = self._p_from[k] + s * way, ds / duration * way, dds / duration**2 * way
        if self._lever.any():  # the point moves along the line, and the sensor about it
            v_point = np.cross(w, self._lever)
            a_point = np.cross(alpha, self._lever) + np.cross(w, v_point)
            p, v, a = p - quat_rotate(wxyz, self._lever), v - quat_rotate(wxyz, v_point), a - quat_rotate(wxyz, a_point)
        state = HandState(p, v, a, wxyz, w)
        return state if self._sway is None else self._sway.added_to(state, t)
