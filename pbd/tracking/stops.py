"""Find where the hand stands still: both sensors quiet, by the recording's own measure of quiet."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording, Stop
from pbd.pose import Array, quat_inverse, quat_rotate
from pbd.tracking.integration import integrate_move
from pbd.tracking.rest import Rest

WINDOW_S = 0.1
"""Energies are means over this long."""

REST_FACTOR = 10.0
"""Quiet is under this many times the energy at rest ..."""

PEAK_SHARE, PEAK_S = 10.0**-2.2, 1.0
"""... or under this share of the largest energy within this many seconds: the short stops of a foot."""

ACC_FLOOR, GYR_FLOOR = 0.01, 0.003
"""m/s2 and rad/s: a sensor without noise is quiet below these."""

MISCALIBRATION = 0.5
"""m/s2: an accelerometer's bias shows as motion when the sensor rests at another tilt; up to this much is ignored."""

MERGE_S = 0.1
"""Motion shorter than this between two stops is a jolt, not a move."""

BOUNCE_S, BOUNCE_M = 0.3, 0.02
"""A short stop this soon before or after another, and this near, is a sensor being put down or picked up."""

COAST_S = 0.6
"""Only a stop shorter than this may turn out to be a hand that moves on at constant velocity."""


def find_stops(recording: Recording, a_nav: Array, wxyz_nav_sensor: Array, rest: Rest) -> tuple[Stop, ...]:
    """Find all stops, by an angular-rate and specific-force energy detector with thresholds from the recording's rest.

    Args:
        recording: without NaN.
        a_nav: (n, 3) m/s2 motion acceleration.
        wxyz_nav_sensor: (n, 4).
        rest: the quietest second.

    Returns:
        In order; possibly none.
    """
    t = recording.t
    n = max(2, round(WINDOW_S * recording.rate_hz))
    if len(t) < n:
        return ()
    reach = max(1, round(PEAK_S * recording.rate_hz))

    spread, mean = _window_moments(a_nav, n)
    excess = np.maximum(np.linalg.norm(mean, axis=1) - _allowance(wxyz_nav_sensor, rest, n), 0.0) ** 2
    quiet = _quiet(spread + excess, rest.acc_rms**2, ACC_FLOOR, reach)
    if recording.gyr is not None:
        spread, mean = _window_moments(recording.gyr - rest.gyro_bias, n)
        quiet &= _quiet(spread + (mean**2).sum(axis=1), rest.gyr_rms**2, GYR_FLOOR, reach)

    # A sample is still when any window that holds it is quiet: a moving one is in none.
    still = np.zeros(len(t), dtype=bool)
    for offset in range(n):
        still[offset : offset + len(quiet)] |= quiet
    stops = _drop_bounces(_merge(_runs(still), t), t, a_nav)
    return _drop_coasting(stops, t, a_nav)


def _quiet(energy: Array, energy_at_rest: float, floor: float, reach: int) -> NDArray[np.bool_]:
    from scipy.ndimage import maximum_filter1d

    peak = maximum_filter1d(energy, 2 * reach + 1, mode="nearest")
    threshold = np.maximum(max(REST_FACTOR * energy_at_rest, floor**2), PEAK_SHARE * peak)
    quiet: NDArray[np.bool_] = energy < threshold
    return quiet


def _window_moments(values: Array, n: int) -> tuple[Array, Array]:
    """Variance summed over the axes (m,) and mean (m, 3) of each window of n samples."""
    sums = np.cumsum(np.vstack((np.zeros((1, 3)), values)), axis=0)
    squares = np.concatenate(([0.0], np.cumsum((values**2).sum(axis=1))))
    mean = (sums[n:] - sums[:-n]) / n
    variance = (squares[n:] - squares[:-n]) / n - (mean**2).sum(axis=1)
    return np.maximum(variance, 0.0), mean


def _allowance(wxyz_nav_sensor: Array, rest: Rest, n: int) -> Array:
    """Mean acceleration that miscalibration may feign at each window's tilt, m/s2: none at the tilt of the rest."""
    up = quat_rotate(quat_inverse(wxyz_nav_sensor), (0.0, 0.0, 1.0))
    tilted = np.linalg.norm(up - rest.up_sensor, axis=1)[n // 2 :][: len(up) - n + 1]
    allowed: Array = ACC_FLOOR + MISCALIBRATION * tilted
    return allowed


def _runs(still: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Half-open ranges of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], still, [False])).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _merge(runs: list[tuple[int, int]], t: Array) -> list[Stop]:
    merged: list[tuple[int, int]] = []
    for start, stop in runs:
        if merged and t[start] - t[merged[-1][1] - 1] < MERGE_S:
            merged[-1] = (merged[-1][0], stop)
        else:
            merged.append((start, stop))
    return [_stop(start, stop, t) for start, stop in merged]


def _stop(start: int, stop: int, t: Array) -> Stop:
    return Stop(start, stop, float(t[stop - 1] - t[start]))


def _drop_bounces(stops: list[Stop], t: Array, a_nav: Array) -> list[Stop]:
    """Drop the shorter of two stops that belong to one put-down; the move it ends is the longer for it."""
    kept = stops[:1]
    for stop in stops[1:]:
        before = kept[-1]
        move = slice(before.stop - 1, stop.start + 1)
        soon = t[stop.start] - t[before.stop - 1] < BOUNCE_S
        short = min(before.dwell_s, stop.dwell_s) < BOUNCE_S
        if soon and short and np.linalg.norm(integrate_move(t[move], a_nav[move]).p_nav[-1]) < BOUNCE_M:
            kept[-1] = max(before, stop, key=lambda s: s.dwell_s)
        else:
            kept.append(stop)
    return kept


def _drop_coasting(stops: list[Stop], t: Array, a_nav: Array) -> tuple[Stop, ...]:
    """Drop short stops at which the hand moves on: quiet acceleration is not stillness.

    Half-way through a slow, smooth move the acceleration passes zero. Integrated from the stop before to the stop
    after, the velocity there is that of the move; at a true stop it is what drift left. How much drift leaves is
    judged from the closures of all moves of the same recording.
    """
    kept = list(stops)
    while True:
        moves = list(pairwise(kept))
        if len(moves) < 2:
            return tuple(kept)
        errors = [_drift(t, a_nav, before, after) for before, after in moves]
        level = max(0.02, float(np.median(errors)))
        doubtful = [k for k in range(1, len(kept) - 1) if kept[k].dwell_s < COAST_S]
        scores = [_velocity_at(t, a_nav, kept[k - 1], kept[k], kept[k + 1]) / level for k in doubtful]
        if not scores or max(scores) < 1.0:
            return tuple(kept)
        del kept[doubtful[int(np.argmax(scores))]]


def _drift(t: Array, a_nav: Array, before: Stop, after: Stop) -> float:
    """Mean acceleration error of a move, m/s2: the velocity left over at its end by its duration."""
    move = slice(before.stop - 1, after.start + 1)
    closure = integrate_move(t[move], a_nav[move]).closure
    return float(np.linalg.norm(closure) / max(t[after.start] - t[before.stop - 1], 1e-3))


def _velocity_at(t: Array, a_nav: Array, before: Stop, stop: Stop, after: Stop) -> float:
    """Velocity at a stop were it none, in m/s2: divided by the duration over which drift could have built it up."""
    move = slice(before.stop - 1, after.start + 1)
    v_nav = integrate_move(t[move], a_nav[move]).v_nav
    middle = (stop.start + stop.stop) // 2 - move.start
    return float(np.linalg.norm(v_nav[middle]) / max(t[move.stop - 1] - t[move.start], 1e-3))
