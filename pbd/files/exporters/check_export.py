"""What a receiver makes of an exported file: read back, its gaps filled by the receiver's rule, and checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from pbd.data import JointTrajectory, Samples
from pbd.errors import PbdError, PlanError
from pbd.files.exporters.controller_interpolation import (
    EPSILON,
    LIMITS,
    Rule,
    Share,
    evaluate,
    interpolate,
    limit_shares,
)
from pbd.files.exporters.export_request import ExportRequest
from pbd.pose import Array

Shares = Mapping[Rule, tuple[Share, Share, Share]]

ROUNDED = 1e-3
"""Share of a limit by which rounding the points may exceed it, at most: whole nanoseconds do by less than 1e-5."""

RATES_HZ = (20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)
"""Rates that are tried in a refused one's place."""

EXACT_RAD = 1e-5
"""Up to this deviation from the planned motion, rad, its audit still holds: it is the audit's pose tolerance, and a
tenth of its smallest distance on an arm of a metre."""


def check_received(
    request: ExportRequest,
    points: Samples,
    rules: tuple[Rule, ...],
    digits: float = EPSILON,
    sampled: Callable[[ExportRequest], Samples] | None = None,
) -> Shares:
    """Replay a file's points by each rule; return the largest shares of the velocity, acceleration and jerk limits.

    Args:
        request: what was to be written; without its `made_from` poses and collisions are not looked at.
        points: as read from the file.
        rules: of the format's receivers.
        digits: how large the last digit of the file's numbers is, as a share of them.
        sampled: makes the points of another request, to try another rate.

    Raises:
        PlanError: a limit would be broken, a keyframe missed, or something touched.
    """
    robot, found = request.robot, {}
    arrays = points.t, points.q, points.qd, points.qdd
    sound = points.q.shape[1] == len(robot.joints) and all(np.isfinite(each).all() for each in arrays)
    if not sound or len(points.t) < 2 or (np.diff(points.t) <= 0.0).any():
        what = f"audit: the {request.format_name} file can't be read back"
        raise PlanError(f"{what}; no file was written, please report it")
    for rule in rules:
        found[rule] = used = limit_shares(points, rule, robot.limits, digits)
        worst = max(used, key=lambda share: share.value)
        if not worst.value <= 1.0:
            slower = np.floor(100.0 * worst.value ** (-1.0 / (1 + LIMITS.index(worst.limit)))) / 100.0
            how = f"--margin {100.0 * ROUNDED:g}" if worst.value < 1.0 + ROUNDED else f"{slower:g} times the --speed"
            what = f"{reached(request, points, rule, worst)}; give {how}"
            raise PlanError(what, joint=robot.joints[worst.joint], value=worst.value, bound=1.0)
        path = None if request.made_from is None else _other_path(request, points, rule)
        try:
            if path is not None:
                request.source.audit(path)
        except PlanError as error:
            rate_hz = _rate_that_works(request, rules, sampled)
            how = "a lower --speed" if rate_hz is None else f"--rate {rate_hz:g}"
            raise PlanError(f"{error.message}; give {how}", **error.fields) from None
    return found


def _rate_that_works(
    request: ExportRequest, rules: tuple[Rule, ...], sampled: Callable[[ExportRequest], Samples] | None
) -> float | None:
    for rate_hz in RATES_HZ:
        if request.rate_hz is not None and rate_hz > request.rate_hz and sampled is not None:
            with suppress(PbdError):  # servoj has two rates
                other = replace(request, rate_hz=rate_hz)
                check_received(other, sampled(other), rules)
                return rate_hz
    return None


def reached(request: ExportRequest, points: Samples, rule: Rule, worst: Share) -> str:
    """Say how much of a limit is reached, and where."""
    joint, t = request.robot.joints[worst.joint], points.t[worst.point]
    times = f"{worst.value:.{2 if worst.value > 1.0 + ROUNDED else 7}f}"
    if rule in ("cubic", "quintic"):
        who = f"a controller that fills the gaps between samples by {rule}s"
    else:
        who = "a controller that takes each sample at its time" if rule == "hold" else "the controller"
    return f"{who} would reach {times} times {joint}'s {worst.limit} limit, at {t:.2f} s"


def _other_path(request: ExportRequest, points: Samples, rule: Rule) -> JointTrajectory | None:
    """Compare the motion with the planned one; return what is not that, to be audited itself.

    Raises:
        PlanError: the file's polynomials are another motion.
    """
    planned, coefficients, h = request.trajectory, interpolate(points, rule), np.diff(points.t)
    off = np.zeros(len(h))
    for share in (0.0, 0.5):
        exact = planned.at(points.t[:-1] + share * h).q
        off = np.maximum(off, np.abs(evaluate(coefficients, share * h[:, None]) - exact).max(axis=1))
    if off.max() <= EXACT_RAD:
        return None
    if rule in ("cubic", "quintic"):  # these are made to give the planned motion back
        worst = int(np.argmax(off))
        what = f"audit: by {rule}s the file's points miss the planned motion by {off[worst]:.2g} rad"
        raise PlanError(f"{what} at {points.t[worst]:.2f} s; no file was written, please report it", value=off[worst])
    keyframes = zip(planned.keyframe_t.tolist(), planned.keyframe_q, strict=True)
    return JointTrajectory(
        joint_names=planned.joint_names,
        knots=points.t,
        coefficients=coefficients[:, :4],
        gripper_t=points.t,
        gripper_opening=points.gripper,
        keyframe_t=np.array([_nearest_t(points, t, q) for t, q in keyframes]),
        keyframe_q=planned.keyframe_q,
    )


def _nearest_t(points: Samples, t: float, q: Array) -> float:
    """When the motion is at a keyframe: as planned if the arm is there then, else at the point that is nearest."""
    off = np.abs(points.q - q).max(axis=1)
    there = [np.interp(t, points.t, column) for column in points.q.T]
    if np.abs(np.array(there) - q).max() <= off.min():
        return min(t, float(points.t[-1]))
    return float(points.t[np.argmin(off)])
