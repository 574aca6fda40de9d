"""Put back what a sensor could not say at the end of its range, as far as its neighbours tell it; say how unsure it is.

The shape of a clipped peak is continued from its sides. By how far the hand turned above the gyro's range, gravity
tells, which the accelerometer sees in the rests before and after; how much faster it was than the accelerometer's range
lets it be, the stop at the end of the move tells. Either is least squares with the sigma of what was continued; what no
rest tells (a turn about the vertical, say) keeps that sigma.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from pbd.data import GRAVITY, Recording, Stop
from pbd.pose import Array, quat_inverse, quat_multiply, quat_rotate
from pbd.tracking.integration import EVEN_DRIFT, integral_of_means
from pbd.tracking.rest import STILL_GYR
from pbd.tracking.saturation import Clip
from pbd.tracking.steady import carried, find_steady

PEAK = 0.5
"""What is continued from the sides rises above the range by this share of it at most."""

UNSEEN = 0.1
"""One sigma of what was lost is all of what was continued, and this share of the range for as long as it lasted."""

GRAVITY_SIGMA = np.radians(1.0)
"""rad: how well two rests and the gyro between them agree on gravity (scale errors of some 0.5 %)."""

LONGEST_S, CALM_S = 5.0, 0.5
"""The gyro is trusted to carry gravity's direction for this long from rest to rest, and for so long into them."""


def restore(recording: Recording, clips: Sequence[Clip]) -> tuple[Recording, tuple[Clip, ...]]:
    """Put back what was lost above the ranges, as far as the sides and gravity tell it.

    Args:
        recording: without NaN.
        clips: of `find_clips`.

    Returns:
        The recording, and the clips with `lost` and `sigma`.
    """
    if not clips:
        return recording, ()
    channels = {"acc": recording.acc.copy(), "gyr": None if recording.gyr is None else recording.gyr.copy()}
    interval = 1.0 / recording.rate_hz
    put_back = []
    for clip in clips:
        values = channels[clip.sensor]
        assert values is not None
        top = abs(float(values[clip.start, clip.axis]))
        above = _above(clip.sign * values[:, clip.axis], clip.start, clip.stop)
        values[clip.start : clip.stop, clip.axis] += clip.sign * above
        lost = float(above.sum()) * interval
        put_back.append(replace(clip, lost=lost, sigma=lost + UNSEEN * top * len(above) * interval))
    acc, gyr = channels["acc"], channels["gyr"]
    assert acc is not None
    if gyr is not None and any(clip.sensor == "gyr" for clip in clips):
        put_back = _settle_turns(acc, gyr, recording.rate_hz, put_back)
    return replace(recording, acc=acc, gyr=gyr), tuple(put_back)


def _above(x: Array, start: int, stop: int) -> Array:
    """How far x (n,) rose above its flat top start..stop, by Hermite's cubic through its sides."""
    top = float(x[start])
    if start < 2 or stop > len(x) - 2:
        return np.zeros(stop - start)
    before, after, width = x[start - 1], x[stop], stop - start + 1
    rise, fall = max(before - x[start - 2], top - before), min(x[stop + 1] - after, after - top)
    u = np.arange(1, width) / width
    cubic = before * (1 + 2 * u) * (1 - u) ** 2 + after * u**2 * (3 - 2 * u)
    cubic += width * (rise * u * (1 - u) ** 2 - fall * u**2 * (1 - u))
    above: Array = np.clip(cubic - top, 0.0, PEAK * top)
    return above


def _settle_turns(acc: Array, gyr: Array, rate_hz: float, clips: Sequence[Clip]) -> list[Clip]:
    """Correct how far the hand turned above the gyro's range by what gravity says; `gyr` (n, 3) is changed in place."""
    steady = find_steady(acc, gyr, rate_hz)
    still = steady.turning < STILL_GYR
    rows, up_sensor, turning = steady.rows[still], steady.up_sensor[still], steady.turning[still]
    between: dict[tuple[int, int], list[int]] = {}
    for i, clip in enumerate(clips):
        before = int(np.searchsorted(rows, clip.start, side="right")) - 1
        after = int(np.searchsorted(rows, clip.stop))
        if clip.sensor == "gyr" and before >= 0 and after < len(rows):
            between.setdefault((before, after), []).append(i)
    settled = list(clips)
    for (before, after), members in between.items():
        if rows[after] - rows[before] > LONGEST_S * rate_hz:
            continue
        # The hand still sways where it has just come to rest: of the moments soon after, the calmest.
        near = np.flatnonzero((rows <= rows[before]) & (rows > rows[before] - CALM_S * rate_hz))
        far = np.flatnonzero((rows >= rows[after]) & (rows < rows[after] + CALM_S * rate_hz))
        begin, end = near[np.argmin(turning[near])], far[np.argmin(turning[far])]
        ups = up_sensor[begin], up_sensor[end]
        span = slice(int(rows[begin]), int(rows[end]))
        for i, clip in zip(
            members, _settle(gyr, span, steady.gyro_bias, ups, rate_hz, [clips[i] for i in members]), strict=True
        ):
            settled[i] = clip
    return settled


def _settle(
    gyr: Array, span: slice, bias: Array, ups: tuple[Array, Array], rate_hz: float, clips: Sequence[Clip]
) -> list[Clip]:
    """Correct the turns at clips so that in `span` the vertical goes from one to the other of `ups`, in sensor axes.

    A turn e about the axis a at a clip moves the later vertical u that the gyro predicts by -e a' x u, with a' that
    axis in the sensor's later attitude: linear least squares, each clip with its own sigma, solved twice since e may
    be large. Turning about the vertical stays as unsure as it was.
    """
    prior = np.array([clip.sigma for clip in clips])
    turn, variance = np.zeros(len(clips)), prior**2
    for _ in range(2):
        attitude = carried(gyr[span] - bias, 1.0 / rate_hz)
        to_end = quat_multiply(quat_inverse(attitude[-1]), attitude)
        up = quat_rotate(to_end[0], ups[0])
        axes = np.array(
            [quat_rotate(to_end[_middle(clip) - span.start], clip.sign * np.eye(3)[clip.axis]) for clip in clips]
        )
        moves = -np.cross(axes, up)
        cov = np.linalg.inv(moves @ moves.T / GRAVITY_SIGMA**2 + np.diag(prior**-2.0))
        more = cov @ (moves @ (ups[1] - up) / GRAVITY_SIGMA**2 - turn / prior**2)
        turn, variance = turn + more, np.diagonal(cov)
        for clip, step in zip(clips, more, strict=True):
            gyr[clip.start : clip.stop, clip.axis] += clip.sign * step * rate_hz * _arch(clip)
    return [
        replace(clip, lost=clip.lost + float(e), sigma=float(np.sqrt(v)))
        for clip, e, v in zip(clips, turn, variance, strict=True)
    ]


def _arch(clip: Clip) -> Array:
    """How what was lost is shared out over the samples of a clip: a parabola, (m,) with the sum 1."""
    u = (np.arange(clip.stop - clip.start) + 0.5) / (clip.stop - clip.start)
    parabola: Array = u * (1.0 - u)
    parabola /= parabola.sum()
    return parabola


def settle_velocities(
    t: Array, a_nav: Array, wxyz_nav_sensor: Array, stops: Sequence[Stop], clips: Sequence[Clip]
) -> tuple[Array, tuple[Clip, ...]]:
    """Correct what velocity the hand gained above the accelerometer's range by the stop at the end of the move.

    A gain e along the axis n adds e n to the move's closure, whose other parts have the sigma EVEN_DRIFT sqrt(T).

    Args:
        t: (n,) s.
        a_nav: (n, 3) m/s2.
        wxyz_nav_sensor: (n, 4).
        stops: in order.
        clips: of `restore`.

    Returns:
        Motion acceleration (n, 3) m/s2, and the clips with `lost` and `sigma` as they are known now.
    """
    a_nav, settled = a_nav.copy(), list(clips)
    interval = float(np.median(np.diff(t)))
    for before, after in pairwise(stops):
        first, last = before.stop - 1, after.start
        members = [i for i, clip in enumerate(clips) if clip.sensor == "acc" and first < clip.start < last]
        if not members:
            continue
        axes = np.array([_axis_nav(clips[i], wxyz_nav_sensor) for i in members])
        drift = EVEN_DRIFT**2 * float(t[last] - t[first])
        closure = integral_of_means(t[first : last + 1], a_nav[first : last + 1])[-1]
        prior = np.array([clips[i].sigma for i in members])
        cov = np.linalg.inv(axes @ axes.T / drift + np.diag(prior**-2.0))
        gains = -cov @ axes @ closure / drift
        for i, axis, gain, variance in zip(members, axes, gains, np.diagonal(cov), strict=True):
            clip = clips[i]
            a_nav[clip.start : clip.stop] += gain / interval * np.outer(_arch(clip), axis)
            settled[i] = replace(clip, lost=clip.lost + float(gain), sigma=float(np.sqrt(variance)))
    return a_nav, tuple(settled)


def clip_covariance(
    t: Array, a_nav: Array, wxyz_nav_sensor: Array, p_nav_sensor: Array, stops: Sequence[Stop], clips: Sequence[Clip]
) -> Array:
    """What clipped samples add to the covariance (len(stops), 6, 6), m and rad, of the pose at each stop.

    Where a gain of velocity is unsure by sigma along n, at the time s before the end of a move that takes T, the end is
    off by sigma (s - T / 2) n, the drift of velocity being taken out linearly. Where a turn is unsure by sigma about n,
    specific force f is off by sigma n x f in the rest of the move, and that is integrated likewise. The next stop's
    gravity ends that, but not what is about the vertical: it turns every later move, and each adds its own.
    """
    added = np.zeros((len(stops), 6, 6))
    z = np.array((0.0, 0.0, 1.0))
    f_nav = a_nav + GRAVITY * z
    moves = [(before.stop - 1, after.start) for before, after in pairwise(stops)]
    for clip in clips:
        axis, middle = clip.sigma * _axis_nav(clip, wxyz_nav_sensor), _middle(clip)
        for k, (first, last) in enumerate(moves, start=1):
            off = np.zeros(3)
            if first <= clip.start < last:
                whole, left = float(t[last] - t[first]), float(t[last] - t[min(middle, last)])
                off = (left - 0.5 * whole) * axis
                if clip.sensor == "gyr":
                    instants = t[middle : last + 1]
                    error = np.cross(axis, f_nav[middle : last + 1])
                    velocity = integral_of_means(instants, error)
                    off = integral_of_means(instants, velocity)[-1] - 0.5 * whole * velocity[-1]
            elif clip.sensor == "gyr" and clip.start < first:
                off = np.cross(axis[2] * z, p_nav_sensor[last] - p_nav_sensor[first])
            added[k, :3, :3] += np.outer(off, off)
            if clip.sensor == "gyr" and clip.start < last:
                added[k, 5, 5] += axis[2] ** 2
    added[:, :3, :3] = np.cumsum(added[:, :3, :3], axis=0)
    return added


def _middle(clip: Clip) -> int:
    return (clip.start + clip.stop) // 2


def _axis_nav(clip: Clip, wxyz_nav_sensor: Array) -> Array:
    return quat_rotate(wxyz_nav_sensor[_middle(clip)], clip.sign * np.eye(3)[clip.axis])
