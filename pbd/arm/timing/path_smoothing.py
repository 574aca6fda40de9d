"""Moves along a curve in joint space, from rest to rest, near the optimum within velocity, acceleration and jerk.

The fastest profile within velocity and acceleration (speed_profile.py) jumps in acceleration, by up to twice its limit
A. Where the jerk J lets a joint do so at once (2 A / J is short), a moving average over that time turns each jump into
a ramp that keeps J, and costs that time; where no jump is as far half of that will do: what is fastest is
taken. Where it takes longer, the profile is first made to keep J (jerk.py).

Averages keep what bounds their parts: no joint exceeds its velocity or acceleration. The ends are held still meanwhile,
so they are met exactly; a bend is cut by a twenty-fourth of the time squared times the acceleration across it, which is
kept below OFF_RAD.

The averages are the control points of a uniform cubic B-spline: its pieces are what the arm gets, exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, PchipInterpolator

from pbd.arm.timing.piecewise_cubic import WITHIN, PiecewiseCubic
from pbd.arm.timing.speed_profile import SpeedProfile, fastest_profile
from pbd.data import JointLimits
from pbd.pose import Array

GRID_POINTS = 1000
"""Points of the path at which the fastest profile keeps the limits."""

OFF_RAD = 1e-3
"""Largest deviation from the curve that averaging may cause: a millimetre at the end of an arm of a metre."""

JERK_STEPS = 90, 3000
"""Fewest and most steps of the profile that keeps the jerk limits."""

_WIDTH, _CAREFUL_WIDTH = 4, 3  # control points in a moving average; linear programs chatter from step to step
_RAMPS = 1.0, 0.75, 0.5  # shares of 2 A / J: not every jump is as far as it might be
_SLOWEST = 0.002  # of the mean speed: no demonstration is followed more slowly
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class Curve:
    """A smooth path through waypoints.

    Attributes:
        s: (n,) where the waypoints are: a joint at its top speed moves by one in one second.
        q: the joints (k,) rad over s.
        t: (n,) s, when a demonstration passed them, or None.
    """

    s: Array
    q: CubicSpline
    t: Array | None

    @staticmethod
    def through(waypoints: Array, limits: JointLimits, t: Array | None = None) -> Curve | None:
        """Lay a curve through waypoints (n, k) rad; None where they are all one."""
        apart = (np.abs(np.diff(waypoints, axis=0)) / limits.velocity).max(axis=1) > _SAME
        kept = np.flatnonzero(np.append(True, apart))
        if len(kept) < 2:
            return None
        waypoints = np.vstack((waypoints[kept[:-1]], waypoints[-1]))  # the end is met exactly
        s = np.append(0.0, np.cumsum((np.abs(np.diff(waypoints, axis=0)) / limits.velocity).max(axis=1)))
        return Curve(s, CubicSpline(s, waypoints), None if t is None else np.append(t[kept[:-1]], t[-1]))

    def grid(self) -> Array:
        """Points (n,) of s, the waypoints among them."""
        between = int(np.ceil(GRID_POINTS / (len(self.s) - 1)))
        inner = self.s[:-1, None] + np.arange(between) / between * np.diff(self.s)[:, None]
        return np.append(inner.ravel(), self.s[-1])

    def profile(self, limits: JointLimits, factor: float) -> SpeedProfile:
        """Take it as fast as a share of the velocity and acceleration limits, and its own times, allow."""
        s = self.grid()
        x_most = None if self.t is None else self._demonstrated(s, self.t) ** 2
        velocity, acceleration = WITHIN * factor * limits.velocity, WITHIN * factor * limits.acceleration
        return fastest_profile(s, self.q(s, 1), self.q(s, 2), velocity, acceleration, x_most)

    def _demonstrated(self, s: Array, passed: Array) -> Array:
        """How fast (n,) a demonstration went at grid points, that passed the waypoints at these times."""
        t = np.linspace(passed[0], passed[-1], 4 * len(s))
        course = PchipInterpolator(passed, self.s)
        slowest = _SLOWEST * self.s[-1] / (passed[-1] - passed[0])
        return np.asarray(np.maximum(np.interp(s, course(t), course(t, 1)), slowest))


def curved_move(
    waypoints: Array, limits: JointLimits, factor: float, t: Array | None = None, near: float = 1.0
) -> PiecewiseCubic:
    """Time a move along a curve.

    Args:
        waypoints: (n, k) rad, the first where the arm is, the last where it comes to rest.
        factor: a share of the velocity, acceleration and jerk limits.
        t: (n,) s, increasing: when a demonstration passed the waypoints, where the arm is to be no faster.
        near: the share of OFF_RAD by which averaging may lead off the curve.
    """
    curve = Curve.through(waypoints, limits, t)
    if curve is None:
        return PiecewiseCubic(np.empty(0), np.empty((0, 4, waypoints.shape[1])))
    profile = curve.profile(limits, factor)
    ramp_s = 2.0 * float((limits.acceleration / limits.jerk).max())
    # The averages' and the spline's own variance, in steps squared, times half the acceleration.
    off = 0.5 * (_CAREFUL_WIDTH**2 / 12.0 + 1.0 / 3.0) * factor * float(limits.acceleration.max())
    steps = int(np.clip(profile.t[-1] / np.sqrt(near * OFF_RAD / off), *JERK_STEPS))
    if ramp_s > _CAREFUL_WIDTH * profile.t[-1] / steps and (careful := _careful(curve, profile, limits, factor, steps)):
        return _averaged(curve, limits, careful, careful.t[-1] / steps, _CAREFUL_WIDTH).within(limits, factor)
    made = [
        _averaged(curve, limits, profile, share * ramp_s / _WIDTH, _WIDTH).within(limits, factor) for share in _RAMPS
    ]
    return min(made, key=lambda pieces: pieces.duration)


def _careful(
    curve: Curve, profile: SpeedProfile, limits: JointLimits, factor: float, steps: int
) -> SpeedProfile | None:
    """Slow a profile so that it keeps the jerk limits too."""
    from pbd.arm.timing.jerk import jerk_limited_profile

    s = profile.at(profile.t[-1] / steps * np.arange(steps + 1.0))
    s[-1] = profile.s[-1]
    middle = 0.5 * (s[:-1] + s[1:])
    acceleration, jerk = WITHIN * factor * limits.acceleration, WITHIN * factor * limits.jerk
    x_most = np.interp(s, profile.s, profile.x)
    return jerk_limited_profile(s, x_most, curve.q(middle, 1), curve.q(middle, 2), acceleration, jerk)


def _averaged(curve: Curve, limits: JointLimits, profile: SpeedProfile, h: float, width: int) -> PiecewiseCubic:
    """Take the curve in steps of h s; average over so many of them."""
    count = max(1, int(profile.t[-1] / h))
    h = float(profile.t[-1]) / count  # so that no part of a step is lost at the end
    # Between waypoints at a joint's limit the curve may swing beyond it by a hair.
    q = np.clip(curve.q(profile.at(h * np.arange(count + 1.0))), limits.lower, limits.upper)
    q[-1] = curve.q(curve.s[-1])
    # Still for the average's width and the spline's own at both ends.
    held = np.concatenate((np.repeat(q[:1], width + 1, axis=0), q, np.repeat(q[-1:], width + 1, axis=0)))
    total = np.concatenate((np.zeros_like(q[:1]), np.cumsum(held - q[0], axis=0)))
    points = q[0] + (total[width:] - total[:-width]) / width
    spline = BSpline(h * np.arange(len(points) + 4.0), points, k=3)
    coefficients = np.stack([spline(spline.t[3:-4], order) / factorial(order) for order in range(4)], axis=1)
    return PiecewiseCubic(np.full(len(coefficients), h), coefficients)
