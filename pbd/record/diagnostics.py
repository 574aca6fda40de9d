"""Check a sensor while it records, when a fault can still be corrected.

A saturated axis, a dead one, a gyro or magnetometer that says nothing, a sensor that repeats itself. What is looked for
is what `pbd.tracking` finds in a finished recording (saturation.py, channel_faults.py), here in its last seconds.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from pbd.data import GRAVITY, Recording
from pbd.pose import Array
from pbd.record.values import recording_of
from pbd.sensors.decoding import Sample
from pbd.tracking.repair.channel_faults import LIVE_SHARE, SENSOR_NAMES, STUCK_S, stuck_axes
from pbd.tracking.repair.saturation import TOP_TOLERANCE, clips_of

CHECK_EVERY_S = 0.25
"""s between two checks of the latest samples."""

CHECKED_S = STUCK_S + 2.0 * CHECK_EVERY_S

REPEAT_WARNING_S = 5.0
"""s after which a warning is repeated, if the fault persists."""

MOVING_ACC = 0.5
"""m/s2: standard deviation of an axis above which the hand moves for certain. A gyro at rest may repeat itself."""

FEWEST_SAMPLES = 8
"""Least number of samples that are judged."""


class Diagnostics:
    """Takes samples and reports faults in them."""

    def __init__(self) -> None:
        self._recent: deque[tuple[float, Sample]] = deque()
        self._looked = 0.0
        self._said_at: dict[str, float] = {}
        self._lived = False
        # Whether it has shown noise. A sensor that never did is coarse, and repeats itself at every rest.
        self._largest: dict[tuple[str, int, float], float] = {}

    def feed(self, t: float, sample: Sample) -> list[str]:
        """Take the next sample, at t s; return new faults, a line each."""
        self._recent.append((t, sample))
        if t - self._looked < CHECK_EVERY_S:
            return []
        while self._recent[0][0] < t - CHECKED_S:
            self._recent.popleft()
        looked, self._looked = self._looked, t
        window = _window(self._recent)
        if len(window) < FEWEST_SAMPLES:
            return []
        flaws = self._clipped(window, looked) | self._dead(window)
        new = [what for what in flaws if t - self._said_at.get(what, -np.inf) >= REPEAT_WARNING_S]
        self._said_at |= dict.fromkeys(new, t)
        return [flaws[what] for what in new]

    def _clipped(self, window: Recording, since: float) -> dict[str, str]:
        """Axes that reached the end of their range since then. A peak below an earlier one is not clipped."""
        flaws: dict[str, str] = {}
        for clip in clips_of(window):
            side = clip.sensor, clip.axis, clip.sign
            reading = abs(float(getattr(window, clip.sensor)[clip.start, clip.axis]))
            if reading >= self._largest.get(side, 0.0) * (1.0 - TOP_TOLERANCE) and window.t[clip.stop - 1] > since:
                shown = f"{reading / GRAVITY:.3g} g" if clip.sensor == "acc" else f"{np.degrees(reading):.0f} deg/s"
                axis = f"{'xyz'[clip.axis]} axis of the {SENSOR_NAMES[clip.sensor]}"
                what = f"the {axis} is at the end of its range ({shown}): move slower, or set a larger one"
                flaws[f"{axis} clipped"] = what
        for name, values in _motion(window):
            for k in range(3):
                for sign in (1.0, -1.0):
                    largest = float((sign * values[:, k]).max())
                    self._largest[name, k, sign] = max(self._largest.get((name, k, sign), 0.0), largest)
        return flaws

    def _dead(self, window: Recording) -> dict[str, str]:
        """Axes and sensors that are constant while others change."""
        given = dict(_motion(window))
        whole = window.t[-1] - window.t[0] >= STUCK_S
        changing = np.any([np.diff(values, axis=0).any(axis=1) for values in given.values()], axis=0).mean()
        self._lived |= bool(changing > LIVE_SHARE)
        if whole and changing == 0.0:
            if self._lived:
                return {"stuck": f"for {STUCK_S:g} s all samples are the same: the sensor is stuck; plug it in again"}
            return {"still": "all samples are the same so far: if that stays so while you move, the sensor is stuck"}
        flaws: dict[str, str] = {}
        for name, axis, start, _ in stuck_axes(window):
            what, value = f"{'xyz'[axis]} axis of the {SENSOR_NAMES[name]}", float(given[name][start, axis])
            stuck = f"the {what} is stuck at {value:.4g}, while others change: repair or replace the sensor"
            flaws[f"{what} stuck"] = stuck
        if whole and np.std(window.acc, axis=0).max() > MOVING_ACC:
            if window.gyr is not None and not _changes(window.gyr):
                flaws["gyro dead"] = (
                    "the gyro reads the same while the hand moves, so it is dead: repair or replace the sensor"
                )
            if window.mag is not None and not _changes(window.mag[np.isfinite(window.mag[:, 0])]):
                flaws["magnetometer dead"] = "the magnetometer reads the same while the hand moves: it will be left out"
        return flaws


def _window(recent: deque[tuple[float, Sample]]) -> Recording:
    """The samples as a recording; those that lack a gyro's reading, where others have one, are left out."""
    has_gyr = any(sample.gyr for _, sample in recent)
    whole = [(t, sample) for t, sample in recent if sample.acc and (sample.gyr or not has_gyr)]
    return recording_of(np.array([t for t, _ in whole]), [sample for _, sample in whole])


def _changes(values: Array) -> bool:
    return bool(np.diff(values, axis=0).any())


def _motion(window: Recording) -> list[tuple[str, Array]]:
    return [(name, values) for name in SENSOR_NAMES if (values := getattr(window, name)) is not None]
