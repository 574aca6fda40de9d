"""Estimate the hand's path from a repaired recording: the default method of `track`."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from pbd.data import ErrorEstimate, Recording, SensorEstimate, Stop
from pbd.data.covariance import PoseCovariance
from pbd.errors import TrackingError
from pbd.pose import Array, lengths, quat_inverse, quat_log, quat_multiply
from pbd.tracking.first_rest import REST_S, Rest
from pbd.tracking.noise import OUTLIER_SIGMAS, Noise, acc_sigma_factor
from pbd.tracking.smoother.doubtful_stops import stop_weights
from pbd.tracking.smoother.normal_equations import STATE, STATE_ACC_BIAS, STATE_GYR_BIAS, Solved
from pbd.tracking.smoother.path import SensorPath, between_stops
from pbd.tracking.smoother.preintegration import ACC_MATRIX, GYR_MATRIX, LAG, POS, ROT, LostMotion, integral_of_means
from pbd.tracking.smoother.smooth import Solution, smooth
from pbd.tracking.smoother.state import lower_matrix
from pbd.tracking.smoother.variance_components import with_own_noise

BOUNCE_S, BOUNCE_M, BOUNCE_RAD = 0.3, 0.02, np.radians(10.0)
"""Two stops are one put-down that bounced if the gap between them and the shorter stop each last less than BOUNCE_S (s)
and the sensor moved less than BOUNCE_M (m) and turned less than BOUNCE_RAD (rad) from one to the other."""

GRIP_S = 0.8
"""Longest gap, s, between two stops that a grip joins, marked in the gap or up to this long before it: the fingers
close, or tap twice (taps.py)."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """The hand's path, its stops, and the covariance of the poses at them.

    Attributes:
        path: at each row; the position is constant in a stop.
        stops: k stops, in order.
        closure: (k - 1, 3) m/s, velocity misclosure: integral of each move's acceleration, zero without errors.
        covariance: joint covariance of the poses at the stops.
        solution: the smoother's, after `with_own_noise`; None with the paper's method.
        sensor: the sensor's errors; None: not estimated.
    """

    path: SensorPath
    stops: tuple[Stop, ...]
    closure: Array
    covariance: PoseCovariance
    solution: Solution | None = None
    sensor: SensorEstimate | None = None


def estimate(
    recording: Recording,
    rest: Rest,
    noise: Noise,
    lost_motion: Sequence[LostMotion] = (),
    gaps: Sequence[tuple[int, int]] = (),
    still_gaps: Sequence[tuple[int, int]] = (),
) -> Estimate:
    """Smooth a recording; return path, stops and covariance. The arguments are those of `smooth`.

    Raises:
        TrackingError: the hand never stands still, or not where the sensor seems to rest.
    """
    solution = smooth(recording, rest, noise, lost_motion, gaps, still_gaps=still_gaps)
    if solution is None:
        raise TrackingError("the hand never stands still; stop for half a second between the moves")
    t, problem = recording.t, solution.problem
    weights = stop_weights(problem, solution.state).tolist()
    believed = [k for k, weight in enumerate(weights) if weight]
    if not believed:
        refuse_doubted_rest(t, rest, ())
    joined = _join_stops(solution, believed, [event.t for event in recording.grip])
    stops = tuple(
        Stop(start, stop, float(t[stop - 1] - t[start]), max(weights[k] for k in parts))
        for parts in joined
        for start, stop in ((problem.stops[parts[0]][0], problem.stops[parts[-1]][1]),)
    )
    in_stops = np.flatnonzero(np.isin(problem.stop_of, believed))
    first = np.searchsorted(problem.stop_of[in_stops], [parts[0] for parts in joined])
    end = np.searchsorted(problem.stop_of[in_stops], [parts[-1] for parts in joined], "right")
    knots = in_stops[(first + end - 1) // 2].tolist()
    # Nav's origin is in the last second of the first rest, or of its part before a gap in the data: what the hand
    # creeps in a long wait is no error of the moves.
    begin = int(in_stops[first[0]])
    leaves = begin + int(np.argmin(np.append(problem.same_stop[begin:], False)))
    knots[0] = max((begin + leaves) // 2, int(np.searchsorted(problem.t, problem.t[leaves] - REST_S)))
    sensor = None if problem.no_gyro else _sensor_estimate(solution, begin)
    solution = with_own_noise(solution)
    p_stop = solution.state.p[knots] - solution.state.p[knots[0]]
    of_knots = solution.solved, knots, p_stop
    functions = _covariance_times, _each_covariance, _move_covariance
    covariance = PoseCovariance(len(knots), *(partial(function, *of_knots) for function in functions))
    v = integral_of_means(t, solution.path.a)
    return Estimate(
        _with_still_stops(solution, stops, joined, solution.state.p[knots]),
        stops,
        np.array([v[after.start] - v[before.stop - 1] for before, after in pairwise(stops)]).reshape(-1, 3),
        covariance,
        solution,
        sensor,
    )


def refuse_doubted_rest(t: Array, rest: Rest, stops: Sequence[Stop]) -> None:
    """Refuse a recording whose first rest is no stop, because another stop would be taken for the dock.

    Raises:
        TrackingError: with the time of that rest.
    """
    if any(stop.start < rest.stop and rest.start < stop.stop for stop in stops):
        return
    raise TrackingError(
        f"the sensor seems to rest from {t[rest.start]:.1f} to {t[rest.stop - 1]:.1f} s, but the stops beside it "
        "contradict this: the hand coasts there, or one of the channels is wrong; start with two seconds of rest, and "
        "check the sensor with pbd calibrate sensor",
        row=rest.start,
        t=float(t[rest.start]),
    )


def _sensor_estimate(solution: Solution, first: int) -> SensorEstimate:
    """The sensor's errors, including those removed before smoothing; biases are those at the knot `first`."""
    solved, x, noise, rest = solution.solved, solution.state, solution.problem.noise, solution.problem.rest
    sensor, acc_factor, removed = noise.sensor, acc_sigma_factor(noise, rest), solution.removed
    sigma = np.sqrt(np.diagonal(solved.shared))
    biases = slice(STATE_GYR_BIAS.start, STATE_ACC_BIAS.stop)
    of_biases = np.sqrt(np.diagonal(solved.covariance_of_knots(biases)[first]))
    acc_scale, lag_sigma, none = acc_factor * sensor.acc_scale, np.array(solution.fixed.prior.lag_sigma), np.array(0.0)
    M = x.shared[GYR_MATRIX].reshape(3, 3) - removed.scale * np.eye(3)
    N = lower_matrix(x.shared[ACC_MATRIX])
    return SensorEstimate(
        ErrorEstimate(rest.gyro_bias + x.gyr_bias[first], of_biases[:3], rest.gyro_bias, np.array(noise.gyr_bias)),
        ErrorEstimate(M, sigma[GYR_MATRIX].reshape(3, 3), none, np.array(sensor.gyr_scale)),
        ErrorEstimate(x.acc_bias[first], of_biases[3:], none, np.array(acc_factor * sensor.acc_bias)),
        ErrorEstimate(N, lower_matrix(sigma[ACC_MATRIX], acc_scale), none, np.array(acc_scale)),
        ErrorEstimate(removed.lag + x.shared[LAG][0], sigma[LAG][0], np.array(noise.lag), lag_sigma),
    )


def _join_stops(solution: Solution, believed: Sequence[int], grips: Sequence[float]) -> list[list[int]]:
    """Join stops that are parts of one: groups of indices into `problem.stops`.

    Two stops are joined if the hand stayed where it was, or if a knock or one of the `grips` (s) divides them and the
    hand is where it was (beside a grip: or near there, if it sways in one of the stops). Of a put-down that bounced
    only the longer stop is kept.
    """
    problem, t, p = solution.problem, solution.problem.frame.t, solution.state.p
    wxyz = solution.path.wxyz[[(start + stop) // 2 for start, stop in problem.stops]]
    joined = [[believed[0]]]
    for k in believed[1:]:
        before = joined[-1][-1]
        (begun, left), (arrived, gone) = t[np.array([problem.stops[before], problem.stops[k]]) - (0, 1)]
        short_gap = arrived - left < BOUNCE_S
        gripped = has_grip(left, arrived, grips)
        p_before, p_k = (np.median(p[problem.stop_of == stop], axis=0) for stop in (before, k))
        between = slice(problem.stops[before][1], problem.stops[k][0])
        moved, turned = _farthest(p_k[None], wxyz[k : k + 1], p_before, wxyz[before])
        away = _farthest(solution.path.p[between], solution.path.wxyz[between], p_before, wxyz[before])
        returned = (short_gap or gripped) and is_where_it_was(moved, turned)
        sways = gripped and not all(is_where_it_was(*_sway(solution.path, problem.stops[i])) for i in (before, k))
        stayed = returned or sways or is_where_it_was(*away)
        bounced = short_gap and min(left - begun, gone - arrived) < BOUNCE_S
        if not (bounced or stayed) or moved > BOUNCE_M or turned > BOUNCE_RAD:
            joined.append([k])
        elif gripped or not bounced:
            joined[-1].append(k)
        elif gone - arrived > left - begun:
            joined[-1][-1] = k
    return joined


def _farthest(p: Array, wxyz: Array, from_p: Array, from_wxyz: Array) -> tuple[float, float]:
    """Largest distance (m) and angle (rad) of poses p (n, 3) and wxyz (n, 4) from one pose; zeros if there is none."""
    turns = quat_log(quat_multiply(wxyz, quat_inverse(from_wxyz)))
    return float(lengths(p - from_p).max(initial=0.0)), float(lengths(turns).max(initial=0.0))


def _sway(path: SensorPath, stop: tuple[int, int]) -> tuple[float, float]:
    """How far (m) and by how much (rad) the hand sways in a stop, from its middle."""
    p, wxyz = path.p[slice(*stop)], path.wxyz[slice(*stop)]
    return _farthest(p, wxyz, np.median(p, axis=0), wxyz[len(wxyz) // 2])


def has_grip(left: float, arrived: float, grips: Sequence[float]) -> bool:
    """Whether the gap between two stops, from `left` to `arrived` s, belongs to one of the `grips` (s)."""
    return arrived - left < GRIP_S and any(left - GRIP_S < at <= arrived for at in grips)


def is_where_it_was(moved: float, turned: float) -> bool:
    """Whether a displacement (m) and a turn (rad) are so small that the hand stood still, except for a knock."""
    max_shift = OUTLIER_SIGMAS * Noise.still_shift
    return moved < max_shift and turned < max_shift / Noise.pivot_distance


def _with_still_stops(
    solution: Solution, stops: Sequence[Stop], joined: Sequence[Sequence[int]], p_stop: Array
) -> SensorPath:
    """The path relative to the first stop, with each stop at one place: `p_stop` (k, 3) m.

    How far a stop creeps is distributed over the moves beside it. Between joined parts that were shaken, attitude is
    held.
    """
    path, t = solution.path, solution.problem.frame.t
    p, places = path.p - p_stop[0], p_stop - p_stop[0]
    first, last = (places - p[rows] for rows in ([stop.start for stop in stops], [stop.stop - 1 for stop in stops]))
    shift, faster = between_stops(t, stops, first, last)
    p, v, wxyz = p + shift, path.v + faster, path.wxyz.copy()
    for stop, parts, place in zip(stops, joined, places, strict=True):
        p[stop.start : stop.stop], v[stop.start : stop.stop] = place, 0.0
        for (_, left), (arrived, _) in pairwise(solution.problem.stops[k] for k in parts):
            shaken = _farthest(path.p[left:arrived], path.wxyz[left:arrived], path.p[left - 1], path.wxyz[left - 1])
            if not is_where_it_was(*shaken):
                wxyz[left:arrived] = wxyz[left - 1]
    return SensorPath(wxyz, v, p, path.a)


def _covariance_times(solved: Solved, knots: Sequence[int], p: Array, columns: Array) -> Array:
    """Joint covariance of the poses at k knots, times columns (k, 6, c).

    It is relative to the position and heading of the first pose, which define nav; p (k, 3) m are the positions there.
    """
    relative = relative_to_first(columns, p, transposed=True)
    right = np.zeros((len(solved.scale), STATE, columns.shape[2]))
    right[knots, POS], right[knots, ROT] = relative[:, :3], relative[:, 3:]
    left = solved.covariance_times(right)[knots]
    return relative_to_first(np.concatenate((left[:, POS], left[:, ROT]), axis=1), p)


def _each_covariance(solved: Solved, knots: Sequence[int], p: Array) -> Array:
    """The diagonal blocks (k, 6, 6) of the matrix that `_covariance_times` multiplies by."""
    order = np.r_[POS, ROT]
    own = solved.covariance_of_knots(slice(ROT.start, POS.stop))[knots][:, order[:, None], order]
    turn, with_first = _by_first(p), _covariance_with_first(solved, knots)
    covariance = _made_relative(own, turn, with_first, with_first[0])
    rest = np.eye(6) + turn[0]  # of the first pose only the tilt remains: no rounding there
    covariance[0] = rest @ with_first[0] @ rest.T
    return covariance


def _move_covariance(solved: Solved, knots: Sequence[int], p: Array) -> Array:
    """Covariance (k - 1, 3, 3) of the displacements between the poses whose covariance `_covariance_times` multiplies
    by."""
    with_first = _covariance_with_first(solved, knots)
    turn, moved_with_first = (np.diff(each[:, :3], axis=0) for each in (_by_first(p), with_first))
    return _made_relative(solved.covariance_of_moves(knots, POS), turn, moved_with_first, with_first[0])


def _covariance_with_first(solved: Solved, knots: Sequence[int]) -> Array:
    """Covariance (k, 6, 6) of the pose at each knot with the pose at the first one."""
    first = np.zeros((len(solved.scale), STATE, 6))
    first[knots[0], POS, :3] = first[knots[0], ROT, 3:] = np.eye(3)
    return solved.covariance_times(first)[knots][:, np.r_[POS, ROT]]


def _made_relative(own: Array, turn: Array, with_first: Array, of_first: Array) -> Array:
    """Covariance (k, c, c) of errors to which `turn` (k, c, 6) times that of the first pose is added."""
    crossed = with_first @ turn.transpose(0, 2, 1)
    relative: Array = own + crossed + crossed.transpose(0, 2, 1) + turn @ of_first @ turn.transpose(0, 2, 1)
    return relative


def _by_first(p: Array) -> Array:
    """How the error of the first pose changes each relative pose, (k, 6, 6); see `relative_to_first`."""
    turn = np.zeros((len(p), 6, 6))
    turn[:, :3, :3] = -np.eye(3)
    turn[:, :3, 5] = -np.cross((0.0, 0.0, 1.0), p)
    turn[:, 5, 5] = -1.0
    return turn


def relative_to_first(columns: Array, p: Array, transposed: bool = False) -> Array:
    """Map errors (k, 6, c) of position and rotation to those relative to the first pose; or apply the transposed map.

    A heading error h of the first pose turns all of nav: p - h z x p. Its tilt remains, because gravity shows it.
    """
    turn, out = _by_first(p), columns.copy()
    if transposed:
        out[0] += np.einsum("kij,kic->jc", turn, columns)
    else:
        out += turn @ columns[0]
    return out
