"""Check time stamps, and space them evenly where they are coarse, jitter or come in batches.

The velocity errs by a stamp's error times the change of acceleration; coarse stamps also suggest a wrong rate and lost
samples. So stamps are replaced by evenly spaced times, unless the samples themselves were taken at uneven times.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording
from pbd.data.one_line_repr import counted
from pbd.data.source_columns import DATES, NO_UNIT, SourceColumns
from pbd.data.streams import RATE_TOLERANCE, batched_interval
from pbd.errors import RecordingError, warn
from pbd.io.numbers import DAY_S
from pbd.pose import Array
from pbd.timestamps.straighten import LONGEST_BURST_S, WITHIN_BATCH, straighten

SLOWEST_HZ, FASTEST_HZ = 4.0, 4000.0
"""Lowest and highest rate of inertial sensors, Hz; another rate means a wrong unit of time. Their ratio is 1000, so
that the interval tells ms, us and ns apart."""

SHORTEST_S = 0.3
"""Shortest recording, s, in which it can be seen whether the hand moves."""

CLOCK_JUMP_S = 60.0
"""Longest time between two samples of one demonstration, s. A longer one is a jump of the clock."""

COARSE_TICK = 0.05
"""Time stamps are coarse if their resolution is at least this share of the sampling interval."""

OFF_BEAT = 0.02
"""Largest deviation of a step from a whole number of intervals, as a share of the interval, and largest share of steps
that deviate by more. Beyond both, stamps are coarse or jitter.
Stamps come in batches if a larger share of the steps than this is below WITHIN_BATCH intervals."""

WANDER_RATIO = 0.5
"""Largest mean square successive difference of the stamps' delays, as a share of their variance, if the samples were
taken at uneven times. It is 2 if the delays are random (J. von Neumann, 1941)."""

FEWEST_STEPS = 3
"""Fewest steps of coarse times, or between batches, that tell the rate: the first and the last may be cut off."""

LATE_SAMPLES = 8
"""Within this many samples the stamps catch up after a late one; of twice as many, one is surely on time. After a lost
sample they never catch up."""

NOMINAL_TOLERANCE = 0.01
"""No sample is lost if the mean rate differs from the nominal one by less than this share."""


def with_clock(recording: Recording) -> Recording:
    """The recording with checked time stamps. Warns if they are replaced, or if the rate is not the nominal one.

    Raises:
        RecordingError: it is too short, or its time runs backwards, jumps, stands still or is not in seconds.
    """
    if len(recording) < 2:
        raise RecordingError(
            f"the recording has {counted(len(recording), 'sample') or '0 samples'}; record at least a second of rest, "
            "then move"
        )
    source, known = recording.info.source, recording.t[np.isfinite(recording.t)]
    if len(known) > 1:  # another unit, before its steps are taken for jumps
        _refuse_slow(float(np.median(np.diff(known))) or batched_interval(known), source)
    _refuse_disorder(recording.t)
    t = steady_clock(recording)
    recording = recording if t is recording.t else replace(recording, t=t)
    step = float(np.median(np.diff(t)))
    if step <= 0.0:
        what = f"most rows carry the same time; {source.must_be_seconds()} that increase, or import it with --rate HZ"
        if (times := len(np.unique(t))) > 1:
            what = f"its {len(t)} rows have only {times} different times, too coarse to tell the rate; import it with "
            what += "--rate HZ, or with finer times"
        raise RecordingError(what)
    if step < 1.0 / FASTEST_HZ:
        days = SLOWEST_HZ < 1.0 / (step * DAY_S) <= FASTEST_HZ
        advice = "the time is likely in days: import the file with --unit t=day" if days else source.must_be_seconds()
        raise RecordingError(
            f"the samples come {step:.3g} s apart, closer than any sensor's; {advice}",
            value=step,
            bound=1.0 / FASTEST_HZ,
        )
    interval = 1.0 / recording.rate_hz
    _refuse_slow(interval, source)
    lasts = float(t[-1] - t[0]) + interval
    if lasts < SHORTEST_S:
        raise RecordingError(
            f"the recording lasts {lasts:.2g} s ({counted(len(t), 'sample')}); record at least a second of rest, then "
            "move",
            value=lasts,
            bound=SHORTEST_S,
        )
    _warn_of_rate(recording)
    return recording


def _refuse_slow(interval: float, source: SourceColumns) -> None:
    """Refuse an interval, s, that is too long for a sensor: the time is in ms, us or ns, or the sensor is slow."""
    if interval * SLOWEST_HZ <= 1.0:
        return
    units = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    likely = [unit for unit, scale in units.items() if SLOWEST_HZ < 1.0 / (interval * scale) <= FASTEST_HZ]
    named = [source.time_unit(unit) for unit in likely or ("ms", "us")]
    advice = f"import the file with {' or '.join(f'--unit t={unit}' for unit in named)}"
    advice += ", or with its --rate HZ if it counts rows" if interval == 1.0 else ""
    faster = f"record faster, {SLOWEST_HZ:g} a second at least"
    if source.at_a_rate:
        advice = f"{source.must_be_seconds()}, or {faster}"
    elif source.time_unit_by == DATES or (source.time_unit_by != NO_UNIT and interval < 1.0):
        advice = faster
    elif interval < 1.0:  # times in whole ms or us would differ by 1 at least
        advice = f"{faster}; if the time is in {named[0]}, {advice}"
    else:
        advice = f"the time is likely in {named[0]}: {advice}" if likely else f"if the time is in ms or us, {advice}"
    raise RecordingError(
        f"the samples come {interval:.3g} s apart; {advice}",
        value=1.0 / interval,
        bound=SLOWEST_HZ,
    )


def steady_clock(recording: Recording) -> Array:
    """Time stamps (n,) s, evenly spaced if they were coarse, in batches or jittered; lost samples stay lost.

    `recording.t` must not run backwards. Warns if it changes the stamps.
    """
    t, nominal_hz = recording.t, recording.info.rate_hz
    new = np.concatenate(([True], (np.diff(t) > 0.0) | row_changes(recording.acc, recording.gyr)))
    stamps = t[new]
    steps = np.diff(stamps)
    if len(stamps) > 4 * LATE_SAMPLES and (steps > WITHIN_BATCH * steps.mean()).sum() >= FEWEST_STEPS:
        interval, in_batches, complete = _sampling_interval(stamps, nominal_hz)
        burst_s = LONGEST_BURST_S if in_batches else 2 * LATE_SAMPLES * interval
        fault = _stamp_fault(stamps, interval)
        if fault and not _is_uneven(stamps, even := straighten(stamps, burst_s, complete)[0]):
            # Rounding errors of coarse stamps average out. Batches of unequal sizes would bias a fit.
            slope, begin = (1.0, np.median(stamps - even)) if in_batches else np.polyfit(even, stamps, 1)
            even = begin + slope * even
            t = even[np.cumsum(new) - 1]
            warn(f"{fault}; evenly spaced times at {1.0 / np.median(np.diff(even)):.4g} Hz are used instead")
    return t


def _warn_of_rate(recording: Recording) -> None:
    """Warn if the samples do not come at the nominal rate."""
    nominal_hz, rate_hz = recording.info.rate_hz, recording.rate_hz
    if nominal_hz is not None and abs(rate_hz / nominal_hz - 1.0) > RATE_TOLERANCE:
        warn(
            f"the sensor is set to {nominal_hz:.4g} Hz, but by the time stamps the samples come at {rate_hz:.4g} Hz; "
            f"if the time stamps are wrong, every distance comes out {(nominal_hz / rate_hz) ** 2:.2f} times its true "
            "value: check the rate"
        )


def _refuse_disorder(t: Array) -> None:
    if not np.isfinite(t).all():
        row = int(np.flatnonzero(~np.isfinite(t))[0])
        raise RecordingError(f"the time of row {row} is not a number; correct or remove that row", row=row)
    steps = np.diff(t)
    for wrong, what in ((steps < 0.0, "runs backwards"), (steps > CLOCK_JUMP_S, "jumps")):
        if wrong.any():
            row = int(np.flatnonzero(wrong)[0])
            raise RecordingError(
                f"time {what} from {t[row]:.3f} s (row {row}) to {t[row + 1]:.3f} s (row {row + 1}); "
                "sort the file, or cut it there",
                row=row + 1,
                value=float(t[row + 1]),
                bound=float(t[row]),
            )


def row_changes(*sensors: Array | None) -> NDArray[np.bool_]:
    """Whether each row of the readings (n, 3) of some sensors differs from the one before it, (n - 1,)."""
    changes = [(values[1:] != values[:-1]).any(axis=1) for values in sensors if values is not None]
    return np.asarray(np.any(changes, axis=0))


def _sampling_interval(t: Array, nominal_hz: float | None) -> tuple[float, bool, bool]:
    """The sampling interval, s, of stamps that may be coarse; whether they come in batches; whether none is lost."""
    mean = float(t[-1] - t[0]) / (len(t) - 1)
    complete = nominal_hz is not None and abs(mean * nominal_hz - 1.0) < NOMINAL_TOLERANCE
    steps = np.diff(t)
    # The samples of a batch may be stamped one after the other. The longest steps, if they are rare, are gaps.
    begins = steps > WITHIN_BATCH * np.sort(steps)[: int((1.0 - OFF_BEAT) * len(steps))].mean()
    batches = np.diff(np.flatnonzero(begins))
    if len(batches) > 1 and batches.mean() > LATE_SAMPLES / 2:
        arrived = t[np.maximum.accumulate(np.arange(len(t)) * np.append(True, begins))]
        return mean if complete else batched_interval(arrived), True, complete
    spans = t[LATE_SAMPLES:] - t[:-LATE_SAMPLES]
    usual = float(np.sort(spans)[len(spans) // 2])  # not the mean of two, which may be far from both
    if complete or usual <= 0.0:
        return mean, False, complete
    return float(spans[np.abs(spans - usual) < 0.5 * usual / LATE_SAMPLES].mean()) / LATE_SAMPLES, False, False


def _stamp_fault(t: Array, interval: float) -> str:
    """Fault, in words, of stamps (n,) s of samples without repetitions; "" if there is none."""
    steps = np.diff(t)
    if (steps < WITHIN_BATCH * interval).mean() > OFF_BEAT:
        return "the time stamps come in batches"
    away = np.abs(steps - interval * np.maximum(np.rint(steps / interval), 1.0))
    if (away > OFF_BEAT * interval).mean() <= OFF_BEAT:
        return ""
    tick = _tick(t)
    how = f"come in steps of {1e3 * tick:.4g} ms" if tick >= COARSE_TICK * interval else "jitter"
    return f"the time stamps {how}"


def _is_uneven(t: Array, even: Array) -> bool:
    """Whether the samples were taken at uneven times, as by a program that polls a sensor between other work.

    Stamps of even samples scatter about even times, each by itself; those of uneven samples wander away from them. The
    last sample of each batch tells, if it is off by more than rounding explains.
    """
    steps = np.diff(t)
    delay = (t - even)[np.flatnonzero(steps > WITHIN_BATCH * steps.mean())]
    return bool((np.diff(delay) ** 2).mean() < WANDER_RATIO * delay.var() > WANDER_RATIO * _tick(t) ** 2)


def _tick(t: Array) -> float:
    """The resolution, s, of stamps (n,) s, in whole us."""
    return 1e-6 * float(np.gcd.reduce(np.rint(1e6 * np.diff(t)).astype(np.int64)))
