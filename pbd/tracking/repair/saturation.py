"""Find samples at which a sensor has reached the end of its range, and continue the peaks from their sides.

A clipped axis gives one reading again and again: flat tops with steep sides. What the hand did above them is lost. The
smoother finds the error of the continuation. Gravity at the stops shows how far the hand turned above the gyro's range;
the stop at the end of a move shows how much faster it was than the accelerometer's range allows.

The largest readings of a rounded peak may be alike too: where it is read coarsely, or by the chance of noise. Coarsely
read, m samples lie within one step of the sensor's resolution, and then its sides fall by few steps. By chance, each
reading after the first hits the same step among all to which noise and hand could have taken it; how many those are,
the sides tell. Were the noise small, a rounded peak with such sides could not be flat; were it large, its readings
would scatter. Between the two, for a parabola with white noise of whatever size, the chance is at most
(2.5 steps / fall)^(m - 1) for m of 3 and more, with the fall of the sides over two samples. (Two samples on either hand
of a peak are alike whenever it lies in their middle.)

What can't be found: clipped peaks of one or two samples, tops too shallow to differ from noise,
and those clipped before the axis was mixed with others (calibrated for misalignment) or averaged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.data import GRAVITY, Recording
from pbd.errors import warn
from pbd.pose import Array
from pbd.tracking.repair.channel_faults import REPEATED_ROWS, SENSOR_NAMES
from pbd.tracking.repair.clock import differs
from pbd.tracking.smoother.preintegration import Impulse
from pbd.tracking.zero_velocity import runs

LEAST_RANGE = {"acc": 1.15 * GRAVITY, "gyr": 1.0}
"""Smallest range of a sensor, m/s2 and rad/s. A flat top below it is a rest."""

TOP_TOLERANCE = 1e-6
"""Relative difference from the largest reading below which a reading belongs to the flat top."""

SIDE_SAMPLES = 2
"""Number of samples on either side of a flat top that show how steeply it falls."""

CHANCE_STEPS = 2.5
"""A rounded peak repeats its top reading with chance CHANCE_STEPS / fall, with the fall of its sides in steps of
resolution."""

CLIPPED_CHANCE = 1e-4
"""An axis is clipped if one of its flat tops has a smaller chance than this to be a rounded peak."""

LARGEST_OVERSHOOT = 0.5
"""Largest height of a continued peak above the range, as a share of the range."""

LOST_SHARE = 0.1
"""One sigma of what was lost is the whole continuation plus this share of the range for as long as it lasted."""


@dataclass(frozen=True)
class Clip:
    """Samples start <= i < stop at which one axis of a sensor (acc, gyr) is at the end of its range, on side `sign`."""

    sensor: str
    axis: int
    sign: float
    start: int
    stop: int


def find_clips(recording: Recording) -> tuple[Clip, ...]:
    """Find the clipped samples of a recording without NaN; in order, with a warning where there are any."""
    clips = clips_of(recording)
    if clips:
        _warn(recording, clips)
    return clips


def clips_of(recording: Recording) -> tuple[Clip, ...]:
    """Find them without a word."""
    given = {name: values for name in SENSOR_NAMES if (values := getattr(recording, name)) is not None}
    # A row that a sensor or a program repeats makes no top flatter.
    new = np.concatenate(([True], differs(recording)))
    clips = (
        Clip(sensor, axis, sign, start, stop)
        for sensor, values in given.items()
        for axis in range(3)
        for sign in (1.0, -1.0)
        for start, stop in _tops(sign * values[:, axis], sensor, new)
    )
    return tuple(sorted(clips, key=lambda clip: clip.start))


def _tops(x: Array, sensor: str, new: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Where x (n,) is clipped at its largest value; nowhere, if it is not. `new` (n,): not a repeated row."""
    top = float(x.max())
    if top < LEAST_RANGE[sensor]:
        return []
    tops = runs(x >= top * (1.0 - TOP_TOLERANCE))
    counted = ((start, stop, int(new[start:stop].sum())) for start, stop in tops)
    flat = [each for each in counted if each[2] >= REPEATED_ROWS]
    if not flat:
        return []
    between = np.diff(np.unique(x))
    step = max(float(between[between > top * TOP_TOLERANCE].min(initial=np.inf)), top * TOP_TOLERANCE)
    for start, stop, samples in flat:
        sides = x[max(start - SIDE_SAMPLES, 0) : start], x[stop : stop + SIDE_SAMPLES]
        fall = min((top - float(side.min()) for side in sides if len(side)), default=0.0)
        if (CHANCE_STEPS * step / max(fall, step)) ** (samples - 1) < CLIPPED_CHANCE:
            return tops
    return []


def _warn(recording: Recording, clips: Sequence[Clip]) -> None:
    clipped: dict[str, set[str]] = {}
    for clip in clips:
        clipped.setdefault(clip.sensor, set()).add("xyz"[clip.axis])
    axes = " and ".join(
        f"the {SENSOR_NAMES[sensor]}'s {', '.join(sorted(clipped[sensor]))}" for sensor in sorted(clipped)
    )
    rows = len({row for clip in clips for row in range(clip.start, clip.stop)})
    first = clips[0]
    reading = abs(float(getattr(recording, first.sensor)[first.start, first.axis]))
    shown = f"{reading / GRAVITY:.3g} g" if first.sensor == "acc" else f"{np.degrees(reading):.0f} deg/s"
    warn(
        f"{rows} samples of {axes} axis are at the end of the range ({shown}), the first at "
        f"t = {recording.t[first.start]:.2f} s: values above it are guessed; move slower, or set a larger range"
    )


def restore(recording: Recording, clips: Sequence[Clip]) -> tuple[Recording, tuple[Impulse, ...]]:
    """Continue clipped peaks from their sides.

    Args:
        recording: without NaN.
        clips: of `find_clips`.

    Returns:
        The recording, and what may still be missing in each half of a clip, one sigma.
    """
    if not clips:
        return recording, ()
    channels: dict[str, Any] = {clip.sensor: getattr(recording, clip.sensor).copy() for clip in clips}
    interval = 1.0 / recording.rate_hz
    impulses = []
    for clip in clips:
        values = channels[clip.sensor]
        top = abs(float(values[clip.start, clip.axis]))
        above = _above(values[:, clip.axis], clip.sign, clip.start, clip.stop)
        values[clip.start : clip.stop, clip.axis] += clip.sign * above
        lost = np.zeros(3)
        lost[clip.axis] = (float(above.sum()) + LOST_SHARE * top * len(above)) * interval / np.sqrt(2.0)
        by_sensor = {"acc": np.zeros(3), "gyr": np.zeros(3), clip.sensor: lost}
        quarter = (clip.stop - clip.start) // 4
        # Nor is it known when it was lost: in the first half, or in the second.
        impulses += [Impulse(row, **by_sensor) for row in (clip.start + quarter, clip.stop - quarter)]
    return replace(recording, **channels), tuple(impulses)


def _above(x: Array, sign: float, start: int, stop: int) -> Array:
    """How far sign * x (n,) rose above its flat top start..stop, by Hermite's cubic through its sides."""
    if start < 2 or stop > len(x) - 2:
        return np.zeros(stop - start)
    top, width = sign * float(x[start]), stop - start + 1
    earlier, before, after, later = (sign * float(x[row]) for row in (start - 2, start - 1, stop, stop + 1))
    rise, fall = max(before - earlier, top - before), min(later - after, after - top)
    u = np.arange(1, width) / width
    cubic = before * (1 + 2 * u) * (1 - u) ** 2 + after * u**2 * (3 - 2 * u)
    cubic += width * (rise * u * (1 - u) ** 2 - fall * u**2 * (1 - u))
    above: Array = np.clip(cubic - top, 0.0, LARGEST_OVERSHOOT * top)
    return above
