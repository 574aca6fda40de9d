"""The goals that the servos are given: a planned motion, eased in from where the arm was measured to stand."""

from __future__ import annotations

import numpy as np

from pbd.data import JointLimits, JointTrajectory
from pbd.driving.arm import State
from pbd.driving.counts import Counts
from pbd.errors import PlanError
from pbd.pose import Array

SLACK_DEG = 5.0
"""How far beyond the model's limits an arm may stand, degrees, to be eased back: play, a zero set by eye (assumed)."""

LEAD_S, SETTLE_S = 0.5, 0.3
"""s: from where the arm stands into the plan's first joints, at most SLACK_DEG away; and at its last ones."""


def planned_start(counts: Counts, state: State, limits: JointLimits) -> tuple[float, ...]:
    """Give the joints that a plan starts from, rad: as measured, within the model's limits.

    PlanError: the arm stands far outside them.
    """
    q = counts.joints(state.counts)
    inside = np.clip(q, limits.lower, limits.upper)
    worst = int(np.argmax(np.abs(q - inside)))
    if np.degrees(abs(q - inside)[worst]) > SLACK_DEG:
        low, high, at = np.degrees([limits.lower[worst], limits.upper[worst], q[worst]])
        name = counts.names[worst]
        what = f"{name} stands at {at:.0f} degrees, outside the model's {low:.0f} to {high:.0f}"
        raise PlanError(f"{what}: let go of it with --release, and move it by hand to where it has room", joint=name)
    return tuple(inside.tolist())


def goals_of(
    counts: Counts, trajectory: JointTrajectory, state: State, rate_hz: float, stroke_s: float
) -> tuple[Array, Array]:
    """Sample a motion that starts where the arm was measured.

    Gives instants of the plan (n,) s, below 0 in the lead-in, and goals (n, k + 1), counts, not rounded.
    PlanError: a goal lies outside the calibrated range.
    """
    lead, settle = max(1, round(LEAD_S * rate_hz)), round(SETTLE_S * rate_hz)
    steps = int(np.ceil(trajectory.duration * rate_hz)) + settle
    t = np.arange(-lead, steps + 1) / rate_hz
    samples = trajectory.at(np.maximum(t, 0.0))
    goals = counts.of(samples.q, samples.gripper)
    counts.check_reach(t[lead:], goals[lead:])
    eased = 0.5 * (1.0 - np.cos(np.pi * np.clip(1.0 + t / LEAD_S, 0.0, 1.0)))[:, None]
    goals[:, :-1] = state.counts[:-1] + eased * (goals[:, :-1] - state.counts[:-1])
    most = (counts.upper[-1] - counts.lower[-1]) / (stroke_s * rate_hz)  # the fingers may stand anywhere at the start
    at = float(state.counts[-1])
    for goal in goals:
        at += float(np.clip(goal[-1] - at, -most, most))
        goal[-1] = at
    return t, goals
