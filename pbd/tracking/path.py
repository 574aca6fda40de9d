"""The path at each row, between the knots that the smoother has estimated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd.pose import Array, quat_canonical, quat_exp, quat_from_matrix, quat_log, quat_multiply
from pbd.tracking.factors import GRAVITY, State, sensor_errors
from pbd.tracking.knots import Problem


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
    """Integrate each leg from its first knot, and share out what is left over at the next.

    Turn and velocity that are left over arose evenly in time (white noise, bias); the way takes a cubic that keeps
    velocity at both ends.
    """
    frame, rows, legs = problem.frame, problem.rows, problem.legs
    t, g = frame.t, np.array([0.0, 0.0, float(x.shared[GRAVITY][0])])
    k = np.clip(np.searchsorted(rows, np.arange(len(t)), side="right") - 1, 0, len(rows) - 2)
    since, T = (t - t[rows[k]])[:, None], legs.T[:, None]
    share = since / T[k]

    E, wxyz_knot = x.E[:-1], quat_from_matrix(x.E)
    turn = quat_log(quat_from_matrix(x.E[1:] @ E.transpose(0, 2, 1)))
    wxyz = quat_multiply(quat_multiply(quat_exp(share * turn[k]), wxyz_knot[k]), frame.wxyz)

    left_v = np.diff(x.v, axis=0) - np.einsum("kij,kj->ki", E, legs.dU) + g * T
    left_p = np.diff(x.p, axis=0) - x.v[:-1] * T - np.einsum("kij,kj->ki", E, legs.dP) + 0.5 * g * T**2
    left_p -= 0.5 * T * left_v
    U, UU = frame.U[rows[k]], frame.UU[rows[k]]
    v = x.v[k] + np.einsum("kij,kj->ki", E[k], frame.U - U) - g * since + share * left_v[k]
    p = x.p[k] + x.v[k] * since + np.einsum("kij,kj->ki", E[k], frame.UU - UU - U * since) - 0.5 * g * since**2
    p += 0.5 * share * since * left_v[k] + share**2 * (3.0 - 2.0 * share) * left_p[k]
    v += 6.0 * share * (1.0 - share) / T[k] * left_p[k]
    own = np.einsum("kij,kj->ki", legs.J[:, 3:6], sensor_errors(x)) / T
    a = np.einsum("kij,kj->ki", E[k], frame.u + own[k]) - g
    return Path(quat_canonical(wxyz), v, p, a)
