"""A profile that keeps jerk limits too: the fastest one, found by a few linear programs.

Over a path parameter s the square of the speed, x, makes a joint's acceleration linear: q' x'/2 + q'' x. Its jerk is
the difference of that between two places by the time t(x) it takes from one to the other. That |difference| <= J t(x)
isn't a linear bound, but t is convex in x, so its tangent at the last x lies below it: with the tangent in its place
the bound is linear and on the safe side, and each program starts from the solution of the one before.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array, diags_array, kron, vstack

from pbd.arm.timing.speed_profile import SpeedProfile
from pbd.pose import Array

ROUNDS = 4
_ENOUGH = 1e-3  # a round that gains less time than this share is the last
_SLOW = 1e-6  # of the highest x: where times would have no end


def jerk_limited_profile(
    s: Array, x_most: Array, dq: Array, ddq: Array, acceleration: Array, jerk: Array
) -> SpeedProfile | None:
    """Take a path from rest to rest as fast as its joints may.

    Args:
        s: (n + 1,) grid points, best about equally far apart in time.
        x_most: (n + 1,) the highest squares of the speed: those without jerk limits; zero at both ends.
        dq, ddq: (n, k) the joints' first and second derivatives by s, midway between grid points.
        acceleration, jerk: (k,) limits.

    Returns:
        None where the solver gives up.
    """
    scale = float(x_most.max())
    step, most = np.diff(s), x_most / scale
    n, k = dq.shape
    # (n k, n + 1): each joint's acceleration in each segment, as a share of its limit.
    by_x = scale * np.stack((0.5 * ddq - 0.5 * dq / step[:, None], 0.5 * ddq + 0.5 * dq / step[:, None]), axis=2)
    by_x /= acceleration[:, None]
    columns = np.arange(n)[:, None, None] + np.zeros((1, k, 1), np.int64) + np.arange(2)
    rows = np.repeat(np.arange(n * k), 2)
    accelerations = csr_array((by_x.ravel(), (rows, columns.ravel())), shape=(n * k, n + 1))
    rest = csr_array((k, n + 1))
    changes = vstack((accelerations, rest)) - vstack((rest, accelerations))  # ((n + 1) k, n + 1)
    # (n + 1, n): from the middle of each segment to the next; at the ends, where the arm stands still, a segment.
    weights = np.full((2, n), 0.5)
    weights[0, 0] = weights[1, -1] = 1.0
    between = diags_array(weights, offsets=(0, -1), shape=(n + 1, n), format="csr")
    x, ramp = np.maximum(most, _SLOW), (jerk / acceleration)[:, None]
    x[0] = x[-1] = 0.0
    profile = None
    for _ in range(ROUNDS):
        t, by_x_there = _times(step, x, scale)
        tangent = diags_array(by_x_there, offsets=(0, 1), shape=(n, n + 1), format="csr")
        room = csr_array(kron(between @ tangent, ramp))
        fixed = np.kron(between @ (t - tangent @ x), ramp[:, 0])
        solved = linprog(  # type: ignore[call-overload]  # its stubs know no sparse matrices
            tangent.T @ np.ones(n),
            A_ub=vstack((accelerations, -accelerations, changes - room, -changes - room)),
            b_ub=np.concatenate((np.ones(2 * n * k), fixed, fixed)),
            bounds=np.stack((np.zeros(n + 1), most), axis=1),
            method="highs-ds",
        )
        if solved.x is None:
            return profile
        x = np.clip(solved.x, 0.0, most)
        faster = SpeedProfile(s, scale * x)
        if not np.isfinite(faster.t[-1]):
            return profile
        gained = np.inf if profile is None else 1.0 - faster.t[-1] / profile.t[-1]
        profile = faster
        if gained < _ENOUGH:
            break
    return profile


def _times(step: Array, x: Array, scale: float) -> tuple[Array, Array]:
    """Return how long (n,) each segment takes, and the derivatives (2, n) of that by x before and after it."""
    v = np.sqrt(np.maximum(x, _SLOW) * scale)
    v[0] = v[-1] = 0.0
    both = v[:-1] + v[1:]
    with np.errstate(divide="ignore"):
        slope = -step * scale / both**2 / np.stack((v[:-1], v[1:]))
    return 2.0 * step / both, np.where(np.isfinite(slope), slope, 0.0)
