"""The fastest speed profile along a path in joint space within velocity and acceleration limits.

This is TOPP-RA (Pham and Pham, "A New Approach to Time-Optimal Path Parameterization Based on Reachability Analysis",
2018, doi 10.1109/TRO.2018.2819195). Let s be the path parameter and x the square of its speed ds/dt. At each grid point
x has a largest value from which the end can still be reached; a backward pass finds it. A forward pass from the start
then takes the largest x that is allowed. Between two grid points u = d2s/dt2 is constant, and the acceleration
q' u + q'' x of each joint is bounded at both of them.

Each bound is a pair of lines over x, -c - m x <= u <= c - m x, so each step is solved in closed form.
"""

from dataclasses import dataclass

import numpy as np

from pbd.pose import Array

_FLAT = 1e-9  # a joint with a smaller |dq/ds| sets no bound on u


@dataclass(frozen=True, eq=False)
class SpeedProfile:
    """The square of the speed ds/dt, x (n,), at grid points s (n,) of a path; x is linear between them."""

    s: Array
    x: Array

    @property
    def t(self) -> Array:
        """The time (n,) at which each grid point is passed, s."""
        v = np.sqrt(self.x)
        return np.append(0.0, np.cumsum(2.0 * np.diff(self.s) / (v[:-1] + v[1:])))

    def at(self, t: Array) -> Array:
        """Return the path parameter at instants (n,) s; outside the profile, that of the nearer end."""
        times = self.t
        i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        since = np.clip(t - times[i], 0.0, times[i + 1] - times[i])
        u = 0.5 * np.diff(self.x) / np.diff(self.s)
        return np.clip(self.s[i] + since * (np.sqrt(self.x[i]) + 0.5 * u[i] * since), self.s[i], self.s[i + 1])


def fastest_profile(
    s: Array, dq: Array, ddq: Array, velocity: Array, acceleration: Array, x_max: Array | None = None
) -> SpeedProfile:
    """Find the fastest profile of a path from rest to rest.

    Args:
        s: (n,) grid points, increasing.
        dq, ddq: (n, k) first and second derivatives of the joints by s.
        velocity, acceleration: (k,) limits.
        x_max: (n,) additional upper bound of x.
    """
    step = np.diff(s)
    c, m, x_highest = _bounds(step, dq, ddq, acceleration)
    with np.errstate(divide="ignore"):
        x_highest = np.minimum(x_highest, ((velocity / np.abs(dq)) ** 2).min(axis=1))
    if x_max is not None:
        x_highest = np.minimum(x_highest, x_max)
    x_highest[0] = x_highest[-1] = 0.0
    # Backward pass: x_next = x + 2 step u must not exceed the largest x there, nor be below zero.
    x = np.empty(len(s))
    x[-1] = 0.0
    slope = 1.0 - 2.0 * step[:, None] * m
    gain = 2.0 * step[:, None] * c
    rising, falling = slope > 0.0, slope < 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        must_stop = np.where(falling, gain / -slope, np.inf).min(axis=1)
        # The bound (x_next + gain) / slope on x is per_next x_next + fixed.
        per_next, fixed = np.where(rising, 1.0 / slope, np.inf), np.where(rising, gain / slope, np.inf)
    ceiling = np.minimum(x_highest[:-1], must_stop)
    for i in reversed(range(len(step))):
        x[i] = min(
            ceiling[i], float((per_next[i] * x[i + 1] + fixed[i]).min()) if x[i + 1] > 0.0 else float(fixed[i].min())
        )
    reachable = x.copy()
    for i in range(len(step)):
        highest = float((gain[i] + slope[i] * x[i]).min())
        x[i + 1] = max(0.0, min(reachable[i + 1], highest))
    return SpeedProfile(s, x)


def _bounds(step: Array, dq: Array, ddq: Array, acceleration: Array) -> tuple[Array, Array, Array]:
    """Return c and m (n - 1, 2 k) of the bounds on u, and the highest x (n,) at which some u satisfies them all."""
    at_start = (dq[:-1], ddq[:-1])
    at_end = (dq[1:] + 2.0 * step[:, None] * ddq[1:], ddq[1:])  # x at the end is x + 2 step u
    a, b = (np.concatenate(pair, axis=1) for pair in zip(at_start, at_end, strict=True))
    limit = np.concatenate((acceleration, acceleration))
    flat = np.abs(a) < _FLAT
    with np.errstate(divide="ignore"):
        x_flat = np.where(flat, limit / np.abs(b), np.inf).min(axis=1)
    a_safe = np.where(flat, 1.0, a)
    c = np.where(flat, np.inf, limit / np.abs(a_safe))
    m = np.where(flat, 0.0, b / a_safe)
    # Two bounds on u are compatible as long as -c1 - m1 x <= c2 - m2 x.
    apart = m[:, None, :] - m[:, :, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(apart > 0.0, (c[:, None, :] + c[:, :, None]) / apart, np.inf).min(axis=(1, 2))
    highest = np.full(len(step) + 1, np.inf)
    highest[:-1] = np.minimum(room, x_flat)
    return c, m, highest
