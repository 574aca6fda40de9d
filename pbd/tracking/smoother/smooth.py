"""The whole recording at once: the most probable motion, by Gauss-Newton over the knots, and how sure it is.

A false stop (a hand that coasts) would bend the whole path. So standing still is a robust factor whose sigma
starts large and shrinks (graduated non-convexity). The lag between the sensors and a common scale of the gyro
are found first, with wide priors, and removed from the samples if they are large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pbd.data import Recording
from pbd.pose import Array, lengths, quat_about_z, quat_inverse, quat_multiply, quat_to_matrix
from pbd.tracking.first_rest import Rest
from pbd.tracking.noise import OUTLIER_SIGMAS, Noise
from pbd.tracking.smoother.attitude import first_guess, frame_of, heading
from pbd.tracking.smoother.doubtful_stops import MAX_RECUTS, doubted_stops, revised_stops, settled
from pbd.tracking.smoother.factors import creep, shared_prior
from pbd.tracking.smoother.gauss_newton import ANNEALING, descend
from pbd.tracking.smoother.knots import Problem, pose_problem, row_noise
from pbd.tracking.smoother.normal_equations import Solved
from pbd.tracking.smoother.path import Path, path_of
from pbd.tracking.smoother.preintegration import GYR_MATRIX, LAG, Impulse
from pbd.tracking.smoother.state import GRAVITY, SHARED, Local, Prior, State
from pbd.tracking.zero_velocity import ENERGY_WINDOW_S, Spans, energies, find_candidates, still_speed

WIDE_LAG_SIGMA, REMOVED_LAG = 0.03, 0.005
"""Lag of the gyro, s: one sigma of the wide prior (filters of one chip); least lag that is taken out of the samples."""

WIDE_SCALE_SIGMA, REMOVED_SCALE, SCALE_OUTLIER_SIGMAS = 0.15, 0.05, 5.0
"""Scale common to the gyro's axes, a share: one sigma of the wide prior; least scale that is taken out of the samples,
and least ratio to its sigma. A wrong clock looks like such a scale."""


@dataclass(frozen=True, eq=False)
class Solution:
    """What the smoother makes of a recording.

    Attributes:
        problem: its knots and measurements; its stops are those that were believed.
        state: at the knots.
        local: the linearisation's constants.
        still: (m,) 0 to 1, how much each knot's standing still counts.
        solved: the covariance.
        path: at each row.
        lag: s, what has been taken out of the gyro's stamps.
        scale: share, what has been taken out of the gyro's readings, all axes alike.
        candidates: what looked still, accepted or not.
        legs: whitened residuals (m - 1, 9) of the legs, and the covariance (m - 1, 9, 9) of what is estimated of them.
    """

    problem: Problem
    state: State
    local: Local
    still: Array
    solved: Solved
    path: Path
    lag: float
    scale: float
    candidates: Spans
    legs: tuple[Array, Array] | None = None

    def stop_weights(self) -> Array:
        """Weight of each stop, 0 to 1: the largest robust weight of its knots."""
        at, weights = self.problem.stop_of >= 0, np.zeros(len(self.problem.stops))
        excess = lengths(creep(self.problem, self.state)[0][at]) ** 2 / self.problem.still[at] ** 2 - 3.0
        np.maximum.at(weights, self.problem.stop_of[at], 1.0 / (1.0 + np.maximum(excess, 0.0) / OUTLIER_SIGMAS**2) ** 2)
        return weights


def smooth(
    recording: Recording,
    rest: Rest,
    noise: Noise,
    impulses: Sequence[Impulse] = (),
    unseen: Sequence[tuple[int, int]] = (),
    asked: Sequence[int] = (),
) -> Solution | None:
    """Estimate the motion of a repaired recording; None where there is no stop.

    Args:
        recording: without NaN.
        rest: a quiet second.
        noise: parameters.
        impulses: motion lost above a sensor's range.
        unseen: first and last row of each hole.
        asked: rows at which a knot is wanted.

    Raises:
        TrackingError: the orientation can't be known.
    """
    lag, scale = 0.0, 0.0
    stops: Spans | None = None
    device = recording.gyr is None
    prior = Prior(noise.lag, WIDE_LAG_SIGMA, WIDE_SCALE_SIGMA)

    # A knot right after lost motion: an unknown turn is not small.
    asked = [*asked, *(min(impulse.row + 1, len(recording) - 1) for impulse in impulses)]

    def posed(stops: Spans, calm: Spans) -> Problem:
        return pose_problem(
            *(frame, recording.mag, rest, noise, stops, calm, speed, density, asked, impulses, unseen),
            device=device,
        )

    for _ in range(4):
        frame = frame_of(_retimed(recording, lag, scale), rest.gyro_bias * (1.0 + scale))
        window = min(max(2, round(ENERGY_WINDOW_S / frame.dt)), len(frame.t))
        # A device's own attitude follows a turn late: without a gyro specific force in sensor axes alone is constant.
        shown = energies(*((frame.acc, np.zeros_like(frame.acc)) if device else (frame.u, frame.gyr)), window)
        speed = still_speed(*shown, len(frame.t), rest, noise)
        density = row_noise(frame, rest, noise, unseen, device)
        if stops is None:
            stops = find_candidates(frame.t, frame.dt, *shown, rest, unseen)
        if not stops:
            return None
        problem = posed(stops, stops)
        if not problem.stops:
            return None
        begun, local = _initial_state(problem, prior)
        found = descend(problem, begun, local, ANNEALING)
        more, common = _large_lag_and_scale(found.x, found.solved)
        # A lag beyond its own prior is another fault.
        if device or (more == 0.0 and common == 0.0) or abs(lag + more) > OUTLIER_SIGMAS * WIDE_LAG_SIGMA:
            break
        lag, scale = lag + more, (1.0 + scale) * (1.0 + common) - 1.0
    narrow = Prior(noise.lag if lag == 0.0 else 0.0, noise.lag_sigma)
    # The model is linear in what the prior is about.
    known = shared_prior(problem, found.at, narrow) - shared_prior(problem, found.at, prior)
    x, local = found.at.moved(found.solved.plus(known)), replace(local, prior=narrow)
    found = descend(problem, x, local)
    path = path_of(problem, found.x)
    candidates: Spans = stops or []
    cut = np.zeros(len(candidates), dtype=np.bool_)
    for _ in range(MAX_RECUTS):
        cut = cut | doubted_stops(problem, found.still, candidates)
        stops, calm = revised_stops(problem, path.v, found.solved, candidates, cut, speed)
        if not stops:
            break
        if settled(problem.frame.t, problem.stops, stops):
            problem = replace(problem, stops=stops)
            break
        found.solved.forget()
        again = posed(stops, calm)
        if not again.stops:
            break
        x, local = _transferred(problem, found.x, path, again), replace(local, origin=_origin(again))
        problem = again
        del found, path  # of a long recording they are large
        found = descend(problem, x, local, ANNEALING[-1:])
        path = path_of(problem, found.x)
    return Solution(problem, found.x, local, found.still, found.solved, path, lag, scale, candidates)


def _retimed(recording: Recording, lag: float, scale: float) -> Recording:
    """The recording with the gyro's lag and common scale taken out."""
    if recording.gyr is None or (lag == 0.0 and scale == 0.0):
        return recording
    at = recording.t + lag
    gyr = np.column_stack([np.interp(at, recording.t, axis) for axis in recording.gyr.T]) * (1.0 + scale)
    return replace(recording, gyr=gyr)


def _large_lag_and_scale(x: State, solved: Solved) -> tuple[float, float]:
    """The lag (s) and the scale that are too large for a linear model, if they are significant; else 0."""
    i = np.arange(SHARED)
    tau, sigma = float(x.shared[LAG][0]), float(np.sqrt(solved.shared[0, 0]))
    away = tau - Noise.lag
    lag = tau if abs(away) > max(REMOVED_LAG, OUTLIER_SIGMAS * sigma) else 0.0
    diagonal = i[GYR_MATRIX][::4]
    common = -float(x.shared[diagonal].mean())  # w_true = (1 - M) w
    sigma = float(np.sqrt(solved.shared[np.ix_(diagonal, diagonal)].mean()))
    return lag, common if abs(common) > max(REMOVED_SCALE, SCALE_OUTLIER_SIGMAS * sigma) else 0.0


def _origin(problem: Problem) -> int:
    """The knot in the middle of the first stop."""
    return int(np.median(np.flatnonzero(problem.stop_of == 0)))


def _initial_state(problem: Problem, prior: Prior) -> tuple[State, Local]:
    """Initial state: a hand at rest, in the attitude of a first guess, with nav's heading."""
    m, origin = len(problem.rows), _origin(problem)
    strength = dip = 0.0
    if problem.device:
        E = np.tile(np.eye(3), (m, 1, 1))
    else:
        wxyz = first_guess(problem.frame, problem.rows, problem.stops)
        if problem.field is None:
            first = problem.stop_of == 0
            off = -heading(quat_multiply(wxyz[first], problem.frame.wxyz[problem.rows[first]]))
        else:
            level = _first_field(problem, quat_to_matrix(wxyz))
            strength = float(np.linalg.norm(level))
            dip = float(np.arctan2(level[2], np.hypot(level[0], level[1])))
            off = float(np.arctan2(level[0], level[1]))
        E = quat_to_matrix(quat_multiply(quat_about_z(off), wxyz))
    still = np.zeros((m, 3))
    shared = np.zeros(SHARED)
    shared[LAG], shared[GRAVITY] = prior.lag, problem.noise.gravity
    state = State(E, still, still, still, still, shared)
    return state, Local(origin, strength, dip, prior, np.ones(6))


def _first_field(problem: Problem, R: Array) -> Array:
    """The magnetic field (3,) at the first stop at which the magnetometer works: some wake up late."""
    assert problem.field is not None
    level = np.einsum("kij,kj->ki", R, problem.field)
    means = (level[problem.stop_of == k].mean(axis=0) for k in range(len(problem.stops)))
    usual = float(np.median(lengths(level)))
    return next((mean for mean in means if lengths(mean) > 0.5 * usual), np.array([0.0, 1.0, 0.0]))


def _transferred(problem: Problem, x: State, path: Path, again: Problem) -> State:
    """Transfer an estimate to other knots."""
    rows = again.rows
    E = quat_to_matrix(quat_multiply(path.wxyz[rows], quat_inverse(again.frame.wxyz[rows])))
    k = np.clip(np.searchsorted(problem.rows, rows), 0, len(problem.rows) - 1)
    return State(E, path.v[rows], path.p[rows], x.gyr_bias[k], x.acc_bias[k], x.shared)
