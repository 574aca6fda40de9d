"""Find where the hand stands still: both sensors quiet, by the recording's own measure of quiet."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import takewhile

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording, Stop
from pbd.pose import Array, lengths, quat_inverse, quat_rotate
from pbd.tracking.integration import integral_of_means, integrate_move
from pbd.tracking.rest import Rest
from pbd.tracking.steady import median, squares, window_sums
from pbd.tracking.zero_velocity import runs as runs

WINDOW_S = 0.1
"""Energies are means over this long."""

REST_FACTOR = 10.0
"""A rest is quiet: under this many times the energy of the recording's first quiet second ..."""

ACC_FLOOR, GYR_FLOOR = 0.08, 0.02
"""... or, rms in m/s2 and rad/s, under what a hand that holds still trembles."""

PEAK_SHARE, PEAK_S = 10.0**-2.2, 1.0
"""Where nothing is that quiet, a short stop has less than this share of the largest energy within so many seconds: a
foot's, say. How long it lasts is doubtful; the hand is taken to stand still over its quietest window only."""

STEADY_ACC = 0.04
"""m/s2: within a stop the mean acceleration is steady to this and three times its noise."""

MISTILT, MISCALIBRATION = 0.1, 0.5
"""m/s2: by how much the mean acceleration of a short stop may differ from that of the nearest long one, for a wrong
attitude, and for an accelerometer's errors where the tilt differs. (For COAST_S no hand accelerates steadily.)"""

MERGE_S = 0.1
"""Motion shorter than this between two stops is a jolt, not a move."""

BOUNCE_S, BOUNCE_M = 0.3, 0.02
"""A short stop this soon before or after another, and this near, is a sensor being put down or picked up."""

COAST_S, SLOW_COAST_S, COASTING_STOPS = 0.6, 1.5, 4
"""Only a stop shorter than this may turn out to be a hand that moves on at constant velocity, one of several in a row;
a single one, in a slow move, lasts longer, up to the second figure. So many in a row are looked at together ..."""

COAST_SPEED, COAST_GAIN, COAST_SHARE = 0.03, 0.3, 0.2
"""... if the velocities left over before and after it are at least this fast (m/s), and this share of all that was
gained and lost on the way; and, by the time it took, less than this share of them is left over without the stop."""

SHOWN_S = 0.2
"""The mean acceleration over a stop this long is as likely the sensor's own as that of a hand that doesn't stop."""


def find_stops(recording: Recording, a_nav: Array, wxyz_nav_sensor: Array, rest: Rest) -> tuple[Stop, ...]:
    """Find all stops, by an angular-rate and specific-force energy detector with thresholds from the recording's rest.

    Args:
        recording: without NaN.
        a_nav: (n, 3) m/s2 motion acceleration.
        wxyz_nav_sensor: (n, 4).
        rest: a quiet second.

    Returns:
        In order; possibly none.
    """
    t = recording.t
    n = max(2, round(WINDOW_S * recording.rate_hz))
    if len(t) < n:
        return ()

    spread, mean_nav = _window_moments(a_nav, n)
    quiet, doubtful, restlessness = _detect(recording, spread, mean_nav, n, rest)

    tolerance = STEADY_ACC + 3.0 * rest.acc_rms / np.sqrt(n)
    mean_up = window_sums(quat_rotate(quat_inverse(wxyz_nav_sensor), (0.0, 0.0, 1.0)), n) / n
    mean_sensor = window_sums(recording.acc, n) / n
    quiet_runs = [_quiet_run(slice(*run), mean_nav, mean_sensor, mean_up) for run in runs(quiet)]
    long = [run for run in quiet_runs if int((run.push < tolerance).sum()) > COAST_S * recording.rate_hz]
    places = [run.rows for run in long]
    for run in quiet_runs:
        push = run.push
        if long:
            nearest = long[_nearest(run.rows, places)]  # of a long one, itself
            off, tilted = np.linalg.norm(run.acc - nearest.acc), np.linalg.norm(run.up - nearest.up)
            push = push + max(float(off - MISTILT - MISCALIBRATION * tilted), 0.0)
        quiet[run.rows] &= push < tolerance
    for start, stop in runs(doubtful):
        if not quiet[max(start - 2 * n, 0) : stop + 2 * n].any():  # not the edge of a rest
            quiet[start + int(np.argmin(restlessness[start:stop]))] = True

    # A sample is still when any window that holds it is quiet: a moving one is in none.
    still = np.zeros(len(t), dtype=bool)
    for offset in range(n):
        still[offset : offset + len(quiet)] |= quiet
    stops = _drop_bounces(_merge(runs(still), t), t, a_nav)
    return _drop_coasting(stops, t, a_nav)


def _detect(
    recording: Recording, spread: Array, mean_nav: Array, n: int, rest: Rest
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Array]:
    """Which windows of n samples are quiet, which may be a short stop, and the energy of each by its threshold, (m,).

    Args:
        recording: for rate and gyro.
        spread: (m,) variance of the motion acceleration within each window.
        mean_nav: (m, 3) its mean.
        n: samples a window.
        rest: for the thresholds.
    """
    energies = [(spread + squares(mean_nav), spread, rest.acc_rms, ACC_FLOOR)]
    if recording.gyr is not None:
        gyr_spread, gyr_mean = _window_moments(recording.gyr - rest.gyro_bias, n)
        energy = gyr_spread + squares(gyr_mean)
        energies.append((energy, energy, rest.gyr_rms, GYR_FLOOR))
    reach = max(1, round(PEAK_S * recording.rate_hz))
    quiet = np.ones(len(spread), dtype=bool)
    doubtful, restlessness = quiet.copy(), np.zeros(len(spread))
    for energy, unsteady, rms_at_rest, floor in energies:
        threshold = max(REST_FACTOR * rms_at_rest**2, floor**2)
        quiet &= unsteady < threshold
        doubtful &= energy < PEAK_SHARE * _peak(energy, reach)
        restlessness += energy / threshold
    return quiet, doubtful, restlessness


def _peak(energy: Array, reach: int) -> Array:
    from scipy.ndimage import maximum_filter1d

    peak: Array = maximum_filter1d(energy, 2 * reach + 1, mode="nearest")
    return peak


@dataclass(frozen=True, eq=False)
class _QuietRun:
    """A run of quiet windows.

    Attributes:
        rows: which.
        acc: (3,) m/s2, the median of their mean accelerations in nav.
        up: (3,) that of the vertical in sensor axes.
        push: (m,) m/s2, how far each window's mean is from that of the whole run. At rest specific force is steady,
            whatever the accelerometer's errors: in sensor axes it sways with the hand, in nav it creeps while the
            attitude settles, but one of the two is steady. In a slow, smooth move neither is.
    """

    rows: slice
    acc: Array
    up: Array
    push: Array


def _quiet_run(rows: slice, mean_nav: Array, mean_sensor: Array, mean_up: Array) -> _QuietRun:
    nav, sensor, up = (median(means[rows]) for means in (mean_nav, mean_sensor, mean_up))
    pushes = squares(mean_nav[rows] - nav), squares(mean_sensor[rows] - sensor)
    return _QuietRun(rows, nav, up, np.sqrt(np.minimum(*pushes)))


def _nearest(run: slice, long: Sequence[slice]) -> int:
    """Which of the long runs, in order and apart from each other and from this one, is nearest; of two, the earlier."""
    after = bisect_left(long, run.start, key=lambda other: other.start)
    beside = range(max(after - 1, 0), min(after + 1, len(long)))
    return min(beside, key=lambda k: max(long[k].start - run.stop, run.start - long[k].stop))


def _window_moments(values: Array, n: int) -> tuple[Array, Array]:
    """Variance summed over the axes (m,) and mean (m, 3) of each window of n samples."""
    mean = window_sums(values, n) / n
    variance = window_sums(squares(values), n) / n - squares(mean)
    return np.maximum(variance, 0.0), mean


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

    Half-way through a smooth move the acceleration passes zero. Were the hand taken to stand still there, the velocity
    left over before it would be the hand's own, and that left over after it the same the other way round: without that
    stop nothing is left over. Drift has no reason to do that, less what the sensor shows at rest.
    """

    @cache
    def shown(stop: Stop) -> Array:
        """Acceleration at a stop: the sensor's own, and gravity put wrong by tilt."""
        mean: Array = a_nav[stop.start : stop.stop].mean(axis=0)
        return mean

    def left_over(before: Stop, after: Stop, off: Array) -> tuple[float, float, float]:
        """Speed at the second stop by what is felt since the first, but for `off`; all that was gained and lost on the
        way, m/s; and how long that took."""
        move = slice(before.stop - 1, after.start + 1)
        duration, a = float(t[after.start] - t[before.stop - 1]), a_nav[move] - off
        return float(np.linalg.norm(integral_of_means(t[move], a)[-1])), float(lengths(a).mean()) * duration, duration

    def none_between(stops: list[Stop]) -> bool:
        """Tell whether the hand stands still at the first and the last of these stops only."""
        first, last = stops[0], stops[-1]
        off = 0.5 * (shown(first) + shown(last))

        def doubtful(stop: Stop) -> Array:
            own: Array = off + stop.dwell_s / (stop.dwell_s + SHOWN_S) * (shown(stop) - off)
            return own

        there = left_over(first, stops[1], 0.5 * (shown(first) + doubtful(stops[1])))
        back = left_over(stops[-2], last, 0.5 * (doubtful(stops[-2]) + shown(last)))
        if any(speed <= max(COAST_SPEED, COAST_GAIN * gained) for speed, gained, _ in (there, back)):
            return False
        rates = [speed / duration for speed, _, duration in (there, back, left_over(first, last, off))]
        return rates[2] < COAST_SHARE * min(rates[:2])

    kept = list(stops)
    k = 1
    while k < len(kept) - 1:
        # One stop that is none, or several in a row, as while the hand coasts.
        ends = range(k + 1, min(k + 1 + COASTING_STOPS, len(kept)))
        coasting = takewhile(lambda end: kept[end - 1].dwell_s < COAST_S, ends)
        end = next((end for end in coasting if none_between(kept[k - 1 : end + 1])), None)
        if end is None:
            k += 1
        else:
            del kept[k:end]
    # Of two long ones beside each other the shorter is none.
    for stop in sorted(kept[1:-1], key=lambda stop: stop.dwell_s):
        k = bisect_left(kept, stop.start, key=lambda other: other.start)
        if stop.dwell_s < SLOW_COAST_S and 0 < k < len(kept) - 1 and none_between(kept[k - 1 : k + 2]):
            del kept[k]
    return tuple(kept)
