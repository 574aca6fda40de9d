"""Time stamps: checked, and put on a steady beat where they are coarse or come in batches.

A small error of a stamp does little harm. The velocity errs by the change of acceleration in that time. But coarse
stamps suggest another rate, and losses where there are none. So they are put back on the sensor's steady beat.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pbd.data import Recording
from pbd.data.one_line_repr import counted
from pbd.errors import RecordingError, warn
from pbd.pose import Array

SLOWEST_HZ, FASTEST_HZ = 4.0, 4000.0
"""Rates of inertial sensors: at others the unit of time is wrong. They are a factor of 1000 apart, so that a step tells
ms, us and ns apart."""

SHORTEST_S = 0.3
"""Shortest recording, s, that shows whether the hand moves."""

CLOCK_JUMP_S = 60.0
"""Longest silence of a sensor within one demonstration, s: after a longer one its clock jumped."""

COARSE_TICK = 0.05
"""Share of the sampling interval above which the time stamps' resolution is coarse."""

OFF_BEAT = 0.02
"""Coarse stamps are replaced if more than this share of them are off the beat by more than this share of the interval;
or if so many come within a quarter of an interval of the one before: in batches."""

LATE_SAMPLES = 8
"""Number of samples within which a late stamp is made up for. A lost sample never is."""

NOMINAL_TOLERANCE = 0.01
"""Relative deviation of the mean rate from the nominal one below which no sample is lost."""

DRIFT_S = 1.0
"""s: averaging time for a clock's slow drift."""

RATE_TOLERANCE = 0.05
"""Relative deviation of the measured rate from the nominal one above which there is a warning."""


def with_clock(recording: Recording) -> Recording:
    """The recording on a clock that can be believed; warns where it was changed, or is not the sensor's rate.

    Raises:
        RecordingError: too short, or a time that runs backwards, jumps, stands still or is not in seconds.
    """
    if len(recording) < 2:
        raise RecordingError(
            f"the recording has {counted(len(recording), 'sample') or '0 samples'}; record at least a second of rest, "
            "then move"
        )
    _refuse_other_unit(recording.t)
    _refuse_disorder(recording.t)
    recording = replace(recording, t=steady_clock(recording))
    t = recording.t
    step = float(np.median(np.diff(t)))
    if step <= 0.0:
        raise RecordingError("most rows carry the same time; the column 't' must be seconds that increase")
    if step < 1.0 / FASTEST_HZ:
        raise RecordingError(
            f"the samples come {step:.3g} s apart, closer than any sensor's; the column 't' must be seconds",
            value=step,
            bound=1.0 / FASTEST_HZ,
        )
    interval = 1.0 / recording.rate_hz
    _refuse_slow(interval)
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


def _refuse_other_unit(t: Array) -> None:
    """Refuse a time in ms, us or ns, before its steps are taken for jumps."""
    steps = np.diff(t[np.isfinite(t)])
    forward = steps[steps > 0.0]
    if 2 * len(forward) > len(steps):
        _refuse_slow(float(np.median(forward)))


def _refuse_slow(interval: float) -> None:
    if interval * SLOWEST_HZ <= 1.0:
        return
    units = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    likely = [unit for unit, scale in units.items() if SLOWEST_HZ < 1.0 / (interval * scale) <= FASTEST_HZ]
    named = likely or ["ms", "us"]
    what = "the time is likely in" if likely else "if the time is in"
    raise RecordingError(
        f"the samples come {interval:.3g} s apart; {what} {' or '.join(named)}"
        + f"{': ' if likely else ', '}import the file with {' or '.join(f'--unit t={unit}' for unit in named)}",
        value=1.0 / interval,
        bound=SLOWEST_HZ,
    )


def steady_clock(recording: Recording) -> Array:
    """Time stamps (n,) s, on a steady beat where they were coarse or in batches; lost samples stay lost.

    `recording.t` must not run backwards. Warns where it changes something.
    """
    t, nominal_hz = recording.t, recording.info.rate_hz
    new = np.concatenate(([True], (np.diff(t) > 0.0) | differs(recording)))
    stamps = t[new]
    if len(stamps) > 4 * LATE_SAMPLES and stamps[-1] > stamps[0]:
        interval, reach, whole = _beat(stamps, nominal_hz)
        fault = _fault(stamps, interval)
        if fault:
            stamps = _on_beat(stamps, interval, reach, whole)
            t = stamps[np.cumsum(new) - 1]
            rate_hz = 1.0 / float(np.median(np.diff(stamps)))
            warn(f"{fault}; evenly spaced times at {rate_hz:.4g} Hz are used instead")
    return t


def _warn_of_rate(recording: Recording) -> None:
    """Warn where the samples do not come at the nominal rate."""
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


def differs(recording: Recording) -> NDArray[np.bool_]:
    """Whether each row differs from the one before it, (n - 1,)."""
    given = [values for values in (recording.acc, recording.gyr) if values is not None]
    differs: NDArray[np.bool_] = np.any([(values[1:] != values[:-1]).any(axis=1) for values in given], axis=0)
    return differs


def _beat(t: Array, nominal_hz: float | None) -> tuple[float, int, bool]:
    """The sampling interval of stamps that may be coarse, from the spans of several; of how many; is none lost?"""
    mean, reach = float(t[-1] - t[0]) / (len(t) - 1), min(LATE_SAMPLES, len(t) // 4)
    if nominal_hz is not None and abs(mean * nominal_hz - 1.0) < NOMINAL_TOLERANCE:
        return mean, reach, True
    spans = t[reach:] - t[:-reach]
    usual = float(np.median(spans))
    return float(spans[np.abs(spans - usual) < 0.5 * usual / reach].mean()) / reach, reach, False


def _fault(t: Array, interval: float) -> str:
    """What is wrong with stamps (n,) s of samples that are all new; nothing: an empty word."""
    steps = np.diff(t)
    if (steps < 0.25 * interval).mean() > OFF_BEAT:
        return "the time stamps come in batches"
    tick = 1e-6 * float(np.gcd.reduce(np.rint(1e6 * steps).astype(np.int64)))
    away = np.abs(steps - interval * np.maximum(np.rint(steps / interval), 1.0))
    if tick >= COARSE_TICK * interval and (away > OFF_BEAT * interval).mean() > OFF_BEAT:
        return f"the time stamps come in steps of {1e3 * tick:.4g} ms"
    return ""


def _on_beat(t: Array, interval: float, reach: int, whole: bool) -> Array:
    from scipy.ndimage import minimum_filter1d, uniform_filter1d

    place = np.arange(len(t), dtype=np.float64)
    if not whole:
        # A stamp comes late, or rounded down, but never early: what is left over is least for the most punctual stamps,
        # and rises for good where samples are lost.
        punctual = minimum_filter1d(t - interval * place, reach + 1, mode="nearest", origin=-(reach // 2))
        place[1:] += np.cumsum(np.maximum(np.rint(np.diff(punctual) / interval), 0.0))
    interval, begin = np.polyfit(place, t, 1)
    left_over = t - begin - interval * place
    smooth = uniform_filter1d(left_over, max(1, round(DRIFT_S / interval)), mode="nearest")
    beat: Array = begin + interval * place + smooth
    return beat
