"""Evenly spaced times instead of stamps that are coarse, jitter or come in batches.

The velocity errs by a stamp's error times the change of acceleration; coarse stamps also suggest a wrong rate and lost
samples. So they are replaced, unless the samples themselves were taken at uneven times.
"""

import numpy as np

from pbd.pose import Array
from pbd.timestamps.straighten import LONGEST_BURST_S, WANDER_RATIO, WITHIN_BATCH, straighten

OFF_GRID_SHARE = 0.02
"""A step is off the grid if it differs from a whole number of intervals by more than this share of the interval. Stamps
are coarse or jitter if more than this share of the steps are off the grid. They come in batches if more than this share
of the steps are below WITHIN_BATCH intervals."""

WANDER_RATIO_OF_FEW, FEW_DELAYS = 1.0, 80
"""WANDER_RATIO of fewer than FEW_DELAYS: by simulation, of 40 delays that wander it is above 0.5 in a third of cases,
and above 1 in one of 20."""

FEWEST_STEPS = 3
"""Fewest steps of coarse times, or between batches, that tell the rate. The first and the last may be cut off."""

LATE_SAMPLES = 8
"""Within this many samples, the stamps catch up after a late one; after a lost sample they never do. Of twice as many
samples, one is surely on time."""


def even_times(t: Array, nominal_hz: float | None = None) -> tuple[Array, str]:
    """Evenly spaced times (n,) s for stamps (n,) s of different samples; lost samples stay lost.

    The stamps must not run backwards; `nominal_hz` is the sensor's rate, if it is known.

    Returns:
        The times, and the fault of the stamps: "jitter", "come in batches", or "come in steps of ... ms"; "" if they
        are kept as they are.
    """
    steps = np.diff(t)
    if len(t) <= 4 * LATE_SAMPLES or (steps > WITHIN_BATCH * steps.mean()).sum() < FEWEST_STEPS:
        return t, ""
    interval, in_batches, complete = _sampling_interval(t, nominal_hz)
    if not (fault := _stamp_fault(t, interval)):
        return t, ""
    even, _ = straighten(t, LONGEST_BURST_S if in_batches else 2 * LATE_SAMPLES * interval, complete)
    if _is_uneven(t, even):
        return t, ""
    # Rounding errors of coarse stamps average out. Batches of unequal sizes would bias a fit.
    slope, begin = (1.0, np.median(t - even)) if in_batches else np.polyfit(even, t, 1)
    return begin + slope * even, fault


def _sampling_interval(t: Array, nominal_hz: float | None) -> tuple[float, bool, bool]:
    """The sampling interval, s, of stamps that may be coarse; whether they come in batches; whether none is lost."""
    mean = float(t[-1] - t[0]) / (len(t) - 1)
    complete = nominal_hz is not None and abs(mean * nominal_hz - 1.0) < 0.01  # so near: none is lost
    steps = np.diff(t)
    # The samples of a batch may be stamped one after the other. The longest steps, if they are rare, are gaps.
    begins = steps > WITHIN_BATCH * np.sort(steps)[: int((1.0 - OFF_GRID_SHARE) * len(steps))].mean()
    batches = np.diff(np.flatnonzero(begins))
    if batches.mean() > LATE_SAMPLES / 2:
        arrived = t[np.maximum.accumulate(np.arange(len(t)) * np.append(True, begins))]
        return mean if complete else batched_interval(arrived), True, complete
    spans = t[LATE_SAMPLES:] - t[:-LATE_SAMPLES]
    usual = float(np.sort(spans)[len(spans) // 2])  # not the mean of two, which may be far from both
    if complete or usual <= 0.0:
        return mean, False, complete
    return float(spans[np.abs(spans - usual) < 0.5 * usual / LATE_SAMPLES].mean()) / LATE_SAMPLES, False, False


def _stamp_fault(t: Array, interval: float) -> str:
    """The fault of stamps (n,) s, as `even_times` returns it; "" if there is none."""
    steps = np.diff(t)
    if (steps < WITHIN_BATCH * interval).mean() > OFF_GRID_SHARE:
        return "come in batches"
    away = np.abs(steps - interval * np.rint(steps / interval))
    if (away > OFF_GRID_SHARE * interval).sum() < max(OFF_GRID_SHARE * len(steps), FEWEST_STEPS):
        return ""
    tick = _tick(t)
    explained = (away > tick).mean() <= OFF_GRID_SHARE
    return f"come in steps of {1e3 * tick:.4g} ms" if explained else "jitter"


def _is_uneven(t: Array, even: Array) -> bool:
    """Whether the samples were taken at uneven times, as by a program that polls a sensor between other work.

    The stamps of even samples scatter about even times, each by itself. Those of uneven samples wander away from them.
    Only the last sample of each batch is looked at, and only deviations that rounding does not explain count.
    """
    steps = np.diff(t)
    delay = (t - even)[np.flatnonzero(steps > WITHIN_BATCH * steps.mean())]
    ratio = WANDER_RATIO if len(delay) >= FEW_DELAYS else WANDER_RATIO_OF_FEW
    return bool((np.diff(delay) ** 2).mean() < ratio * delay.var() and delay.var() > _tick(t) ** 2)


def _tick(t: Array) -> float:
    """The resolution, s, of stamps (n,) s, in whole us."""
    return 1e-6 * float(np.gcd.reduce(np.rint(1e6 * np.diff(t)).astype(np.int64)))


def batched_interval(t: Array) -> float:
    """Mean interval, s, of the rows of times (n,) s that come in equal groups, gaps left out; 0 if there are fewer than
    three different times."""
    first = np.flatnonzero(np.diff(t) > 0.0) + 1  # of each batch; the very first batch may be cut off
    if len(first) < 2:
        return 0.0
    rows, steps = np.diff(first, append=len(t)), np.diff(t[first])
    # If a batch has the time of its last row, a large batch follows a long step. If it has the time of its first row,
    # the long step comes after it; then that step is left out, with the batch's rows.
    usual = steps < 1.5 * np.median(steps) * np.maximum(rows[1:] / np.median(rows), 1.0)
    return float(steps[usual].sum() / rows[:-1][usual].sum()) if usual.any() else 0.0
