"""Smooth a whole recording: the most probable motion and its covariance, by Gauss-Newton over the knots.

A false stop (a hand that coasts) would bend the whole path. So zero velocity is a robust factor whose sigma starts
large and shrinks (graduated non-convexity). Large errors of the sensor are removed from the samples, then stops are
revised.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pbd.data import Recording
from pbd.data.streams import interpolate
from pbd.pose import Array, lengths, quat_about_z, quat_inverse, quat_multiply, quat_rotate, quat_to_matrix
from pbd.tracking.first_rest import QUIET_GYR, Rest
from pbd.tracking.moving_windows import Spans, cumulative
from pbd.tracking.noise import Noise
from pbd.tracking.smoother.attitude import gyro_frame_of, heading, level_at_stops
from pbd.tracking.smoother.doubtful_stops import doubted_stops, revised_stops, settled, stop_weights
from pbd.tracking.smoother.factors import shared_prior, shows_north
from pbd.tracking.smoother.gauss_newton import Descent, descend
from pbd.tracking.smoother.knots import STOP_KNOT_S, Problem, Samples, build_problem, mean_around
from pbd.tracking.smoother.large_errors import LargeErrors, find_large_errors
from pbd.tracking.smoother.normal_equations import Solved
from pbd.tracking.smoother.path import SensorPath, path_of
from pbd.tracking.smoother.preintegration import LAG, LostMotion
from pbd.tracking.smoother.state import SHARED, SHARED_GRAVITY, Fixed, Prior, State
from pbd.tracking.zero_velocity import ENERGY_WINDOW_S, at_rows, energies, find_candidates, zero_velocity_sigma

ANNEALING = (20.0, 3.0)
"""Factors on a stop's velocity sigma before it has its own size. From an earlier solution only the last is used."""

MAX_RECUTS = 5
"""Largest number of times that stops are revised."""

WIDE_SCALE_SIGMA = 0.15
"""One sigma of the wide prior of a scale error common to the gyro's axes. A wrong clock looks like such an error."""


@dataclass(frozen=True, eq=False)
class Solution:
    """The smoother's estimate of a recording.

    Attributes:
        problem: knots and measurements; its stops are the ones of the last iteration.
        state: the estimate at the knots.
        fixed: what the iterations hold fixed.
        still_weight: (m,) 0 to 1, robust weight of the zero-velocity factor at each knot.
        solved: the factorised normal equations: the covariance.
        path: the estimate at each row.
        removed: the sensor's errors that were removed from the samples.
        candidates: spans that looked still, accepted or not.
        converged: whether the iterations converged.
        leg_residuals: the legs' whitened residuals (m - 1, 9), and the covariance (m - 1, 9, 9) of their predictions by
            the estimate; None before `with_own_noise`.
        leg_drifts: (2, 2, m - 1), of the biases of gyro and accelerometer: the legs' squared changes, whitened, and
            what these should be.
    """

    problem: Problem
    state: State
    fixed: Fixed
    still_weight: Array
    solved: Solved
    path: SensorPath
    removed: LargeErrors
    candidates: Spans
    converged: bool
    leg_residuals: tuple[Array, Array] | None = None
    leg_drifts: Array | None = None


def smooth(
    recording: Recording,
    rest: Rest,
    noise: Noise,
    lost_motion: Sequence[LostMotion] = (),
    gaps: Sequence[tuple[int, int]] = (),
    extra_rows: Sequence[int] = (),
    still_gaps: Sequence[tuple[int, int]] = (),
) -> Solution | None:
    """Estimate the motion of a repaired recording; None if there is no stop.

    Args:
        recording, rest, noise: without NaN; its first rest; of the sensor and the hand.
        lost_motion: what clipped samples hide.
        gaps: last row before and first row after each gap in the data in which the hand may have moved.
        extra_rows: rows at which a knot is wanted.
        still_gaps: the same as `gaps`, of those in which the hand stood still.

    Raises:
        TrackingError: there is neither a gyro nor the device's attitude.
    """
    # A knot right after lost motion: the unknown turn is too large to linearise over a longer leg.
    extra_rows = [*extra_rows, *(min(lost.row + 1, len(recording) - 1) for lost in lost_motion)]
    wide = _solve_with_wide_prior(recording, rest, noise, lost_motion, gaps, extra_rows, still_gaps)
    if wide is None:
        return None
    samples, candidates, removed, problem, found, fixed = wide
    del wide  # of a long recording it is large
    narrow = Prior(noise.lag if removed.lag == 0.0 else 0.0, noise.lag_sigma)
    # The model is linear in lag and scale, so the prior can be exchanged without a new linearisation.
    change = shared_prior(problem, found.at, narrow) - shared_prior(problem, found.at, fixed.prior)
    found, fixed = replace(found, solved=found.solved.plus(change)), replace(fixed, prior=narrow)
    x = found.x
    if recording.mag is not None and shows_north(fixed.dip):
        x, fixed = _with_first_field_north(problem, x, fixed, recording.mag)
    if x is not found.x or not found.converged:
        found = descend(problem, x, fixed)
    path, cut = path_of(problem, found.x), np.zeros(len(candidates), dtype=np.bool_)
    recuts = MAX_RECUTS
    while True:
        if recuts:
            recuts -= 1
            cut = cut | doubted_stops(problem, path.v, found.still_weight, candidates, samples.still_sigma)
            all_gaps = (*samples.gaps, *samples.still_gaps)
            stops = revised_stops(problem, path.v, found.solved, candidates, cut, samples.still_sigma, all_gaps)
            if not stops or settled(problem.frame.t, problem.stops, stops):
                problem, recuts = replace(problem, stops=stops or problem.stops), 0
                continue
        else:  # a small weight of a small sigma still holds the hand, so what is no stop is left out
            stops = [stop for stop, weight in zip(problem.stops, stop_weights(problem, found.x), strict=True) if weight]
            if len(stops) in (0, len(problem.stops)):
                break
        found.solved.forget()
        revised = build_problem(samples, stops)
        if not revised.stops:
            break
        rows, fixed = revised.rows, replace(fixed, origin=_origin_knot(revised))
        E = quat_to_matrix(quat_multiply(path.wxyz[rows], quat_inverse(revised.frame.wxyz[rows])))
        k, before = np.searchsorted(problem.rows, rows), found.x
        x = State(E, path.v[rows], path.p[rows], before.gyr_bias[k], before.acc_bias[k], before.shared)
        problem = revised
        del found, path, before  # large too
        found = descend(problem, x, fixed, ANNEALING[-1:])
        path = path_of(problem, found.x)
    return Solution(
        *(problem, found.x, fixed, found.still_weight, found.solved, path, removed, candidates, found.converged)
    )


def _solve_with_wide_prior(
    recording: Recording,
    rest: Rest,
    noise: Noise,
    lost_motion: Sequence[LostMotion],
    gaps: Sequence[tuple[int, int]],
    extra_rows: Sequence[int],
    still_gaps: Sequence[tuple[int, int]],
) -> tuple[Samples, Spans, LargeErrors, Problem, Descent, Fixed] | None:
    """Solve with wide priors of lag and scale, and anew each time that this shows large errors: they are removed.

    Also returns the samples without these errors, and the spans that look still; None if there is no stop.
    """
    removed, prior = LargeErrors(), Prior(noise.lag, noise.wide_lag_sigma, WIDE_SCALE_SIGMA)
    stops: Spans | None = None
    drift: Array | float = 0.0  # rad/s, of the gyro's bias since the first rest
    no_gyro = recording.gyr is None
    for passes_left in (3, 2, 1, 0):  # each solution may show large errors that the one before hid
        without = removed.removed_from(recording)
        frame = gyro_frame_of(without, rest.gyro_bias * (1.0 + removed.scale))
        window = min(max(2, round(ENERGY_WINDOW_S / frame.dt)), len(frame.t))
        # The device's own attitude follows a turn late. So without a gyro, specific force is judged in sensor axes.
        force, rate = (frame.acc, np.zeros_like(frame.acc)) if no_gyro else (frame.u, frame.gyr)
        energy = energies(force, rate - drift, window)
        if stops is None:
            stops = find_candidates(frame.t, frame.dt, energy, rest, gaps)
        still_sigma = at_rows(zero_velocity_sigma(energy, frame.dt, noise), len(frame.t))
        del energy  # of a long recording it is large
        samples = Samples(
            *(frame, rest, noise, stops, without.mag, still_sigma, extra_rows, lost_motion, gaps, still_gaps, no_gyro)
        )
        problem = build_problem(samples, stops)
        if not problem.stops:
            return None
        initial, fixed = _initial_state(problem, prior)
        found = descend(problem, initial, fixed, ANNEALING)
        if not passes_left:
            break
        if np.abs(found.x.gyr_bias).max() > 0.5 * QUIET_GYR:  # later rests may seem to turn
            drift = interpolate(frame.t, problem.t, found.x.gyr_bias)
            more = find_candidates(frame.t, frame.dt, energies(force, rate - drift, window), rest, gaps)
            if sum(stop - start for start, stop in more) > sum(stop - start for start, stop in stops):
                stops = more
                continue
        large = find_large_errors(problem, found, None if no_gyro else recording.mag, removed)
        if large is None:
            break
        removed = large
    return samples, stops or Spans(), removed, problem, found, fixed


def _with_first_field_north(problem: Problem, x: State, fixed: Fixed, mag: Array) -> tuple[State, Fixed]:
    """Turn nav until its y is where the field `mag` (n, 3) as measured points at the first rest.

    A calibration relies on it. Where a room's field points elsewhere at other stops, nav has turned to the mean.
    """
    frame = problem.frame
    measured = mean_around(quat_rotate(frame.wxyz, mag), problem.rows, round(STOP_KNOT_S / frame.dt))
    east, north, _ = _first_field(problem, x.E, measured)
    off = float(np.arctan2(east, north))
    Rz = quat_to_matrix(quat_about_z(off))
    return replace(x, E=Rz @ x.E, v=x.v @ Rz.T, p=x.p @ Rz.T), replace(fixed, azimuth=-off)


def _origin_knot(problem: Problem) -> int:
    """The knot in the middle of the first stop."""
    return int(np.median(np.flatnonzero(problem.stop_of == 0)))


def _initial_state(problem: Problem, prior: Prior) -> tuple[State, Fixed]:
    """Initial state: dead reckoning, levelled by `level_at_stops`, with nav's heading."""
    m, origin = len(problem.rows), _origin_knot(problem)
    strength, dip = 0.0, 0.5 * np.pi
    if problem.no_gyro:
        E = np.tile(np.eye(3), (m, 1, 1))
    else:
        wxyz = level_at_stops(problem.frame, problem.rows, problem.stops)
        first = problem.stop_of == 0
        off = -heading(quat_multiply(wxyz[first], problem.frame.wxyz[problem.rows[first]]))
        if problem.field is not None:
            level = _first_field(problem, quat_to_matrix(wxyz), problem.field)
            strength = float(np.linalg.norm(level))
            dip = float(np.arctan2(level[2], np.hypot(level[0], level[1])))
            off = float(np.arctan2(level[0], level[1])) if shows_north(dip) else off
        E = quat_to_matrix(quat_multiply(quat_about_z(off), wxyz))
    none = np.zeros((m, 3))
    shared = np.zeros(SHARED)
    shared[LAG], shared[SHARED_GRAVITY] = prior.lag, problem.noise.gravity
    state = State(E, *_dead_reckoning(problem, E), none, none, shared)
    return state, Fixed(origin, strength, dip, 0.0, prior, np.ones(6))


def _dead_reckoning(problem: Problem, E: Array) -> tuple[Array, Array]:
    """Velocity (m, 3) and position (m, 3), integrated with attitudes E; the velocity's drift is linear between stops.

    From rest everywhere, the first step would turn the end of a long recording by radians.
    """
    legs, still = problem.legs, problem.stop_of >= 0
    T, up = legs.T[:, None], np.array([0.0, 0.0, problem.noise.gravity])
    gained = cumulative(np.einsum("kij,kj->ki", E[:-1], legs.dU) - up * T)
    drift = interpolate(problem.t, problem.t[still], gained[still])
    v = gained - drift
    way = np.einsum("kij,kj->ki", E[:-1], legs.dP) - 0.5 * up * T**2 - 0.5 * np.diff(drift, axis=0) * T
    return v, cumulative(v[:-1] * T + way)


def _first_field(problem: Problem, R: Array, field: Array) -> Array:
    """Mean of the field (m, 3) at the first stop with more than half its usual strength, turned by R (m, 3, 3).

    Some magnetometers wake up late.
    """
    level = np.einsum("kij,kj->ki", R, field)
    means = (level[problem.stop_of == k].mean(axis=0) for k in range(len(problem.stops)))
    usual = float(np.median(lengths(level)))
    return next((mean for mean in means if lengths(mean) > 0.5 * usual), np.array([0.0, 1.0, 0.0]))
