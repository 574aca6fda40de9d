"""Check time stamps, and space them evenly where they are coarse, jitter or come in batches."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording
from pbd.data.one_line_repr import counted
from pbd.data.source_columns import DATES, NO_UNIT, SourceColumns
from pbd.data.streams import RATE_TOLERANCE, interpolate
from pbd.data.units import UNITS
from pbd.errors import RecordingError, warn
from pbd.pose import Array
from pbd.timestamps.even_times import LATE_SAMPLES, OFF_GRID_SHARE, batched_interval, even_times

SLOWEST_HZ, FASTEST_HZ = 4.0, 4000.0
"""Lowest and highest rate of inertial sensors, Hz; another rate means a wrong unit of time. Their ratio is 1000, so
that the interval tells ms, us and ns apart."""

SHORTEST_S = 0.3
"""Shortest recording, s, in which it can be seen whether the hand moves."""

CLOCK_JUMP_S = 60.0
"""Longest time between two samples of one demonstration, s. A longer one is a jump of the clock."""


def with_checked_times(recording: Recording) -> Recording:
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
    t = even_stamps(recording)
    recording = _without_rereads(recording if t is recording.t else replace(recording, t=t))
    step = float(np.median(np.diff(t)))
    if step <= 0.0:
        what = f"most rows carry the same time; {source.time_advice()} that increase, or import it with --rate HZ"
        if (times := len(np.unique(t))) > 1:
            what = f"its {len(t)} rows have only {times} different times, too coarse to tell the rate; import it with "
            what += "--rate HZ, or with finer times"
        raise RecordingError(what)
    if step < 1.0 / FASTEST_HZ:
        raise RecordingError(
            f"the samples come {step:.3g} s apart, closer than any sensor's; {_longer_unit(step, source)}",
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


def _longer_unit(step: float, source: SourceColumns) -> str:
    """Say what to do about samples that come `step` s apart, too soon for a sensor: the time is in a longer unit."""
    rates = {unit: source.time_factor / (UNITS["t"][unit] * step) for unit in ("0.1ms", "ms", "s", "day")}
    likely = [unit for unit, rate in rates.items() if SLOWEST_HZ < rate <= FASTEST_HZ]
    if not likely or source.has_no_times or source.time_unit_by == DATES:
        return source.time_advice()
    options = " or ".join(f"--unit t={unit}" for unit in likely)
    return f"the time is likely in {' or '.join(likely).replace('day', 'days')}: import the file with {options}"


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
    if source.has_no_times:
        advice = f"{source.time_advice()}, or {faster}"
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


def even_stamps(recording: Recording) -> Array:
    """Time stamps (n,) s, evenly spaced if they were coarse, in batches or jittered; lost samples stay lost.

    `recording.t` must not run backwards. Warns if it changes the stamps.
    """
    t = recording.t
    new = np.concatenate(([True], (np.diff(t) > 0.0) | row_changes(recording.acc, recording.gyr)))
    even, fault = even_times(t[new], recording.info.rate_hz)
    if fault:
        t = even[np.cumsum(new) - 1]
        warn(replaced_stamps_message(fault, even))
    return t


def replaced_stamps_message(fault: str, even: Array) -> str:
    """The warning that stamps with this fault are replaced by evenly spaced times (n,) s."""
    return f"the time stamps {fault}; evenly spaced times at {1.0 / np.median(np.diff(even)):.4g} Hz are used instead"


def _without_rereads(recording: Recording) -> Recording:
    """Interpolate between the samples if a program read some of them twice. Warns of it.

    If it read all of them equally often, they are as evenly spaced as the rows, and stay as they are.
    """
    t, changed = recording.t, np.append(True, row_changes(recording.acc, recording.gyr))
    new = _new_samples(t, changed)
    reread = ~new & (np.diff(t, prepend=-np.inf) > 0.0)
    taken, fault = (t, "") if reread.mean() <= OFF_GRID_SHARE else even_times(t[new])
    if not fault:
        return recording
    warn(
        f"{reread.mean():.0%} of the rows repeat the sample before, as the sensor gives only "
        f"{1.0 / np.median(np.diff(taken)):.4g} a second; they are interpolated"
    )
    channels: dict[str, Any] = {
        name: interpolate(t, taken, values[new])
        for name, values in recording.channels.items()
        if name in ("acc", "gyr")
    }
    return replace(recording, **channels)


def _new_samples(t: Array, changed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows (n,) that are not the sample before, read once more; `changed` (n,) says which differ from the row before.

    Noise changes each sample. The readings of a coarse sensor may stay, but then for whole intervals.
    """
    begin = np.flatnonzero(changed)
    if len(begin) <= LATE_SAMPLES:
        return np.ones(len(t), dtype=bool)
    spans = t[begin[LATE_SAMPLES:]] - t[begin[:-LATE_SAMPLES]]
    interval = float(np.percentile(spans, 10.0)) / LATE_SAMPLES  # at rest a coarse sensor changes less often
    since = t - t[begin][np.cumsum(changed) - 1]
    held = np.floor(since / max(interval, 1e-9) + 0.1)  # a tenth early counts as a whole interval
    return np.asarray(changed | (np.diff(held, prepend=0.0) > 0.0))


def _warn_of_rate(recording: Recording) -> None:
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
