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

STEADY_ACC = 0.02
"""m/s2: within a stop the mean acceleration is steady to this and three times its noise."""

MISTILT, MISCALIBRATION = 0.1, 0.5
"""m/s2: what a wrong attitude may feign anywhere, and an accelerometer's errors at another tilt than that of the rest.
A short stop with more is none; for as long as COAST_S no hand accelerates steadily."""

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

    spread, mean_nav = _window_moments(a_nav, n)
    _, mean_sensor = _window_moments(recording.acc, n)
    threshold = _threshold(spread + (mean_nav**2).sum(axis=1), rest.acc_rms**2, ACC_FLOOR, reach)
    quiet = spread < threshold
    if recording.gyr is not None:
        gyr_spread, gyr_mean = _window_moments(recording.gyr - rest.gyro_bias, n)
        energy = gyr_spread + (gyr_mean**2).sum(axis=1)
        quiet &= energy < _threshold(energy, rest.gyr_rms**2, GYR_FLOOR, reach)

    tolerance = STEADY_ACC + 3.0 * rest.acc_rms / np.sqrt(n)
    up = _window_moments(quat_rotate(quat_inverse(wxyz_nav_sensor), (0.0, 0.0, 1.0)), n)[1]
    feigned = MISTILT + MISCALIBRATION * np.linalg.norm(up - rest.up_sensor, axis=1)
    for start, stop in _runs(quiet):
        run = slice(start, stop)
        push = _unsteadiness(mean_nav[run], mean_sensor[run])
        if t[stop - 1] - t[start] < COAST_S:
            push += np.maximum(np.linalg.norm(np.median(mean_nav[run], axis=0)) - feigned[run], 0.0)
        quiet[run] &= spread[run] + np.maximum(push - tolerance, 0.0) ** 2 < threshold[run]

    # A sample is still when any window that holds it is quiet: a moving one is in none.
    still = np.zeros(len(t), dtype=bool)
    for offset in range(n):
        still[offset : offset + len(quiet)] |= quiet
    stops = _drop_bounces(_merge(_runs(still), t), t, a_nav)
    return _drop_coasting(stops, t, a_nav)


def _threshold(energy: Array, energy_at_rest: float, floor: float, reach: int) -> Array:
    from scipy.ndimage import maximum_filter1d

    peak = maximum_filter1d(energy, 2 * reach + 1, mode="nearest")
    return np.maximum(max(REST_FACTOR * energy_at_rest, floor**2), PEAK_SHARE * peak)


def _unsteadiness(mean_nav: Array, mean_sensor: Array) -> Array:
    """How far each window's mean is from that of its whole quiet run, (m, 3) and (m, 3) -> (m,) m/s2.

    At rest specific force is steady, whatever the accelerometer's errors. In sensor axes it sways with the hand; in nav
    it creeps while the attitude settles. At rest one of the two is steady; in a slow, smooth move neither is.
    """
    return np.minimum(*(np.linalg.norm(mean - np.median(mean, axis=0), axis=1) for mean in (mean_nav, mean_sensor)))


def _window_moments(values: Array, n: int) -> tuple[Array, Array]:
    """Variance summed over the axes (m,) and mean (m, 3) of each window of n samples."""
    sums = np.cumsum(np.vstack((np.zeros((1, 3)), values)), axis=0)
    squares = np.concatenate(([0.0], np.cumsum((values**2).sum(axis=1))))
    mean = (sums[n:] - sums[:-n]) / n
    variance = (squares[n:] - squares[:-n]) / n - (mean**2).sum(axis=1)
    return np.maximum(variance, 0.0), mean


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
