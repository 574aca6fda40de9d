"""The watch on a moving arm: what ends a motion before its end."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from pbd.driving.arm import Bounds, State
from pbd.errors import SensorError
from pbd.files.servo_calibration import COUNTS
from pbd.pose import Array

LAG_S = 0.25
"""How far a servo may be behind its goals, s, without being off them; assumed: an STS3215 follows within 0.1 s."""

MOST_LOAD, LOAD_S = 0.8, 0.5
"""Share of its strength above which a servo may not stay, and for how long, s. The servo itself gives way at 0.8 after
2 s (its Overload_Torque and Protection_Time as they leave the factory)."""

COOLER_C = 5.0
"""So many degrees below the temperature at which a servo switches itself off, and drops the arm, the motion ends."""

LEAST_VOLTS_SHARE = 0.8
"""Least share of the voltage at the start, assumed: below it the supply gives way."""

FLAGS = {1: "its voltage", 2: "its encoder", 4: "its heat", 8: "its current", 32: "its load"}
"""What a servo's error flags complain of."""


class Watch:
    """Looks at each state as it comes; keeps the worst of it.

    The gripper, last, is to close on things: its place and its load are not watched.

    Attributes:
        error_deg, load, celsius: (n,) the largest so far; `volts` the smallest.
    """

    def __init__(
        self, names: Sequence[str], bounds: Bounds, start: State, tolerance_deg: float, rate_hz: float
    ) -> None:
        """`start` is the arm at rest; with a tolerance of infinity no place is watched."""
        n = len(names)
        self._names, self._bounds, self._tolerance_deg = names, bounds, tolerance_deg
        self._least_volts = np.maximum(bounds.least_volts, LEAST_VOLTS_SHARE * start.volts)
        self._goals: deque[Array] = deque([start.counts], maxlen=max(2, round(LAG_S * rate_hz)))
        self._loaded, self._most_loaded = np.zeros(n), LOAD_S * rate_hz
        self.error_deg, self.load = np.zeros(n), np.zeros(n)
        self.celsius, self.volts = start.celsius.copy(), start.volts.copy()

    def goal(self, counts: Array) -> None:
        """Remember a goal (n,) that was given."""
        self._goals.append(counts)

    def look(self, state: State) -> None:
        """Look at a state.

        Raises:
            SensorError: which servo, what is wrong with it, and what to do.
        """
        goals = np.array(self._goals)
        off = np.maximum(goals.min(axis=0) - state.counts, state.counts - goals.max(axis=0)).clip(0.0)
        error_deg = 360.0 * off / COUNTS
        load = np.abs(state.load)
        self.error_deg, self.load = np.maximum(self.error_deg, error_deg), np.maximum(self.load, load)
        self.celsius, self.volts = np.maximum(self.celsius, state.celsius), np.minimum(self.volts, state.volts)
        self._loaded = np.where(load > MOST_LOAD, self._loaded + 1, 0)
        check_health(self._names, self._bounds, state)
        arm = slice(0, len(self._names) - 1)
        for name, volts, least in zip(self._names, state.volts, self._least_volts, strict=True):
            if volts < least:
                what = f"the voltage at {name} fell to {volts:.1f} V, below {least:.1f} V"
                raise SensorError(f"{what}: use a stronger power supply", joint=name)
        if (error_deg[arm] > self._tolerance_deg).any():
            worst = int(np.argmax(error_deg[arm]))
            what = (
                f"{self._names[worst]} is {error_deg[worst]:.1f} degrees off its goal, beyond {self._tolerance_deg:g}"
            )
            raise SensorError(f"{what} (--tolerance): clear its way, or run slower (--speed)", joint=self._names[worst])
        if (self._loaded[arm] > self._most_loaded).any():
            worst = int(np.argmax(self._loaded[arm]))
            name, share = self._names[worst], 100.0 * MOST_LOAD
            what = f"{name} has pushed with more than {share:.0f} % of its strength for {LOAD_S:g} s"
            raise SensorError(f"{what}: clear its way, or carry less", joint=name)


def check_health(names: Sequence[str], bounds: Bounds, state: State) -> None:
    """Refuse to move an arm whose servos are hot, complain, or have the wrong supply; raises SensorError."""
    for i, name in enumerate(names):
        if state.celsius[i] >= bounds.celsius[i] - COOLER_C:
            what = f"{name} is at {state.celsius[i]:.0f} °C, and lets go at {bounds.celsius[i]:.0f}"
            raise SensorError(f"{what}: let it cool down", joint=name)
        least, most = bounds.least_volts[i], bounds.most_volts[i]
        if not least <= state.volts[i] <= most:
            what = f"{name} has {state.volts[i]:.1f} V, outside its {least:g} to {most:g} V"
            raise SensorError(f"{what}: check the power supply", joint=name)
        if state.flags[i]:
            why = ", ".join(what for bit, what in FLAGS.items() if state.flags[i] & bit) or f"flag {state.flags[i]}"
            what = f"the servo of {name} complains of {why}"
            raise SensorError(f"{what}: switch the arm off and on, and look at it", joint=name)
