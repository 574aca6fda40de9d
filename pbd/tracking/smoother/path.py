"""The path at each row, between the knots that the smoother has estimated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pbd.data import Stop
from pbd.pose import Array, quat_canonical, quat_from_matrix, quat_multiply
from pbd.tracking.smoother.factors import sensor_errors
from pbd.tracking.smoother.knots import Problem
from pbd.tracking.smoother.normal_equations import batches
from pbd.tracking.smoother.state import GRAVITY, State


@dataclass(frozen=True, eq=False)
class Path:
    """At each row: wxyz (n, 4) nav <- sensor, v (n, 3) m/s, p (n, 3) m, a (n, 3) m/s2, in nav.

    `a` is what the accelerometer says, without the sensor's own errors: `v` differs from its integral by its noise.
    """

    wxyz: Array
    v: Array
    p: Array
    a: Array


def path_of(problem: Problem, x: State) -> Path:
    """Integrate each leg from its first knot, less gravity, and distribute the residual at the next.

    Residual turn and velocity are taken to have grown evenly in time (white noise, bias); the position follows a cubic
    that keeps velocity at both ends.
    """
    frame, rows, T = problem.frame, problem.rows, problem.legs.T[:, None]
    g, E = np.array([0.0, 0.0, float(x.shared[GRAVITY][0])]), x.E[:-1]
    U, UU = problem.legs.U[:-1], frame.UU[rows[:-1]]
    left_v = np.diff(x.v, axis=0) - _turned(E, problem.legs.dU) + g * T
    left_p = np.diff(x.p, axis=0) - x.v[:-1] * T - _turned(E, problem.legs.dP) + 0.5 * g * T**2
    left_p -= 0.5 * T * left_v
    wxyz = quat_from_matrix(x.E)
    change = wxyz[1:] * np.where((wxyz[1:] * wxyz[:-1]).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0) - wxyz[:-1]
    own = _turned(problem.legs.J[:, 3:6], sensor_errors(x)) / T
    of_legs = (
        *(frame.t[rows[:-1], None], U, UU, E, wxyz[:-1], change / T, own),
        # Beside the integrals the way is a cubic in the time since the knot.
        *(x.p[:-1], x.v[:-1], 0.5 * (left_v / T - g) + 3.0 * left_p / T**2, -2.0 * left_p / T**3),
    )
    n, length = len(frame.t), np.diff(rows)
    length[-1] += 1  # the last knot is the last row
    path = Path(np.empty((n, 4)), *np.empty((3, n, 3)))
    for legs in batches(len(T)):
        at = slice(rows[legs.start], rows[legs.start] + length[legs].sum())
        at_rows = (np.repeat(each[legs], length[legs], axis=0) for each in of_legs)
        t0, U0, UU0, turned, wxyz0, turning, own_error, c0, c1, c2, c3 = at_rows
        s = frame.t[at, None] - t0
        between = wxyz0 + s * turning  # so little that a chord is as good as its arc
        path.wxyz[at] = quat_canonical(quat_multiply(between, frame.wxyz[at]))
        path.v[at] = _turned(turned, frame.U[at] - U0) + c1 + s * (2.0 * c2 + 3.0 * s * c3)
        path.p[at] = _turned(turned, frame.UU[at] - UU0 - U0 * s) + c0 + s * (c1 + s * (c2 + s * c3))
        path.a[at] = _turned(turned, frame.u[at] + own_error) - g
    return path


def between_stops(t: Array, stops: Sequence[Stop], first: Array, last: Array) -> tuple[Array, Array]:
    """Shift (n, 3) of a path outside its stops, and its change of velocity (n, 3), when the stops are shifted.

    Along a move the shift grows as 3 s^2 - 2 s^3 of its time. That is its conditional mean where the acceleration errs
    by white noise and velocity is known at both ends: least squares of the acceleration, a cubic.

    Args:
        first: (k, 3) m, the shift at the first row of each stop, and last (k, 3) at the last one.
    """
    shift, faster = np.zeros((2, len(t), 3))
    shift[: stops[0].start], shift[stops[-1].stop :] = first[0], last[-1]
    for k, (stop, following) in enumerate(pairwise(stops)):
        between = slice(stop.stop, following.start)
        begin, lasts = t[stop.stop - 1], t[following.start] - t[stop.stop - 1]
        s, more = ((t[between] - begin) / lasts)[:, None], first[k + 1] - last[k]
        shift[between], faster[between] = last[k] + s**2 * (3.0 - 2.0 * s) * more, 6.0 * s * (1.0 - s) / lasts * more
    return shift, faster


def _turned(matrices: Array, vectors: Array) -> Array:
    turned: Array = np.einsum("kij,kj->ki", matrices, vectors)
    return turned
