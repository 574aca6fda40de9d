"""Straighten arrival times, and coarse time stamps: even times, with gaps where samples were lost.

USB delivers in bursts, phones in batches, and a busy host reads late, but no sample arrives before it was taken. So the
true times lie on a line below the arrivals, one interval per sample. After a lost sample all arrivals stay above that
line by one interval more. If the least delayed samples leave the line slowly, the rate changed, and the times follow.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array

LOST_SHARE = 0.6
"""Smallest delay of a sample, as a share of the interval, that counts as a lost sample before it."""

LONGEST_BURST_S, BURST_BATCHES = 0.5, 4
"""Longest burst of arrivals, s, and in batches if that is longer. A delay that lasts longer means a lost sample."""

WITHIN_BATCH = 0.25
"""Samples that follow each other within this share of the interval arrived in one batch."""

LOSS_SCATTERS = 5.0
"""Smallest rise of the least delay that shows a loss, in usual distances between the least and the second least delay.
If delays are exponential, this distance is the least delay's standard deviation; without a loss, the least delays of
two bursts then differ by more in one of 150 cases."""

LOSSLESS_QUANTILE = 0.1
"""This quantile of the slopes between blocks belongs to blocks without a loss. If every tenth sample is lost, 19 % of
blocks of 16 samples lose none. The median would take a loss in each block for a longer interval."""

FIRST_SPANS = (1, 2, 4, 8)
"""Distances, in blocks, of those that are compared for the first estimate."""

LITTLE_JITTER, STEADY_SHARE = 0.1, 0.9
"""The steps from one batch to the next tell the interval if more than STEADY_SHARE of them deviate by less than
LITTLE_JITTER, a share of the interval between batches."""

MAX_STEP_DEVIATION = 0.2
"""Largest mean distance, in intervals, of a rise of the least delay from whole numbers that counts as losses. Losses
raise it in steps (0), a change of the rate as a ramp (1/4)."""

BLOCK_SAMPLES = 64
"""Samples per block. The line below the arrivals is fitted to the least delayed sample of each block."""

FIRST_BLOCK_SAMPLES = 16
"""Samples per block for the first estimate of the interval: between most blocks and the next no sample is lost."""

FEWEST_BLOCKS = 8
"""Fewest blocks that tell the slope by their least delayed samples."""

LEAST_DRIFT_S, DRIFT_JITTERS = 0.02, 4.0
"""The rate changes only if the least delays of blocks of LONGEST_BURST_S range over this, s, and over this many times
the usual delay. A beat with a USB adapter's frames of 16 ms is smaller."""

WANDER_RATIO = 0.5
"""Largest mean square successive difference of delays that wander, as a share of their variance: where the rate
changes, or samples were taken at uneven times. It is 2 where they are random (J. von Neumann, 1941)."""

MAX_DRIFT = 0.2
"""Largest change of the rate, as a share: an untrimmed oscillator is off by a tenth at most. Where a reading stays for
more than one interval, so that rows are missing, the rate seems to change by more."""


def straighten(arrival: Array, burst_s: float = LONGEST_BURST_S, complete: bool = False) -> tuple[Array, int]:
    """Convert arrival times (n,) s to times (n,) s from 0, as even as the sensor's rate, with gaps at the losses.

    The least delay is sought within `burst_s`, the longest burst, or BURST_BATCHES batches, if that is longer. If
    `complete`, it is known that no sample is lost. Returns the times, and how many samples were lost.
    """
    n, steps = len(arrival), np.diff(arrival)
    # The last sample of each batch; the last batch may be cut off. A backlog is read in several pieces.
    soon = WITHIN_BATCH * steps.sum() / max(n - 1, 1)
    ends = np.flatnonzero(steps > soon)
    follows = np.append(ends, n - 1)[1:]  # the end of the batch after it
    ends = ends[arrival[follows] - arrival[ends] > soon * (follows - ends)]
    if len(ends) < 2:
        return arrival - arrival[:1], 0
    k = np.arange(n, dtype=np.float64)
    # Samples of a batch waited for its last one, so only its delay tells, however long a suspended host slept.
    last = np.append(ends, n - 1)[np.searchsorted(ends, np.arange(n))]
    sizes = np.sort(np.diff(ends, prepend=-1))
    batch = int(sizes[np.searchsorted(np.cumsum(sizes), 0.5 * sizes.sum())])  # that of the median sample
    interval = first_slope(k[ends], arrival[ends], batch)
    lost, drift = np.zeros(n), np.zeros(n)
    for _ in range(6):  # losses are counted anew with the changed rate: five rounds suffice at 10 %
        burst = max(round(burst_s / interval), BURST_BATCHES * batch, 2)
        for _ in range(3):  # a better interval gives a better count of losses, and the reverse
            lost = lost if complete else _lost_before((arrival - drift - k * interval)[last], interval, burst, ends)
            interval = _slope_below((k + lost)[ends], (arrival - drift)[ends], max(BLOCK_SAMPLES // batch, 1))
        drift = _drift((arrival - interval * (k + lost))[last], max(round(LONGEST_BURST_S / interval), burst), interval)
        if not drift.any():
            break
    t = interval * (k + lost) + drift
    return t - t[0], int(lost[-1])


def _drift(delay: Array, block: int, interval: float) -> Array:
    """Return how the least delayed of the delays (n,) s, `interval` s apart, rise and fall slowly, (n,) s; or 0."""
    starts = range(0, len(delay), 2 * block)
    if len(starts) < 6:  # fewer blocks show no change of the rate
        return np.zeros(len(delay))
    rows = np.array([at + int(np.argmin(delay[at : at + block])) for at in starts])
    least = delay[rows]
    usual = np.median(np.array([np.median(delay[at : at + block]) for at in starts]) - least)
    steps, bend = np.diff(least), least - np.polyval(np.polyfit(rows, least, 1), rows)
    far = np.ptp(bend) >= max(LEAST_DRIFT_S, DRIFT_JITTERS * usual)
    slopes = steps / np.diff(rows)
    if not far or (steps**2).mean() > WANDER_RATIO * least.var() or np.abs(slopes).max() > MAX_DRIFT * interval:
        return np.zeros(len(delay))
    last = len(delay) - 1
    ends = least[0] - slopes[0] * rows[0], least[-1] + slopes[-1] * (last - rows[-1])
    return np.asarray(np.interp(np.arange(last + 1), (0, *rows, last), (ends[0], *least, ends[1])))


def _lost_before(delay: Array, interval: float, ahead: int, ends: NDArray[np.intp]) -> Array:
    """Count the samples lost before each sample, (n,), from rises of the delays (n,) s that do not fall again.

    The least delay of the batches within `ahead` samples is compared. It must rise by more than its usual scatter.
    """
    from scipy.ndimage import find_objects, label, minimum_filter1d

    rise = min(max(2, round(0.1 / interval)), ahead)  # in 0.1 s the least delay rises to its full value after a loss
    batches = max(ahead * len(ends) // len(delay), 2)
    # Batches are compared, not samples: the backlog of a stall has many samples, but one delay.
    in_batches = batches + 1  # so many have samples among `ahead`: the last in part
    of_batch = minimum_filter1d(delay[np.append(ends, -1)], in_batches, origin=-(in_batches // 2), mode="nearest")
    least: Array = of_batch[np.searchsorted(ends, np.arange(len(delay)))]
    # Too few samples follow the last ones: among these a loss shows only by a delay that is longer than a burst.
    tail = max(len(least) - ahead, 1)
    steps = np.diff(least[tail - 1 :])
    least[tail:] = least[tail - 1] + np.cumsum(np.where(steps > ahead * interval, steps, 0.0))
    risen = least.copy()
    risen[:rise] -= least[0]
    risen[rise:] -= least[:-rise]
    lost = np.zeros(len(delay))
    whole = delay[ends[: len(ends) // batches * batches]].reshape(-1, batches)
    scatter = float(np.median(np.diff(np.partition(whole, 1, axis=1)[:, :2]))) if len(whole) else 0.0
    for (rows,) in find_objects(label(risen > max(LOST_SHARE * interval, LOSS_SCATTERS * scatter))[0]):
        first = max(rows.start - rise, 0)
        level = np.maximum.accumulate(least[first : rows.stop] - least[first]) / interval
        if level.size <= 4 * rise or np.abs(level - np.rint(level)).mean() < MAX_STEP_DEVIATION:
            lost[first : rows.stop] = np.diff(np.floor(level + 1.0 - LOST_SHARE), prepend=0.0)
    return np.asarray(np.cumsum(lost))


def first_slope(k: Array, arrival: Array, batch: int) -> float:
    """Return the slope of the line below the ends of batches, before losses are counted.

    It is the slope between ends, or between the least delayed ends of blocks, between which no sample was lost. Each
    better estimate shows this for blocks further apart (FIRST_SPANS). If there are few ends, and they jitter, the slope
    is that of their convex hull.

    Args:
        k, arrival: (n,) index of the sample that ends the batch, lost ones not counted; (n,) s.
        batch: usual number of samples in a batch.
    """
    block = max(FIRST_BLOCK_SAMPLES // batch, 1)
    slope = pair_slope(k, arrival, 1)
    off = np.abs(np.diff(arrival) - slope * np.diff(k))
    is_steady = (off < LITTLE_JITTER * slope * batch).mean() > STEADY_SHARE
    if is_steady:
        slope = _slope_without_loss(k, arrival, slope, batch, 1)
    elif len(k) < FEWEST_BLOCKS * block:
        return _slope_of_hull(k, arrival)
    else:
        rows = _least_delayed(k, arrival, pair_slope(k, arrival, block, LOSSLESS_QUANTILE), block)
        slope = pair_slope(k[rows], arrival[rows], 1, LOSSLESS_QUANTILE)
    rows = _least_delayed(k, arrival, slope, block)
    for span in FIRST_SPANS:
        slope = _slope_without_loss(k[rows], arrival[rows], slope, batch, span)
    # Losses lengthen the mean step. It is shorter where some batches have a sample more: a beat with USB frames.
    return min(slope, pair_slope(k, arrival, len(k) // 2)) if is_steady else slope


def _slope_without_loss(k: Array, arrival: Array, slope: float, batch: int, span: int) -> float:
    """Improve the slope by the pairs that are `span` rows apart and between which no sample was lost.

    The loss of one sample shows if a batch is one sample; else the sizes of two batches may differ.
    """
    samples, lasts = k[span:] - k[:-span], arrival[span:] - arrival[:-span]
    whole = np.abs(lasts - slope * samples) < 0.5 * slope * batch
    return float(lasts[whole].sum() / samples[whole].sum()) if whole.any() else slope


def _slope_of_hull(k: Array, arrival: Array) -> float:
    """Return the slope of the line that touches the arrivals from below, in the middle of their convex hull."""
    hull: list[tuple[float, float]] = []
    for x, y in zip(k.tolist(), arrival.tolist(), strict=True):
        while len(hull) > 1 and (y - hull[-1][1]) * (x - hull[-2][0]) <= (y - hull[-2][1]) * (x - hull[-1][0]):
            hull.pop()
        hull.append((x, y))
    middle = 0.5 * (k[0] + k[-1])
    return next((end[1] - begin[1]) / (end[0] - begin[0]) for begin, end in pairwise(hull) if end[0] >= middle)


def _slope_below(k: Array, arrival: Array, block: int) -> float:
    """Return the slope of the line below the arrivals: a robust fit to the least delayed sample of each block."""
    slope = pair_slope(k, arrival, len(k) // 2)
    rows = _least_delayed(k, arrival, slope, block)
    return pair_slope(k[rows], arrival[rows], len(rows) // 2) if len(rows) >= FEWEST_BLOCKS else slope


def _least_delayed(k: Array, arrival: Array, slope: float, block: int) -> list[int]:
    delay = arrival - slope * k
    return [start + int(np.argmin(delay[start : start + block])) for start in range(0, len(delay), block)]


def pair_slope(k: Array, arrival: Array, span: int, quantile: float = 0.5) -> float:
    """Return a quantile of the slopes of the pairs that are `span` rows apart: the median, as in Theil and Sen's."""
    return float(np.quantile((arrival[span:] - arrival[:-span]) / (k[span:] - k[:-span]), quantile))
