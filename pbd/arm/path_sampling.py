"""Sample a motion densely enough for collision checks: see `JointPath`."""

import numpy as np
from numpy.typing import NDArray

from pbd.arm.collision.clearance import JointPath
from pbd.data import JointTrajectory
from pbd.pose import Array

_SAME_S = 1e-9  # instants closer than this are merged


def sample_polyline(q: Array, opening: float, rates: Array, step_m: float) -> JointPath:
    """Sample a polyline in joint space through joints (m, k); t is 0 to 1, with an equal share for each segment.

    `rates` (p, k + 1): see motion_bounds.py. No pair of bodies moves by more than `step_m` between samples.

    Raises:
        ValueError: a joint isn't finite.
    """
    if not np.isfinite(q).all():
        raise ValueError("joints must be finite, got NaN or an infinity")
    motion = np.max(np.abs(np.diff(q, axis=0)) @ rates[:, :-1].T, axis=1, initial=0.0)
    steps = np.ceil(motion / step_m).astype(np.int64) + 1
    move, share = _shares(steps)
    t = np.append(move + share, len(steps)) / len(steps)
    x = np.full((len(t), q.shape[1] + 1), opening)
    x[:-1, :-1] = q[move] + share[:, None] * np.diff(q, axis=0)[move]
    x[-1, :-1] = q[-1]
    return JointPath(t, x)


def sample_trajectory(
    trajectory: JointTrajectory, rates: Array, step_m: float, start: float = -np.inf, end: float = np.inf
) -> JointPath:
    """Sample a trajectory from `start` to `end` (s); `rates` and `step_m` as for `sample_polyline`."""
    start, end = max(start, 0.0), min(end, trajectory.duration)
    marks = np.concatenate((_turning_points(trajectory), trajectory.knots, trajectory.gripper_t, (start, end)))
    marks = np.unique(marks[(marks >= start) & (marks <= end)])
    marks = np.append(marks[:-1][np.diff(marks) > _SAME_S], marks[-1])
    # Between two marks each joint moves in one direction with monotonic speed, so its top speed is at an end.
    duration = np.diff(marks)
    opening = np.interp(marks, trajectory.gripper_t, trajectory.gripper_opening)
    at_marks = np.abs(trajectory.at(marks).qd)
    speed = np.column_stack((np.maximum(at_marks[:-1], at_marks[1:]), np.abs(np.diff(opening)) / duration))
    motion = duration * (speed @ np.max(rates, axis=0, initial=0.0))
    steps = np.ceil(motion / step_m).astype(np.int64) + 1
    span, share = _shares(steps)
    t = np.append(marks[span] + share * duration[span], marks[-1])
    samples = trajectory.at(t)
    return JointPath(t, np.column_stack((samples.q, samples.gripper)))


def _shares(steps: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """Divide each span into steps (n,); return for each step the index of its span, and where in the span it begins,
    as a share of the span."""
    span = np.repeat(np.arange(len(steps)), steps)
    return span, (np.arange(len(span)) - np.repeat(np.cumsum(steps) - steps, steps)) / steps[span]


def _turning_points(trajectory: JointTrajectory) -> Array:
    """Return the instants, s, inside a piece at which a joint's velocity or acceleration is zero."""
    _, c1, c2, c3 = np.moveaxis(trajectory.coefficients, 1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Solve c1 + 2 c2 s + 3 c3 s^2 = 0 in the numerically stable form, which also allows c3 = 0.
        w = -(c2 + np.copysign(np.sqrt(c2**2 - 3.0 * c3 * c1), c2))
        roots = np.stack((w / (3.0 * c3), c1 / w, -c2 / (3.0 * c3)))
    inside = (roots > 0.0) & (roots < np.diff(trajectory.knots)[:, None])
    return np.asarray((roots + trajectory.knots[:-1, None])[inside])
