"""Put back what a sensor could not say at the end of its range, as far as its neighbours tell it; say how unsure it is.

The shape of a clipped peak is continued from its sides. By how far the hand turned above the gyro's range, gravity
tells, which the accelerometer sees in the rests before and after; how much faster it was than the accelerometer's range
lets it be, the stop at the end of the move tells. Either is least squares with the sigma of what was continued; what no
rest tells (a turn about the vertical, say) keeps that sigma.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
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
        above = _above(values[:, clip.axis], clip.sign, clip.start, clip.stop)
        values[clip.start : clip.stop, clip.axis] += clip.sign * above
        lost = float(above.sum()) * interval
        put_back.append(replace(clip, lost=lost, sigma=lost + UNSEEN * top * len(above) * interval))
    acc, gyr = channels["acc"], channels["gyr"]
    assert acc is not None
    if gyr is not None and any(clip.sensor == "gyr" for clip in clips):
        put_back = _settle_turns(acc, gyr, recording.rate_hz, put_back)
    return replace(recording, acc=acc, gyr=gyr), tuple(put_back)


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
        near = bisect_right(rows, rows[before] - CALM_S * rate_hz)
        far = bisect_left(rows, rows[after] + CALM_S * rate_hz)
        begin, end = near + np.argmin(turning[near : before + 1]), after + np.argmin(turning[after:far])
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
    for first, last, inside in _clips_of_moves(stops, clips):
        members = [i for i in inside if clips[i].sensor == "acc" and clips[i].start > first]
        if not members:
            continue
        axes = np.array([_axis_nav(clips[i], wxyz_nav_sensor) for i in members])
        drift = EVEN_DRIFT**2 * float(t[last] - t[first])
        closure = integral_of_means(t[first : last + 1], a_nav[first : last + 1])[-1]
        # A Kalman filter's step: of what is measured there are three numbers, of clips in a move perhaps thousands.
        prior = np.array([clips[i].sigma for i in members]) ** 2
        spread = prior[:, None] * axes
        gain_of = spread @ np.linalg.inv(axes.T @ spread + drift * np.eye(3))
        gains, variances = -gain_of @ closure, prior - (gain_of * spread).sum(axis=1)
        for i, axis, gain, variance in zip(members, axes, gains, variances, strict=True):
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
    if len(stops) < 2 or not clips:
        return added
    first, last = np.array([(before.stop - 1, after.start) for before, after in pairwise(stops)]).T
    z = np.array((0.0, 0.0, 1.0))
    in_nav = np.array([clip.sigma * _axis_nav(clip, wxyz_nav_sensor) for clip in clips])

    turns = np.array([clip.sensor == "gyr" for clip in clips])
    starts = np.array([clip.start for clip in clips])[turns]
    about_z = np.concatenate(([0.0], np.cumsum(in_nav[turns, 2] ** 2)))  # of the first 0, 1, 2 ... turns
    added[1:, 5, 5] = about_z[np.searchsorted(starts, last)]
    sideways = np.cross(z, p_nav_sensor[last] - p_nav_sensor[first])
    earlier = about_z[np.searchsorted(starts, first)]
    added[1:, :3, :3] = earlier[:, None, None] * sideways[:, :, None] * sideways[:, None, :]

    for k, (begin, end, members) in enumerate(_clips_of_moves(stops, clips), start=1):
        if not members:
            continue
        instants, f_nav = t[begin : end + 1], a_nav[begin : end + 1] + GRAVITY * z
        velocity = integral_of_means(instants, f_nav)
        position = integral_of_means(instants, velocity)
        middles = np.array([min(_middle(clips[i]), end) for i in members]) - begin
        left, whole = (instants[-1] - instants[middles])[:, None], instants[-1] - instants[0]
        gained = velocity[-1] - velocity[middles]
        gone = position[-1] - position[middles] - left * velocity[middles]
        axes = in_nav[members.start : members.stop]
        off = np.where(
            turns[members.start : members.stop, None],
            np.cross(axes, gone - 0.5 * whole * gained),
            (left - 0.5 * whole) * axes,
        )
        added[k, :3, :3] += off.T @ off
    added[:, :3, :3] = np.cumsum(added[:, :3, :3], axis=0)
    return added


def _clips_of_moves(stops: Sequence[Stop], clips: Sequence[Clip]) -> Iterator[tuple[int, int, range]]:
    """Yield each move's first and last row, and which of the clips, in order, begin in it before the last."""
    starts = [clip.start for clip in clips]
    for before, after in pairwise(stops):
        first, last = before.stop - 1, after.start
        yield first, last, range(bisect_left(starts, first), bisect_left(starts, last))


def _middle(clip: Clip) -> int:
    return (clip.start + clip.stop) // 2


def _axis_nav(clip: Clip, wxyz_nav_sensor: Array) -> Array:
    return quat_rotate(wxyz_nav_sensor[_middle(clip)], clip.sign * np.eye(3)[clip.axis])
