"""Whether a trajectory's pieces join up and keep the joints' limits: at the roots of their derivatives, not at samples.

A piece is q = c0 + c1 s + c2 s^2 + c3 s^3 of s seconds from its beginning.
"""

from __future__ import annotations

from typing import NoReturn

import numpy as np

from pbd.data import JointLimits, JointTrajectory
from pbd.errors import PlanError
from pbd.pose import Array

RELATIVE = 1e-6
"""The share of a limit by which rounding may go beyond it, or a velocity or acceleration may jump."""

JUMP_RAD = 1e-9
"""By how much a position may jump between pieces, rad."""

_NAMES = ("position", "velocity", "acceleration", "jerk")
_UNITS = ("rad", "rad/s", "rad/s2", "rad/s3")
_NEXT = "no trajectory was written; please report it with the demonstration and the robot's TOML"


def check_smoothness(trajectory: JointTrajectory, limits: JointLimits) -> None:
    """Check that position, velocity and acceleration do not jump between pieces, and that both ends are at rest.

    Raises:
        PlanError: there is one; its fields are joint, t (s), value and bound.
    """
    begin = _derivatives(trajectory, np.zeros((len(trajectory.coefficients), 1)))
    end = _derivatives(trajectory, np.diff(trajectory.knots)[:, None])
    bounds = np.stack((np.full_like(limits.velocity, JUMP_RAD), *(RELATIVE * each for each in _bounds(limits)[:2])))
    before, after = end[:3].copy(), begin[:3].copy()
    rest = np.zeros_like(after[:, :1])
    before, after = np.concatenate((rest, before), axis=1), np.concatenate((after, rest), axis=1)
    before[0, 0], after[0, -1] = after[0, 0], before[0, -1]  # it may start and end anywhere
    order, i, joint = _worst(np.abs(after - before) / bounds[:, None])
    jump = after[order, i, joint] - before[order, i, joint]
    if abs(jump) > bounds[order, joint]:
        what = f"jumps by {jump:.3g} {_UNITS[order]} in {_NAMES[order]}"
        _break(trajectory, joint, trajectory.knots[i], what, jump, bounds[order, joint])


def check_limits(trajectory: JointTrajectory, limits: JointLimits) -> tuple[float, float, float]:
    """Return the largest share of the velocity, acceleration and jerk limits.

    Raises:
        PlanError: a limit is broken; its fields are joint, t (s), value and bound.
    """
    s = _extremes(trajectory)
    values = np.stack([_derivatives(trajectory, each) for each in s], axis=1)  # (order, extreme, piece, joint)
    for sign, bound in ((-1.0, limits.lower), (1.0, limits.upper)):
        e, i, joint = _worst(sign * (values[0] - bound))
        q = values[0, e, i, joint]
        if sign * (q - bound[joint]) > RELATIVE:
            what = f"is at {q:.6g} rad, beyond its limit of {bound[joint]:.6g} rad,"
            _break(trajectory, joint, trajectory.knots[i] + s[e, i, joint], what, q, bound[joint])
    share = np.abs(values[1:]) / _bounds(limits)[:, None, None]
    order, e, i, joint = _worst(share)
    if share[order, e, i, joint] > 1.0 + RELATIVE:
        _exceed(trajectory, limits, order, joint, trajectory.knots[i] + s[e, i, joint], values[1 + order, e, i, joint])
    velocity, acceleration, jerk = share.max(axis=(1, 2, 3)).tolist()
    return velocity, acceleration, jerk


def check_samples(trajectory: JointTrajectory, limits: JointLimits) -> None:
    """Check that the samples at 1 kHz, which others get to see, change no faster than the limits allow.

    Raises:
        PlanError: they do; its fields are joint, t (s), value and bound.
    """
    dt = np.diff(trajectory.t)[:, None]
    for order, values in enumerate((trajectory.q, trajectory.qd, trajectory.qdd)):
        bound, rates = _bounds(limits)[order], np.diff(values, axis=0) / dt
        share = np.abs(rates) / bound
        i, joint = _worst(share)
        if share[i, joint] > 1.0 + RELATIVE:
            _exceed(trajectory, limits, order, joint, float(trajectory.t[i]), rates[i, joint])


def _bounds(limits: JointLimits) -> Array:
    return np.stack((limits.velocity, limits.acceleration, limits.jerk))


def _derivatives(trajectory: JointTrajectory, s: Array) -> Array:
    """Return (4, m, k): q, qd, qdd, qddd of each piece at s (m, 1) or (m, k) seconds from its beginning."""
    c0, c1, c2, c3 = np.moveaxis(trajectory.coefficients, 1, 0)
    velocity, acceleration = c1 + s * (2.0 * c2 + s * 3.0 * c3), 2.0 * c2 + 6.0 * c3 * s
    return np.stack((c0 + s * (c1 + s * (c2 + s * c3)), velocity, acceleration, 6.0 * c3 + 0.0 * s))


def _extremes(trajectory: JointTrajectory) -> Array:
    """Return (5, m, k) s: each piece's ends, and where its velocity and its acceleration are zero inside."""
    duration = np.diff(trajectory.knots)[:, None]
    _, c1, c2, c3 = np.moveaxis(trajectory.coefficients, 1, 0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # c1 + 2 c2 s + 3 c3 s^2 = 0, in the form that loses no digits and takes c3 = 0
        w = -(c2 + np.copysign(np.sqrt(c2**2 - 3.0 * c3 * c1), c2))
        roots = np.stack((w / (3.0 * c3), c1 / w, -c2 / (3.0 * c3)))
    # Roots that lie outside their piece, or nowhere, go to its ends, which are checked anyway.
    inside = np.clip(np.nan_to_num(roots, nan=0.0), 0.0, duration)
    return np.concatenate(([np.zeros_like(c1), duration + np.zeros_like(c1)], inside))


def _worst(values: Array) -> tuple[int, ...]:
    return tuple(map(int, np.unravel_index(int(np.argmax(values)), values.shape)))


def _exceed(
    trajectory: JointTrajectory, limits: JointLimits, order: int, joint: int, t: float, value: float
) -> NoReturn:
    name, unit, bound = _NAMES[order + 1], _UNITS[order + 1], _bounds(limits)[order, joint]
    what = f"has {name} {value:.6g} {unit}, beyond its limit of {bound:.6g} {unit},"
    _break(trajectory, joint, t, what, value, bound)


def _break(trajectory: JointTrajectory, joint: int, t: float, what: str, value: float, bound: float) -> NoReturn:
    name = trajectory.joint_names[joint]
    fail(f"{name} {what} at {t:.3f} s", joint=name, t=float(t), value=float(value), bound=float(bound))


def fail(what: str, **fields: object) -> NoReturn:
    """Refuse a trajectory that should never have been made."""
    raise PlanError(f"audit: {what}; {_NEXT}", **fields)
