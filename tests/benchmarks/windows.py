"""Windows of real recordings, tracked from one known velocity to another (the data folder's README says how).

A window is a move between two stops, at which the optics tell the velocity. The smoother's own Gaussian of velocities
and displacements is conditioned on that; it gives the displacement and its sigma at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array, quat_about_z, quat_canonical, quat_inverse, quat_log, quat_multiply, quat_rotate
from pbd.tracking.first_rest import find_rest
from pbd.tracking.noise import noise_of
from pbd.tracking.repair.repair_recording import repair_recording
from pbd.tracking.repair.saturation import declip, find_clips
from pbd.tracking.smoother.normal_equations import STATE
from pbd.tracking.smoother.path import SensorPath
from pbd.tracking.smoother.preintegration import POS, ROT, VEL
from pbd.tracking.smoother.smooth import Solution, smooth
from pbd.tracking.smoother.variance_components import with_own_noise
from tests.benchmarks.trials import VELOCITY_SIGMA, Trial, Window, phases, slope

WINDOWS_S = (1.0, 2.0, 5.0)

GIVEN, WAY, TURN = slice(0, 6), slice(6, 9), slice(9, 12)
"""Of a window: velocities where it begins and ends (m/s), displacement (m), attitude at its end (rad), in nav."""

AT_ONCE = 32
"""Windows whose covariance is solved for together."""

Ends = list[tuple[int, int]]


@dataclass(frozen=True, eq=False)
class Motion:
    """The tracker's path of a whole trial and, by length, the ends of its windows and their covariance (k, 12, k, 12).

    The covariance is relative to the mean heading while moving, as the score is.
    """

    path: SensorPath
    windows: dict[float, tuple[Ends, Array]]


def motion_of(trial: Trial, lengths: Sequence[float] = WINDOWS_S) -> Motion:
    """Smooth a whole trial as `track` does, with a knot at each end of its windows."""
    recording, gaps = repair_recording(trial.recording)
    recording, lost = declip(recording, find_clips(recording))
    rest = find_rest(recording)
    ends = {length: window_ends(trial, length) for length in lengths}
    asked = sorted({row for of in ends.values() for window in of for row in window})
    unseen = [(gap.before, gap.after) for gap in gaps]
    solution = smooth(recording, rest, noise_of(recording, rest), lost, unseen, asked)
    assert solution is not None
    solution, path = with_own_noise(solution), solution.path
    mean = np.where(trial.moving[solution.problem.rows], solution.problem.duration, 0.0)
    mean /= mean.sum()
    return Motion(path, {length: (of, joint_covariance(solution, path, mean, of)) for length, of in ends.items()})


def window_ends(trial: Trial, length: float) -> Ends:
    """First and last row of each window inside a moving phase whose ends the optics see."""
    n, seen = round(length * trial.recording.rate_hz), seen_by_optics(trial)
    starts = [i for start, stop in phases(trial.moving) for i in range(start, stop - n, n)]
    return [(i, i + n) for i in starts if seen[i] and seen[i + n]]


def seen_by_optics(trial: Trial) -> NDArray[np.bool_]:
    """Rows (n,) at which position and velocity are known."""
    seen: NDArray[np.bool_] = np.isfinite((trial.p_true + trial.v_true).sum(axis=1))
    return seen


def joint_covariance(solution: Solution, path: SensorPath, mean: Array, ends: Ends) -> Array:
    """Covariance (k, 12, k, 12) of windows, given how the mean heading is made of the knots' (m,)."""
    rows = np.array(ends, dtype=np.intp).reshape(-1, 2)
    first, last = np.searchsorted(solution.problem.rows, rows).T
    # A heading error h turns what is level: x - h z x x.
    values = np.stack((path.v[rows[:, 0]], path.v[rows[:, 1]], path.p[rows[:, 1]] - path.p[rows[:, 0]]), axis=1)
    turned = np.zeros((len(rows), 12))
    turned[:, :9], turned[:, 11] = np.cross((0.0, 0.0, 1.0), values).reshape(-1, 9), 1.0
    joint = np.empty((len(rows), 12, len(rows), 12))
    one = np.eye(3)
    for at in range(0, len(rows), AT_ONCE):
        chunk = np.arange(at, min(at + AT_ONCE, len(rows)))
        right = np.zeros((len(mean), STATE, len(chunk), 12))
        for c, k in enumerate(chunk):
            i, j = first[k], last[k]
            right[i, VEL, c, 0:3], right[j, VEL, c, 3:6] = one, one
            right[j, POS, c, WAY], right[i, POS, c, WAY], right[j, ROT, c, TURN] = one, -one, one
        right[:, 2] -= mean[:, None, None] * turned[chunk]
        X = solution.solved.covariance_times(right.reshape(len(mean), STATE, -1))
        left = np.concatenate((X[first, VEL], X[last, VEL], X[last, POS] - X[first, POS], X[last, ROT]), axis=1)
        left -= turned[:, :, None] * (mean @ X[:, 2])
        joint[:, :, chunk] = left.reshape(len(rows), 12, len(chunk), 12)
    return joint


def window_errors(
    trial: Trial, motion: Motion, lengths: Sequence[float] = WINDOWS_S, given: str = "own"
) -> list[Window]:
    """All windows of a trial, tracked from one known velocity to another.

    Args:
        trial: the truth; of windows that were smoothed, those whose ends it knows.
        motion: of the trial.
        lengths: s, of those that were asked for.
        given: each window knows its "own" two velocities, those of "all" windows of its length, or "none": then it is
            what the trial's true stops alone say of it. "alike": its own two, and the tracker's are slopes of the same
            polynomial, through its own path, as the optics' are.
    """
    path = motion.path
    v = slope(path.p, trial.recording.rate_hz) if given == "alike" else path.v
    turn = quat_about_z(heading_off(trial, path.wxyz)[0])
    p_true, v_true = quat_rotate(turn, trial.p_true), quat_rotate(turn, trial.v_true)
    seen, found = seen_by_optics(trial), []
    for length in lengths:
        ends, joint = motion.windows[length]
        if not ends:
            continue
        rows = np.array(ends, dtype=np.intp).ravel()
        v_off = (v_true - v)[rows].ravel()
        once = np.unique(rows, return_index=True)[1]  # windows that meet share a velocity
        velocities = joint[:, GIVEN, :, GIVEN].reshape(3 * len(rows), -1)
        for k, (i, j) in enumerate(ends):
            if not (seen[i] and seen[j]):
                continue
            slots = {"all": once[seen[rows[once]]], "none": once[:0]}.get(given, np.array([2 * k, 2 * k + 1]))
            of = (3 * slots[:, None] + np.arange(3)).ravel()
            P = velocities[np.ix_(of, of)] + VELOCITY_SIGMA**2 * np.eye(len(of))
            with_way = joint[:, GIVEN, k, WAY].reshape(-1, 3)[of]
            gain = np.linalg.solve(P, with_way).T
            way = path.p[j] - path.p[i] + gain @ v_off[of]
            Q = joint[k, WAY, k, WAY] - gain @ with_way
            error = way - (p_true[j] - p_true[i])
            z = error / np.sqrt(np.diagonal(Q))
            found.append(Window(i, j, length, quat_rotate(quat_inverse(turn), error), z))
    return found


def paper_windows(trial: Trial, wxyz: Array, a_nav: Array) -> list[Window]:
    """All windows by the paper's equations 5 and 6, from the true velocity at their beginning; z is unknown."""
    turn, steps, found = quat_about_z(heading_off(trial, wxyz)[0]), np.diff(trial.recording.t)[:, None], list[Window]()
    p_true, v_true = quat_rotate(turn, trial.p_true), quat_rotate(turn, trial.v_true)
    for length in WINDOWS_S:
        for i, j in window_ends(trial, length):
            v = v_true[i] + np.cumsum(a_nav[i + 1 : j + 1] * steps[i:j], axis=0)
            error = (v * steps[i:j]).sum(axis=0) - (p_true[j] - p_true[i])
            found.append(Window(i, j, length, error, np.full(3, np.nan)))
    return found


def turn_z_scores(trial: Trial, motion: Motion) -> list[float]:
    """The attitude's error at the windows' ends, but for the mean heading, in sigmas of each axis of nav."""
    turn = quat_about_z(-heading_off(trial, motion.path.wxyz)[0])
    found: list[float] = []
    for ends, joint in motion.windows.values():
        for k, (_, j) in enumerate(ends):
            if np.isfinite(trial.wxyz_true[j]).all():
                off = quat_multiply(turn, quat_multiply(motion.path.wxyz[j], quat_inverse(trial.wxyz_true[j])))
                found.extend((quat_log(off) / np.sqrt(np.diagonal(joint[k, TURN, k, TURN]))).tolist())
    return found


def heading_off(trial: Trial, wxyz: Array) -> tuple[float, Any]:
    """The mean heading from the optics to the estimate while moving, rad; and where both are known."""
    known = trial.moving & np.isfinite(trial.wxyz_true).all(axis=1)
    off = quat_canonical(quat_multiply(wxyz, quat_inverse(trial.wxyz_true)))
    return float(np.mean(2.0 * np.arctan2(off[known, 3], off[known, 0]))), known
