"""Between two stops both ends are known: attitude and acceleration are made to agree with what the stops say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.data import Attitude, Recording, Stop
from pbd.pose import (
    Array,
    quat_canonical,
    quat_cumulative,
    quat_exp,
    quat_inverse,
    quat_log,
    quat_multiply,
    quat_rotate,
)
from pbd.tracking.gravity import motion_acceleration
from pbd.tracking.integration import edge, integral_of_means
from pbd.tracking.orientation import TAU_ACC_S, turns_between_middles
from pbd.tracking.rest import Rest

VQF_FLOOR = np.radians(0.2)
"""rad: how sure VQF's tilt is at best. It takes the mean acceleration over its time constant for gravity's direction, so
that a hand that changes its velocity by dv tilts it by up to dv / (g TAU_ACC_S) more."""

GYRO_BIAS, GYRO_SCALE = np.radians(0.02), 0.005
"""rad/s, of what is left of the bias; and, per square root of a radian, of what turning adds (scale, misalignment)."""

HAND_SPEED, FOOT_SPEED, DOUBTFUL_S = 0.005, 0.05, 0.15
"""m/s: what a hand that stands still may drift; what a foot may, in a stop shorter than DOUBTFUL_S."""

TILT_FLOOR = np.radians(0.05)
"""rad: no rest tells the vertical better than this."""

ACC_BIAS, ACC_ERROR = 0.1, 0.05
"""m/s2: one sigma of the accelerometer's bias before anything is known; and of its other errors over a move."""


@dataclass(frozen=True, eq=False)
class _Legs:
    """From the middle of each stop to that of the next: who turned how far, and how sure the gyro is of it.

    Attributes:
        middles: (k,) rows.
        of_row: (n,) the leg that each row lies on; rows before the first middle are on leg 0 too.
        share: (n,) from 0 to 1, of the gyro's variance that has arisen by each row.
        variance: (k - 1,) rad^2 of the gyro's turn, about each axis.
        turned: (n,) rad, the sum of all turning up to each row.
        vqf: (k,) rad^2, of VQF's tilt on the leg after each stop (the last: before it).
    """

    middles: NDArray[np.intp]
    of_row: NDArray[np.intp]
    share: Array
    variance: Array
    turned: Array
    vqf: Array


def smooth_motion(
    recording: Recording, attitude: Attitude, stops: tuple[Stop, ...], rest: Rest
) -> tuple[Attitude, Array]:
    """Attitude and motion acceleration (n, 3) m/s2 in nav, once the stops are known.

    Linear least squares, solved once, over a small tilt at each stop and the accelerometer's bias; it weighs

    - the turn from stop to stop by the gyro, with its bias from VQF,
    - gravity, as the accelerometer shows it at each rest (the longer, the surer),
    - the closure of each move: a tilt makes gravity look like motion, and the velocity is zero at both ends,
    - VQF's own tilt.

    In between the gyro carries the attitude, and what it misses at the far end is shared out by where it arose; in a long
    move, in which the gyro gets lost, VQF takes over by its own uncertainty. Last, what acceleration the rests still show
    (scale errors) is taken out in between.

    Nothing here iterates: the solution has the lowest cost by construction. Without a gyro the attitude stays as it is.
    """
    if not stops:
        return attitude, motion_acceleration(recording, attitude, rest.gravity)
    legs = _legs(recording, attitude, stops, rest)
    if recording.gyr is not None:
        attitude = Attitude(_hold_tilt(recording, attitude, stops, rest, legs), attitude.gyro_bias)
    return attitude, _zero_at_rests(recording, motion_acceleration(recording, attitude, rest.gravity), stops, legs)


def _legs(recording: Recording, attitude: Attitude, stops: tuple[Stop, ...], rest: Rest) -> _Legs:
    t = recording.t
    middles = np.array([(stop.start + stop.stop - 1) // 2 for stop in stops], dtype=np.intp)
    of_row = np.clip(np.searchsorted(middles, np.arange(len(t)), side="right") - 1, 0, max(len(stops) - 2, 0))
    speed = np.zeros(len(t))
    if recording.gyr is not None:
        speed = np.linalg.norm(recording.gyr - attitude.gyro_bias, axis=1)
    turned = np.cumsum(speed * np.diff(t, prepend=t[0]))
    density = rest.gyr_rms / np.sqrt(3.0 * recording.rate_hz)
    duration, angle = np.diff(t[middles]), np.diff(turned[middles])
    variance = (GYRO_BIAS**2 * duration + density**2) * duration + GYRO_SCALE**2 * angle
    velocity = integral_of_means(t, motion_acceleration(recording, attitude, rest.gravity))
    second = max(1, round(recording.rate_hz))
    change = np.zeros(len(t))
    change[second:] = ((velocity[second:] - velocity[:-second]) ** 2).sum(axis=1)
    energy = np.diff(np.cumsum(change)[middles]) / np.maximum(np.diff(middles), 1)
    vqf = (
        VQF_FLOOR**2 + np.concatenate((energy, energy[-1:] if len(energy) else [0.0])) / (rest.gravity * TAU_ACC_S) ** 2
    )
    if len(stops) == 1:
        return _Legs(middles, of_row, np.zeros(len(t)), variance, turned, vqf)
    start = middles[of_row]
    so_far = (GYRO_BIAS**2 * duration[of_row] + density**2) * (t - t[start])
    so_far += GYRO_SCALE**2 * (turned - turned[start])
    return _Legs(middles, of_row, np.clip(so_far / variance[of_row], 0.0, 1.0), variance, turned, vqf)


def _hold_tilt(recording: Recording, attitude: Attitude, stops: tuple[Stop, ...], rest: Rest, legs: _Legs) -> Array:
    """Return wxyz_nav_sensor (n, 4)."""
    assert recording.gyr is not None
    t, middles, leg = recording.t, legs.middles, legs.of_row
    turns = turns_between_middles(t, recording.gyr - attitude.gyro_bias, 1.0 / recording.rate_hz)
    carried = quat_cumulative(quat_exp(turns))
    at_stops = attitude.wxyz_nav_sensor[middles]
    start = quat_multiply(at_stops, quat_inverse(carried[middles]))
    missed = quat_log(quat_multiply(quat_multiply(start[:-1], carried[middles[1:]]), quat_inverse(at_stops[1:])))
    missed = np.vstack((missed, np.zeros((1, 3))))
    wxyz = quat_multiply(quat_exp(-legs.share[:, None] * missed[leg]), quat_multiply(start[leg], carried))

    tilt = _tilt_at_stops(recording, quat_rotate(wxyz, recording.acc), missed[:-1, :2], stops, rest, legs)
    tilt = np.vstack((tilt, tilt[-1:]))
    wxyz = quat_multiply(quat_exp(tilt[leg] + legs.share[:, None] * (tilt[leg + 1] - tilt[leg])), wxyz)

    # Far from its stops the gyro is less sure than VQF.
    variance = np.concatenate((legs.variance, [0.0]))[leg] * legs.share * (1.0 - legs.share)
    for outside, middle in ((t < t[middles[0]], middles[0]), (t > t[middles[-1]], middles[-1])):
        variance[outside] = (GYRO_BIAS * (t[outside] - t[middle])) ** 2
        variance[outside] += GYRO_SCALE**2 * np.abs(legs.turned[outside] - legs.turned[middle])
    to_vqf = quat_log(quat_multiply(attitude.wxyz_nav_sensor, quat_inverse(wxyz)))
    share = variance / (variance + legs.vqf[leg])
    return quat_canonical(quat_multiply(quat_exp(share[:, None] * to_vqf), wxyz))


def _tilt_at_stops(
    recording: Recording, f_nav: Array, missed: Array, stops: tuple[Stop, ...], rest: Rest, legs: _Legs
) -> Array:
    """Rotation vectors (k, 3) rad, about nav's x and y, by which the attitude at each stop is wrong.

    With e the tilt, specific force in nav at rest is g z - e x g z, so that e = (f_y, -f_x) / g; the same holds for the
    mean over a move that begins and ends with velocity zero.

    Args:
        recording: for its instants.
        f_nav: (n, 3) m/s2 specific force by the attitude that is to be corrected.
        missed: (k - 1, 2) rad, by how much the gyro missed each next stop.
        stops: in order.
        rest: for gravity.
        legs: between the stops.
    """
    from scipy.linalg import solveh_banded

    t, g, k = recording.t, rest.gravity, len(stops)
    interval = 1.0 / recording.rate_hz
    speed = _speed_at_stops(stops)
    dwell = np.maximum([stop.dwell_s for stop in stops], interval)
    f = np.array([f_nav[_inner(stop, t)].mean(axis=0) for stop in stops])
    weight_rest = 1.0 / ((speed / (g * dwell)) ** 2 + TILT_FLOOR**2)
    diagonal = weight_rest + 1.0 / np.maximum(legs.vqf, np.concatenate((legs.vqf[:1], legs.vqf[:-1])))
    beside = np.zeros(k)
    known = weight_rest[:, None] * np.column_stack((f[:, 1], -f[:, 0])) / g
    if k > 1:
        start, end = np.array([stop.stop - 1 for stop in stops[:-1]]), np.array([stop.start for stop in stops[1:]])
        duration = t[end] - t[start]
        gain = integral_of_means(t, f_nav)
        closure = gain[end] - gain[start]
        bend = np.concatenate(([0.0], np.cumsum((np.diff(f_nav, n=2, axis=0) ** 2).sum(axis=1)), [0.0]))
        unseen = speed[:-1] ** 2 + speed[1:] ** 2 + interval**2 / 12.0 * np.maximum(bend[end - 1] - bend[start], 0.0)
        weight_move = 1.0 / (unseen / (g * duration) ** 2 + (ACC_ERROR / g) ** 2)
        late = np.add.reduceat(legs.share, np.column_stack((start, end)).ravel())[::2] / (end - start)
        weight_gyro = 1.0 / legs.variance
        early = 1.0 - late
        diagonal[:-1] += weight_gyro + weight_move * early**2
        diagonal[1:] += weight_gyro + weight_move * late**2
        beside[1:] = weight_move * early * late - weight_gyro
        of_gyro = weight_gyro[:, None] * missed
        of_move = (weight_move / (g * duration))[:, None] * np.column_stack((closure[:, 1], -closure[:, 0]))
        known[:-1] += early[:, None] * of_move - of_gyro
        known[1:] += late[:, None] * of_move + of_gyro
    banded = np.vstack((beside, diagonal)) if k > 1 else diagonal[None]
    tilt = solveh_banded(banded, known)
    return np.column_stack((tilt, np.zeros(k)))


def _speed_at_stops(stops: tuple[Stop, ...]) -> Array:
    return np.array([HAND_SPEED if stop.dwell_s > DOUBTFUL_S else FOOT_SPEED for stop in stops])


def _inner(stop: Stop, t: Array) -> slice:
    inside = edge(stop, t)
    return slice(stop.start + inside, stop.stop - inside)


def _zero_at_rests(recording: Recording, a_nav: Array, stops: tuple[Stop, ...], legs: _Legs) -> Array:
    """Take out what acceleration the rests show, in between by how far the hand has turned from one to the other."""
    dwell = np.maximum([stop.dwell_s for stop in stops], 1.0 / recording.rate_hz)
    trust = ACC_BIAS**2 / (ACC_BIAS**2 + (_speed_at_stops(stops) / dwell) ** 2)
    shown = trust[:, None] * np.array([a_nav[_inner(stop, recording.t)].mean(axis=0) for stop in stops])
    following = np.vstack((shown[1:], shown[-1:]))[legs.of_row]
    held: Array = a_nav - shown[legs.of_row] - legs.share[:, None] * (following - shown[legs.of_row])
    return held
