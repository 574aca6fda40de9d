"""Watches a moving arm, and ends the motion when a servo is off its goal, overloaded, hot or at a wrong voltage."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from pbd.driving.servo_arm import ServoLimits, ServoState
from pbd.errors import SensorError
from pbd.files.servo_calibration import COUNTS
from pbd.pose import Array

LAG_S = 0.25
"""Longest lag of a servo behind its goals, s (assumed: an STS3215 follows within 0.1 s)."""

MAX_LOAD, LOAD_S = 0.8, 0.5
"""Largest share of a servo's strength, and the longest time above it, s. The servo itself gives way at 0.8 after 2 s
(factory settings of Overload_Torque and Protection_Time)."""

OVERLOAD = 32
"""Error flag of a servo that gives way to a load. A gripper that LeRobot has configured sets it after 2 s of grasping
at more than 25 % of its strength, and goes on grasping at 20 % (Overload_Torque, Protection_Time, Protective_Torque).
Source: lerobot/robots/so101_follower/so101_follower.py, `configure`; Feetech's memory table of the STS series."""

ERROR_FLAGS = {1: "voltage", 2: "encoder", 4: "temperature", 8: "current", OVERLOAD: "load"}
"""Meaning of the bits of a servo's error flags."""


class MotionMonitor:
    """Checks each state and keeps the extremes. The gripper closes on things, so its position and load are not checked.

    Attributes:
        error_deg, load, celsius: (n,) largest values so far, without those of a fault.
        volts: (n,) smallest values so far, likewise.
    """

    def __init__(
        self, names: Sequence[str], bounds: ServoLimits, start: ServoState, tolerance_deg: float, rate_hz: float
    ) -> None:
        """Begin; `start` is the arm at rest. With an infinite tolerance, positions are not checked."""
        n = len(names)
        self._names, self._bounds, self._tolerance_deg = names, bounds, tolerance_deg
        self._min_volts = 0.8 * start.volts  # below it the power supply is overloaded (assumed)
        self._goals: deque[Array] = deque([start.counts], maxlen=max(2, round(LAG_S * rate_hz)))
        self._overloaded, self._max_overloaded = np.zeros(n), LOAD_S * rate_hz
        self.error_deg, self.load = np.zeros(n), np.zeros(n)
        self.celsius, self.volts = start.celsius.copy(), start.volts.copy()

    def add_goal(self, counts: Array) -> None:
        """Note a goal (n,) that was sent, counts."""
        self._goals.append(counts)

    def check(self, state: ServoState) -> None:
        """Check a state.

        Raises:
            SensorError: names the servo, what is wrong, and what to do.
        """
        goals = np.array(self._goals)
        off = np.maximum(goals.min(axis=0) - state.counts, state.counts - goals.max(axis=0)).clip(0.0)
        error_deg = 360.0 * off / COUNTS
        load = np.abs(state.load)
        self._overloaded = np.where(load > MAX_LOAD, self._overloaded + 1, 0)
        check_health(self._names, self._bounds, state)
        arm = slice(0, len(self._names) - 1)
        for name, volts, lowest in zip(self._names, state.volts, self._min_volts, strict=True):
            if volts < lowest:
                what = f"the voltage at {name} fell to {volts:.1f} V, below {lowest:.1f} V"
                raise SensorError(f"{what}: use a stronger power supply", joint=name)
        if (error_deg[arm] > self._tolerance_deg).any():
            worst = int(np.argmax(error_deg[arm]))
            what = (
                f"{self._names[worst]} is {error_deg[worst]:.1f} degrees off its goal, beyond {self._tolerance_deg:g}"
            )
            raise SensorError(f"{what} (--tolerance): clear its way, or run slower (--speed)", joint=self._names[worst])
        if (self._overloaded[arm] > self._max_overloaded).any():
            worst = int(np.argmax(self._overloaded[arm]))
            name, share = self._names[worst], 100.0 * MAX_LOAD
            what = f"{name} has pushed with more than {share:.0f} % of its strength for {LOAD_S:g} s"
            raise SensorError(f"{what}: clear its way, or carry less", joint=name)
        self.error_deg, self.load = np.maximum(self.error_deg, error_deg), np.maximum(self.load, load)
        self.celsius, self.volts = np.maximum(self.celsius, state.celsius), np.minimum(self.volts, state.volts)


def check_health(names: Sequence[str], bounds: ServoLimits, state: ServoState) -> None:
    """Refuse servos that are hot, have a wrong voltage, or report an error, but for the gripper's overload.

    Raises:
        SensorError: names the servo, what is wrong, and what to do.
    """
    for i, name in enumerate(names):
        if state.celsius[i] >= bounds.celsius[i] - 5.0:  # where a servo switches itself off and drops the arm
            what = f"{name} is at {state.celsius[i]:.0f} °C, and switches off at {bounds.celsius[i]:.0f}"
            raise SensorError(f"{what}: let it cool down", joint=name)
        low, high = bounds.min_volts[i], bounds.max_volts[i]
        if not low <= state.volts[i] <= high:
            what = f"{name} has {state.volts[i]:.1f} V, outside its {low:g} to {high:g} V"
            raise SensorError(f"{what}: check the power supply", joint=name)
        if flags := state.flags[i] & ~(OVERLOAD if i == len(names) - 1 else 0):
            why = ", ".join(what for bit, what in ERROR_FLAGS.items() if flags & bit) or f"flag {flags}"
            what = f"the servo of {name} reports a fault ({why})"
            raise SensorError(f"{what}: switch the arm off and on, and look at it", joint=name)
