"""A sensor that has stopped measuring for a while and repeats its last reading.

One with noise gives itself away by that alone. One without, or a coarse one, says the same at any rest; there it must
have been turning, or be elsewhere all at once when it measures again, or have been seen to move on.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from itertools import pairwise
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording, Stop
from pbd.errors import TrackingError
from pbd.pose import Array, lengths
from pbd.tracking.dead import CALM_ROWS, NAMES, noisy
from pbd.tracking.preintegration import integral_of_means
from pbd.tracking.zero_velocity import runs

FROZEN_S, FROZEN_ROWS = 0.050, 3
"""A sensor that repeats itself for longer than this, and so often, has stopped measuring ..."""

REPEATS = 0.01
"""... unless it repeats more than this share of its readings anyway: a coarse one does."""

HELD_S, TURNING, TURNED = 0.2, 0.05, 0.03
"""For so long no hand turns faster than this (rad/s, off what the gyro reads wherever else it repeats itself), and so
far (rad), so steadily that nothing changes. Nor ..."""

LEAP, LEAP_STEPS, ALONE, AFTER_LEAP = {"acc": 0.1, "gyr": 0.05}, 2.5, 3.0, 3
"""... does it set out from a rest with a change from one sample to the next as large as this (m/s2, rad/s; and steps of
a coarse sensor), and so many times as large as the next few."""

EDGE_S, FULL_SPEED, FULL_SHARE = 0.15, 0.1, 0.5
"""A repetition that begins or ends so near a stop's edge makes it suspicious: if the velocity left over (m/s) is as
large as this, and as this share of the largest on the way."""

UNSEEN_S = 0.6
"""s: for so long a hand may set out or arrive before a coarse sensor's reading changes by a step."""

SURE, EVEN_DRIFT, LONGEST_S = 3.0, 0.05, 5.0
"""In sigmas of drift, which is so many m/s per root second; for longer than this from a stop it says nothing."""


def frozen(recording: Recording) -> NDArray[np.bool_]:
    """Rows (n,) at which a sensor repeats itself for too long. (What it repeats may be a rest's: `refuse_freezes`.)"""
    t, same = recording.t, _repeats(recording)
    given = {name: values for name in NAMES if (values := getattr(recording, name)) is not None}
    long = [
        (start, stop) for start, stop in runs(same) if t[stop] - t[start] > FROZEN_S and stop - start >= FROZEN_ROWS
    ]
    dead = _within(long, len(t))
    if long and (same & ~dead[1:]).mean() < REPEATS and noisy(recording.acc[~dead]):
        return dead
    held = [(start, stop) for start, stop in long if t[stop] - t[start] > HELD_S]
    if not held:
        return np.zeros(len(t), dtype=bool)
    floors = {name: max(LEAP[name], LEAP_STEPS * _resolution(values)) for name, values in given.items()}

    repeated = np.flatnonzero(same)
    usual_rate = np.zeros(3) if recording.gyr is None else np.median(recording.gyr[repeated], axis=0)

    def turns(start: int, stop: int) -> bool:
        if recording.gyr is None:
            return False
        usual = usual_rate
        if stop - start > 0.5 * len(repeated):  # at most one does, so that a long recording takes no longer
            elsewhere = repeated[(repeated < start) | (repeated >= stop)]
            usual = np.median(recording.gyr[elsewhere] if len(elsewhere) >= CALM_ROWS else recording.gyr, axis=0)
        rate = float(np.linalg.norm(recording.gyr[start] - usual))
        return rate > TURNING and rate * (t[stop] - t[start]) > TURNED

    def leaps(stop: int) -> bool:
        return any(_leaps(values[stop : stop + 2 + AFTER_LEAP], floors[name]) for name, values in given.items())

    return _within([(start, stop) for start, stop in held if turns(start, stop) or leaps(stop)], len(t))


def refuse_freezes(recording: Recording, v_nav: Array, a_nav: Array, stops: tuple[Stop, ...]) -> None:
    """Refuse a stop at which the sensor began to repeat itself, or still did, while the hand was in full motion.

    Halfway through a move a sensor may read what it reads at rest. If it freezes there, the hand seems to stop dead.

    Args:
        recording: without NaN.
        v_nav: (n, 3) m/s.
        a_nav: (n, 3) m/s2.
        stops: in order.

    Raises:
        TrackingError: where.
    """
    t = recording.t
    held = [(start, stop) for start, stop in runs(_repeats(recording)) if t[stop] - t[start] > HELD_S]
    begins, ends = [start for start, _ in held], [stop for _, stop in held]
    step = _resolution(recording.acc) if held else 0.0
    for before, after in pairwise(stops) if held else ():
        move = slice(before.stop - 1, after.start + 1)
        at_end = any(abs(t[row] - t[after.start]) < EDGE_S for row in _nearest_two(begins, after.start))
        at_begin = any(abs(t[row] - t[before.stop - 1]) < EDGE_S for row in _nearest_two(ends, before.stop - 1))
        if not (at_begin or at_end):
            continue
        speeds = lengths(integral_of_means(t[move], a_nav[move]))
        rounded = float(t[after.start] - t[before.stop - 1]) * step  # what a coarse sensor may leave over
        if speeds[-1] > max(FULL_SPEED, FULL_SHARE * float(speeds.max()), rounded):
            _refuse(t, after.start if at_end else before.stop - 1, float(speeds[-1]))
    speeds_far = np.where(_from_rest(t, stops) > EDGE_S, lengths(v_nav), 0.0) if held else np.zeros(0)
    for start, end in held:
        speed = float(speeds_far[start : end + 1].max())
        if speed > max(0.5 * FULL_SPEED, UNSEEN_S * step):
            _refuse(t, start, speed)
        for row, arriving in ((start, True), (end, False)):
            speed = _full_speed(recording, a_nav, stops, row, arriving, step)
            if speed > 0.0:
                _refuse(t, row, speed)


def _full_speed(
    recording: Recording, a_nav: Array, stops: tuple[Stop, ...], row: int, arriving: bool, step: float
) -> float:
    """How fast, m/s, the hand moves where a repetition begins (arriving) or ends; 0 where it may well stand still.

    In a stop less than EDGE_S of a move may be seen before it, or after: that passes for a jolt. Elsewhere a hand whose
    acceleration changes from sample to sample, and then not at all, has come to rest, or the sensor froze.
    """
    t, acc = recording.t, recording.acc
    k = bisect_right(stops, row, key=lambda stop: stop.start) - 1
    if k >= 0 and row < stops[k].stop:
        far = int(np.searchsorted(t, t[row] - EDGE_S if arriving else t[row] + EDGE_S))
        span = slice(max(far, stops[k].start), row + 1) if arriving else slice(row, min(far + 1, stops[k].stop))
        # A knock is a sample or two, of which little is true.
        knock = float(lengths(a_nav[span]).max() * np.diff(t[span]).max(initial=0.0))
        speed = float(lengths(integral_of_means(t[span], a_nav[span])[-1]))
        return speed if speed - knock > max(FULL_SPEED, EDGE_S * step) else 0.0
    other = k if arriving else k + 1
    if not (0 <= other < len(stops) and 0 < row < len(t) - 1):
        return 0.0
    change = acc[row] - acc[row - 1] if arriving else acc[row + 1] - acc[row]
    if lengths(change) < max(LEAP["acc"], LEAP_STEPS * step):
        return 0.0
    span = slice(stops[k].stop - 1, row + 1) if arriving else slice(row, stops[other].start + 1)
    lasts = float(t[span.stop - 1] - t[span.start])
    if lasts > LONGEST_S:
        return 0.0
    velocity = integral_of_means(t[span], a_nav[span])
    speeds = lengths(velocity if arriving else velocity - velocity[-1])
    speed = float(speeds[-1 if arriving else 0])
    bound = max(FULL_SPEED, FULL_SHARE * float(speeds.max()), lasts * step, SURE * EVEN_DRIFT * sqrt(lasts))
    return speed if speed > bound else 0.0


def _from_rest(t: Array, stops: tuple[Stop, ...]) -> Array:
    """How far each row is from the nearest stop, (n,) s."""
    edges = np.array([t[row] for stop in stops for row in (stop.start, stop.stop - 1)])
    k = np.searchsorted(edges, t)
    after = np.concatenate((edges, [np.inf]))[k] - t
    before = t - np.concatenate(([-np.inf], edges))[k]
    return np.where(k % 2 == 1, 0.0, np.minimum(before, after))


def _refuse(t: Array, row: int, speed: float) -> None:
    raise TrackingError(
        f"the readings repeat around row {row} (t = {t[row]:.2f} s) as in a rest, but the hand was moving at "
        f"{speed:.2f} m/s: the sensor froze during a move; record again",
        row=row,
        t=float(t[row]),
        value=speed,
        bound=FULL_SPEED,
    )


def _nearest_two(rows: list[int], row: int) -> list[int]:
    """Of rows in order the last before another and the first after it."""
    i = bisect_left(rows, row)
    return rows[max(i - 1, 0) : i + 1]


def _repeats(recording: Recording) -> NDArray[np.bool_]:
    """Whether each row says the same as the one before it, at another time, (n - 1,)."""
    given = [values for values in (recording.acc, recording.gyr) if values is not None]
    same: NDArray[np.bool_] = ~np.any([np.diff(values, axis=0).any(axis=1) for values in given], axis=0)
    return same & (np.diff(recording.t) > 0.0)


def _within(spans: list[tuple[int, int]], n: int) -> NDArray[np.bool_]:
    """All rows (n,) of some spans, but the first of each: it was measured."""
    rows = np.zeros(n, dtype=bool)
    for start, stop in spans:
        rows[start + 1 : stop + 1] = True
    return rows


def _leaps(values: Array, floor: float) -> bool:
    """Tell whether (m, 3) is elsewhere all at once after its first row: a hand that sets out changes more and more."""
    changes = lengths(np.diff(values, axis=0))
    return len(changes) > 1 and bool(changes[0] > max(floor, ALONE * changes[1:].max()))


def _resolution(values: Array) -> float:
    """The smallest change of an axis of (n, 3) from row to row."""
    changes = np.abs(np.diff(values, axis=0))
    return float(changes.min(where=changes > 0.0, initial=np.inf))
