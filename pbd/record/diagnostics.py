"""Check a sensor while it records, when a fault can still be corrected.

It finds a saturated or stuck axis, a gyro or magnetometer that does not change, and a sensor that repeats its samples.
`pbd.tracking.repair` finds the same faults in a finished recording (saturation.py, channel_faults.py).
"""

from collections import deque

import numpy as np

from pbd.data import Recording
from pbd.pose import Array
from pbd.record.session_types import recording_from_samples
from pbd.sensors.decoding import Sample
from pbd.tracking.repair.channel_faults import LIVE_SHARE, SENSOR_NAMES, frozen_rows, stuck_axes
from pbd.tracking.repair.saturation import TOP_TOLERANCE, clips_of

CHECK_EVERY_S = 0.25
"""Time between two checks, s."""

STUCK_S = 2.0
"""Time after which a sensor whose samples are all the same is stuck, s."""

REPEAT_WARNING_S = 5.0
"""Time after which a warning is repeated if the fault persists, s."""


class Diagnostics:
    """Takes samples and reports the sensor's faults."""

    def __init__(self) -> None:
        self._recent: deque[tuple[float, Sample]] = deque()
        self._checked_t = 0.0
        self._warned_at: dict[str, float] = {}
        self._has_shown_noise = False  # a sensor without noise is coarse, and repeats itself at every rest
        self._largest: dict[tuple[str, int, float], float] = {}  # reading so far, by sensor, axis and sign

    def feed(self, t: float, sample: Sample) -> list[str]:
        """Take the next sample, at t s; return a message for each new fault."""
        self._recent.append((t, sample))
        if t - self._checked_t < CHECK_EVERY_S:
            return []
        while self._recent[0][0] < t - STUCK_S - 2.0 * CHECK_EVERY_S:
            self._recent.popleft()
        last_check, self._checked_t = self._checked_t, t
        window = _window(self._recent)
        if len(window) < 8:
            return []
        faults = self._saturated_axes(window, last_check) | self._stuck_channels(window)
        new = [what for what in faults if t - self._warned_at.get(what, -np.inf) >= REPEAT_WARNING_S]
        self._warned_at |= dict.fromkeys(new, t)
        return [faults[what] for what in new]

    def _saturated_axes(self, window: Recording, since: float) -> dict[str, str]:
        """Find axes that reached the end of their range after `since` s. A peak below an earlier one is not clipped."""
        faults: dict[str, str] = {}
        for clip in clips_of(window):
            side = clip.sensor, clip.axis, clip.sign
            is_new = window.t[clip.stop - 1] > since
            if is_new and clip.limit(window) >= self._largest.get(side, 0.0) * (1.0 - TOP_TOLERANCE):
                shown = clip.limit_text(window)
                axis = f"{'xyz'[clip.axis]} axis of the {SENSOR_NAMES[clip.sensor]}"
                faults[f"{axis} clipped"] = (
                    f"the {axis} is at the end of its range ({shown}): move slower and without knocks, or set a larger "
                    "one"
                )
        for name, values in _triads(window):
            for k in range(3):
                for sign in (1.0, -1.0):
                    largest = float((sign * values[:, k]).max())
                    self._largest[name, k, sign] = max(self._largest.get((name, k, sign), 0.0), largest)
        return faults

    def _stuck_channels(self, window: Recording) -> dict[str, str]:
        """Find axes and sensors that are constant while others change."""
        given = dict(_triads(window))
        long_enough = window.t[-1] - window.t[0] >= STUCK_S
        changing = np.any([np.diff(values, axis=0).any(axis=1) for values in given.values()], axis=0).mean()
        self._has_shown_noise |= bool(changing > LIVE_SHARE)
        if long_enough and changing == 0.0:
            if self._has_shown_noise:
                return {"stuck": f"for {STUCK_S:g} s all samples are the same: the sensor is stuck; plug it in again"}
            return {"still": "all samples are the same so far: if that stays so while you move, the sensor is stuck"}
        faults: dict[str, str] = {}
        for name, axis, start, _ in stuck_axes(window):
            what, value = f"{'xyz'[axis]} axis of the {SENSOR_NAMES[name]}", float(given[name][start, axis])
            stuck = f"the {what} is stuck at {value:.4g}, while others change: repair or replace the sensor"
            faults[f"{what} stuck"] = stuck
        now = window.t > window.t[-1] - 2.0 * CHECK_EVERY_S
        gyro_goes_on = window.gyr is not None and _changes(window.gyr[now])
        if gyro_goes_on and not _changes(window.acc[now]) and frozen_rows(window)[now].all():
            faults["acc frozen"] = "the accelerometer repeats itself while the gyro goes on: plug the sensor in again"
        # Above 0.5 m/s2 the hand certainly moves; at rest, a working gyro may repeat its reading.
        if long_enough and np.std(window.acc, axis=0).max() > 0.5:
            if window.gyr is not None and not _changes(window.gyr):
                faults["gyro dead"] = (
                    "the gyro reads the same while the hand moves, so it is dead: repair or replace the sensor"
                )
            if window.mag is not None and not _changes(window.mag[np.isfinite(window.mag[:, 0])]):
                what = "the magnetometer reads the same while the hand moves: it will be left out"
                faults["magnetometer dead"] = what
        return faults


def _window(recent: deque[tuple[float, Sample]]) -> Recording:
    """Make a recording of the samples with an acceleration. If some have a gyro reading, those without are left out."""
    has_gyr = any(sample.gyr for _, sample in recent)
    complete = [(t, sample) for t, sample in recent if sample.acc and (sample.gyr or not has_gyr)]
    return recording_from_samples(np.array([t for t, _ in complete]), [sample for _, sample in complete])


def _changes(values: Array) -> bool:
    return bool(np.diff(values, axis=0).any())


def _triads(window: Recording) -> list[tuple[str, Array]]:
    return [(name, values) for name in SENSOR_NAMES if (values := getattr(window, name)) is not None]
