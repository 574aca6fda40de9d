"""Between two stops both ends are known: attitude and acceleration are made to agree with what the stops say."""

from __future__ import annotations

import numpy as np

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
from pbd.tracking.integration import integral_of_means
from pbd.tracking.lag import LAG_S, advance, find_lag, lag_acceleration
from pbd.tracking.legs import GYRO_BIAS, GYRO_SCALE, VQF_FLOOR, Legs, find_legs, inside
from pbd.tracking.orientation import TAU_ACC_S, turns_between_middles
from pbd.tracking.rest import Rest

TILT_FLOOR = np.radians(0.05)
"""rad: no rest tells the vertical better than this."""

HEADING_SIGMA = np.radians(1.0)
"""rad: of VQF's heading from one stop to another; a magnetic field is seldom uniform over half a metre."""

BIAS_S = 30.0
"""A gyro's bias stays about the same for this long."""

LONG_STOP_S, EXACT_RATE = 0.5, 1e-6
"""Only a stop this long tells the gyro's bias, and none better than this (rad/s)."""

ACC_ERROR = 0.05
"""m/s2: by how much the mean of the accelerometer over a move may be wrong, beside its noise."""

ACC_AT_REST = 0.3
"""m/s2: a sensor's bias and scale may show this much acceleration at rest."""

STOPS_TO_LEARN = 10.0
"""After so many stops what they show counts for as much as ACC_AT_REST."""


def smooth_motion(
    recording: Recording, attitude: Attitude, a_nav: Array, stops: tuple[Stop, ...], rest: Rest
) -> tuple[Attitude, Array]:
    """Attitude and motion acceleration (n, 3) m/s2 in nav once the stops are known, from those they were found with.

    Linear least squares over a small tilt at each stop. It weighs

    - the turn from stop to stop by the gyro,
    - gravity, as the accelerometer shows it at each stop (the longer and the calmer, the surer),
    - the closure of each move: a tilt makes gravity look like motion, and the velocity is zero at both ends,
    - VQF's own tilt.

    In between the gyro carries the attitude, and what it misses at the far end is shared out by where it arose; in a
    long move, in which the gyro gets lost, VQF takes over by its own uncertainty. The acceleration that the stops still
    show (bias and scale of the sensor) is taken out in between, and last the gyro's lag behind the accelerometer.

    The least squares is linear, so that its cost is the lowest by construction. Without a gyro the attitude stays as it
    is.
    """
    if not stops:
        return attitude, a_nav
    legs = find_legs(recording, attitude, a_nav, stops, rest)
    if recording.gyr is None:
        return attitude, _zero_at_stops(recording.t, a_nav, stops, legs)
    wxyz, rate = _hold_tilt(recording, attitude, stops, rest, legs), recording.gyr - attitude.gyro_bias
    a_nav = motion_acceleration(recording, Attitude(wxyz, attitude.gyro_bias), rest.gravity)
    by_lag = lag_acceleration(wxyz, rate, recording.acc)
    a_nav = _zero_at_stops(recording.t, a_nav + LAG_S * by_lag, stops, legs)
    lag = find_lag(recording.t, a_nav, by_lag, stops, rest, legs)
    return Attitude(advance(wxyz, rate, lag), attitude.gyro_bias), a_nav + (lag - LAG_S) * by_lag


def _hold_tilt(recording: Recording, attitude: Attitude, stops: tuple[Stop, ...], rest: Rest, legs: Legs) -> Array:
    """Return wxyz_nav_sensor (n, 4)."""
    assert recording.gyr is not None
    t, middles, leg = recording.t, legs.middles, legs.of_row
    rate = recording.gyr - _steady(attitude.gyro_bias, t)
    turns = turns_between_middles(t, rate - _bias_left(rate, stops, t), 1.0 / recording.rate_hz)
    carried = quat_cumulative(quat_exp(turns))
    at_stops = attitude.wxyz_nav_sensor[middles]
    start = quat_multiply(at_stops, quat_inverse(carried[middles]))
    missed = quat_log(quat_multiply(quat_multiply(start[:-1], carried[middles[1:]]), quat_inverse(at_stops[1:])))
    wxyz = quat_multiply(start[leg], carried)
    wxyz = quat_multiply(quat_exp(-_shared(missed, legs)), wxyz)

    tilt = _tilt_at_stops(t, quat_rotate(wxyz, recording.acc), missed[:, :2], stops, rest, legs)
    heading = _heading_at_stops(missed[:, 2:], legs)
    wxyz = quat_multiply(quat_exp(_between(np.hstack((tilt, heading)), legs)), wxyz)

    # Far from its stops the gyro is less sure than VQF.
    variance = _shared(legs.gyro[:, None], legs)[:, 0] * (1.0 - legs.share)
    for outside, middle in ((t < t[middles[0]], middles[0]), (t > t[middles[-1]], middles[-1])):
        away_s, away_rad = t[outside] - t[middle], np.abs(legs.turned[outside] - legs.turned[middle])
        variance[outside] = (GYRO_BIAS * away_s) ** 2 + GYRO_SCALE**2 * away_rad
    # VQF needs its time constant to see a tilt again.
    to_stop = np.min([np.abs(t - t[middles[i]]) for i in (leg, np.minimum(leg + 1, len(stops) - 1))], axis=0)
    seen = 1.0 - np.exp(-to_stop / TAU_ACC_S)
    vqf = np.append(legs.vqf, VQF_FLOOR**2)[leg]
    share = variance * seen**2 / (variance * seen**2 + vqf)
    to_vqf = quat_log(quat_multiply(attitude.wxyz_nav_sensor, quat_inverse(wxyz)))
    return quat_canonical(quat_multiply(quat_exp(share[:, None] * to_vqf), wxyz))


def _steady(bias: Array, t: Array) -> Array:
    """Mean over BIAS_S on either hand: VQF's bias follows the motion a little, a gyro's does not."""
    first, last = np.searchsorted(t, t - BIAS_S), np.searchsorted(t, t + BIAS_S, side="right")
    sums = np.vstack((np.zeros((1, 3)), np.cumsum(bias, axis=0)))
    mean: Array = (sums[last] - sums[first]) / (last - first)[:, None]
    return mean


def _bias_left(rate: Array, stops: tuple[Stop, ...], t: Array) -> Array:
    """What VQF has left of the gyro's bias, (3,) rad/s: the mean rate over the long stops, each weighed by its calm.

    A stop of T seconds in which the sensor sways by an angle w about its mean turn shows the bias to 2 w / T only.
    """
    known, weight = np.zeros(3), 1.0 / GYRO_BIAS**2
    for stop in stops:
        if stop.dwell_s < LONG_STOP_S:
            continue
        rows = inside(stop, t)
        mean = rate[rows].mean(axis=0)
        sway = np.cumsum(rate[rows] - mean, axis=0) / (stop.stop - stop.start)  # w / T
        calm = 1.0 / (4.0 * float((sway**2).max()) + EXACT_RATE**2)
        known, weight = known + calm * mean, weight + calm
    bias: Array = known / weight
    return bias


def _heading_at_stops(missed: Array, legs: Legs) -> Array:
    """By how much VQF's heading at each stop, (k, 1) rad, is off what the gyro says from stop to stop."""
    from scipy.linalg import solveh_banded

    by_gyro = missed / legs.gyro[:, None]
    known = np.append(-by_gyro, 0.0)[:, None] + np.append(0.0, by_gyro)[:, None]
    weight = np.append(1.0 / legs.gyro, 0.0) + np.append(0.0, 1.0 / legs.gyro)
    diagonal = weight + 1.0 / HEADING_SIGMA**2
    if len(diagonal) == 1:
        return np.zeros((1, 1))
    return np.asarray(solveh_banded(np.vstack((np.append(0.0, -1.0 / legs.gyro), diagonal)), known))


def _tilt_at_stops(t: Array, f_nav: Array, missed: Array, stops: tuple[Stop, ...], rest: Rest, legs: Legs) -> Array:
    """Angles (k, 2) rad, about nav's x and y, by which the attitude at each stop is wrong.

    With e the tilt, specific force in nav at rest is g z - e x g z, so that e = (f_y, -f_x) / g; the same holds for the
    mean over a move that begins and ends with velocity zero.

    Args:
        t: (n,) s.
        f_nav: (n, 3) m/s2 specific force by the attitude that is to be corrected.
        missed: (k - 1, 2) rad, by how much the gyro missed each next stop.
        stops: in order.
        rest: for gravity.
        legs: between the stops.
    """
    from scipy.linalg import solveh_banded

    g, k = rest.gravity, len(stops)
    interval = float(np.median(np.diff(t)))
    dwell = np.maximum([stop.dwell_s for stop in stops], interval)
    f = np.array([f_nav[inside(stop, t)].mean(axis=0) for stop in stops])
    at_rest = 1.0 / ((legs.speed / (g * dwell)) ** 2 + TILT_FLOOR**2)
    diagonal, known = at_rest.copy(), at_rest[:, None] * _tilt_of(f / g)
    if k == 1:
        alone: Array = known / diagonal[:, None]
        return alone
    # VQF's tilt at a stop is as bad as on the worse of its legs.
    diagonal += 1.0 / np.maximum(np.append(legs.vqf, 0.0), np.append(0.0, legs.vqf))

    start, end = np.array([stop.stop - 1 for stop in stops[:-1]]), np.array([stop.start for stop in stops[1:]])
    duration = t[end] - t[start]
    gain = integral_of_means(t, f_nav)
    bend = np.cumsum((np.diff(f_nav, n=2, axis=0, prepend=f_nav[:1], append=f_nav[-1:]) ** 2).sum(axis=1))
    unseen = legs.speed[:-1] ** 2 + legs.speed[1:] ** 2 + interval**2 / 12.0 * (bend[end] - bend[start])
    of_move = 1.0 / (unseen / (g * duration) ** 2 + (ACC_ERROR / g) ** 2)
    late = np.add.reduceat(legs.share, np.column_stack((start, end)).ravel())[::2] / (end - start)
    by_closure = (of_move / (g * duration))[:, None] * _tilt_of(gain[end] - gain[start])

    by_gyro = missed / legs.gyro[:, None]
    diagonal[:-1] += of_move * (1.0 - late) ** 2 + 1.0 / legs.gyro
    diagonal[1:] += of_move * late**2 + 1.0 / legs.gyro
    beside = np.append(0.0, of_move * (1.0 - late) * late - 1.0 / legs.gyro)
    known[:-1] += (1.0 - late)[:, None] * by_closure - by_gyro
    known[1:] += late[:, None] * by_closure + by_gyro
    tilt: Array = solveh_banded(np.vstack((beside, diagonal)), known)
    return tilt


def _tilt_of(level: Array) -> Array:
    """(k, 3) -> (k, 2): the rotation that makes a nearly vertical vector vertical, for one of unit length."""
    return np.column_stack((level[:, 1], -level[:, 0]))


def _zero_at_stops(t: Array, a_nav: Array, stops: tuple[Stop, ...], legs: Legs) -> Array:
    """Take out the acceleration that the stops show, between two of them by how far the hand has turned."""
    dwell = np.maximum([stop.dwell_s for stop in stops], np.median(np.diff(t)))
    shaken = (legs.speed / dwell) ** 2
    shown = np.array([a_nav[inside(stop, t)].mean(axis=0) for stop in stops])
    # How much a sensor shows that is not shaken, its stops tell themselves, the calm ones above all.
    calm = 1.0 / (1.0 + shaken / ACC_AT_REST**2) ** 2
    own = float(calm @ np.maximum((shown**2).mean(axis=1) - shaken, 0.0))
    usual = (STOPS_TO_LEARN * ACC_AT_REST**2 + own) / (STOPS_TO_LEARN + calm.sum())
    shown /= (1.0 + shaken / usual)[:, None]
    held: Array = a_nav - _between(shown, legs)
    return held


def _between(at_stops: Array, legs: Legs) -> Array:
    """Interpolate (k, m) between the stops by the legs' shares -> (n, m)."""
    return at_stops[legs.of_row] + _shared(np.diff(at_stops, axis=0), legs)


def _shared(of_legs: Array, legs: Legs) -> Array:
    """What has arisen by each row of a figure of its leg: (k - 1, m) -> (n, m)."""
    if len(of_legs) == 0:
        return np.zeros((len(legs.share), of_legs.shape[1]))
    return legs.share[:, None] * of_legs[legs.of_row]
