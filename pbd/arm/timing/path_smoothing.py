"""Moves along a curve in joint space, from rest to rest, near the optimum within velocity, acceleration and jerk.

The fastest profile within velocity and acceleration limits (speed_profile.py) has jumps in acceleration, of up to
twice the limit A. A moving average over a time 2 A / J turns each jump into a ramp within the jerk limit J, and makes
the move longer by that time. If no jump is that large, a shorter average is enough, so several are tried and the
fastest is taken. If 2 A / J is long, the profile is first slowed to keep the jerk limit, then averaged.

An average never exceeds the bounds of what it averages, so velocity and acceleration limits hold. The joints are held
at both ends for the time of the average, so the ends are met exactly. In a bend, the average leaves the curve by 1/24
of the averaging time squared times the acceleration; this is kept below OFF_RAD.

The averages are the control points of a uniform cubic B-spline. Its polynomial pieces are the exact result.

A few linear programs slow a profile to keep the jerk limit. Let x be the square of the speed ds/dt along the path. A
joint's acceleration is then linear in x: q' x'/2 + q'' x. Its jerk is the difference of the acceleration between two
points, divided by the time t(x) between them. The bound |difference| <= J t(x) is not linear. But t is convex in x, so
its tangent at a known x lies below it: with the tangent, the bound is linear and on the safe side. Each program takes
the tangent at the solution of the one before.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, PchipInterpolator
from scipy.optimize import linprog
from scipy.sparse import csr_array, diags_array, kron, vstack

from pbd.arm.timing.piecewise_cubic import WITHIN, PiecewiseCubic
from pbd.arm.timing.speed_profile import SpeedProfile, fastest_profile
from pbd.data import JointLimits
from pbd.pose import Array

GRID_POINTS = 1000
"""Least number of grid points of the path, at which the fastest profile keeps the limits."""

OFF_RAD = 1e-3
"""Largest deviation from the curve that averaging may cause, rad: 1 mm at the end of an arm of 1 m."""

JERK_STEPS = 90, 3000
"""Fewest and most time steps of the profile that keeps the jerk limits."""

_WIDTH = 4  # control points in the moving average of a profile without jerk limits
_JERK_WIDTH = 3  # the same for a profile with jerk limits; it removes the linear program's chatter between steps
_RAMPS = 1.0, 0.75, 0.5  # averaging times that are tried, as shares of 2 A / J
_SLOWEST = 0.002  # lowest speed at which a demonstration is followed, as a share of its mean speed
_PROGRAMS = 4  # largest number of linear programs
_ENOUGH = 1e-3  # a program that reduces the duration by a smaller share is the last
_LEAST_X = 1e-6  # lower bound of x, as a share of the highest x, so that times stay finite
_SAME = 1e-9  # waypoints that a joint at top speed passes within this time, s, are one


@dataclass(frozen=True, eq=False)
class Curve:
    """A smooth path through waypoints.

    Attributes:
        s: (n,) s, path parameter: the shortest time to reach each waypoint within the velocity limits.
        q: the joints (k,) rad over s.
        t: (n,) s, when the demonstration passed the waypoints, or None.
    """

    s: Array
    q: CubicSpline
    t: Array | None

    @staticmethod
    def through(waypoints: Array, limits: JointLimits, t: Array | None = None) -> Curve | None:
        """Fit a spline through waypoints (n, k) rad; None if they all coincide."""
        kept = np.arange(len(waypoints))
        while len(kept) > 1:
            steps = (np.abs(np.diff(waypoints[kept], axis=0)) / limits.velocity).max(axis=1)
            same = np.flatnonzero(steps <= _SAME) + 1
            if not len(same):
                s = np.append(0.0, np.cumsum(steps))
                return Curve(s, CubicSpline(s, waypoints[kept]), None if t is None else t[kept])
            same[same == len(kept) - 1] -= 1  # the end is met exactly
            kept = np.delete(kept, same)
        return None

    def grid(self) -> Array:
        """Return grid points (n,) of s that include the waypoints."""
        between = int(np.ceil(GRID_POINTS / (len(self.s) - 1)))
        inner = self.s[:-1, None] + np.arange(between) / between * np.diff(self.s)[:, None]
        return np.append(inner.ravel(), self.s[-1])

    def profile(self, limits: JointLimits, factor: float) -> SpeedProfile:
        """Return the fastest profile within a share `factor` of the limits, and no faster than the demonstration."""
        s = self.grid()
        x_max = None
        if self.t is not None:
            t, course = np.linspace(self.t[0], self.t[-1], 4 * len(s)), PchipInterpolator(self.t, self.s)
            slowest = _SLOWEST * self.s[-1] / (self.t[-1] - self.t[0])
            x_max = np.maximum(np.interp(s, course(t), course(t, 1)), slowest) ** 2
        velocity, acceleration = WITHIN * factor * limits.velocity, WITHIN * factor * limits.acceleration
        return fastest_profile(s, self.q(s, 1), self.q(s, 2), velocity, acceleration, x_max)


def curved_move(
    waypoints: Array, limits: JointLimits, factor: float, t: Array | None = None, deviation_share: float = 1.0
) -> PiecewiseCubic:
    """Time a move along a curve.

    Args:
        waypoints: (n, k) rad, from the arm's present joints to those where it comes to rest.
        limits: of the joints.
        factor: share of the velocity, acceleration and jerk limits.
        t: (n,) s, increasing: when the demonstration passed the waypoints; the arm is nowhere faster.
        deviation_share: share of OFF_RAD by which averaging may leave the curve.
    """
    curve = Curve.through(waypoints, limits, t)
    if curve is None:
        return PiecewiseCubic(np.empty(0), np.empty((0, 4, waypoints.shape[1])))
    profile = curve.profile(limits, factor)
    ramp_s = 2.0 * float((limits.acceleration / limits.jerk).max())
    # Deviation per step squared: half the acceleration, times the variance of the average and of the spline, in steps.
    off = 0.5 * (_JERK_WIDTH**2 / 12.0 + 1.0 / 3.0) * factor * float(limits.acceleration.max())
    steps = int(np.clip(profile.t[-1] / np.sqrt(deviation_share * OFF_RAD / off), *JERK_STEPS))
    if ramp_s > _JERK_WIDTH * profile.t[-1] / steps:
        s = profile.at(profile.t[-1] / steps * np.arange(steps + 1.0))
        s[-1] = profile.s[-1]
        dq, ddq = (curve.q(0.5 * (s[:-1] + s[1:]), order) for order in (1, 2))
        acceleration, jerk = WITHIN * factor * limits.acceleration, WITHIN * factor * limits.jerk
        slower = jerk_limited_profile(s, np.interp(s, profile.s, profile.x), dq, ddq, acceleration, jerk)
        if slower is not None:
            return _averaged(curve, limits, factor, slower, slower.t[-1] / steps, _JERK_WIDTH)
    made = [_averaged(curve, limits, factor, profile, share * ramp_s / _WIDTH, _WIDTH) for share in _RAMPS]
    return min(made, key=lambda pieces: pieces.duration)


def _averaged(
    curve: Curve, limits: JointLimits, factor: float, profile: SpeedProfile, h: float, width: int
) -> PiecewiseCubic:
    """Sample the profile in steps of about h s, average over `width` steps, and slow the result to the limits."""
    count = max(1, int(profile.t[-1] / h))
    h = float(profile.t[-1]) / count  # a whole number of steps
    # Between waypoints at a joint limit the spline may overshoot it slightly.
    q = np.clip(curve.q(profile.at(h * np.arange(count + 1.0))), limits.lower, limits.upper)
    q[-1] = curve.q(curve.s[-1])
    # Hold the ends for as long as the average and the spline reach.
    held = np.concatenate((np.repeat(q[:1], width + 1, axis=0), q, np.repeat(q[-1:], width + 1, axis=0)))
    total = np.concatenate((np.zeros_like(q[:1]), np.cumsum(held - q[0], axis=0)))
    points = q[0] + (total[width:] - total[:-width]) / width
    spline = BSpline(h * np.arange(len(points) + 4.0), points, k=3)
    coefficients = np.stack([spline(spline.t[3:-4], order) / factorial(order) for order in range(4)], axis=1)
    return PiecewiseCubic(np.full(len(coefficients), h), coefficients).slowed_to_limits(limits, factor)


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
    x, ramp = np.maximum(most, _LEAST_X), (jerk / acceleration)[:, None]
    x[0] = x[-1] = 0.0
    profile = None
    for _ in range(_PROGRAMS):
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
    v = np.sqrt(np.maximum(x, _LEAST_X) * scale)
    v[0] = v[-1] = 0.0
    both = v[:-1] + v[1:]
    with np.errstate(divide="ignore"):
        slope = -step * scale / both**2 / np.stack((v[:-1], v[1:]))
    return 2.0 * step / both, np.where(np.isfinite(slope), slope, 0.0)
