"""Find samples at the end of a sensor's range (clipped), and extrapolate the peaks from their sides.

A clipped axis repeats one reading: a flat top with steep sides. The smoother estimates the error of the extrapolation:
gravity at the stops shows the lost turn, the stop after a move shows the lost velocity.

A rounded peak may have a flat top too, by a coarse resolution or by chance. For a parabola with white noise of any size
the chance of m equal samples is at most (2.5 steps / fall)^(m - 1), from m = 3 on, with the fall of the sides over two
samples. Impacts have no flat tops, but where they are clipped, several have the same top reading.

Not found: a few peaks of one or two samples, flat tops that differ too little from noise, and clips of an axis that was
later averaged or mixed with others (corrected for misalignment).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import lgamma, log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.data import GRAVITY, Recording
from pbd.errors import amount, warn
from pbd.pose import Array
from pbd.tracking.repair.channel_faults import REPEATED_ROWS, SENSOR_NAMES
from pbd.tracking.repair.clock import row_changes
from pbd.tracking.smoother.preintegration import LostMotion
from pbd.tracking.zero_velocity import runs

LEAST_RANGE = {"acc": 1.15 * GRAVITY, "gyr": 0.5}
"""Smallest range of a sensor, m/s2 and rad/s (InvenSense ICM-42688-P: 31 deg/s). A flat top below it is a rest."""

TOP_TOLERANCE = 1e-6
"""A reading belongs to the flat top if it differs by less than this share from the largest reading."""

CHANCE_STEPS = 2.5
"""This, divided by the fall of a rounded peak's sides in steps, is the largest chance that the top reading repeats."""

TAIL_STEPS = 30
"""Number of steps below the top reading over which peaks are counted. Higher peaks are rarer, so each but the highest
has at most a chance of 1 in so many to be in the top step."""

CLIPPED_CHANCE = 1e-4
"""Chance that flat or equal tops are those of peaks, below which the axis is clipped."""

LOST_SHARE = 0.1
"""One sigma of the lost motion is the whole extrapolation plus this share of the range, over the time of the clip, plus
the fall of its sides over one sample: of an impact, one or two samples are all that is seen."""


@dataclass(frozen=True)
class Clip:
    """Rows start <= i < stop at which an axis (0 to 2) of a sensor (acc, gyr) is at the end `sign` of its range."""

    sensor: str
    axis: int
    sign: float
    start: int
    stop: int

    def limit(self, recording: Recording) -> float:
        """The end of the range, m/s2 or rad/s."""
        return abs(float(getattr(recording, self.sensor)[self.start, self.axis]))

    def limit_text(self, recording: Recording) -> str:
        """The end of the range, in g or deg/s."""
        limit = self.limit(recording)
        return f"{limit / GRAVITY:.3g} g" if self.sensor == "acc" else f"{np.degrees(limit):.0f} deg/s"


def find_clips(recording: Recording) -> tuple[Clip, ...]:
    """Find the clipped samples of a recording without NaN, in order; warns if there are any."""
    clips = clips_of(recording)
    if not clips:
        return ()
    axes, ends = [], []
    for sensor in sorted({clip.sensor for clip in clips}):
        own = [clip for clip in clips if clip.sensor == sensor]
        letters = sorted({"xyz"[clip.axis] for clip in own})
        axes.append(f"the {SENSOR_NAMES[sensor]}'s {', '.join(letters)} {'axis' if len(letters) == 1 else 'axes'}")
        ends.append(own[0].limit_text(recording))
    rows = len({row for clip in clips for row in range(clip.start, clip.stop)})
    are = "is" if rows == 1 else "are"
    warn(
        f"{amount(rows, 'sample')} of {' and '.join(axes)} {are} at the end of the range ({' and '.join(ends)}), the "
        f"first at t = {recording.t[clips[0].start]:.2f} s: values above it are guessed; move slower and "
        "without knocks, or set a larger range"
    )
    return clips


def clips_of(recording: Recording) -> tuple[Clip, ...]:
    """`find_clips` without its warning."""
    clips = (
        Clip(sensor, axis, sign, start, stop)
        for sensor, values in recording.channels.items()
        if sensor in SENSOR_NAMES
        for new in [np.append(True, row_changes(values))]
        for axis in range(3)
        for sign in (1.0, -1.0)
        for start, stop in _clipped_runs(sign * values[:, axis], sensor, new)
    )
    return tuple(sorted(clips, key=lambda clip: clip.start))


def _clipped_runs(x: Array, sensor: str, new: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Runs in which x (n,) is clipped at its largest value. `new` (n,): rows that differ from the row before."""
    top = float(x.max())
    if top < LEAST_RANGE[sensor]:
        return []
    tops = runs(x >= top * (1.0 - TOP_TOLERANCE))
    counted = ((start, stop, int(new[start:stop].sum())) for start, stop in tops)
    flat = [each for each in counted if each[2] >= REPEATED_ROWS]
    if not flat and len(tops) < 2:
        return []  # sorting takes long
    between = np.diff(np.unique(x))
    step = float(between[between > top * TOP_TOLERANCE].min(initial=np.inf))
    for start, stop, samples in flat:
        sides = x[max(start - 2, 0) : start], x[stop : stop + 2]
        fall = min((top - float(side.min()) for side in sides if len(side)), default=0.0)
        if by_clipping(fall, step, samples):
            return tops
    beside = np.pad(x, 1, constant_values=-np.inf)
    peaks = x[(x > beside[:-2]) & (x >= beside[2:])]
    high, others = int(np.count_nonzero(peaks > top - TAIL_STEPS * step)), len(tops) - 1
    log_ways = lgamma(high) - lgamma(others + 1) - lgamma(high - others)
    return tops if log_ways - others * log(TAIL_STEPS) < log(CLIPPED_CHANCE) else []


def by_clipping(fall: float, step: float, samples: int) -> bool:
    """Whether so many samples at the top are no rounded peak's, whose sides fall by `fall` in readings of this step."""
    return (CHANCE_STEPS * step / max(fall, step)) ** (samples - 1) < CLIPPED_CHANCE


def declip(recording: Recording, clips: Sequence[Clip]) -> tuple[Recording, tuple[LostMotion, ...]]:
    """Extrapolate clipped peaks from their sides.

    Args:
        recording: without NaN.
        clips: from `find_clips` or `clips_of`.

    Returns:
        The recording, and one sigma of what may still be lost, for each half of a clip.
    """
    if not clips:
        return recording, ()
    channels: dict[str, Any] = {clip.sensor: getattr(recording, clip.sensor).copy() for clip in clips}
    interval = 1.0 / recording.rate_hz
    lost_motion = []
    for clip in clips:
        values = channels[clip.sensor]
        top = abs(float(values[clip.start, clip.axis]))
        overshoot = _overshoot(values[:, clip.axis], clip.sign, clip.start, clip.stop)
        if clip.sensor == "gyr":
            overshoot = np.minimum(overshoot, 0.5 * top)  # a lost turn counts as small; lost velocity may be large
        values[clip.start : clip.stop, clip.axis] += clip.sign * overshoot
        lost = np.zeros(3)
        sides = values[[max(clip.start - 1, 0), min(clip.stop, len(values) - 1)], clip.axis]
        fall = top - float((clip.sign * sides).min())
        unknown = float(overshoot.sum()) + LOST_SHARE * top * len(overshoot) + fall
        lost[clip.axis] = unknown * interval / np.sqrt(2.0)
        turn, dv = (lost, np.zeros(3)) if clip.sensor == "gyr" else (np.zeros(3), lost)
        quarter = (clip.stop - clip.start) // 4
        # It is unknown when it was lost, so each half gets an impulse of its own.
        lost_motion += [LostMotion(row, turn, dv) for row in (clip.start + quarter, clip.stop - quarter)]
    return replace(recording, **channels), tuple(lost_motion)


def _overshoot(x: Array, sign: float, start: int, stop: int) -> Array:
    """Height of sign * x (n,) above its flat top (rows start to stop), by a Hermite cubic through its sides."""
    if start < 2 or stop > len(x) - 2:
        return np.zeros(stop - start)
    top, width = sign * float(x[start]), stop - start + 1
    earlier, before, after, later = (sign * float(x[row]) for row in (start - 2, start - 1, stop, stop + 1))
    rise, fall = max(before - earlier, top - before), min(later - after, after - top)
    u = np.arange(1, width) / width
    cubic = before * (1 + 2 * u) * (1 - u) ** 2 + after * u**2 * (3 - 2 * u)
    cubic += width * (rise * u * (1 - u) ** 2 - fall * u**2 * (1 - u))
    return np.maximum(cubic - top, 0.0)
