"""The fastest speed profile along a path that also keeps the jerk limits, by a few linear programs.

Let x be the square of the speed ds/dt along the path. A joint's acceleration is then linear in x: q' x'/2 + q'' x. Its
jerk is the difference of the acceleration between two points, divided by the time t(x) between them. The bound
|difference| <= J t(x) is not linear. But t is convex in x, so its tangent at a known x lies below it: with the tangent,
the bound is linear and on the safe side. Each program takes the tangent at the solution of the one before.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array, diags_array, kron, vstack

from pbd.arm.timing.speed_profile import SpeedProfile
from pbd.pose import Array

ROUNDS = 4  # largest number of linear programs
_ENOUGH = 1e-3  # a round that reduces the duration by a smaller share is the last
_SLOW = 1e-6  # lower bound of x, as a share of the highest x, so that times stay finite


def jerk_limited_profile(
    s: Array, x_max: Array, dq: Array, ddq: Array, acceleration: Array, jerk: Array
) -> SpeedProfile | None:
    """Find the fastest profile of a path from rest to rest.

    Args:
        s: (n + 1,) grid points; best spaced about equally in time.
        x_max: (n + 1,) upper bound of x: the profile without jerk limits; zero at both ends.
        dq, ddq: (n, k) first and second derivatives of the joints by s, midway between grid points.
        acceleration, jerk: (k,) limits.

    Returns:
        The best profile; None if the solver finds none.
    """
    scale = float(x_max.max())
    step, most = np.diff(s), x_max / scale
    n, k = dq.shape
    # Maps x to each joint's acceleration in each segment, as a share of its limit: (n k, n + 1).
    by_x = scale * np.stack((0.5 * ddq - 0.5 * dq / step[:, None], 0.5 * ddq + 0.5 * dq / step[:, None]), axis=2)
    by_x /= acceleration[:, None]
    columns = np.arange(n)[:, None, None] + np.zeros((1, k, 1), np.int64) + np.arange(2)
    rows = np.repeat(np.arange(n * k), 2)
    accelerations = csr_array((by_x.ravel(), (rows, columns.ravel())), shape=(n * k, n + 1))
    rest = csr_array((k, n + 1))
    changes = vstack((accelerations, rest)) - vstack((rest, accelerations))  # ((n + 1) k, n + 1)
    # Maps the segments' times to the times between their midpoints (n + 1, n); at the ends, at rest, a full segment.
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
    """Return the time (n,) of each segment, and its derivatives (2, n) by x at the segment's start and end."""
    v = np.sqrt(np.maximum(x, _SLOW) * scale)
    v[0] = v[-1] = 0.0
    both = v[:-1] + v[1:]
    with np.errstate(divide="ignore"):
        slope = -step * scale / both**2 / np.stack((v[:-1], v[1:]))
    return 2.0 * step / both, np.where(np.isfinite(slope), slope, 0.0)
