"""Repair wild samples and blocks in the wrong order; refuse blocks that came twice.

At a splice the readings jump: the lines through the two rows on either side do not meet. An impact makes a jump too.
But only at a splice do the lines meet once the wild rows are removed, or the two blocks exchanged.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording
from pbd.data.one_line_repr import counted
from pbd.data.recording import DEVICE_CLOCK
from pbd.data.units import UNITS
from pbd.errors import RecordingError, amount, warn
from pbd.pose import Array, lengths
from pbd.tracking.moving_windows import Rows, squares
from pbd.tracking.noise import OUTLIER_SIGMAS
from pbd.tracking.repair.channel_faults import SENSOR_NAMES, has_noise
from pbd.tracking.repair.gaps import bridged

WILD_DISTANCE = {"acc": (30.0, 1), "gyr": (0.3, 3)}
"""Smallest distance (m/s2, rad/s) of a wild row from the line through its neighbours, and the largest number of wild
rows in sequence. A longer run may be real (a tap)."""

KNOCK_LEVER = 0.02
"""Smallest distance, m, of the point about which a knock turns the sensor (a wrist, the other end of what a hand
holds). A knock also pushes the sensor: the accelerometer jumps by at least this times the gyro's jump per interval."""

OUTLIER_RATIO = 25.0
"""Smallest ratio that shows a splice, in three tests. Sound recordings (hands, feet, 40 to 286 Hz) reach 8, 12 and 7.
1. A wild row: its distance, over the largest of noise, motion around it, and the jump that remains without it.
2. An exchange of blocks: the squared jumps before the exchange, over those after it.
3. The same exchange: the squared jumps before it, over those around them. After it, the jumps must not stand out."""

MOTION_AROUND_S = 0.3
"""s: the motion around a row is measured within this time before and after it."""

NOISE_FLOOR = {"acc": 0.04, "gyr": 0.012}
"""Smallest noise that is assumed, m/s2 and rad/s."""

JUMPS_TRIED = 60
"""The ends of packets are looked for among this many of the largest jumps."""

DOUBLED_ROWS = 6
"""Smallest number of different rows in a block that came twice. Fewer equal rows may be chance."""

IRRATIONAL = np.sqrt(np.array([2.0, 3.0, 5.0, 7.0, 11.0, 13.0]))
"""Weights with which hardly any different sums are equal: for six channels, and for DOUBLED_ROWS rows."""


def without_wild(recording: Recording) -> Recording:
    """Interpolate wild samples of accelerometer and gyro; warns if there are any."""
    mended: dict[str, Any] = {}
    found: list[tuple[int, str]] = []
    reach = max(8, round(MOTION_AROUND_S * recording.rate_hz))
    for name, sensor in SENSOR_NAMES.items():
        values = getattr(recording, name)
        if values is None or len(values) < 2 * reach:
            continue
        wild = _wild_rows(values, *WILD_DISTANCE[name], NOISE_FLOOR[name], reach)
        wild = wild[~_knocked(recording, wild, reach)]
        good = np.ones(len(values), dtype=bool)
        good[wild] = False
        mended[name] = bridged(recording.t, values, good)
        found += [(int(row), f"{sensor} {np.abs(values[row]).max():.4g} {next(iter(UNITS[name]))}") for row in wild]
    if not found:
        return recording
    row, what = min(found)
    warn(
        f"{counted(len(found), 'impossible sample')} left out (no hand moves like that); the first is row {row} "
        f"(t = {recording.t[row]:.2f} s): {what}"
    )
    return replace(recording, **mended)


def in_order(recording: Recording) -> Recording:
    """Exchange two blocks that came in the wrong order; warns if there are any. A device's own times tell the order."""
    swapped = None if recording.info.clock == DEVICE_CLOCK else _swapped_blocks(recording)
    if swapped is None:
        return recording
    first, size = swapped
    rows = np.arange(len(recording))
    warn(
        f"rows {first} to {first + size - 1} (from t = {recording.t[first]:.2f} s) came before the "
        f"{amount(size, 'row')} they follow, and are put behind them: packets are sent out of order"
    )
    rows[first : first + 2 * size] = np.roll(rows[first : first + 2 * size], size)
    changes: dict[str, Any] = {name: values[rows] for name, values in recording.channels.items()}
    return replace(recording, **changes)


def refuse_doubled(recording: Recording) -> None:
    """Refuse a recording in which a block of rows came twice, because a program lost its place in a buffer.

    Raises:
        RecordingError: with the rows.
    """
    rows = np.hstack([recording.acc] if recording.gyr is None else [recording.acc, recording.gyr])
    # Rows, or blocks of rows, hardly have equal weighted sums unless they are equal: the weights are irrational.
    sums = rows @ IRRATIONAL[: rows.shape[1]]
    new = np.flatnonzero(np.diff(sums, prepend=np.inf))
    if len(new) < DOUBLED_ROWS:
        return
    sums = sums[new]
    blocks = sum((w * sums[k : len(sums) - DOUBLED_ROWS + 1 + k] for k, w in enumerate(IRRATIONAL)), np.zeros(1))
    if np.diff(np.sort(blocks)).all():  # far faster than the argsort below
        return
    order = np.argsort(blocks, kind="stable")
    same = np.flatnonzero(np.diff(blocks[order]) == 0.0)
    # The readings of a coarse sensor recur. A block that came twice has rows that occur nowhere else.
    _, of_row, rows_alike = np.unique(sums, return_inverse=True, return_counts=True)
    _, of_block, blocks_alike = np.unique(blocks, return_inverse=True, return_counts=True)
    in_block = np.lib.stride_tricks.sliding_window_view(of_row, DOUBLED_ROWS)[order[same]]
    nowhere_else = (rows_alike[in_block] == blocks_alike[of_block[order[same]], None]).all(axis=1)
    first, again = new[order[same[nowhere_else]]], new[order[same[nowhere_else] + 1]]
    # Of ten million sums some are equal by chance, within rounding.
    first, again = np.stack((first, again))[:, (rows[first] == rows[again]).all(axis=1)]
    if len(first) == 0 or not has_noise(recording.acc):
        return
    start = int(first.min())
    far = int(again[np.argmin(first)]) - start
    goes_on = (rows[start : len(rows) - far] == rows[start + far :]).all(axis=1)
    stop = start + int(np.argmin(np.append(goes_on[:far], False))) - 1
    raise RecordingError(
        f"rows {start + far} to {stop + far} (from t = {recording.t[start + far]:.2f} s) repeat rows {start} to "
        f"{stop}: a block came twice, so the times after it are wrong; record again",
        row=start + far,
        t=float(recording.t[start + far]),
    )


def _extrapolate(x: Array, edges: Rows, rows: int = 0) -> tuple[Array, Array]:
    """Extrapolate x (n, k) to the middle of each gap from the two rows before it, and from the two after: (m, k) each.

    A gap leaves out `rows` rows from an edge (m,) on; 0: its middle is half a row before the edge.
    """
    far = 0.5 * (rows + 1)
    before, after = x[edges - 1], x[edges + rows]
    return before + far * (before - x[edges - 2]), after - far * (x[edges + rows + 1] - after)


def _unmet(x: Array, edges: Rows) -> Array:
    """Smallest distance (m,) between the lines of `_extrapolate`, from the row before each edge to the row after it.

    At a splice the lines meet nowhere. Where a move begins or ends abruptly they meet between the two rows.
    """
    before, after = _extrapolate(x, edges)
    gap, bend = after - before, x[edges + 1] - x[edges] - x[edges - 1] + x[edges - 2]
    nearest = np.einsum("ij,ij->i", gap, bend) / np.maximum(squares(bend), np.finfo(float).tiny)
    return lengths(gap - np.clip(nearest, -0.5, 0.5)[:, None] * bend)


def _jumps(x: Array) -> Array:
    """Jumps (n - 3,) between the lines of `_extrapolate` at every edge from 2 to len(x) - 2. Slices copy no rows."""
    before, after = x[1:-2], x[2:-1]
    return lengths(after - 0.5 * (x[3:] - after) - (before + 0.5 * (before - x[:-3])))


def _wild_rows(values: Array, away: float, most: int, least: float, reach: int) -> Rows:
    """Wild rows of (n, 3): at least `away` from the line through their neighbours, at most `most` in sequence.

    `least` is the smallest noise; motion is measured in `reach` rows on either side.
    """
    ends = np.median(values[:5], axis=0), np.median(values[-5:], axis=0)
    x = np.vstack((ends[0], ends[0], values, *[ends[1]] * (most + 1)))  # the first and last rows may be wild too
    edges = np.arange(2, len(x) - most - 1)
    jumps = _jumps(x)[: len(edges)]
    sums = np.concatenate(([0.0], np.cumsum(jumps**2)))
    at = np.flatnonzero(jumps > 0.5 * away)
    low, high = np.maximum(at - reach, 0), np.minimum(at + reach + 1, len(jumps))
    wild, least = [np.zeros(0, dtype=np.intp)], max(least, float(np.median(jumps)))
    for rows in range(1, most + 1):
        before, after = _extrapolate(x, edges[at], rows)
        block = edges[at, None] + np.arange(rows)
        far = np.linalg.norm(x[block] - 0.5 * (before + after)[:, None], axis=2).min(axis=1)
        first, last = np.maximum(at - 1, 0), np.minimum(at + rows + 2, len(jumps))  # the block's own jumps
        around = (sums[first] - sums[low] + sums[high] - sums[last]) / (first - low + high - last)
        usual = np.sqrt(np.maximum(around, least**2))
        alone = far > OUTLIER_RATIO * np.maximum(usual, lengths(after - before))
        wild.append(block[alone & (far > away)].ravel())
    return np.unique(np.concatenate(wild)) - 2


def _knocked(recording: Recording, rows: Rows, reach: int) -> NDArray[np.bool_]:
    """Whether the sensor was knocked at some rows (k,): both its sensors jump, as KNOCK_LEVER says."""
    if recording.gyr is None or len(rows) == 0:
        return np.zeros(len(rows), dtype=bool)
    (push, usual_push), (turn, usual_turn) = (
        _jumps_at(getattr(recording, name), rows, reach, least) for name, least in NOISE_FLOOR.items()
    )
    both = (push > OUTLIER_SIGMAS * usual_push) & (turn > OUTLIER_SIGMAS * usual_turn)
    return np.asarray(both & (push > KNOCK_LEVER * recording.rate_hz * turn))


def _jumps_at(values: Array, rows: Rows, reach: int, least: float) -> tuple[Array, Array]:
    """Largest jump (k,) of readings (n, 3) at some rows, and rms (k,), at least `least`, of those around (`reach`)."""
    jumps = np.pad(_jumps(values), (2 + reach, 1 + reach))
    near = np.lib.stride_tricks.sliding_window_view(jumps, 2 * reach + 1)[rows]
    own = near[:, reach - 1 : reach + 3]  # before the row, after it, and one further to either side
    around = squares(near) - squares(own)
    return own.max(axis=1), np.sqrt(np.maximum(around / (2 * reach - 3), least**2))


def _swapped_blocks(recording: Recording) -> tuple[int, int] | None:
    """First row and size of two blocks of equal size that came in the wrong order; None if there are none."""
    if len(recording) < 6:
        return None
    jumps, sensors = np.zeros(len(recording) - 3), []
    for name, least in NOISE_FLOOR.items():
        values = getattr(recording, name)
        if values is not None:
            gaps = _jumps(values)
            noise = max(least, float(np.median(gaps)))
            jumps += (gaps / noise) ** 2
            sensors.append((values, noise))

    def left_over(earlier: Rows, later: Rows) -> Array:
        ends = [(_extrapolate(x, later + 2)[1], _extrapolate(x, earlier + 2)[0], noise) for x, noise in sensors]
        return np.asarray(sum(squares(after - before) / noise**2 for after, before, noise in ends))

    largest = np.sort(np.argpartition(jumps, -min(JUMPS_TRIED, len(jumps)))[-JUMPS_TRIED:])
    pairs = np.triu_indices(len(largest), 1)
    p, q = largest[pairs[0]], largest[pairs[1]]
    # The three jumps are evenly spaced. The smallest may not be among the largest ones: it is placed by the other two.
    a, b = np.concatenate((p, p, 2 * p - q)), np.concatenate((q, (p + q) // 2, p))
    c = np.concatenate((2 * q - p, q, q))
    longest = 2.0 * recording.rate_hz  # no wireless sensor's packet is longer than 2 s
    fits = (a >= 0) & (c < len(jumps)) & (b - a == c - b) & (b - a <= longest) & (b - a > 1)
    a, b, c = a[fits], b[fits], c[fits]
    if len(a) == 0:
        return None
    three, left = np.array([jumps[a], jumps[b], jumps[c]]), left_over(a, b) + left_over(c, a) + left_over(b, c)
    gain = three.sum(axis=0) / (left + 1.0)
    best = int(np.argmax(gain))
    if gain[best] < OUTLIER_RATIO:
        return None
    at = np.array((a[best], b[best], c[best]))
    away = np.abs(np.subtract.outer(np.arange(len(jumps)), at)).min(axis=1)
    beside = jumps[(away > 2) & (away <= max(8, round(MOTION_AROUND_S * recording.rate_hz)))]
    around = float(beside.sum()) / max(len(beside), 1)
    apart = sum((_unmet(x, at + 2) / noise) ** 2 for x, noise in sensors)
    usual = OUTLIER_RATIO * max(around, 1.0)
    if three[:, best].mean() < OUTLIER_RATIO * around or np.max(apart) < usual or left[best] > 3.0 * usual:
        return None
    return int(a[best]) + 2, int(b[best] - a[best])
