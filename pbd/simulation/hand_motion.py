"""The motion of a hand from rest to rest in closed form: its pose, velocity, acceleration and angular rate.

Each move follows the minimum-jerk law of human reaching (Flash and Hogan 1985, "The coordination of arm movements", J.
Neuroscience 5(7)): in position along a straight line, in rotation about one axis fixed in the sensor. All derivatives
are exact; none is computed numerically.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pbd.pose import Array, quat_exp, quat_from_rpy, quat_multiply, quat_rotate


@dataclass(frozen=True)
class Waypoint:
    """A place where the hand stands still, and the move to it.

    Attributes:
        p: the sensor's position in world (x east, y magnetic north, z up), m.
        turn: rotation of the hand during the move, as a rotation vector in sensor axes, rad.
        move_s: duration of the move; 0 for the first waypoint, above 0 for the others.
        rest_s: how long the hand then stands still.
        grip: True if the grip closes in the middle of the rest, False if it opens, None if it does not change.
    """

    p: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    move_s: float = 0.0
    rest_s: float = 0.0
    grip: bool | None = None


@dataclass(frozen=True, eq=False)
class HandState:
    """The sensor's motion at n instants.

    Attributes:
        p, v, a: (n, 3) position, velocity, acceleration in world: m, m/s, m/s2.
        wxyz: (n, 4) attitude, sensor to world; continuous in time, so w may be negative.
        w: (n, 3) angular rate in sensor axes, rad/s.
    """

    p: Array
    v: Array
    a: Array
    wxyz: Array
    w: Array


def minimum_jerk(u: ArrayLike) -> tuple[Array, Array, Array]:
    """Return the fraction of the path and its two derivatives with respect to u, at fractions u of the time, 0 to 1."""
    u = np.asarray(u, dtype=np.float64)
    rest = 1.0 - u
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 30.0 * (u * rest) ** 2, 60.0 * u * rest * (1.0 - 2.0 * u)


class HandMotion:
    """The motion through waypoints. At t = 0 the rest at the first one begins. Before and after it the hand rests."""

    def __init__(
        self,
        waypoints: Sequence[Waypoint],
        start_rpy: ArrayLike = (0.0, 0.0, 0.0),
        p_sensor_point: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Join the moves.

        Args:
            waypoints: at least one.
            start_rpy: (3,) attitude of the sensor in world at the first waypoint, rad.
            p_sensor_point: (3,) the point of the hand that follows the waypoints' `p`, m in sensor axes.
        """
        self._lever = np.asarray(p_sensor_point, dtype=np.float64)
        p = np.array([w.p for w in waypoints], dtype=np.float64)
        rest = np.array([w.rest_s for w in waypoints], dtype=np.float64)
        move = np.array([w.move_s for w in waypoints], dtype=np.float64)
        wxyz = [quat_from_rpy(start_rpy)]
        for waypoint in waypoints[1:]:
            wxyz.append(quat_multiply(wxyz[-1], quat_exp(waypoint.turn)))
        # Row k is the move that ends at waypoint k. Row 0 is a move to the start itself, so every instant has a row.
        self._begin = np.concatenate(([0.0], np.cumsum(move + rest)[:-1]))
        self._duration = np.concatenate(([1.0], move[1:]))
        self._p_from = np.concatenate((p[:1], p[:-1]))
        self._way = np.diff(p, axis=0, prepend=p[:1])
        self._wxyz_from = np.array([wxyz[0], *wxyz[:-1]])
        self._turn = np.array([np.zeros(3), *(w.turn for w in waypoints[1:])], dtype=np.float64)

    @property
    def knots(self) -> Array:
        """Instants at which a move begins or ends, s. Between them the motion is smooth."""
        return np.stack((self._begin, self._begin + self._duration), axis=-1)[1:].ravel()

    def at(self, t: ArrayLike) -> HandState:
        """Evaluate the motion at instants (n,) s."""
        t = np.asarray(t, dtype=np.float64)
        k = np.maximum(np.searchsorted(self._begin, t, side="right") - 1, 0)
        duration = self._duration[k][:, None]
        s, ds, dds = minimum_jerk(np.clip((t - self._begin[k])[:, None] / duration, 0.0, 1.0))
        wxyz = quat_multiply(self._wxyz_from[k], quat_exp(s * self._turn[k]))
        w, alpha = ds / duration * self._turn[k], dds / duration**2 * self._turn[k]
        way = self._way[k]
        p, v, a = self._p_from[k] + s * way, ds / duration * way, dds / duration**2 * way
        if self._lever.any():  # the point follows the straight line, and the sensor turns about it
            v_point = np.cross(w, self._lever)
            a_point = np.cross(alpha, self._lever) + np.cross(w, v_point)
            p, v, a = p - quat_rotate(wxyz, self._lever), v - quat_rotate(wxyz, v_point), a - quat_rotate(wxyz, a_point)
        return HandState(p, v, a, wxyz, w)
