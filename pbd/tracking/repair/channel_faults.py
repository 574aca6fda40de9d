"""Channels that say nothing: a stuck axis, a sensor that never changes or freezes for a while, a dead magnetometer.

A real sensor's noise changes its reading all the time; one that reads the same over and over is dead, or froze. A
sensor without noise (a simulated one), or a coarse one, is constant too while it rests: there the path must tell.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording, Stop
from pbd.errors import PbdWarning, RecordingError, TrackingError
from pbd.pose import Array, lengths
from pbd.tracking.moving_windows import window_moments
from pbd.tracking.rest import STILL_ACC
from pbd.tracking.zero_velocity import edges, runs

NAMES = {"acc": "accelerometer", "gyr": "gyro"}

STUCK_S = 2.0
"""s: an axis that doesn't change for so long is stuck, if another of the same sensor does. (Not of the other sensor:
some gyros say 0 on all axes whenever they take themselves to be at rest.)"""

ALIVE = 0.7
"""An axis that lives changes from row to row in this share of the rows, at least."""

ROUGH = 2.0
"""Third differences of noise are 3.2 times as large as its first ones; those of smooth motion are smaller."""

CALM_ROWS, ROUNDING = 20, 1e-6
"""Noise is looked for in so many rows; changes smaller than this (m/s2, rad/s) are a computer's rounding."""

FROZEN_S, FROZEN_ROWS = 0.050, 3
"""A sensor with noise that repeats itself for longer than this (s), and so often, has stopped measuring ..."""

REPEATS = 0.01
"""... unless it repeats more than this share of its readings anyway: a coarse one does."""

HELD_S = 0.2
"""s: a coarse sensor that repeats itself for longer is held against the path."""

EDGE_S, FULL_SPEED = 0.15, 0.05
"""A hand further than this (s) from all stops that moves faster than this (m/s) reads no constant."""


def refuse_dead(recording: Recording) -> None:
    """Refuse a recording that never changes, a gyro that never does, or an axis of either sensor that is stuck.

    Raises:
        RecordingError: which axis, since when.
    """
    t = recording.t
    if not any(np.diff(values, axis=0).any() for values in (recording.acc, recording.gyr) if values is not None):
        raise RecordingError("all rows are the same: the sensor is stuck, or was never read; record again", row=0)
    if recording.gyr is not None and not np.diff(recording.gyr, axis=0).any() and noisy(recording.acc):
        raise RecordingError(
            "the gyro always reads the same, so it is dead; repair it, or leave out the columns gx, gy, gz if the "
            "device gives its own attitude",
            value=recording.gyr[0].tolist(),
        )
    for name, axis, start, stop in stuck_axes(recording):
        value = float(getattr(recording, name)[start, axis])
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
            spans = edges(values[1:, axis] == values[:-1, axis])
            for start, last in spans[np.diff(recording.t[spans], axis=1)[:, 0] >= STUCK_S].tolist():
                if any(_alive(other) for other in np.delete(values[start : last + 1], axis, axis=1).T):
                    yield name, axis, start, last + 1


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


def frozen(recording: Recording, filled: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Rows (n,) at which a sensor with noise repeats itself for too long, or its accelerometer alone does.

    Of one without noise the path must tell: `refuse_freezes`. Of the gyro alone nothing follows: some say 0 at rest.

    Args:
        recording: without NaN.
        filled: (n,) rows that were; None: no row was.
    """
    held: NDArray[np.bool_] = ~np.any(np.diff(recording.acc, axis=0) != 0.0, axis=1)
    if filled is not None:
        held &= ~(filled[1:] | filled[:-1])
    return _too_long(recording, _repeats(recording)) | _too_long(recording, held)


def _too_long(recording: Recording, same: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Of rows that say the same as the one before, (n - 1,), those (n,) that go on for too long."""
    t = recording.t
    rows = np.zeros(len(t), dtype=bool)
    for start, last in runs(same):
        if t[last] - t[start] > FROZEN_S and last - start >= FROZEN_ROWS:
            rows[start + 1 : last + 1] = True  # the first of them was measured
    if rows.any() and (same & ~rows[1:]).mean() < REPEATS and noisy(recording.acc[~rows]):
        return rows
    return np.zeros(len(t), dtype=bool)


def refuse_freezes(recording: Recording, v_nav: Array, stops: tuple[Stop, ...]) -> None:
    """Refuse a sensor that repeats itself while the hand is in full motion, by the path.

    Halfway through a move a sensor may read what it reads at rest. If it freezes there, the hand seems to stop dead.

    Args:
        recording: without NaN.
        v_nav: (n, 3) m/s.
        stops: in order.

    Raises:
        TrackingError: where.
    """
    t = recording.t
    held = [(start, last) for start, last in runs(_repeats(recording)) if t[last] - t[start] > HELD_S]
    if not held:
        return
    speeds = lengths(v_nav)
    for stop in stops:
        near = slice(*np.searchsorted(t, (t[stop.start] - EDGE_S, t[stop.stop - 1] + EDGE_S)))
        speeds[near] = 0.0
    for start, last in held:
        speed = float(speeds[start : last + 1].max())
        if speed > FULL_SPEED:
            raise TrackingError(
                f"the readings repeat around row {start} (t = {t[start]:.2f} s) as in a rest, but the hand was moving "
                f"at {speed:.2f} m/s: the sensor froze during a move; record again",
                row=start,
                t=float(t[start]),
                value=speed,
                bound=FULL_SPEED,
            )


def _repeats(recording: Recording) -> NDArray[np.bool_]:
    """Whether each row says the same as the one before it, at another time, (n - 1,)."""
    given = [values for values in (recording.acc, recording.gyr) if values is not None]
    same: NDArray[np.bool_] = ~np.any([np.diff(values, axis=0).any(axis=1) for values in given], axis=0)
    return same & (np.diff(recording.t) > 0.0)


def _alive(column: Array) -> bool:
    """Tell whether an axis (n,) has noise, by the calmest of its rows."""
    return (np.abs(np.diff(column)) > ROUNDING).mean() >= ALIVE and _rough(column[:, None], np.inf)


def noisy(acc: Array) -> bool:
    """Tell whether a sensor at rest has noise, by the calmest of its rows that change."""
    return _rough(acc[1:][(np.abs(np.diff(acc, axis=0)) > ROUNDING).any(axis=1)], STILL_ACC**2)


def _rough(values: Array, largest: float) -> bool:
    """Tell whether the calmest rows of (n, k), if their variance is below the largest, are no smooth motion."""
    if len(values) < CALM_ROWS:
        return False
    variance, _ = window_moments(values, CALM_ROWS)
    calmest = int(np.argmin(variance))
    rows = values[calmest : calmest + CALM_ROWS]
    first, third = (float(np.abs(np.diff(rows, n=n, axis=0)).sum()) for n in (1, 3))
    return bool(variance[calmest] < largest) and third > ROUGH * first
