"""Find samples at which a sensor has reached the end of its range.

A clipped axis gives one reading again and again: a flat top with steep sides, or at one of the values at which makers
let a range end. What the hand did above it is lost; restoring.py puts back what can be told of it.

What can't be found: clipped peaks of single samples (of two, at an odd value), and those clipped before the axis was
mixed with others (calibrated for misalignment) or averaged.
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
from pbd.tracking.stops import runs

LOWEST = {"acc": 1.15 * GRAVITY, "gyr": 1.0}
"""No range ends below this, in m/s2 and rad/s: a flat top under it is a rest."""

RANGES = {"acc": GRAVITY * np.array([1.5, 2, 3, 4, 6, 8, 12, 16, 24]), "gyr": np.radians([125, 250, 500, 1000, 2000])}
"""Where makers let a range end ..."""

EXACTLY, PAIR = 1e-4, 2
"""... and to which share they do: a flat top there has this many samples at least."""

SAME = 1e-6
"""Readings that differ by less than this share of the extreme one are the same."""

FLAT, STEEP = 3, 5.0
"""Elsewhere a flat top has this many samples at least, and its sides fall by this many steps of the sensor's
resolution: a rounded peak that is coarsely read does not (of a noisy sensor's one in some thousand does: a warning too
many, where more samples asked for would be clipped peaks missed)."""


@dataclass(frozen=True)
class Clip:
    """Samples start <= i < stop at which one axis of a sensor (acc, gyr) is at the end of its range, on side `sign`.

    `lost` is the integral of what was above it, as far as it could be put back, rad or m/s; `sigma` how unsure that is.
    """

    sensor: str
    axis: int
    sign: float
    start: int
    stop: int
    lost: float = 0.0
    sigma: float = 0.0


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
    usual = (np.abs(top / RANGES[sensor] - 1.0) < EXACTLY).any()
    long = [(start, stop) for start, stop in tops if new[start:stop].sum() >= (PAIR if usual else FLAT)]
    if usual or not long:
        return tops if long else []
    between = np.diff(np.unique(x))
    step = max(float(between[between > top * SAME].min(initial=np.inf)), top * SAME)
    sides = np.concatenate((x[:1], x, x[-1:]))
    steep = any(top - max(sides[start], sides[stop + 1]) > STEEP * step for start, stop in long)
    return tops if steep else []


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
