"""Dead channels: a stuck axis, a sensor that never changes or freezes for a while, a dead magnetometer.

A real sensor's noise changes every reading. A sensor that repeats the same reading is dead, or froze. A sensor without
noise (simulated or coarse) is constant at rest too: there the path decides.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording, Stop
from pbd.errors import RecordingError, TrackingError, warn
from pbd.pose import Array, lengths
from pbd.tracking.first_rest import STILL_ACC
from pbd.tracking.moving_windows import window_moments
from pbd.tracking.repair.clock import differs
from pbd.tracking.repair.gaps import BRIDGED_S
from pbd.tracking.zero_velocity import edges, runs

SENSOR_NAMES = {"acc": "accelerometer", "gyr": "gyro"}

STUCK_S = 2.0
"""s: an axis that is constant for longer is stuck, if another axis of the same sensor changes. (The other sensor does
not count: some gyros read 0 on all axes at rest.)"""

LIVE_SHARE = 0.7
"""Share of its rows in which a working axis changes, at least."""

NOISE_ROUGHNESS = 2.0
"""Ratio of third to first differences above which readings are noise. White noise has 3.2, smooth motion less."""

NOISE_ROWS, ROUNDING = 20, 1e-6
"""Number of consecutive rows in which noise is looked for; smallest change, m/s2 or rad/s, that is not rounding."""

REPEATED_ROWS = 3
"""So many rows are no chance: a noisy sensor that repeats itself this often, for longer than a gap that can be bridged,
is frozen; a flat top of so many samples may be clipped."""

COARSE_REPEATS = 0.01
"""Share of repeated readings above which a sensor is taken to be coarse, not frozen."""

COARSE_FROZEN_S = 0.2
"""s: where a coarse sensor repeats itself for longer, the path must show a rest."""

STOP_EDGE_S, MOVING_SPEED = 0.15, 0.05
"""s and m/s: a hand that is further than this from all stops and faster than this is moving, so that its sensor can't
read a constant."""


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
            f"axis {'xyz'[axis]} of the {SENSOR_NAMES[name]} is stuck at {value:.4g} from {t[start]:.2f} s "
            f"(row {start}) to {t[stop - 1]:.2f} s, while others change; repair the sensor, or check the columns",
            row=start,
            t=float(t[start]),
            value=value,
        )


def stuck_axes(recording: Recording) -> Iterator[tuple[str, int, int, int]]:
    """Find the axes that don't change for STUCK_S or more while another of the same sensor does.

    Yields:
        Which sensor (of SENSOR_NAMES), which axis, and the half-open range of rows.
    """
    for name in SENSOR_NAMES:
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
    warn(
        f"the magnetometer always reads {np.linalg.norm(recording.mag[0]):.4g} and is left out: heading starts at the "
        "sensor's own x axis"
    )
    return True


def frozen(recording: Recording, filled: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Rows (n,) at which a sensor with noise repeats itself for too long, or its accelerometer alone does.

    A sensor without noise is left to `refuse_freezes`. The gyro alone does not count: some read 0 at rest.

    Args:
        recording: without NaN.
        filled: (n,) rows that were; None: no row was.
    """
    acc = recording.acc
    clipped = ((acc == acc.max(axis=0)) | (acc == acc.min(axis=0))).all(axis=1)  # all axes at an end of the range
    held: NDArray[np.bool_] = ~np.any(np.diff(acc, axis=0) != 0.0, axis=1) & ~clipped[1:]
    if filled is not None:
        held &= ~(filled[1:] | filled[:-1])
    return _too_long(recording, _repeats(recording)) | _too_long(recording, held)


def _too_long(recording: Recording, same: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows (n,) of those that repeat the one before (n - 1,) for too long."""
    t = recording.t
    rows = np.zeros(len(t), dtype=bool)
    for start, last in runs(same):
        if t[last] - t[start] > BRIDGED_S and last - start >= REPEATED_ROWS:
            rows[start + 1 : last + 1] = True  # the first of them was measured
    if rows.any() and (same & ~rows[1:]).mean() < COARSE_REPEATS and noisy(recording.acc[~rows]):
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
    held = [(start, last) for start, last in runs(_repeats(recording)) if t[last] - t[start] > COARSE_FROZEN_S]
    if not held:
        return
    speeds = lengths(v_nav)
    for stop in stops:
        near = slice(*np.searchsorted(t, (t[stop.start] - STOP_EDGE_S, t[stop.stop - 1] + STOP_EDGE_S)))
        speeds[near] = 0.0
    for start, last in held:
        speed = float(speeds[start : last + 1].max())
        if speed > MOVING_SPEED:
            raise TrackingError(
                f"the readings repeat around row {start} (t = {t[start]:.2f} s) as in a rest, but the hand was moving "
                f"at {speed:.2f} m/s: the sensor froze during a move; record again",
                row=start,
                t=float(t[start]),
                value=speed,
                bound=MOVING_SPEED,
            )


def _repeats(recording: Recording) -> NDArray[np.bool_]:
    """Whether each row repeats the one before it, at another time, (n - 1,)."""
    same: NDArray[np.bool_] = ~differs(recording) & (np.diff(recording.t) > 0.0)
    return same


def _alive(column: Array) -> bool:
    """Tell whether an axis (n,) has noise, by the calmest of its rows."""
    return (np.abs(np.diff(column)) > ROUNDING).mean() >= LIVE_SHARE and _is_noise(column[:, None], np.inf)


def noisy(acc: Array) -> bool:
    """Tell whether a sensor at rest has noise, by the calmest of its rows that change."""
    return _is_noise(acc[1:][(np.abs(np.diff(acc, axis=0)) > ROUNDING).any(axis=1)], STILL_ACC**2)


def _is_noise(values: Array, largest: float) -> bool:
    """Tell whether the calmest rows of (n, k), if their variance is below the largest, are no smooth motion."""
    if len(values) < NOISE_ROWS:
        return False
    variance, _ = window_moments(values, NOISE_ROWS)
    calmest = int(np.argmin(variance))
    rows = values[calmest : calmest + NOISE_ROWS]
    first, third = (float(np.abs(np.diff(rows, n=n, axis=0)).sum()) for n in (1, 3))
    return bool(variance[calmest] < largest) and third > NOISE_ROUGHNESS * first
