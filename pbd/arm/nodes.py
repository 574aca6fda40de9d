"""Nodes along a motion, close enough for collision checks: see `JointPath`."""

from __future__ import annotations

import numpy as np

from pbd.arm.clearance import STEP_M, JointPath
from pbd.data import JointTrajectory
from pbd.pose import Array

_SAME_S = 1e-9  # instants nearer than this are one


def straight(q_start: Array, q_end: Array, opening: float, rates: Array) -> JointPath:
    """Nodes of a straight move in joint space, from q (k,) to q (k,); rates (p, k + 1), see levers.py."""
    motion = float(np.max(rates[:, :-1] @ np.abs(q_end - q_start), initial=0.0))
    t = np.linspace(0.0, 1.0, int(np.ceil(motion / STEP_M)) + 2)
    x = np.empty((len(t), len(q_start) + 1))
    x[:, :-1] = q_start + t[:, None] * (q_end - q_start)
    x[:, -1] = opening
    return JointPath(t, x)


def along(trajectory: JointTrajectory, rates: Array, start: float = 0.0, end: float = np.inf) -> JointPath:
    """Nodes of a trajectory from `start` to `end` (s); rates (p, k + 1), see levers.py."""
    end = min(end, trajectory.duration)
    marks = np.concatenate((_turning_points(trajectory), trajectory.knots, trajectory.gripper_t, (start, end)))
    marks = np.unique(marks[(marks >= start) & (marks <= end)])
    marks = np.append(marks[:-1][np.diff(marks) > _SAME_S], marks[-1])
    # Between two marks each joint goes one way, and gains or loses speed throughout: its ends bound it.
    duration = np.diff(marks)
    opening = np.interp(marks, trajectory.gripper_t, trajectory.gripper_opening)
    speed = np.column_stack((_top_speeds(trajectory, marks), np.abs(np.diff(opening)) / duration))
    motion = duration * (speed @ np.max(rates, axis=0, initial=0.0))
    steps = np.ceil(motion / STEP_M).astype(np.int64) + 1
    share = (np.arange(steps.sum()) - np.repeat(np.cumsum(steps) - steps, steps)) / np.repeat(steps, steps)
    t = np.append(np.repeat(marks[:-1], steps) + share * np.repeat(duration, steps), marks[-1])
    samples = trajectory.at(t)
    return JointPath(t, np.column_stack((samples.q, samples.gripper)))


def _turning_points(trajectory: JointTrajectory) -> Array:
    """Instants inside a piece at which a joint's velocity or acceleration is zero."""
    _, c1, c2, c3 = np.moveaxis(trajectory.coefficients, 1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        # c1 + 2 c2 s + 3 c3 s^2 = 0, in the form that loses no digits and takes c3 = 0
        w = -(c2 + np.copysign(np.sqrt(c2**2 - 3.0 * c3 * c1), c2))
        roots = np.stack((w / (3.0 * c3), c1 / w, -c2 / (3.0 * c3)))
    inside = (roots > 0.0) & (roots < np.diff(trajectory.knots)[:, None])
    return np.asarray((roots + trajectory.knots[:-1, None])[inside])


def _top_speeds(trajectory: JointTrajectory, marks: Array) -> Array:
    """Return the joints' larger speed (n - 1, k) at the two ends of each stretch between marks (n,)."""
    middle = 0.5 * (marks[:-1] + marks[1:])
    piece = np.clip(np.searchsorted(trajectory.knots, middle) - 1, 0, len(trajectory.coefficients) - 1)
    _, c1, c2, c3 = np.moveaxis(trajectory.coefficients[piece], 1, 0)
    ends = [(mark - trajectory.knots[piece])[:, None] for mark in (marks[:-1], marks[1:])]
    begin, end = (np.abs(c1 + s * (2.0 * c2 + s * 3.0 * c3)) for s in ends)
    fastest: Array = np.maximum(begin, end)
    return fastest
