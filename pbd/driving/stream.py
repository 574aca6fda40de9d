"""Stream a motion to the servos at a constant rate, and stop at once if something is wrong.

The motion is eased in from where the arm stands.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pbd.data import JointLimits, JointTrajectory
from pbd.driving.encoders import Encoders
from pbd.driving.motion_monitor import MotionMonitor
from pbd.driving.servo_arm import LostTorqueError, ServoArm, ServoState
from pbd.errors import CalibrationError, PlanError, SensorError, amount
from pbd.files.servo_calibration import COUNTS
from pbd.pose import Array

START_SLACK_DEG = 5.0
"""Largest angle by which an arm may start beyond the model's limits, degrees (assumed: play, a zero set by eye). It is
eased back."""

LEAD_S, SETTLE_S = 0.5, 0.3
"""Durations, s, of the lead-in from where the arm stands, at most START_SLACK_DEG away, to the first planned joints; of
the hold at the last ones."""

STALL_S = 0.1
"""Longest delay of a goal, s. If it is later, the arm has stood still in the meantime, so the motion ends."""


class Clock:
    """The motion's time, s since some instant. Tests let it run faster."""

    def now(self) -> float:
        """Return the present time, s."""
        return time.monotonic()

    def sleep_until(self, t: float) -> None:
        """Sleep until the time `t`, s; return at once if it is past."""
        if (left := t - self.now()) > 0.0:
            time.sleep(left)


@dataclass(frozen=True, eq=False)
class StreamResult:
    """How a motion ended.

    Attributes:
        sent: number of goals sent.
        t: how far the motion got, s.
        periods: (sent - 1,) times between goals, s.
        stopped: the fault for which it stopped early, or None.
        by_hand: whether a person stopped it.
        held: whether the servos have torque, and took the goal that holds the arm.
    """

    sent: int
    t: float
    periods: Array
    stopped: SensorError | None = None
    by_hand: bool = False
    held: bool = True


def planned_start(encoders: Encoders, state: ServoState, limits: JointLimits) -> tuple[float, ...]:
    """Return the joints that a plan starts from, rad: the measured ones, clipped to the model's limits.

    Raises:
        CalibrationError: a servo counts turns.
        PlanError: the arm stands more than START_SLACK_DEG outside them.
    """
    for name, counts in zip(encoders.names, state.counts, strict=True):
        if not 0 <= counts < COUNTS:
            what = f"the servo of {name} counts turns: it says {counts:.0f}, not 0 to {COUNTS - 1}"
            raise CalibrationError(f"{what}; calibrate anew with `pbd run --calibrate --robot R`", joint=name)
    q = encoders.to_joints(state.counts)
    inside = np.clip(q, limits.lower, limits.upper)
    worst = int(np.argmax(np.abs(q - inside)))
    if np.degrees(abs(q - inside)[worst]) > START_SLACK_DEG:
        low, high, at = np.degrees([limits.lower[worst], limits.upper[worst], q[worst]])
        name = encoders.names[worst]
        what = f"{name} stands at {amount(at, 'degree', '.0f')}, outside the model's {low:.0f} to {high:.0f}"
        raise PlanError(f"{what}: let go of it with --release, and move it by hand to where it has room", joint=name)
    return tuple(inside.tolist())


def sample_goals(
    encoders: Encoders, trajectory: JointTrajectory, state: ServoState, rate_hz: float
) -> tuple[Array, Array]:
    """Sample a motion as goals, with a lead-in from where the arm was measured.

    Returns:
        The plan's times (n,) s, below 0 in the lead-in, and goals (n, k + 1), counts, not rounded.

    Raises:
        PlanError: a goal lies outside the calibrated range.
    """
    lead, settle = max(1, round(LEAD_S * rate_hz)), round(SETTLE_S * rate_hz)
    steps = int(np.ceil(trajectory.duration * rate_hz)) + settle
    t = np.arange(-lead, steps + 1) / rate_hz
    samples = trajectory.at(np.maximum(t, 0.0))
    goals = encoders.from_joints(samples.q, samples.gripper)
    encoders.check_range(t[lead:], goals[lead:])
    eased = 0.5 * (1.0 - np.cos(np.pi * np.clip(1.0 + t / LEAD_S, 0.0, 1.0)))[:, None]
    goals[:, :-1] = state.counts[:-1] + eased * (goals[:, :-1] - state.counts[:-1])
    # The fingers may stand anywhere at the start, so their speed is limited instead.
    max_step = (encoders.upper[-1] - encoders.lower[-1]) / (encoders.stroke_s * rate_hz)
    fingers = float(state.counts[-1])
    for goal in goals:
        fingers += float(np.clip(goal[-1] - fingers, -max_step, max_step))
        goal[-1] = fingers
    return t, goals


def stream(
    arm: ServoArm,
    goals: Array,
    rate_hz: float,
    monitor: MotionMonitor,
    clock: Clock,
    stop_wanted: Callable[[], bool],
    dry_run: bool = False,
) -> StreamResult:
    """Send goals (n, k + 1), counts, one each period; with `dry_run` only read the servos.

    Each period reads the servos and then sends the next goal. A late goal delays all that follow, so goals never jump.
    A stop sends the servos their last measured position as the goal (before the first measurement: the first goal,
    where the arm stands), and returns. A fault must show in two readings.
    """
    period, k = 1.0 / rate_hz, 0
    times: list[float] = []
    counts = goals[0]
    why: SensorError | None = None
    due = clock.now()
    try:
        for k, goal in enumerate(goals):
            clock.sleep_until(due)
            now = clock.now()
            seen = arm.state()
            try:
                monitor.check(seen)
            except SensorError:  # a damaged answer may pass its checksum, which is one byte: a second one must agree
                seen = arm.state()
                counts = seen.counts
                monitor.check(seen)
            counts = seen.counts
            if stop_wanted():
                break
            if k and now - due > STALL_S:
                raise SensorError(f"this computer was busy for {now - due:.2f} s: close other programs")
            if not dry_run:
                arm.send_goals(goal)
            monitor.add_goal(goal)
            times.append(now)
            due = max(due, now - 0.5 * period) + period
        else:
            if not dry_run:
                arm.check_torque()
            return StreamResult(len(goals), len(goals) / rate_hz, np.diff(times))
    except SensorError as error:
        why = error
    held = True
    if not dry_run:
        try:
            arm.hold(counts)
        except LostTorqueError as error:
            why, held = error, False
        except SensorError:
            held = False
    return StreamResult(k, k / rate_hz, np.diff(times), why, by_hand=why is None, held=held)
