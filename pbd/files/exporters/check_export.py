"""Check of an exported file: it is read back, interpolated as its receivers do, and audited."""

from collections.abc import Mapping

import numpy as np

from pbd.data import JointTrajectory, Samples
from pbd.errors import PlanError
from pbd.files.exporters.controller_interpolation import (
    EPSILON,
    Rule,
    Share,
    evaluate,
    interpolate,
    limit_shares,
)
from pbd.files.exporters.export_request import ExportRequest
from pbd.pose import Array

Shares = Mapping[Rule, tuple[Share, Share, Share]]
"""Rule -> largest used fraction of the velocity, acceleration and jerk limits."""

ROUNDING_EXCESS = 1e-3
"""Largest excess over a limit, as a fraction of it, that is attributed to rounding: the message then advises --margin.
Rounding to whole nanoseconds causes less than 1e-5."""

EXACT_RAD = 1e-5
"""Largest deviation from the planned motion, rad, for which the planned motion's audit is valid. It is the audit's
pose tolerance, and a tenth of its smallest distance on an arm of one metre."""


def check_received(request: ExportRequest, points: Samples, rules: tuple[Rule, ...], digits: float = EPSILON) -> Shares:
    """Interpolate a file's points by each rule, and check limits, keyframes and collisions.

    Args:
        request: the planned motion; without its `made_from`, only limits are checked.
        digits: relative size of the last digit of the file's numbers.

    Raises:
        PlanError: the motion would exceed a limit, miss a keyframe or touch something.
    """
    robot, used_by_rule = request.robot, {}
    arrays = points.t, points.q, points.qd, points.qdd
    valid = points.q.shape[1] == len(robot.joints) and all(np.isfinite(each).all() for each in arrays)
    if not valid or len(points.t) < 2 or (np.diff(points.t) <= 0.0).any():
        what = f"audit: the {request.format_name} file can't be read back"
        raise PlanError(f"{what}; no file was written, please report it")
    for rule in rules:
        used_by_rule[rule] = used = limit_shares(points, rule, robot.limits, digits)
        worst = max(used, key=lambda share: share.value)
        if not worst.value <= 1.0:
            slower = np.floor(100.0 / worst.value) / 100.0  # --speed multiplies all limits
            how = "--margin 1" if worst.value < 1.0 + ROUNDING_EXCESS else f"{slower:g} times the --speed"
            what = f"{limit_use(request, points, rule, worst)}; give {how}"
            raise PlanError(what, joint=robot.joints[worst.joint], value=worst.value, bound=1.0)
        motion = None if request.made_from is None else _deviating_motion(request, points, rule)
        try:
            if motion is not None:
                request.source.audit(motion)
        except PlanError as error:
            how = "a lower --speed" if request.rate_hz is None else "a higher --rate, or a lower --speed"
            raise PlanError(f"{error.message}; give {how}", **error.fields) from None
    return used_by_rule


def limit_use(request: ExportRequest, points: Samples, rule: Rule, worst: Share) -> str:
    """Return the beginning of a message: how much of a limit a receiver uses, of which joint, and when."""
    joint, t = request.robot.joints[worst.joint], points.t[worst.point]
    times = f"{worst.value:.{2 if worst.value > 1.0 + ROUNDING_EXCESS else 7}f}"
    if rule in ("cubic", "quintic"):
        who = f"a controller that fills the gaps between samples by {rule}s"
    else:
        who = "a controller that takes each sample at its time" if rule == "hold" else "the controller"
    return f"{who} would reach {times} times {joint}'s {worst.limit} limit, at {t:.2f} s"


def _deviating_motion(request: ExportRequest, points: Samples, rule: Rule) -> JointTrajectory | None:
    """Compare the received motion with the planned one. Return None if they agree, else the received motion.

    Raises:
        PlanError: they differ, though the rule reproduces the planned motion.
    """
    planned, coefficients, h = request.trajectory, interpolate(points, rule), np.diff(points.t)
    off = np.zeros(len(h))
    for share in (0.0, 0.5):
        exact = planned.at(points.t[:-1] + share * h).q
        off = np.maximum(off, np.abs(evaluate(coefficients, share * h[:, None]) - exact).max(axis=1))
    if off.max() <= EXACT_RAD:
        return None
    if rule in ("cubic", "quintic"):  # formats for these rules reproduce the planned motion
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
    """Return when the points are at a keyframe q (k,) rad planned at t s: at t, or at a point that is nearer to q."""
    off = np.abs(points.q - q).max(axis=1)
    q_at_t = np.array([np.interp(t, points.t, column) for column in points.q.T])
    if np.abs(q_at_t - q).max() <= off.min():
        return min(t, float(points.t[-1]))
    return float(points.t[np.argmin(off)])
