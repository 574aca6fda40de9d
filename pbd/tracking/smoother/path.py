"""The path at each row, interpolated between the estimated knots."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pbd.data import Stop
from pbd.pose import Array, quat_canonical, quat_from_matrix, quat_multiply
from pbd.tracking.smoother.factors import sensor_errors
from pbd.tracking.smoother.knots import Problem
from pbd.tracking.smoother.normal_equations import batches
from pbd.tracking.smoother.state import SHARED_GRAVITY, State


@dataclass(frozen=True, eq=False)
class SensorPath:
    """At each row, in nav: wxyz (n, 4) nav <- sensor, v (n, 3) m/s, p (n, 3) m, a (n, 3) m/s2.

    `a` is the measured acceleration, corrected for the estimated sensor errors. Its noise is still in it: `v` is
    smoothed and is not exactly its integral.
    """

    wxyz: Array
    v: Array
    p: Array
    a: Array


def path_of(problem: Problem, x: State) -> SensorPath:
    """Integrate each leg from its first knot without gravity, and distribute the residual at its second knot.

    The residuals of attitude and velocity grow linearly in time, that of position by a cubic that keeps the velocity at
    both knots.
    """
    frame, rows, T = problem.frame, problem.rows, problem.legs.T[:, None]
    g, E = np.array([0.0, 0.0, float(x.shared[SHARED_GRAVITY][0])]), x.E[:-1]
    U, UU = problem.legs.U[:-1], frame.UU[rows[:-1]]
    left_v = np.diff(x.v, axis=0) - _rotate(E, problem.legs.dU) + g * T
    left_p = np.diff(x.p, axis=0) - x.v[:-1] * T - _rotate(E, problem.legs.dP) + 0.5 * g * T**2
    left_p -= 0.5 * T * left_v
    wxyz = quat_from_matrix(x.E)
    change = wxyz[1:] * np.where((wxyz[1:] * wxyz[:-1]).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0) - wxyz[:-1]
    own = _rotate(problem.legs.J[:, 3:6], sensor_errors(x)) / T
    of_legs = (
        *(frame.t[rows[:-1], None], U, UU, E, wxyz[:-1], change / T, own),
        # Coefficients of the cubic that is added to the integrated position, in the time since the knot.
        *(x.p[:-1], x.v[:-1], 0.5 * (left_v / T - g) + 3.0 * left_p / T**2, -2.0 * left_p / T**3),
    )
    n, length = len(frame.t), np.diff(rows)
    length[-1] += 1  # the last knot is the last row
    path = SensorPath(np.empty((n, 4)), *np.empty((3, 3, n)).transpose(0, 2, 1))
    for legs in batches(len(T)):
        at = slice(rows[legs.start], rows[legs.start] + length[legs].sum())
        at_rows = (np.repeat(each[legs], length[legs], axis=0) for each in of_legs)
        t0, U0, UU0, E_rows, wxyz0, turning, own_error, c0, c1, c2, c3 = at_rows
        s = frame.t[at, None] - t0
        between = wxyz0 + s * turning  # the turn is small: linear interpolation suffices
        path.wxyz[at] = quat_canonical(quat_multiply(between, frame.wxyz[at]))
        path.v[at] = _rotate(E_rows, frame.U[at] - U0) + c1 + s * (2.0 * c2 + 3.0 * s * c3)
        path.p[at] = _rotate(E_rows, frame.UU[at] - UU0 - U0 * s) + c0 + s * (c1 + s * (c2 + s * c3))
        path.a[at] = _rotate(E_rows, frame.u[at] + own_error) - g
    return path


def between_stops(t: Array, stops: Sequence[Stop], first: Array, last: Array) -> tuple[Array, Array]:
    """Shift (n, 3) of the path outside its stops, and its change of velocity (n, 3), when the k stops are shifted.

    In a move the shift grows as 3 s^2 - 2 s^3 with the share s of its duration. This is the conditional mean if the
    acceleration has white noise and the velocity is known at both ends. `first` and `last` (k, 3) m are the shifts of
    each stop at its first and at its last row; t (n,) s.
    """
    shift, faster = np.zeros((2, 3, len(t))).transpose(0, 2, 1)
    shift[: stops[0].start], shift[stops[-1].stop :] = first[0], last[-1]
    for k, (stop, following) in enumerate(pairwise(stops)):
        between = slice(stop.stop, following.start)
        begin, lasts = t[stop.stop - 1], t[following.start] - t[stop.stop - 1]
        s, more = ((t[between] - begin) / lasts)[:, None], first[k + 1] - last[k]
        shift[between], faster[between] = last[k] + s**2 * (3.0 - 2.0 * s) * more, 6.0 * s * (1.0 - s) / lasts * more
    return shift, faster


def _rotate(matrices: Array, vectors: Array) -> Array:
    rotated: Array = np.einsum("kij,kj->ki", matrices, vectors)
    return rotated
