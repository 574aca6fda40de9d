"""What a receiver makes of an exported file: read back, its gaps filled by the receiver's rule, and checked."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pbd.data import JointTrajectory, Samples
from pbd.data.receiver import EPSILON, Rule, Share, evaluate, fill, shares
from pbd.errors import PlanError
from pbd.files.exporters.job import Order
from pbd.pose import Array

Shares = Mapping[Rule, tuple[Share, Share, Share]]

ROUNDING = 5e-4
"""Share by which a receiver may exceed a limit between points, from rounding to whole nanoseconds."""

EXACT_RAD = 1e-5
"""A motion that is nowhere farther than this from the planned one, rad, is where the audit found the planned one to be:
the pose tolerance of that, and a tenth of its smallest distance on an arm of a metre."""


def check_received(order: Order, points: Samples, rules: tuple[Rule, ...], digits: float = EPSILON) -> Shares:
    """Replay a file's points by each rule; return the largest shares of the velocity, acceleration and jerk limits.

    Args:
        order: what was to be written; without its `made_from` poses and collisions are not looked at.
        points: as read from the file.
        rules: of the format's receivers.
        digits: how large the last digit of the file's numbers is, as a share of them.

    Raises:
        PlanError: a limit would be broken, a keyframe missed, or something touched.
    """
    robot, found = order.robot, {}
    arrays = points.t, points.q, points.qd, points.qdd
    sound = points.q.shape[1] == len(robot.joints) and all(np.isfinite(each).all() for each in arrays)
    if not sound or len(points.t) < 2 or (np.diff(points.t) <= 0.0).any():
        raise PlanError(
            f"audit: the {order.format_name} file can't be read back; no file was written, please report it"
        )
    for rule in rules:
        found[rule] = used = shares(points, rule, robot.limits, digits)
        worst = max(used, key=lambda share: share.value)
        if not worst.value <= 1.0 + ROUNDING:
            if order.rate_hz is not None:
                how = "give a lower --rate, or none" if rule in ("cubic", "quintic") else "give another --rate"
            else:
                how = "give a lower --speed, such as 0.95"
            what = f"{reached(order, points, rule, worst)}; {how}"
            raise PlanError(what, joint=robot.joints[worst.joint], value=worst.value, bound=1.0)
        _check_path(order, points, rule)
    return found


def reached(order: Order, points: Samples, rule: Rule, worst: Share) -> str:
    """Say how much of a limit is reached, and where."""
    joint, t = order.robot.joints[worst.joint], points.t[worst.point]
    if rule in ("cubic", "quintic"):
        who = f"a controller that fills the gaps between samples by {rule}s"
    else:
        who = "a controller that takes each sample at its time" if rule == "hold" else "the controller"
    return f"{who} would reach {worst.value:.2f} times {joint}'s {worst.limit} limit, at {t:.2f} s"


def _check_path(order: Order, points: Samples, rule: Rule) -> None:
    """Compare the motion with the planned one; what differs is audited itself.

    Raises:
        PlanError: the file's polynomials are another motion, or a keyframe is missed, or something touched.
    """
    if order.made_from is None:
        return
    planned, coefficients, h = order.trajectory, fill(points, rule), np.diff(points.t)
    off = np.zeros(len(h))
    for share in (0.0, 0.5):
        exact = planned.at(points.t[:-1] + share * h).q
        off = np.maximum(off, np.abs(evaluate(coefficients, share * h[:, None]) - exact).max(axis=1))
    if off.max() <= EXACT_RAD:
        return
    if rule in ("cubic", "quintic"):  # these are made to give the planned motion back
        worst = int(np.argmax(off))
        what = f"audit: by {rule}s the file's points miss the planned motion by {off[worst]:.2g} rad"
        raise PlanError(f"{what} at {points.t[worst]:.2f} s; no file was written, please report it", value=off[worst])
    keyframes = zip(planned.keyframe_t.tolist(), planned.keyframe_q, strict=True)
    path = JointTrajectory(
        joint_names=planned.joint_names,
        knots=points.t,
        coefficients=coefficients[:, :4],
        gripper_t=points.t,
        gripper_opening=points.gripper,
        keyframe_t=np.array([_nearest_t(points, t, q) for t, q in keyframes]),
        keyframe_q=planned.keyframe_q,
    )
    order.made_from.audit(path)


def _nearest_t(points: Samples, t: float, q: Array) -> float:
    """When the motion is at a keyframe: as planned if the arm is there then, else at the point that is nearest."""
    off = np.abs(points.q - q).max(axis=1)
    there = [np.interp(t, points.t, column) for column in points.q.T]
    if np.abs(np.array(there) - q).max() <= off.min():
        return min(t, float(points.t[-1]))
    return float(points.t[np.argmin(off)])
