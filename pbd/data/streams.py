"""Joins a device's sensors, which sample at their own times and rates, on one clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pbd.errors import warn
from pbd.frozen_arrays import Frozen, freeze_arrays
from pbd.pose import Array
from pbd.timestamps.even_times import even_times

RATE_TOLERANCE = 0.05
"""Largest difference between measured and nominal rate without a warning, as a share of the nominal one."""


SENSORS = {"acc": "accelerometer", "gyr": "gyro", "mag": "magnetometer"}
"""Channel -> the sensor's name in messages."""


@dataclass(frozen=True, eq=False)
class Stream(Frozen):
    """One sensor's readings: `t` (n,) s, in order; `values` (n, 3)."""

    t: Array
    values: Array

    def __post_init__(self) -> None:
        freeze_arrays(self, t=(len(self.t),), values=(len(self.t), 3))

    def __len__(self) -> int:
        return len(self.t)

    @classmethod
    def of(cls, t: Array, values: Array) -> Stream:
        """Sort readings (n, 3) by their times (n,) s; leave out repeated rows and those with a NaN."""
        known = np.flatnonzero(np.isfinite(t) & np.isfinite(values).all(axis=1))
        rows = known[np.argsort(t[known], kind="stable")]
        t, values = t[rows], values[rows]
        new = np.append(True, (np.diff(t) > 0.0) | (np.diff(values, axis=0) != 0.0).any(axis=1))[: len(t)]
        return cls(t[new], values[new])

    def evenly_spaced(self, name: str) -> Stream:
        """Return the stream without repeated times, which interpolation needs.

        If its stamps jitter or come in batches, its times are replaced by evenly spaced ones, with a warning that calls
        the sensor by its channel's `name`.
        """
        even, fault = even_times(self.t)
        if fault:
            rate_hz = 1.0 / np.median(np.diff(even))
            warn(f"the {SENSORS[name]}'s time stamps {fault}; evenly spaced times at {rate_hz:.4g} Hz are used instead")
        t, first = np.unique(even, return_index=True)
        return Stream(t, self.values[first])

    def at(self, t: Array) -> Array:
        """Interpolate at times (m,) s -> (m, 3). NaN before the first sample, after the last, and in a gap."""
        if len(self) == 0:
            return np.full((len(t), 3), np.nan)
        usual_s = np.median(np.diff(self.t)) if len(self) > 1 else np.inf
        after = np.clip(np.searchsorted(self.t, t), 0, len(self) - 1)
        before = np.maximum(after - 1, 0)
        known = (self.t[0] <= t) & (t <= self.t[-1])
        known &= (self.t[after] == t) | (self.t[after] - self.t[before] <= 2.5 * usual_s)  # bridge one lost sample
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
    streams = {name: stream.evenly_spaced(name) for name, stream in streams.items()}
    clock = streams.get("gyr", streams["acc"])
    t = clock.t[np.isfinite(streams["acc"].at(clock.t)[:, 0])]
    return t, {name: stream.at(t) for name, stream in streams.items()}
