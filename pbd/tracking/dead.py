"""Channels that say nothing: an axis that is stuck, a sensor that never changes, a magnetometer that isn't there.

A real sensor's noise changes its reading all the time; one that reads the same over and over, while the others go on,
is dead. A sensor without noise (a simulated one) is constant too while it rests, and is nothing of the kind.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np

from pbd.data import Recording
from pbd.errors import PbdWarning, RecordingError
from pbd.pose import Array
from pbd.tracking.rest import STILL_ACC
from pbd.tracking.steady import window_moments

NAMES = {"acc": "accelerometer", "gyr": "gyro"}

STUCK_S = 2.0
"""An axis that doesn't change for so long is stuck, if another of the same sensor does. (Not of the other sensor: some
gyros say 0 on all axes whenever they take themselves to be at rest.)"""

ALIVE = 0.7
"""An axis that lives changes from row to row in this share of the rows, at least."""

ROUGH = 2.0
"""Third differences of noise are 3.2 times as large as its first ones; those of smooth motion are smaller."""

CALM_ROWS, ROUNDING = 20, 1e-6
"""Noise is looked for in so many rows; changes smaller than this (m/s2, rad/s) are a computer's rounding."""


def refuse_dead(recording: Recording) -> None:
    """Refuse a recording that never changes, a gyro that never does, or an axis of either sensor that is stuck.

    Raises:
        RecordingError: which axis, since when.
    """
    t = recording.t
    given = {name: values for name in NAMES if (values := getattr(recording, name)) is not None}
    if not any(np.diff(values, axis=0).any() for values in given.values()):
        raise RecordingError("all rows are the same: the sensor is stuck, or was never read; record again", row=0)
    if recording.gyr is not None and not np.diff(recording.gyr, axis=0).any() and noisy(recording.acc):
        raise RecordingError(
            "the gyro always reads the same, so it is dead; repair it, or leave out the columns gx, gy, gz if the "
            "device "
            "gives its own attitude",
            value=recording.gyr[0].tolist(),
        )
    for name, axis, start, stop in stuck_axes(recording):
        value = float(given[name][start, axis])
        raise RecordingError(
            f"axis {'xyz'[axis]} of the {NAMES[name]} is stuck at {value:.4g} from {t[start]:.2f} s (row {start}) to "
            f"{t[stop - 1]:.2f} s, while others change; repair the sensor, or check the columns",
            row=start,
            t=float(t[start]),
            value=value,
        )


def stuck_axes(recording: Recording) -> Iterator[tuple[str, int, int, int]]:
    """Find the axes that don't change for STUCK_S or more while another of the same sensor does.

    Yields:
        Which sensor (of NAMES), which axis, and the half-open range of rows.
    """
    for name in NAMES:
        values = getattr(recording, name)
        for axis in range(3) if values is not None else ():
            for start, stop in _constant(recording.t, values[:, axis]):
                if any(_alive(other) for other in np.delete(values[start:stop], axis, axis=1).T):
                    yield name, axis, start, stop


def _constant(t: Array, column: Array) -> list[tuple[int, int]]:
    """Half-open ranges of STUCK_S and more in which a column (n,) doesn't change."""
    edges = np.concatenate(([0], np.flatnonzero(np.diff(column)) + 1, [len(t)]))
    start, stop = edges[:-1], edges[1:]
    long = t[stop - 1] - t[start] >= STUCK_S
    return list(zip(start[long].tolist(), stop[long].tolist(), strict=True))


def magnetometer_is_dead(recording: Recording) -> bool:
    """Tell whether the magnetometer always reads the same, though the sensor has noise; warns."""
    if recording.mag is None or np.diff(recording.mag, axis=0).any():
        return False
    if recording.mag.any() and not noisy(recording.acc):
        return False
    warnings.warn(
        f"the magnetometer always reads {np.linalg.norm(recording.mag[0]):.4g} and is left out: heading starts at the "
        "sensor's own x axis",
        PbdWarning,
        stacklevel=3,
    )
    return True


def _alive(column: Array) -> bool:
    """Tell whether an axis (n,) has noise, by the calmest of its rows."""
    if len(column) < CALM_ROWS or (np.abs(np.diff(column)) > ROUNDING).mean() < ALIVE:
        return False
    variance, _ = window_moments(column[:, None], CALM_ROWS)
    calmest = int(np.argmin(variance))
    return _roughness(column[calmest : calmest + CALM_ROWS]) > ROUGH


def _roughness(values: Array) -> float:
    """How much rougher than smooth motion: third against first differences, of (n,) or (n, 3)."""
    first = np.abs(np.diff(values, axis=0)).sum()
    return float(np.abs(np.diff(values, n=3, axis=0)).sum() / first) if first > 0.0 else 0.0


def noisy(acc: Array) -> bool:
    """Tell whether a sensor at rest has noise, by the calmest of its rows that change."""
    changing = acc[1:][(np.abs(np.diff(acc, axis=0)) > ROUNDING).any(axis=1)]
    if len(changing) < CALM_ROWS:
        return False
    variance, _ = window_moments(changing, CALM_ROWS)
    calmest = int(np.argmin(variance))
    return bool(variance[calmest] < STILL_ACC**2 and _roughness(changing[calmest : calmest + CALM_ROWS]) > ROUGH)
