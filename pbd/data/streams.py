"""Sensors of one device that sample at times and rates of their own, joined on one clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd.data.freeze import freeze
from pbd.pose import Array

MOST_STEPS = 2.5
"""Longest step, in usual steps, over which a stream is interpolated: one lost sample is bridged, two are a gap."""


@dataclass(frozen=True, eq=False)
class Stream:
    """What one sensor said: `t` (n,) s, increasing; `values` (n, 3)."""

    t: Array
    values: Array

    def __post_init__(self) -> None:
        freeze(self, t=(len(self.t),), values=(len(self.t), 3))

    def __len__(self) -> int:
        return len(self.t)

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
