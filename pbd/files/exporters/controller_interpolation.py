"""How a receiver interpolates between a trajectory's points, and which share of the limits that uses.

ROS 2's joint_trajectory_controller and others use cubics (points have velocities) or quintics (accelerations too). A
receiver with the rule "hold" keeps each point until the next: its points are set points, which must not change faster
than the limits allow. "trapezoid" keeps each point's acceleration until the next.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from pbd.data import JointLimits, Samples
from pbd.pose import Array

Rule = Literal["cubic", "quintic", "hold", "trapezoid"]
"""How a receiver moves between two points; see above."""

LIMITS = "velocity", "acceleration", "jerk"

EPSILON = float(np.finfo(np.float64).eps)
"""Relative size of a number's last digit."""

_ROUNDING = 2.0, 8.0, 64.0
"""Largest errors of a quintic's velocity, acceleration and jerk, as multiples of the position's rounding error over the
gap to the power 1, 2, 3. They are the quintic's largest coefficients (1.9, 5.8 and 60), rounded up."""


@dataclass(frozen=True)
class Share:
    """The largest share of a limit that is used (1: all of it), by which joint, and after which point (indices)."""

    limit: str
    joint: int
    point: int
    value: float


def set_point_samples(t: Array, q: Array, gripper: Array) -> Samples:
    """Make samples of set points, which have positions alone.

    Velocities and accelerations are finite differences, starting at rest.

    Args:
        t: (n,) s.
        q: (n, k) rad.
        gripper: (n,) 0 closed to 1 open.
    """
    dt = np.diff(t, prepend=2.0 * t[0] - t[1])[:, None]
    qd = np.diff(q, axis=0, prepend=q[:1]) / dt
    return Samples(t, q, qd, np.diff(qd, axis=0, prepend=0.0 * qd[:1]) / dt, gripper)


def interpolate(points: Samples, rule: Rule) -> Array:
    """Return a receiver's polynomials between points: coefficients (n - 1, 6, k) in s since the earlier point.

    With the rule "hold", a drive goes straight from one set point to the next.
    """
    h = np.diff(points.t)[:, None]
    v0, v1 = h * points.qd[:-1], h * points.qd[1:]
    step = np.diff(points.q, axis=0)
    zero = np.zeros_like(step)
    if rule == "hold":
        terms = [points.q[:-1], step, *[zero] * 4]
    elif rule == "trapezoid":
        terms = [points.q[:-1], v0, 0.5 * h**2 * points.qdd[:-1], *[zero] * 3]
    elif rule == "cubic":
        terms = [points.q[:-1], v0, 3.0 * step - 2.0 * v0 - v1, v0 + v1 - 2.0 * step, zero, zero]
    else:
        a0, a1 = h**2 * points.qdd[:-1], h**2 * points.qdd[1:]
        terms = [
            points.q[:-1],
            v0,
            0.5 * a0,
            10.0 * step - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1,
            -15.0 * step + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1,
            6.0 * step - 3.0 * (v0 + v1) + 0.5 * (a1 - a0),
        ]
    return np.stack([term / h**power for power, term in enumerate(terms)], axis=1)


def limit_shares(
    points: Samples, rule: Rule, limits: JointLimits, digits: float = EPSILON
) -> tuple[Share, Share, Share]:
    """Return the largest shares of the velocity, acceleration and jerk limits that a receiver's interpolation uses.

    Rounding errors of positions and times, divided by powers of a short gap, do not count. `digits` is the relative
    size of a position's last digit.
    """
    coefficients, h = interpolate(points, rule), np.diff(points.t)[:, None]
    rounding = digits * np.abs(points.q).max(axis=0) + EPSILON * points.t[-1] * np.abs(points.qd).max(axis=0)
    bounds = limits.velocity, limits.acceleration, limits.jerk
    values = points.q, points.qd, points.qdd
    found = []
    for order, (name, bound) in enumerate(zip(LIMITS, bounds, strict=True), start=1):
        if rule == "hold":
            peaks: Array = np.abs(np.diff(values[order - 1], axis=0)) / h
        else:
            peaks = _peak_values(np.asarray(polyder(coefficients, order, axis=1), dtype=np.float64), h)
        worst = (peaks - _ROUNDING[order - 1] * rounding / h**order) / bound
        point, joint = np.unravel_index(int(np.argmax(worst)), worst.shape)
        found.append(Share(name, int(joint), int(point), float(worst[point, joint])))
    return found[0], found[1], found[2]


def _peak_values(coefficients: Array, h: Array) -> Array:
    """Return the largest absolute value (n, k) of each polynomial (n, terms, k) over its gap (n, 1) s."""
    while coefficients.shape[1] > 1 and not coefficients[:, -1].any():
        coefficients = coefficients[:, :-1]
    instants = [0.0 * h, h]
    if coefficients.shape[1] == 3:  # a parabola: at its vertex
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            vertex = -0.5 * coefficients[:, 1] / coefficients[:, 2]
        instants.append(np.clip(np.nan_to_num(vertex), 0.0, h))
    elif coefficients.shape[1] > 3:
        instants += [step / 64 * h for step in range(1, 64)]  # so the jerk's peak is found to 0.02 %
    return np.asarray(np.maximum.reduce([np.abs(evaluate(coefficients, s)) for s in instants]))


def evaluate(coefficients: Array, s: Array) -> Array:
    """Evaluate polynomials (n, terms, k) at s (n, 1) seconds after their starts."""
    return np.asarray(polyval(s, np.moveaxis(coefficients, 1, 0), tensor=False))
