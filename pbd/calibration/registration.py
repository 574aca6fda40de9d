"""Least squares of nav in base, and how sure it is where neither the tracker nor the sensor is known that well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbd.calibration.alignment import align
from pbd.calibration.touches import USUAL_SIZE, Touches, rows_of
from pbd.pose import Array, Pose, quat_exp, quat_inverse, quat_log, quat_multiply, quat_to_matrix

SIZES = 0.002 * 2.0 ** np.arange(7)
"""Of a sensor's own errors (`touches.common_errors`), a bias over g: 2 mg, as a good one's, to 130 mg; each as likely
as the others before the points are seen."""

MOST_STEPS, SETTLED = 50, 1e-9
"""Of least squares; and m, rad and a share, from which on a step is none. Three or four do: the start is near."""

LEAST_FACTOR = 0.05**2
"""The tracker's variances are not too large by more than this."""

TWO_SIGMA = 0.97725
"""Of a normal distribution, what lies below two sigma."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be fitted.

    Attributes:
        touched: m touches.
        points: (m, 3) m in base.
        free: nav's tilt too; else both frames have z up.
        scaled: the scale of the hand's positions too.
        touch_m: m per axis, how well the tip meets a point.
    """

    touched: Touches
    points: Array
    free: bool = False
    scaled: bool = False
    touch_m: float = 0.0

    def only(self, keep: Sequence[int]) -> Problem:
        """With some of the points."""
        return Problem(self.touched.only(keep), self.points[list(keep)], self.free, self.scaled, self.touch_m)

    @property
    def unknowns(self) -> list[int]:
        """Which of position (0 to 2), rotation vector in base (3 to 5) and log of the scale (6) are unknown."""
        return [0, 1, 2, *((3, 4, 5) if self.free else (5,)), *((6,) if self.scaled else ())]

    @property
    def freedom(self) -> int:
        """Degrees of freedom that are left."""
        return 3 * len(self.points) - len(self.unknowns)

    def covariance(self, size: float) -> Array:
        """(3 m, 3 m) m2, of the touches in nav, for a size of the sensor's own errors."""
        cov = self.touched.covariance(size)
        cov += self.touch_m**2 * np.eye(len(cov))
        return cov


@dataclass(frozen=True, eq=False)
class Fit:
    """chi2 is the whole sum; cov (7, 7) of position, rotation vector in base, and log of the scale."""

    pose: Pose
    scale: float
    cov: Array
    chi2: float

    def in_base(self, touched: Touches) -> Array:
        """Where the tips lie, (m, 3) m."""
        tips: Array = self.pose.act(self.scale * touched.p_nav_sensor + touched.lever)
        return tips


def register_given(problem: Problem, size: float = USUAL_SIZE, start: Fit | None = None) -> Fit:
    """Fit, taking the tracker's sigmas and the size of the sensor's errors as they are: Gauss and Newton's steps.

    What is left is whitened in nav: there the noise does not turn with the unknown rotation.
    """
    touched, where = problem.touched, problem.unknowns
    if start is None:
        start = Fit(align(touched.p_nav_sensor + touched.lever, problem.points, problem.free), 1.0, np.eye(7), 0.0)
    whiten = np.linalg.inv(np.linalg.cholesky(problem.covariance(size)))
    pose, scale = start.pose, start.scale
    for _ in range(MOST_STEPS):
        off = whiten @ misfit(problem, pose, scale).ravel()
        by_unknown = whiten @ jacobian(problem, pose, scale)
        inverse = np.linalg.inv(by_unknown.T @ by_unknown)
        step = np.zeros(7)
        step[where] = -inverse @ (by_unknown.T @ off)
        pose, scale = moved(pose, scale, step)
        if np.abs(step).max() < SETTLED:
            break
    cov = np.zeros((7, 7))
    cov[np.ix_(where, where)] = inverse
    return Fit(pose, scale, cov, float(off @ off))


def register(problem: Problem) -> Fit:
    """Fit, and let what is left of the points say how far the tracker's sigmas are off, and the sensor's errors large.

    For each of SIZES the tracker's variances are right but for a common factor. With Jeffreys' prior for that (as
    likely to be a tenth as to be ten) the unknowns have Student's t distribution with the degrees of freedom of the
    fit, of a variance chi2 / freedom times that of least squares; and the points are seen with a probability of
    |C|^-1/2 |J^T C^-1 J|^-1/2 chi2^(-freedom / 2), by which the sizes are weighed (A. Zellner, An introduction to
    Bayesian inference in econometrics, 1971, III and X). Sigmas are such that two of them hold 95 %.

    Returns:
        The mean; chi2 is that of the sizes, weighed.
    """
    fits, weights = _of_sizes(problem)
    best = fits[int(weights.argmax())]
    off = np.array([_from(best, fit) for fit in fits])
    mean = weights @ off
    cov = np.einsum("i,iab->ab", weights, np.array([fit.cov * _factor(problem, fit) for fit in fits]))
    cov += np.einsum("i,ia,ib->ab", weights, off - mean, off - mean)
    return Fit(*moved(best.pose, best.scale, mean), cov, float(weights @ [fit.chi2 for fit in fits]))


def predict(problem: Problem, k: int, keep: Sequence[int]) -> tuple[Array, Array]:
    """Point k less where the touch lies by the others, (3,) m in base, and the sigma of that (3,).

    With all correlations: what an error of the other touches does to the fit, it often does to this one too.

    Args:
        problem: of all points.
        k: the point.
        keep: the others that count; they must be enough for a fit.
    """
    others = problem.only(keep)
    fits, weights = _of_sizes(others)
    rows, own = rows_of(keep), rows_of([k])
    offs, covs = [], []
    for size, fit in zip(SIZES, fits, strict=True):
        cov = problem.covariance(size)
        by_unknown = jacobian(problem, fit.pose, fit.scale)
        where = np.ix_(problem.unknowns, problem.unknowns)
        by_others = -by_unknown[own] @ fit.cov[where] @ by_unknown[rows].T @ np.linalg.inv(cov[np.ix_(rows, rows)])
        both = np.hstack((by_others, np.eye(3)))
        of_both = cov[np.ix_([*rows, *own], [*rows, *own])]
        to_base = -fit.scale * quat_to_matrix(fit.pose.wxyz)
        offs.append(to_base @ misfit(problem, fit.pose, fit.scale)[k])
        covs.append(to_base @ both @ of_both @ both.T @ to_base.T * _factor(others, fit))
    off = weights @ np.array(offs)
    cov = np.einsum("i,iab->ab", weights, np.array(covs))
    cov += np.einsum("i,ia,ib->ab", weights, np.array(offs) - off, np.array(offs) - off)
    return off, np.sqrt(np.diagonal(cov))


def misfit(problem: Problem, pose: Pose, scale: float) -> Array:
    """By how much each touch is off in nav, (m, 3) m: what was tracked less where the point is."""
    tips = pose.inverse().act(problem.points)
    off: Array = problem.touched.p_nav_sensor - (tips - problem.touched.lever) / scale
    return off


def jacobian(problem: Problem, pose: Pose, scale: float) -> Array:
    """Of `misfit`, (3 m, unknowns)."""
    R_nav_base = quat_to_matrix(pose.wxyz).T
    from_nav = problem.points - pose.p
    by_turn = R_nav_base @ np.cross(np.eye(3), from_nav[:, None]).transpose(0, 2, 1)  # columns e x (point - nav)
    by_scale = (from_nav @ R_nav_base.T - problem.touched.lever)[:, :, None]
    by_place = np.broadcast_to(R_nav_base, by_turn.shape)
    every = np.concatenate((by_place, by_turn, by_scale), axis=2).reshape(-1, 7) / scale
    return np.asarray(every[:, problem.unknowns])


def _of_sizes(problem: Problem) -> tuple[list[Fit], Array]:
    """The fit for each of SIZES, and the sizes' weights (their sum is 1)."""
    fits: list[Fit] = []
    for size in SIZES:
        fits.append(register_given(problem, float(size), fits[-1] if fits else None))
    unknowns = np.ix_(problem.unknowns, problem.unknowns)
    logs = [
        0.5 * np.linalg.slogdet(fit.cov[unknowns])[1]
        - 0.5 * np.linalg.slogdet(problem.covariance(float(size)))[1]
        - 0.5 * problem.freedom * np.log(_variance(problem, fit))
        for size, fit in zip(SIZES, fits, strict=True)
    ]
    weights = np.exp(np.array(logs) - max(logs))
    return fits, weights / weights.sum()


def _variance(problem: Problem, fit: Fit) -> float:
    """Of a touch, by what is left of the points, as a share of what the tracker says."""
    return LEAST_FACTOR + fit.chi2 / problem.freedom


def _factor(problem: Problem, fit: Fit) -> float:
    """By this times least squares' covariance two sigma hold 95 %: Student's t is wider than a normal distribution."""
    from scipy.special import stdtrit

    return _variance(problem, fit) * (0.5 * float(stdtrit(problem.freedom, TWO_SIGMA))) ** 2


def moved(pose: Pose, scale: float, step: Array) -> tuple[Pose, float]:
    """By (7,): position, rotation vector in base, log of the scale."""
    there = Pose(pose.p + step[:3], quat_multiply(quat_exp(step[3:6]), pose.wxyz))
    return there, scale * float(np.exp(step[6]))


def _from(fit: Fit, other: Fit) -> Array:
    """The (7,) of `moved` from one to another."""
    turn = quat_log(quat_multiply(other.pose.wxyz, quat_inverse(fit.pose.wxyz)))
    return np.array([*(other.pose.p - fit.pose.p), *turn, np.log(other.scale / fit.scale)])
