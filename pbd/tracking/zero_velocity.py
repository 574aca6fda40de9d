"""Zero-velocity candidates: where the hand may stand still. The smoother then accepts, trims or rejects each.

A sensor at rest shows a constant specific force and no rate of turn. So does one that coasts at constant velocity:
the smoother, which knows the velocity, tells them apart.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array
from pbd.tracking.first_rest import QUIET_ACC, QUIET_GYR, Rest
from pbd.tracking.moving_windows import (
    MEANS,
    calm_variance,
    calmed,
    rows_of_mean,
    squares,
    window_maxima,
    window_sums,
)
from pbd.tracking.noise import Noise

Spans = list[tuple[int, int]]
"""Half-open ranges of rows, in order."""

ENERGY_WINDOW_S = 0.1
"""s: averaging time of the energies. So motion is seen up to this late."""

QUIET_ENERGY = 10.0
"""A window is quiet if its energy is below QUIET_ENERGY times the rest's, or its rms below that of a hand that holds
still."""

LULL_SHARE, LULL_S = 10.0**-1.8, 1.0
"""A foot's stance: where nothing is quiet, the calmest window counts as still of those whose energies are below this
share of a move's within LULL_S s. (FACTS has 10^-2.2 of the largest, impacts and knocks included. Steps of a foot have
impacts of 10^0.3 to 10^0.9 times what lasts as long as a move: the least of that is added.)"""

SHORTEST_MOVE_S, SHORTEST_STOP_S = 0.1, 0.08
"""s: a shorter motion between two stops is a jolt; a shorter stop is none."""


def energies(u: Array, gyr: Array, n: int) -> tuple[Array, Array]:
    """Of each window the variance of specific force and the mean square of rate, of what `calmed` leaves: (m,), (m,).

    Args:
        u: (n, 3) m/s2, specific force in a frame that does not turn with the sensor.
        gyr: (n, 3) rad/s, without bias.
        n: rows of a window, ENERGY_WINDOW_S.
    """
    k = rows_of_mean(n / ENERGY_WINDOW_S)
    shake, n = calm_variance(u, n, k), n - MEANS * (k - 1)
    return shake, window_sums(squares(calmed(gyr, k)), n) / n


def find_candidates(
    t: Array, dt: float, shake: Array, turn: Array, rest: Rest, unseen: Sequence[tuple[int, int]] = ()
) -> Spans:
    """Find where specific force is steady and nothing turns.

    Args:
        t: (n,) s.
        dt: s, the sampling interval.
        shake: (m,) (m/s2)^2, and turn (m,) (rad/s)^2: of `energies`.
        rest: for its noise.
        unseen: last row before and first row after each gap. A gap between two rests is part of them.
    """
    n = len(t) - len(shake) + 1
    limits = quiet_limits(rest)
    quiet = (shake < limits[0]) & (turn < limits[1])
    calm = (energy < LULL_SHARE * _of_moves(energy, n, dt) for energy in (shake, turn))
    lull = quiet | np.logical_and(*calm)
    for before, after in unseen:  # interpolated data show nothing; a gap at an end is refused elsewhere
        if before == 0 or after == len(t) - 1:
            continue
        quiet[max(before + 2 - n, 0) : after] = lull[max(before + 2 - n, 0) : after] = False
    restless = shake / limits[0] + turn / limits[1]
    for start, stop in runs(lull):
        if not quiet[max(start - 2 * n, 0) : stop + 2 * n].any():  # not the edge of a rest
            quiet[start + int(np.argmin(restless[start:stop]))] = True
    # A sample is still when any window that holds it is quiet: a moving one is in none.
    still = window_maxima(np.pad(quiet, n - 1), n)
    return _long_enough(t, _merged(t, runs(still), unseen))


def _of_moves(energy: Array, n: int, dt: float) -> Array:
    """The largest energy (m,) within LULL_S of each window of n rows that is no jolt's: it lasts a move long."""
    reach = max(1, round(LULL_S / dt))
    lasting = min(n + round(SHORTEST_MOVE_S / dt), 2 * reach)  # a jolt is in fewer windows
    least = -window_maxima(-np.pad(energy, reach), lasting)
    return window_maxima(least, 2 * reach + 2 - lasting)


def still_speed(shake: Array, turn: Array, n: int, rest: Rest, noise: Noise) -> Array:
    """Sigma of a zero-velocity update, m/s along each axis, at each of n rows.

    A hand at rest creeps. It trembles, which acceleration above the sensor's noise shows. It turns about a point that
    is beside the sensor.

    Args:
        shake: (m,) (m/s2)^2, and turn (m,) (rad/s)^2: of `energies`.
        n: rows.
        rest: for its noise.
        noise: of a hand.
    """
    before = (n - len(shake) + 1) // 2  # a row stands in the middle of its window
    speed = speed_by_energies(shake, turn, rest, noise)
    return np.pad(speed, (before, n - len(shake) - before), mode="edge")


def speed_by_energies(shake: Array, turn: Array, rest: Rest, noise: Noise) -> Array:
    """The same, m/s (k,), of windows of which `energies` are known."""
    shaken = np.maximum(shake - rest.shake, 0.0) / (2.0 * np.pi * noise.tremor_hz) ** 2
    turned = noise.still_lever**2 * np.maximum(turn - rest.turn, 0.0)
    speed: Array = np.sqrt(noise.still_speed**2 + shaken + turned)
    return speed


def quiet_limits(rest: Rest) -> tuple[float, float]:
    """Energies below which a window is quiet: (m/s2)^2 and (rad/s)^2."""
    return max(QUIET_ENERGY * rest.shake, QUIET_ACC**2), max(QUIET_ENERGY * rest.turn, QUIET_GYR**2)


def slow_parts(t: Array, span: tuple[int, int], slow: NDArray[np.bool_]) -> Spans:
    """The parts of a span in which the hand is slow, by a flag per row (stop - start,)."""
    return _long_enough(t, _merged(t, [(span[0] + i, span[0] + j) for i, j in runs(slow)]))


def trimmed(span: tuple[int, int], slow: NDArray[np.bool_]) -> tuple[int, int]:
    """A span without its fast ends, where the hand sets out or arrives. The whole span if no row is slow."""
    inside = np.flatnonzero(slow)
    return (span[0] + int(inside[0]), span[0] + int(inside[-1]) + 1) if len(inside) > 1 else span


def calm_part(t: Array, span: tuple[int, int], slow: NDArray[np.bool_]) -> tuple[int, int]:
    """A span without its fast ends, of which at most an energy window is left out on either side."""
    start, stop = span
    first, last = trimmed(span, slow)
    within = np.searchsorted(t, (t[start] + ENERGY_WINDOW_S, t[stop - 1] - ENERGY_WINDOW_S))
    calm = min(first, int(within[0])), max(last, int(within[1]) + 1)
    return calm if calm[1] - calm[0] > 1 else span


def lasts(t: Array, span: tuple[int, int]) -> bool:
    """Whether a span is long enough to be a stop."""
    return bool(t[span[1] - 1] - t[span[0]] > SHORTEST_STOP_S - 1e-9)


def runs(flags: NDArray[np.bool_]) -> Spans:
    """Half-open ranges of what is true."""
    return [(start, stop) for start, stop in edges(flags).tolist()]


def edges(flags: NDArray[np.bool_]) -> NDArray[np.intp]:
    """The same as an array, (k, 2)."""
    padded = np.concatenate(([False], flags, [False]))
    return np.flatnonzero(padded[1:] != padded[:-1]).reshape(-1, 2)


def _merged(t: Array, spans: Spans, unseen: Sequence[tuple[int, int]] = ()) -> Spans:
    merged: Spans = []
    for start, stop in spans:
        last = merged[-1][1] - 1 if merged else 0
        if merged and (t[start] - t[last] < SHORTEST_MOVE_S or (last, start) in unseen):
            merged[-1] = (merged[-1][0], stop)
        else:
            merged.append((start, stop))
    return merged


def _long_enough(t: Array, spans: Spans) -> Spans:
    return [span for span in spans if lasts(t, span)]
