"""The path at each row, between the knots that the smoother has estimated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd.pose import Array, quat_canonical, quat_from_matrix, quat_multiply
from pbd.tracking.factors import GRAVITY, State
from pbd.tracking.knots import Problem


@dataclass(frozen=True, eq=False)
class Path:
    """At each row: wxyz (n, 4) nav <- sensor, v (n, 3) m/s, p (n, 3) m, a (n, 3) m/s2, in nav."""

    wxyz: Array
    v: Array
    p: Array
    a: Array


def path_of(problem: Problem, x: State) -> Path:
    """Integrate each leg from its first knot, and share out what is left over at the next.

    Turn and velocity that are left over arose evenly in time (white noise, bias); the way takes a cubic that keeps
    velocity at both ends.
    """
    frame, rows, T = problem.frame, problem.rows, problem.legs.T[:, None]
    g, E = np.array([0.0, 0.0, float(x.shared[GRAVITY][0])]), x.E[:-1]
    U, UU = frame.U[rows[:-1]], frame.UU[rows[:-1]]
    left_v = np.diff(x.v, axis=0) - np.einsum("kij,kj->ki", E, problem.legs.dU) + g * T
    left_p = np.diff(x.p, axis=0) - x.v[:-1] * T - np.einsum("kij,kj->ki", E, problem.legs.dP) + 0.5 * g * T**2
    left_p -= 0.5 * T * left_v
    # Beside the integrals the way is a cubic in the time since the knot.
    cubic = (x.p[:-1], x.v[:-1], 0.5 * (left_v / T - g) + 3.0 * left_p / T**2, -2.0 * left_p / T**3)

    length = np.diff(rows)
    length[-1] += 1  # the last knot is the last row

    def at_rows(of_legs: Array) -> Array:
        return np.repeat(of_legs, length, axis=0)

    s = (frame.t - at_rows(frame.t[rows[:-1]]))[:, None]
    c0, c1, c2, c3 = map(at_rows, cubic)
    turned, U0 = at_rows(E), at_rows(U)
    v = np.einsum("kij,kj->ki", turned, frame.U - U0) + c1 + s * (2.0 * c2 + 3.0 * s * c3)
    p = np.einsum("kij,kj->ki", turned, frame.UU - at_rows(UU) - U0 * s) + c0 + s * (c1 + s * (c2 + s * c3))
    a = np.einsum("kij,kj->ki", turned, frame.u) + at_rows(left_v / T - g)
    wxyz = quat_from_matrix(x.E)
    change = wxyz[1:] * np.where((wxyz[1:] * wxyz[:-1]).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0) - wxyz[:-1]
    between = at_rows(wxyz[:-1]) + s * at_rows(change / T)  # so little that a chord is as good as its arc
    return Path(quat_canonical(quat_multiply(between, frame.wxyz)), v, p, a)
