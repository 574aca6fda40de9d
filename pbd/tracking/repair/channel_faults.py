"""Find dead channels: a stuck axis, a sensor that never changes or freezes for a while, a dead magnetometer.

The noise of a real sensor changes every reading. A sensor that repeats its reading is dead or frozen. A sensor without
noise (simulated or coarse) is constant at rest too; there the estimated path decides (`refuse_freezes`).
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording
from pbd.data.recording import resolution_of
from pbd.errors import RecordingError, TrackingError, warn
from pbd.pose import Array, lengths
from pbd.tracking.first_rest import STILL_ACC, STILL_GYR
from pbd.tracking.moving_windows import window_moments
from pbd.tracking.repair.clock import SLOWEST_HZ, row_changes
from pbd.tracking.repair.gaps import BRIDGED_S
from pbd.tracking.zero_velocity import runs

SENSOR_NAMES = {"acc": "accelerometer", "gyr": "gyro"}

STUCK_AXIS_S = 1.0
"""Shortest time, s, for which a stuck axis is constant while another axis of the same sensor changes. (The other
sensor's axes do not count: some gyros read 0 on all axes at rest.)"""

LIVE_SHARE = 0.7
"""A working axis changes in at least this share of its rows."""

NOISE_ROWS, ROUNDING = 20, 1e-6
"""Noise is judged in the calmest NOISE_ROWS rows in sequence. A change below ROUNDING (m/s2, rad/s) is rounding."""

REPEATED_ROWS = 3
"""Smallest number of equal rows in sequence that chance does not explain. A sensor with noise is frozen if it repeats a
row this often, and for longer than BRIDGED_S. A flat top of this many samples may be clipped."""

MOVING_SPEED = 0.05
"""Speed of the hand, m/s, above which its sensor's readings can't be constant."""

WITHOUT_FIELD = "and is left out: heading starts at the sensor's own x axis"
"""What is done about a magnetometer that tells nothing."""


def refuse_dead(recording: Recording) -> None:
    """Refuse a recording or a sensor that never changes, a constant norm of the force, or a stuck axis.

    Raises:
        RecordingError: for a stuck axis with its rows.
    """
    t = recording.t
    if not any(np.diff(values, axis=0).any() for values in (recording.acc, recording.gyr) if values is not None):
        raise RecordingError("all rows are the same: the sensor is stuck, or was never read; record again", row=0)
    if recording.gyr is not None and not np.diff(recording.gyr, axis=0).any() and has_noise(recording.acc):
        raise RecordingError(
            "the gyro always reads the same, so it is dead; repair it, or leave out the columns "
            f"{recording.info.source.names('gyr')} if the device gives its own attitude",
            value=recording.gyr[0].tolist(),
        )
    turns = recording.gyr is not None and np.ptp(recording.gyr, axis=0).max() > STILL_GYR
    if turns and not np.diff(recording.acc, axis=0).any():
        raise RecordingError(
            "the accelerometer always reads the same, though the hand turns, so it is dead; repair it",
            value=recording.acc[0].tolist(),
        )
    norms, moves = lengths(recording.acc), np.ptp(recording.acc, axis=0).max() > STILL_ACC
    # Rows divided by their norm and rounded to four decimals; noise and moves change a true norm by more.
    if moves and np.ptp(norms) < 2e-4 * norms.max() and has_noise(recording.acc):
        raise RecordingError(
            f"the accelerometer reads {norms[0]:.4g} in every row, though the hand moves: each row was divided by its "
            "norm; import what the accelerometer itself reads",
            value=float(norms[0]),
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
    """Find axes that don't change for STUCK_AXIS_S or more, while another axis of the same sensor does.

    Yields the sensor (key of SENSOR_NAMES), the axis, and the half-open range of rows.
    """
    # Equal readings before and after a gap say nothing of the time between.
    seen = np.diff(recording.t) <= 1.0 / SLOWEST_HZ
    for name in SENSOR_NAMES:
        values = getattr(recording, name)
        # Noise of a third of a step changes a steady reading within that time; its mean third difference is 1.5 steps.
        step = 0.0 if values is None else 1.5 * resolution_of(values)
        for axis in range(3) if values is not None else ():
            for start, last in runs((values[1:, axis] == values[:-1, axis]) & seen):
                if recording.t[last] - recording.t[start] < STUCK_AXIS_S:
                    continue
                part = values[start : last + 1]
                live = (np.abs(np.diff(part, axis=0)) > ROUNDING).mean(axis=0) >= LIVE_SHARE
                shown = values[:, live], part[:, live]  # within a move no noise may show
                if any(_is_noise(column[:, None], step) for columns in shown for column in columns.T):
                    yield name, axis, start, last + 1


def magnetometer_is_dead(recording: Recording) -> bool:
    """Whether the magnetometer always reads the same although the accelerometer has noise; warns if so."""
    if recording.mag is None or np.diff(recording.mag, axis=0).any():
        return False
    if recording.mag.any() and not has_noise(recording.acc):
        return False
    warn(f"the magnetometer always reads {np.linalg.norm(recording.mag[0]):.4g} {WITHOUT_FIELD}")
    return True


def frozen_rows(recording: Recording, filled: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Rows (n,) in which both sensors, or the accelerometer alone, repeat themselves for too long.

    A sensor without noise is left to `refuse_freezes`. The gyro alone does not count: some read 0 at rest. Rows that
    are `filled` (n,) were interpolated; None: none.
    """
    acc = recording.acc
    clipped = ((acc == acc.max(axis=0)) | (acc == acc.min(axis=0))).all(axis=1)  # all axes at an end of their range
    held: NDArray[np.bool_] = ~np.any(np.diff(acc, axis=0) != 0.0, axis=1) & ~clipped[1:]
    if filled is not None:
        held &= ~(filled[1:] | filled[:-1])
    return _held_too_long(recording, _repeats(recording)) | _held_too_long(recording, held)


def _held_too_long(recording: Recording, same: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows (n,) that repeat the row before, as flags (n - 1,) say, for too long; none if the sensor is coarse."""
    t = recording.t
    rows = np.zeros(len(t), dtype=bool)
    for start, last in runs(same):
        if t[last] - t[start] > BRIDGED_S and last - start >= REPEATED_ROWS:
            rows[start + 1 : last + 1] = True  # the first equal row was measured
    # Where 1 % or more of the readings repeat elsewhere too, the sensor is coarse, not frozen.
    is_fine = rows.any() and (same & ~rows[1:]).mean() < 0.01 and has_noise(recording.acc[~rows])
    return rows & is_fine


def refuse_freezes(recording: Recording, v_nav: Array) -> None:
    """Refuse a sensor that repeats itself while the hand moves, by the path's velocity (n, 3) m/s, zero in stops.

    Halfway through a move a sensor may read what it reads at rest. If it freezes there, the hand seems to stop dead.

    Raises:
        TrackingError: with row and time.
    """
    t, speeds = recording.t, lengths(v_nav)
    for start, last in runs(_repeats(recording)):
        if t[last] - t[start] <= 0.2:  # s: so long a coarse sensor may repeat itself in a move
            continue
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
    """Whether each row repeats the one before it at a later time, (n - 1,)."""
    return ~row_changes(recording.acc, recording.gyr) & (np.diff(recording.t) > 0.0)


def has_noise(acc: Array) -> bool:
    """Whether an accelerometer at rest has noise, judged in the calmest of its rows that change."""
    return _is_noise(acc[1:][(np.abs(np.diff(acc, axis=0)) > ROUNDING).any(axis=1)])


def _is_noise(values: Array, least: float = 0.0) -> bool:
    """Whether the calmest rows of values (n, k) are noise, with a mean third difference of `least`, not motion."""
    if len(values) < NOISE_ROWS:
        return False
    variance, _ = window_moments(values, NOISE_ROWS)
    rows = values[np.argmin(variance) :][:NOISE_ROWS]
    first, third = (float(np.abs(np.diff(rows, n=n, axis=0)).sum()) for n in (1, 3))
    return third > max(2.0 * first, least * len(rows))  # white noise: 3.2 times as large; motion: less
