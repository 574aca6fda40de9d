"""Put back what a sensor could not say at the end of its range, as far as its neighbours tell it; say how unsure it is.

The shape of a clipped peak is continued from its sides. By how much that is wrong is for the smoother to find: gravity
at the stops tells how far the hand turned above the gyro's range, the stop at the end of the move how much faster it
was than the accelerometer's range lets it be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pbd.data import Recording
from pbd.pose import Array
from pbd.tracking.preintegration import Impulse
from pbd.tracking.saturation import Clip

PEAK = 0.5
"""What is continued from the sides rises above the range by this share of it at most."""

UNSEEN = 0.1
"""One sigma of what was lost is all of what was continued, and this share of the range for as long as it lasted."""


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
    channels = {"acc": recording.acc.copy(), "gyr": None if recording.gyr is None else recording.gyr.copy()}
    interval = 1.0 / recording.rate_hz
    impulses = []
    for clip in clips:
        values = channels[clip.sensor]
        assert values is not None
        top = abs(float(values[clip.start, clip.axis]))
        above = _above(values[:, clip.axis], clip.sign, clip.start, clip.stop)
        values[clip.start : clip.stop, clip.axis] += clip.sign * above
        lost = np.zeros(3)
        lost[clip.axis] = (float(above.sum()) + UNSEEN * top * len(above)) * interval / np.sqrt(2.0)
        by_sensor = {"acc": np.zeros(3), "gyr": np.zeros(3), clip.sensor: lost}
        quarter = (clip.stop - clip.start) // 4
        # Nor is it known when it was lost: in the first half, or in the second.
        impulses += [Impulse(row, **by_sensor) for row in (clip.start + quarter, clip.stop - quarter)]
    acc = channels["acc"]
    assert acc is not None
    return replace(recording, acc=acc, gyr=channels["gyr"]), tuple(impulses)


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
    above: Array = np.clip(cubic - top, 0.0, PEAK * top)
    return above
