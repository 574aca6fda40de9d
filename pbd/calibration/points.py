"""Registration of nav in base from touched points. A point that contradicts the others is left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pbd.calibration.registration import (
    PRIOR_FREEDOM,
    Fit,
    PointObservations,
    Problem,
    register,
    variance,
    widened,
)
from pbd.errors import CalibrationError
from pbd.pose import Array, Pose

TOUCH_SIGMA_M = 0.001
"""m per axis: how precisely a tip is put on a point."""

FEWEST = 3

LEAST_SPREAD_M = 0.05
"""m: least rms distance of the points from their middle or line, in each direction that is needed."""

WRONG_CHANCE = 1e-4
"""Chance of a point's misfit against all the others, below which the point is wrong."""

CLEARER_CHI2 = 9.0
"""A wrong point is named if it explains the misfit better than any other, by this much chi-square."""

POOR_CHI2 = 2.5
"""Chi-square per degree of freedom above which a fit is not trusted."""


@dataclass(frozen=True, eq=False)
class PointFit:
    """Nav in base, from touched points.

    Attributes:
        cov: (6, 6) m and rad, position and rotation vector in base; no tilt where gravity gave it.
        scale: of the hand's positions; 1 unless it was fitted.
        scale_sigma: one sigma; 0 as above.
        residuals: (m, 3) m in base, point less touch, of all points, those left out too.
        left_out: (m, 3) m in base, the same with the point itself left out of the fit.
        left_out_sigma: (m, 3) m, one sigma of that.
        used: (m,) False where a point was found wrong.
        chi2: of the fit, per degree of freedom: 1 where the tracker's sigmas are right.
    """

    T_base_nav: Pose
    cov: Array
    scale: float
    scale_sigma: float
    residuals: Array
    left_out: Array
    left_out_sigma: Array
    used: tuple[bool, ...]
    chi2: float


def fit_points(
    touched: PointObservations,
    points: Array,
    *,
    free: bool = False,
    scaled: bool = False,
    touch_m: float = TOUCH_SIGMA_M,
) -> PointFit:
    """Find nav in base; a point that contradicts the others is left out and marked.

    A wrong point is found by leaving each one out in turn: by how much chi-square falls is tested against what is left
    of the others, with all correlations (W. Baarda, A testing procedure for use in geodetic networks, 1968; A. J. Pope,
    The statistics of residuals and the detection of outliers, 1976, where the sigmas are known up to a factor only).

    Args:
        touched: m touches.
        points: (m, 3) m in base, in the same order.
        free: nav's tilt too (6 unknowns); else both have z up (yaw and position: 4 unknowns).
        scaled: the scale of the hand's positions too.
        touch_m: m per axis, how well the tip meets a point.

    Raises:
        CalibrationError: too few points, in a line, above each other; or they contradict each other and which one is at
            fault can't be located.
    """
    if len(points) != len(touched.stops):
        raise ValueError(f"{len(touched.stops)} touches for {len(points)} points; give one touch per point")
    refuse_shape(points, free)
    touched = replace(touched, cov=touched.cov + touch_m**2 * np.eye(len(touched.cov)))
    problem = Problem(touched, points, free, scaled)
    wrong, fit = _consistent(problem)
    cov = widened(fit.cov, fit.chi2, fit.freedom)
    left_out = [_left_out(problem, k, wrong, fit) for k in range(len(points))]
    return PointFit(
        T_base_nav=fit.pose,
        cov=cov[:6, :6],
        scale=fit.scale,
        scale_sigma=fit.scale * float(np.sqrt(cov[6, 6])),
        residuals=points - fit.in_base(touched),
        left_out=np.array([off for off, _ in left_out]),
        left_out_sigma=np.array([sigma for _, sigma in left_out]),
        used=tuple(k not in wrong for k in range(len(points))),
        chi2=fit.chi2 / fit.freedom,
    )


def _consistent(problem: Problem) -> tuple[list[int], Fit]:
    """The points that are wrong, and the fit of the others."""
    wrong: list[int] = []
    while True:
        fit, used = register(problem, wrong), [k for k in range(len(problem.points)) if k not in wrong]
        without = {k: register(problem, [*wrong, k]) for k in used if _enough(problem, [*wrong, k])}
        gained = {k: fit.chi2 - each.chi2 for k, each in without.items()}
        worst = max(gained, key=lambda k: gained[k], default=None)
        if worst is None or not _wrong(gained[worst], without[worst]):
            return wrong, fit
        rivals = [k for k in gained if k != worst and gained[worst] - gained[k] < CLEARER_CHI2]
        if rivals or len(used) <= FEWEST or fit.freedom < 6:
            raise _contradiction(problem, fit, [worst, *rivals] if rivals else used)
        wrong.append(worst)


def _wrong(gained: float, others: Fit) -> bool:
    """Whether chi-square falls by more, for a point's three coordinates, than what the others leave lets expect."""
    from scipy.special import fdtrc

    share = gained / 3.0 / variance(others.chi2, others.freedom)
    return bool(fdtrc(3.0, PRIOR_FREEDOM + others.freedom, share) < WRONG_CHANCE)


def _enough(problem: Problem, left_out: Sequence[int]) -> bool:
    """Whether the other points are enough for a fit, and lie well."""
    others = np.delete(problem.points, list(left_out), axis=0)
    return problem.freedom(len(others)) > 0 and not _bad_shape(others, problem.free, len(others))


def _left_out(problem: Problem, k: int, wrong: Sequence[int], fit: Fit) -> tuple[Array, Array]:
    """Point k less where the others put it, and the sigma of that, (3,) m; where they can't, by all."""
    out = [k, *(each for each in wrong if each != k)]
    off, cov = problem.points[k] - fit.in_base(problem.touched)[k], fit.cov[:3, :3]
    if _enough(problem, out):
        fit = register(problem, out)
        off, cov = fit.left_out[0], fit.cov_left_out[0]
    return off, np.sqrt(np.diagonal(widened(cov, fit.chi2, fit.freedom)))


def refuse_shape(points: Array, free: bool) -> None:
    """Refuse points (m, 3) from which no pose follows, however well they are touched.

    Raises:
        CalibrationError: too few, two in one place, in a line, above each other.
    """
    if len(points) < FEWEST:
        raise CalibrationError(
            f"{len(points)} points are too few; touch {FEWEST} or more, best 4 to 6 spread all around",
            value=len(points),
            bound=FEWEST,
        )
    for j in range(len(points)):
        for k in range(j):
            if np.linalg.norm(points[j] - points[k]) < 1e-4:
                raise CalibrationError(f"points {k + 1} and {j + 1} are the same place; remove one", points=(k, j))
    if bad := _bad_shape(points, free, FEWEST):
        raise CalibrationError(bad)


def _bad_shape(points: Array, free: bool, fewest: int) -> str:
    """What is wrong with how points (m, 3) lie, or ''."""
    if len(points) < min(fewest, 2):
        return "too few"
    off = points - points.mean(axis=0)
    if free:
        spread = np.linalg.svd(off, compute_uv=False) / np.sqrt(len(points))
        if len(points) < 3 or spread[1] < LEAST_SPREAD_M / 2.0:
            return (
                f"the points lie on a line (within {100.0 * spread[1]:.1f} cm), so the rotation about it is unknown; "
                "touch a point beside it, or leave out --free"
            )
        return ""
    spread_m = float(np.sqrt((off[:, :2] ** 2).sum(axis=1).mean()))
    if spread_m < LEAST_SPREAD_M:
        return (
            f"the points lie above each other (within {100.0 * spread_m:.1f} cm), so the heading is unknown; touch "
            "points at least 20 cm apart on the table"
        )
    return ""


def _contradiction(problem: Problem, fit: Fit, suspects: Sequence[int]) -> CalibrationError:
    off = np.linalg.norm(problem.points - fit.in_base(problem.touched), axis=1)
    names = " or ".join(f"{k + 1}" for k in sorted(suspects))
    return CalibrationError(
        f"the points contradict the demonstration by up to {100.0 * off.max():.1f} cm, and it is unclear which one is "
        f"wrong (point {names}); check their coordinates and their order, touch more points, or move more calmly",
        points=tuple(suspects),
        value=float(off.max()),
    )
