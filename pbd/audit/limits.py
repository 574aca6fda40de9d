"""Check that a trajectory is smooth and keeps the joints' limits, at the roots of its derivatives, not at samples only.

A piece is q = c0 + c1 s + c2 s^2 + c3 s^3, with s in seconds from the start of the piece.
"""

from typing import NoReturn

import numpy as np

from pbd.data import JointLimits, JointTrajectory
from pbd.errors import PlanError
from pbd.pose import Array

ROUNDING = 1e-6
"""Rounding error allowed beyond a limit, as a share of it (rad for a position). Velocity and acceleration may jump by
this share of their limits."""

JUMP_RAD = 1e-9
"""Largest jump, rad, of a position between two pieces."""

_NAMES = ("position", "velocity", "acceleration", "jerk")
_UNITS = ("rad", "rad/s", "rad/s2", "rad/s3")


def check_smoothness(trajectory: JointTrajectory, limits: JointLimits) -> None:
    """Check that position, velocity and acceleration do not jump between pieces, and that both ends are at rest.

    Raises:
        PlanError: something jumps; its fields are joint, t (s), value and bound.
    """
    begin = derivatives(trajectory.coefficients, np.zeros((len(trajectory.coefficients), 1)))[:3]
    end = derivatives(trajectory.coefficients, np.diff(trajectory.knots)[:, None])[:3]
    bounds = np.stack((np.full_like(limits.velocity, JUMP_RAD), *(ROUNDING * _bounds(limits)[:2])))
    rest = np.zeros_like(begin[:, :1])
    before, after = np.concatenate((rest, end), axis=1), np.concatenate((begin, rest), axis=1)
    before[0, 0], after[0, -1] = after[0, 0], before[0, -1]  # the motion may start and end at any position
    order, i, joint = _largest(np.abs(after - before) / bounds[:, None])
    jump = after[order, i, joint] - before[order, i, joint]
    if abs(jump) > bounds[order, joint]:
        what = f"jumps by {jump:.3g} {_UNITS[order]} in {_NAMES[order]}"
        _fail_at(trajectory, joint, trajectory.knots[i], what, jump, bounds[order, joint])


def check_limits(trajectory: JointTrajectory, limits: JointLimits) -> tuple[float, float, float]:
    """Check position, velocity, acceleration and jerk; return the largest share of the last three limits that is used.

    Raises:
        PlanError: a limit is exceeded; its fields are joint, t (s), value and bound.
    """
    s = _extremum_times(trajectory)
    # (order of derivative, extremum, piece, joint)
    values = np.stack([derivatives(trajectory.coefficients, each) for each in s], axis=1)
    for sign, bound in ((-1.0, limits.lower), (1.0, limits.upper)):
        e, i, joint = _largest(sign * (values[0] - bound))
        q = values[0, e, i, joint]
        if sign * (q - bound[joint]) > ROUNDING:
            what = f"is at {q:.6g} rad, beyond its limit of {bound[joint]:.6g} rad,"
            _fail_at(trajectory, joint, trajectory.knots[i] + s[e, i, joint], what, q, bound[joint])
    share = np.abs(values[1:]) / _bounds(limits)[:, None, None]
    order, e, i, joint = _largest(share)
    if share[order, e, i, joint] > 1.0 + ROUNDING:
        t = trajectory.knots[i] + s[e, i, joint]
        _fail_exceeded(trajectory, limits, order, joint, t, values[1 + order, e, i, joint])
    velocity, acceleration, jerk = share.max(axis=(1, 2, 3)).tolist()
    return velocity, acceleration, jerk


def check_samples(trajectory: JointTrajectory, limits: JointLimits) -> None:
    """Check that the exported samples at 1 kHz change no faster than the limits allow.

    Raises:
        PlanError: they change faster; its fields are joint, t (s), value and bound.
    """
    dt = np.diff(trajectory.t)[:, None]
    for order, values in enumerate((trajectory.q, trajectory.qd, trajectory.qdd)):
        bound, rates = _bounds(limits)[order], np.diff(values, axis=0) / dt
        share = np.abs(rates) / bound
        i, joint = _largest(share)
        if share[i, joint] > 1.0 + ROUNDING:
            _fail_exceeded(trajectory, limits, order, joint, float(trajectory.t[i]), rates[i, joint])


def derivatives(coefficients: Array, s: Array) -> Array:
    """Return q, qd, qdd, qddd (4, m, k) of pieces.

    Args:
        coefficients: (m, 4, k), c0 to c3 of each piece and joint.
        s: (m, 1) or (m, k) seconds from the start of each piece.
    """
    c0, c1, c2, c3 = np.moveaxis(coefficients, 1, 0)
    velocity, acceleration = c1 + s * (2.0 * c2 + s * 3.0 * c3), 2.0 * c2 + 6.0 * c3 * s
    return np.stack((c0 + s * (c1 + s * (c2 + s * c3)), velocity, acceleration, 6.0 * c3 + 0.0 * s))


def _bounds(limits: JointLimits) -> Array:
    return np.stack((limits.velocity, limits.acceleration, limits.jerk))


def _extremum_times(trajectory: JointTrajectory) -> Array:
    """Return (5, m, k) s from the start of each piece: its ends, and the zeros of its velocity and acceleration."""
    duration = np.diff(trajectory.knots)[:, None]
    _, c1, c2, c3 = np.moveaxis(trajectory.coefficients, 1, 0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # c1 + 2 c2 s + 3 c3 s^2 = 0, solved in the form that loses no digits and allows c3 = 0
        w = -(c2 + np.copysign(np.sqrt(c2**2 - 3.0 * c3 * c1), c2))
        roots = np.stack((w / (3.0 * c3), c1 / w, -c2 / (3.0 * c3)))
    # Missing roots and roots outside the piece are moved to its ends, which are checked anyway.
    inside = np.clip(np.nan_to_num(roots, nan=0.0), 0.0, duration)
    return np.concatenate(([np.zeros_like(c1), duration + np.zeros_like(c1)], inside))


def _largest(values: Array) -> tuple[int, ...]:
    return tuple(map(int, np.unravel_index(int(np.argmax(values)), values.shape)))


def _fail_exceeded(
    trajectory: JointTrajectory, limits: JointLimits, order: int, joint: int, t: float, value: float
) -> NoReturn:
    name, unit, bound = _NAMES[order + 1], _UNITS[order + 1], _bounds(limits)[order, joint]
    what = f"has {name} {value:.6g} {unit}, beyond its limit of {bound:.6g} {unit},"
    _fail_at(trajectory, joint, t, what, value, bound)


def _fail_at(trajectory: JointTrajectory, joint: int, t: float, what: str, value: float, bound: float) -> NoReturn:
    name = trajectory.joint_names[joint]
    fail(f"{name} {what} at {t:.3f} s", joint=name, t=float(t), value=float(value), bound=float(bound))


def fail(what: str, **fields: object) -> NoReturn:
    """Refuse a trajectory that only a bug of the planner can have made."""
    raise PlanError(
        f"audit: {what}; no trajectory was written; please report it with the demonstration and the robot's TOML",
        **fields,
    )
