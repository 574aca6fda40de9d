"""Joins a device's sensors, which sample at their own times and rates, on one clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pbd.frozen_arrays import Frozen, freeze_arrays
from pbd.pose import Array

RATE_TOLERANCE = 0.05
"""There is a warning if the measured rate differs from the nominal one by more than this share."""

MAX_GAP_STEPS = 2.5
"""Longest interpolated gap in usual steps: one lost sample is bridged, two are a gap."""


@dataclass(frozen=True, eq=False)
class Stream(Frozen):
    """One sensor's readings: `t` (n,) s, increasing; `values` (n, 3)."""

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

    def at(self, t: Array) -> Array:
        """Interpolate at times (m,) s -> (m, 3). NaN before the first sample, after the last, and in a gap."""
        if len(self) == 0:
            return np.full((len(t), 3), np.nan)
        usual_s = np.median(np.diff(self.t)) if len(self) > 1 else np.inf
        after = np.clip(np.searchsorted(self.t, t), 0, len(self) - 1)
        before = np.maximum(after - 1, 0)
        known = (self.t[0] <= t) & (t <= self.t[-1])
        known &= (self.t[after] == t) | (self.t[after] - self.t[before] <= MAX_GAP_STEPS * usual_s)
        read = interpolate(t, self.t, self.values)
        read[~known] = np.nan
        return read


def interpolate(t: Array, known_t: Array, values: Array) -> Array:
    """Values (n, k) at times known_t (n,), interpolated linearly at times t (m,): (m, k), with contiguous columns."""
    return np.array([np.interp(t, known_t, column) for column in values.T]).T


def joined(streams: Mapping[str, Stream]) -> tuple[Array, dict[str, Array]]:
    """Join the streams acc, gyr and mag (those that there are) at the gyro's times; without a gyro, at acc's.

    A sample without a known acceleration is left out, so a gap stays a gap. The field is NaN where it is unknown.

    Returns:
        t (n,) s, and each stream's values (n, 3).
    """
    clock = streams.get("gyr", streams["acc"])
    t = clock.t[np.isfinite(streams["acc"].at(clock.t)[:, 0])]
    return t, {name: stream.at(t) for name, stream in streams.items()}


def batched_interval(t: Array) -> float:
    """Mean interval, s, of times (n,) of which several are equal, without gaps; 0: there are fewer than three times."""
    first = np.flatnonzero(np.diff(t) > 0.0) + 1  # of each batch; the very first batch may be cut off
    if len(first) < 2:
        return 0.0
    rows, steps = np.diff(first, append=len(t)), np.diff(t[first])
    largest = np.maximum(rows[:-1], rows[1:])  # of both batches: a time is that of a batch's first or of its last row
    usual = steps < 1.5 * np.median(steps) * np.maximum(largest / np.median(rows), 1.0)
    return float(steps[usual].sum() / rows[:-1][usual].sum()) if usual.any() else 0.0
