"""Sensors of one device that sample at times and rates of their own, joined on one clock; and a clock that pauses."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from pbd.data.frozen_arrays import freeze_arrays
from pbd.pose import Array

MOST_STEPS = 2.5
"""Longest step, in usual steps, over which a stream is interpolated: one lost sample is bridged, two are a gap."""


@dataclass(frozen=True, eq=False)
class Stream:
    """What one sensor said: `t` (n,) s, increasing; `values` (n, 3)."""

    t: Array
    values: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, t=(len(self.t),), values=(len(self.t), 3))

    def __len__(self) -> int:
        return len(self.t)

    @classmethod
    def of(cls, t: Array, values: Array) -> Stream:
        """Sort readings (n, 3) by their times (n,) s; leave out repeated times and rows with a NaN."""
        known = np.isfinite(t) & np.isfinite(values).all(axis=1)
        in_order, first = np.unique(t[known], return_index=True)
        return cls(in_order, values[known][first])

    @property
    def usual_step_s(self) -> float:
        """Median interval, s; infinite where there are fewer than two samples."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else np.inf

    def at(self, t: Array, usual_step_s: float | None = None) -> Array:
        """Interpolate at times (m,) s -> (m, 3). NaN before the first sample, after the last, and within a gap.

        Args:
            t: s on the stream's clock.
            usual_step_s: the sensor's interval, where it is known better than from these samples.
        """
        if len(self) == 0:
            return np.full((len(t), 3), np.nan)
        usual = self.usual_step_s if usual_step_s is None else usual_step_s
        after = np.clip(np.searchsorted(self.t, t), 0, len(self) - 1)
        before = np.maximum(after - 1, 0)
        known = (self.t[0] <= t) & (t <= self.t[-1])
        known &= (self.t[after] == t) | (self.t[after] - self.t[before] <= MOST_STEPS * usual)
        read = np.column_stack([np.interp(t, self.t, axis) for axis in self.values.T])
        read[~known] = np.nan
        return read


def joined(acc: Stream, gyr: Stream | None, mag: Stream | None) -> tuple[Array, Array, Array | None, Array | None]:
    """Join streams on the gyro's clock; on the accelerometer's where there is no gyro.

    A sample whose acceleration is unknown is left out, so a gap stays a gap.

    Returns:
        t (n,) s, acc (n, 3), gyr (n, 3) or None, mag (n, 3) or None, NaN where the field is unknown.
    """
    clock = acc if gyr is None else gyr
    at_clock = acc.at(clock.t)
    known = np.isfinite(at_clock[:, 0])
    t = clock.t[known]
    return t, at_clock[known], None if gyr is None else gyr.values[known], None if mag is None else mag.at(t)


@dataclass(frozen=True)
class Moment:
    """The measurement was started (else paused) at `t` s of experiment time, at `system` s of the phone's clock."""

    started: bool
    t: float
    system: float


class Moments:
    """All moments so far. They turn experiment time into time that goes on in pauses and after clearing."""

    def __init__(self) -> None:
        self.known: tuple[Moment, ...] = ()
        self._begun: float | None = None

    def take(self, moments: tuple[Moment, ...]) -> bool:
        """Take the latest answer; return whether the measurement began anew since, so that its time does, too."""
        before, self.known = self.known, moments
        if self._begun is None and moments:
            self._begun = moments[0].system
        return bool(before) and moments[:1] != before[:1]

    @property
    def paused_at(self) -> float:
        """Experiment time, s, of the pause that lasts; infinite while it measures."""
        return self.known[-1].t if self.known and not self.known[-1].started else inf

    def to_elapsed(self, t: Array) -> Array:
        """Experiment time (n,) s -> s since the measurement was first started, pauses counted."""
        starts = [each for each in self.known if each.started]
        if not starts or self._begun is None:
            return t
        late = np.array([each.system - self._begun - each.t for each in starts])
        return t + late[np.maximum(np.searchsorted([each.t for each in starts], t) - 1, 0)]  # type: ignore[no-any-return]
