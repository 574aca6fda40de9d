"""Stream a motion, eased in from where the arm stands, at a steady rate, and stop at once when something is wrong."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pbd.data import JointLimits, JointTrajectory
from pbd.driving.arm import ServoArm, State
from pbd.driving.counts import Counts
from pbd.driving.watch import Watch
from pbd.errors import PlanError, SensorError
from pbd.pose import Array

SLACK_DEG = 5.0
"""How far beyond the model's limits an arm may stand, degrees, to be eased back: play, a zero set by eye (assumed)."""

LEAD_S, SETTLE_S = 0.5, 0.3
"""s: from where the arm stands into the plan's first joints, at most SLACK_DEG away; and at its last ones."""

STALL_S = 0.1
"""How late a goal may be, s: more, and the arm has stood still meanwhile."""


class Clock:
    """Time as the motion takes it, s since some instant. Tests run it faster."""

    def now(self) -> float:
        """Say what time it is."""
        return time.monotonic()

    def sleep_until(self, t: float) -> None:
        """Sleep until `t` of the motion's time; not at all where it is past."""
        if (left := t - self.now()) > 0.0:
            time.sleep(left)


@dataclass(frozen=True, eq=False)
class Streamed:
    """What became of a motion.

    Attributes:
        t: s, how far the motion got.
        periods: (sent - 1,) s between goals.
        held: whether the arm was seen to take the goal that holds it (True where nothing was stopped).
    """

    sent: int
    t: float
    periods: Array
    stopped: SensorError | None = None
    by_hand: bool = False
    held: bool = True


def planned_start(counts: Counts, state: State, limits: JointLimits) -> tuple[float, ...]:
    """Give the joints that a plan starts from, rad: as measured, within the model's limits.

    Raises:
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

    Returns:
        Instants of the plan (n,) s, below 0 in the lead-in, and goals (n, k + 1), counts, not rounded.

    Raises:
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


def stream(
    arm: ServoArm,
    goals: Array,
    rate_hz: float,
    watch: Watch,
    clock: Clock,
    stop_wanted: Callable[[], bool],
    dry_run: bool = False,
    stall_s: float = STALL_S,
) -> Streamed:
    """Give goals (n, k + 1), counts, one each period; with `dry_run` only look.

    Each period reads the servos and then gives the next goal. A late goal moves all that follow: goals never jump.
    A stop gives the servos the place at which they were last seen, and returns.
    """
    period, k = 1.0 / rate_hz, 0
    times: list[float] = []
    state: State | None = None
    why: SensorError | None = None
    due = clock.now()
    try:
        for k, goal in enumerate(goals):
            clock.sleep_until(due)
            if stop_wanted():
                break
            now = clock.now()
            if k and now - due > stall_s:
                raise SensorError(f"this computer was busy for {now - due:.2f} s: close other programs")
            state = arm.state()
            watch.look(state)
            if not dry_run:
                arm.go(goal)
            watch.goal(goal)
            times.append(now)
            due = max(due, now - 0.5 * period) + period
        else:
            return Streamed(len(goals), len(goals) / rate_hz, np.diff(times))
    except SensorError as error:
        why = error
    held = True
    if state is not None and not dry_run:
        try:
            arm.hold(state.counts)
        except SensorError:
            held = False
    return Streamed(k, k / rate_hz, np.diff(times), why, by_hand=why is None, held=held)
