"""Find zero-velocity candidates: where the hand may stand still. The smoother then accepts, trims or rejects each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array
from pbd.tracking.first_rest import QUIET_ACC, QUIET_ENERGY, QUIET_GYR, STILL_ACC, STILL_GYR, Rest
from pbd.tracking.moving_windows import (
    PASSES,
    Spans,
    moving_mean_variance,
    rows_of_mean,
    smoothed,
    squares,
    window_maxima,
    window_sums,
)
from pbd.tracking.noise import Noise
from pbd.tracking.slow_ends import without_slow_ends
from pbd.tracking.white_noise import white_energy

ENERGY_WINDOW_S = 0.1
"""s: length of the windows over which energies are averaged. Motion is seen up to this much late."""

LULL_SHARE, LULL_S = 0.01, 1.0
"""Energy of a lull, such as a foot's stance, as a share of the largest lasting energy within LULL_S (s) before or
after: acceleration and rate are at most a tenth of the move's. (Below 10^-2.6, stances are missed; above 10^-1.4, a
fast hand that turns back seems to rest.)"""

SWAY_GYR = 0.04
"""Largest rms rate of a hand that sways in the air, rad/s: 0.3 degrees rms about each axis, at 0.7 Hz. (With 0.05, a
sensor that is being put down seems to rest in one of the benchmark's recordings.)"""

SHORTEST_MOVE_S = 0.1
"""s: a shorter motion between two stops is a jolt and joins them."""


class Energies(NamedTuple):
    """Variance of specific force, (m/s2)^2, and mean square of rate, (rad/s)^2, in each of m windows.

    Attributes:
        acc, gyr: (m,).
        slow_acc, slow_gyr: (m,), of motion that is slower than tremor.
    """

    acc: Array
    gyr: Array
    slow_acc: Array
    slow_gyr: Array

    def latest(self, beside: int) -> Energies:
        """Energies (scalars) of the last window with `beside` rows after it; of slow motion, of the middle window."""
        middle = len(self.acc) // 2
        last = max(len(self.acc) - 1 - beside, middle)
        return Energies(self.acc[last], self.gyr[last], self.slow_acc[middle], self.slow_gyr[middle])


def energies(u: Array, gyr: Array, n: int) -> Energies:
    """Energies in each window of n rows, which last ENERGY_WINDOW_S.

    Means over such windows, in two passes, hardly show tremor: a quarter of it at 6 Hz, 0.05 at 8 Hz, none at 10 Hz.
    u (l, 3) m/s2 is specific force in a frame that does not turn with the sensor; gyr (l, 3) rad/s is without bias.
    """
    found = []
    for k, passes in ((rows_of_mean(n / ENERGY_WINDOW_S), PASSES), (n, 2)):
        found += [moving_mean_variance(u, n, k, passes), window_sums(squares(smoothed(gyr, k, passes)), n) / n]
    return Energies(*found)


def find_candidates(t: Array, dt: float, energy: Energies, rest: Rest, gaps: Sequence[tuple[int, int]] = ()) -> Spans:
    """Find the spans in which specific force is constant and nothing turns.

    Args:
        t, dt: (n,) s; s, the sampling interval.
        energy, rest: of each window; its energies set the thresholds.
        gaps: last row before and first row after each gap. A gap between two rests is part of them.
    """
    n = len(t) - len(energy.acc) + 1
    limits = quiet_limits(rest)
    quiet, held = _quiet(energy, limits), _held(energy)
    calm = (each < LULL_SHARE * _move_energy(each, n, dt) for each in (energy.acc, energy.gyr))
    lull = quiet | np.logical_and(*calm)
    for before, after in gaps:  # interpolated data show no rest; `refuse_gaps` handles a gap at an end
        if before == 0 or after == len(t) - 1:
            continue
        for flags in (quiet, held, lull):
            flags[max(before + 2 - n, 0) : after] = False
    least, restful = 2 * n, np.zeros_like(quiet)
    for start, stop in runs(quiet):
        restful[start:stop] = stop - start >= least
    # From a rest a hand must be held for 1 s: the beginning of a slow move looks the same, but is shorter.
    for spans, shortest in ((runs(held), least), (runs(held & ~restful), 5 * least)):
        for start, stop in spans:
            if _trembles(int(np.count_nonzero(quiet[start:stop])), stop - start, shortest):
                quiet[start:stop] = True
    restless = energy.acc / limits[0] + energy.gyr / limits[1]
    for start, stop in runs(lull):
        if not quiet[max(start - 2 * n, 0) : stop + 2 * n].any():  # not the edge of a rest
            quiet[start + int(np.argmin(restless[start:stop]))] = True
    # A sample is still if any window that contains it is quiet.
    still = window_maxima(np.pad(quiet, n - 1), n)
    found = _merge_close(t, runs(still), gaps)
    # Acceleration changes most where a smooth move begins and ends. Where it is not loud, only the rate shows the move.
    sharp = window_maxima(np.pad(energy.acc > limits[0], 2 * n - 1), 3 * n)
    return without_slow_ends(t, found, np.sqrt(at_rows(energy.gyr, len(t))), sharp)


def _quiet(energy: Energies, limits: tuple[float, float]) -> Any:
    return (energy.acc < limits[0]) & (energy.gyr < limits[1])


def _held(energy: Energies) -> Any:
    """Whether windows are those of a hand in the air: it sways, and trembles by less than a hand moves.

    A hand trembles at 7 Hz by 0.01 g, and by 0.035 g at most (97 people; Wade et al., Arch Neurol 39:358, 1982).
    """
    sways = (energy.slow_acc < QUIET_ACC**2) & (energy.slow_gyr < SWAY_GYR**2)
    return sways & (energy.acc < STILL_ACC**2) & (energy.gyr < STILL_GYR**2)


def _trembles(quiet: int, held: int, least: int) -> bool:
    """Whether a hand that is held for so many windows, of which some are quiet, trembles.

    In fewer than `least` windows it turns back in a move. Where most are quiet, the others are the ends of moves.
    """
    return held >= least and 2 * quiet < held


class QuietWindows:
    """Says which windows are quiet, one after the other, as `find_candidates` does of a whole recording.

    A tremor that follows a rest without a move between them counts later here, once it has lasted longer than the rest.
    """

    def __init__(self, rest: Rest, least: int) -> None:
        """Begin; a hand must be held still for `least` windows to count as trembling."""
        self._limits, self._least = quiet_limits(rest), least
        self._held = (0, 0)  # quiet windows and all windows since the hand is held

    def take(self, energy: Energies) -> bool:
        """Take the energies (scalars) of the next window; return whether it is quiet."""
        quiet, held = bool(_quiet(energy, self._limits)), bool(_held(energy))
        self._held = held * (self._held[0] + quiet), held * (self._held[1] + 1)
        return quiet or _trembles(*self._held, self._least)


def _move_energy(energy: Array, n: int, dt: float) -> Array:
    """Largest energy (m,) within LULL_S of each window (n rows) that lasts longer than a jolt."""
    reach = round(LULL_S / dt)
    lasting = n + round(SHORTEST_MOVE_S / dt)  # a jolt is in fewer windows
    least = -window_maxima(-np.pad(energy, reach), lasting)
    return window_maxima(least, 2 * reach + 2 - lasting)


def at_rows(of_windows: Array, n: int) -> Array:
    """Values of windows at the n rows that are in their middle."""
    before = (n - len(of_windows) + 1) // 2
    return np.pad(of_windows, (before, n - len(of_windows) - before), mode="edge")


def zero_velocity_sigma(energy: Energies, dt: float, noise: Noise) -> Array:
    """Sigma of zero velocity (m,), m/s per axis, in each window; `dt` is the sampling interval, s.

    A hand at rest creeps, trembles (acceleration above the sensor's noise) and turns about a point beside the sensor
    (rate above the sensor's noise).
    """
    of_acc, of_gyr = (white_energy(density / dt**0.5, 1.0 / dt) for density in (noise.acc_density, noise.gyr_density))
    shaken = np.maximum(energy.acc - of_acc, 0.0) / (2.0 * np.pi * noise.tremor_hz) ** 2
    turned = noise.pivot_scatter**2 * np.maximum(energy.gyr - of_gyr, 0.0)
    return np.sqrt(noise.still_speed**2 + shaken + turned)


def quiet_limits(rest: Rest) -> tuple[float, float]:
    """Energies below which a window is quiet, (m/s2)^2 and (rad/s)^2."""
    return max(QUIET_ENERGY * rest.acc_var, QUIET_ACC**2), max(QUIET_ENERGY * rest.gyr_var, QUIET_GYR**2)


def slow_parts(t: Array, span: tuple[int, int], slow: NDArray[np.bool_]) -> Spans:
    """The parts of a span in which the hand is slow, given a flag for each of its rows; each lasts a whole window."""
    parts = _merge_close(t, [(span[0] + i, span[0] + j) for i, j in runs(slow)])
    return [part for part in parts if lasts(t, part, ENERGY_WINDOW_S)]


def trimmed(span: tuple[int, int], slow: NDArray[np.bool_]) -> tuple[int, int]:
    """A span without fast rows at its ends, where the hand arrives or leaves; unchanged if at most one row is slow."""
    inside = np.flatnonzero(slow)
    return (span[0] + int(inside[0]), span[0] + int(inside[-1]) + 1) if len(inside) > 1 else span


def lasts(t: Array, span: tuple[int, int], least_s: float) -> bool:
    """Whether a span lasts `least_s` or longer. Each of its rows lasts as long as the interval to the next."""
    rows = span[1] - span[0]
    return rows > 1 and bool((t[span[1] - 1] - t[span[0]]) * rows / (rows - 1) > least_s - 1e-9)


def runs(flags: NDArray[np.bool_]) -> Spans:
    """Half-open ranges of rows whose flag is true."""
    edges = np.flatnonzero(np.diff(flags, prepend=False, append=False)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def _merge_close(t: Array, spans: Spans, gaps: Sequence[tuple[int, int]] = ()) -> Spans:
    merged: Spans = []
    for start, stop in spans:
        last = merged[-1][1] - 1 if merged else 0
        if merged and (t[start] - t[last] < SHORTEST_MOVE_S or (last, start) in gaps):
            merged[-1] = (merged[-1][0], stop)
        else:
            merged.append((start, stop))
    return merged
