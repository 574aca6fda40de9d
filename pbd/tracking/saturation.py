"""Find samples at which a sensor has reached the end of its range.

A clipped axis gives one reading again and again: flat tops with steep sides. What the hand did above them is lost;
restoring.py puts back what can be told of it.

The largest readings of a rounded peak may be alike too: where it is read coarsely, or by the chance of noise. Coarsely
read, m samples lie within one step of the sensor's resolution, and then its sides fall by few steps. By chance, each
reading after the first hits the same step among all to which noise and hand could have taken it; how many those are,
the sides tell. Were the noise small, a rounded peak with such sides could not be flat; were it large, its readings
would scatter. Between the two, for a parabola with white noise of whatever size, the chance is at most
(2.5 steps / fall)^(m - 1) for m of 3 and more, with the fall of the sides over two samples. (Two samples on either hand
of a peak are alike whenever it lies in their middle.) The flat tops of one axis multiply their chances.

What can't be found: clipped peaks of single samples (of two, at an odd value), tops too shallow to be told from noise,
and those clipped before the axis was mixed with others (calibrated for misalignment) or averaged.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.data import GRAVITY, Recording
from pbd.errors import PbdWarning
from pbd.pose import Array
from pbd.tracking.zero_velocity import runs

LOWEST = {"acc": 1.15 * GRAVITY, "gyr": 1.0}
"""No range ends below this, in m/s2 and rad/s: a flat top under it is a rest."""

RANGES = {"acc": GRAVITY * np.array([1.5, 2, 3, 4, 6, 8, 12, 16, 24]), "gyr": np.radians([125, 250, 500, 1000, 2000])}
"""Where makers let a range end ..."""

EXACTLY, PAIR, USUAL = 1e-4, 2, 0.05
"""... and to which share they do: a flat top there has this many samples at least. The chance that a peak ends there
all the same is no more than this: that of a hand whose turn is a round number, read with some noise."""

SAME = 1e-6
"""Readings that differ by less than this share of the extreme one are the same."""

FLAT, SIDE = 3, 2
"""Elsewhere a flat top has this many samples at least; so many samples on either hand are its sides."""

ROUNDED, CHANCE = 10.0, 2.5
"""In steps of the sensor's resolution: the sides of a rounded peak that is coarsely read fall no further than this; and
of so many, by how far they fall, one is hit by chance."""

ALARM = 1e-4
"""So unlikely must all be by chance, for each axis and side."""


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
    given = {name: values for name in ("acc", "gyr") if (values := getattr(recording, name)) is not None}
    # A row that a sensor or a program repeats makes no top flatter.
    new = np.concatenate(([True], np.any([np.diff(v, axis=0).any(axis=1) for v in given.values()], axis=0)))
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
    if top < LOWEST[sensor]:
        return []
    tops = runs(x >= top * (1.0 - SAME))
    usual = bool((np.abs(top / RANGES[sensor] - 1.0) < EXACTLY).any())
    counted = [(start, stop, int(new[start:stop].sum())) for start, stop in tops]
    flat = [each for each in counted if each[2] >= (PAIR if usual else FLAT)]
    if not flat:
        return []
    between = np.diff(np.unique(x))
    step = max(float(between[between > top * SAME].min(initial=np.inf)), top * SAME)
    chance = USUAL if usual else 1.0
    for start, stop, samples in flat:
        sides = x[max(start - SIDE, 0) : start], x[stop : stop + SIDE]
        fall = min((top - float(side.min()) for side in sides if len(side)), default=0.0)
        if fall > ROUNDED * step:
            chance *= (CHANCE * step / fall) ** (samples - 1)
    return tops if chance < ALARM else []


def _warn(recording: Recording, clips: Sequence[Clip]) -> None:
    names = {"acc": "the accelerometer's", "gyr": "the gyro's"}
    axes = " and ".join(
        f"{names[sensor]} {', '.join(sorted({'xyz'[clip.axis] for clip in clips if clip.sensor == sensor}))}"
        for sensor in names
        if any(clip.sensor == sensor for clip in clips)
    )
    rows = len({row for clip in clips for row in range(clip.start, clip.stop)})
    first = clips[0]
    reading = abs(float(getattr(recording, first.sensor)[first.start, first.axis]))
    shown = f"{reading / GRAVITY:.3g} g" if first.sensor == "acc" else f"{np.degrees(reading):.0f} deg/s"
    warnings.warn(
        f"{rows} samples of {axes} axis are at the end of the range ({shown}), the first at "
        f"t = {recording.t[first.start]:.2f} s: what was above it is a guess; move slower, or set a larger range",
        PbdWarning,
        stacklevel=3,
    )
