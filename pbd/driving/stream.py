"""Stream a motion to the arm at a steady rate, and stop at once when something is wrong."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pbd.driving.arm import ServoArm, State
from pbd.driving.watch import Watch
from pbd.errors import SensorError
from pbd.pose import Array

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
                what = f"this computer was busy for {now - due:.2f} s"
                raise SensorError(f"{what}: close other programs")
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
