"""Register nav in base from touched points. A point that contradicts the others is left out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pbd.calibration.registration import (
    PRIOR_FREEDOM,
    PointObservations,
    RegistrationFit,
    RegistrationProblem,
    register,
    variance_factor,
    widened,
)
from pbd.errors import CalibrationError, amount, require_kind, warn
from pbd.frozen_arrays import numeric
from pbd.pose import Array, Pose

TIP_SIGMA_M = 0.001
"""One sigma per axis, m, of the tip on a point."""

FEWEST_POINTS = 3
"""Smallest number of points."""

LEAST_SPREAD_M = 0.05
"""Smallest rms horizontal distance, m, of the points from their middle. If the tilt is estimated too, half of this is
the smallest rms distance of the points from a line."""

CLEARER_CHI2 = 9.0
"""Smallest gain in chi-square of leaving out the wrong point over leaving out any other."""

POOR_CHI2 = 2.5
"""Chi-square per degree of freedom above which a fit is not trusted."""

SIDEWAYS = "x or y, and whether x and y are exchanged"
MIRRORED = {SIDEWAYS: (1.0, -1.0, 1.0), "z": (1.0, 1.0, -1.0)}
"""What to check if the points fit mirrored -> that mirror. All mirrors across a vertical plane fit alike."""

MAY_BE_MIRRORED = (
    "the points fit as in a mirror too, so a wrong sign does not show; check the sign of {}, or touch one more that "
    "breaks the symmetry"
)
"""Warning; {} is one of MIRRORED."""


@dataclass(frozen=True, eq=False)
class PointFit:
    """Nav in base, from m touched points.

    Attributes:
        T_base_nav: nav's pose in base.
        cov: (6, 6) m and rad, covariance of position and rotation vector in base; zero for the tilt if gravity gave it.
        scale, scale_sigma: scale of the hand's positions, and one sigma, which is 0 unless the scale was fitted.
        residuals: (m, 3) m in base, point minus touch, for all points, also those that were found wrong.
        left_out: (m, 3) m in base, the same if the point itself is left out of the fit.
        left_out_sigma: (m, 3) m, one sigma of `left_out`.
        used: (m,) False for a point that was found wrong.
        chi2: chi-square per degree of freedom; 1 is expected if the tracker's sigmas are right.
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
    scale: float = 1.0,
    touch_m: float = TIP_SIGMA_M,
) -> PointFit:
    """Find nav in base; a point that contradicts the others is left out and marked.

    Each point is left out in turn. The fall of chi-square is tested against the remaining misfit, with correlations.

    Sources: W. Baarda, A testing procedure for use in geodetic networks, 1968; A. J. Pope, The statistics of residuals
    and the detection of outliers, 1976 (for sigmas that are known up to a factor only).

    Args:
        touched: m touches.
        points: (m, 3) m in base, in the same order.
        free: estimate nav's tilt too (6 unknowns). Otherwise both frames have z up (position and yaw: 4 unknowns).
        scaled: estimate the scale of the hand's positions too.
        scale: the known scale of the hand's positions.
        touch_m: m, one sigma per axis of the tip on a point.

    Raises:
        CalibrationError: there are too few points, they lie in a line or above each other, or they contradict each
            other and the wrong one can't be located.
        WrongTypeError: `points` is not one row of three numbers for each touch.
    """
    points = numeric("points", points)
    one_each = points.shape == (len(touched.stops), 3) and np.isfinite(points).all()
    require_kind("points", points, f"({len(touched.stops)}, 3) numbers, one row for each touch", bool(one_each))
    refuse_shape(points, free)
    touched = replace(touched, cov=touched.cov + touch_m**2 * np.eye(len(touched.cov)))
    problem = RegistrationProblem(touched, points, free, scaled, scale)
    wrong, fit, without = _find_wrong_points(problem)

    def left_out_of(k: int) -> tuple[Array, Array]:
        """Return point k minus its touch by the fit of the others, or, if they are too few, of all; and one sigma."""
        others = without.get(k, fit)
        if k in wrong or k in without:
            at = wrong.index(k) if k in wrong else -1
            off, cov = others.left_out[at], others.cov_left_out[at]
        else:
            off, cov = points[k] - fit.in_base(touched)[k], fit.cov[:3, :3]
        return off, np.sqrt(np.diagonal(widened(cov, others.chi2, others.freedom)))

    cov = widened(fit.cov, fit.chi2, fit.freedom)
    left_out = [left_out_of(k) for k in range(len(points))]
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


def _find_wrong_points(problem: RegistrationProblem) -> tuple[list[int], RegistrationFit, dict[int, RegistrationFit]]:
    """Return the indices of wrong points, the fit of the others, and that fit without each of them where possible."""
    wrong, fit = list[int](), register(problem)
    while True:
        used = [k for k in range(len(problem.points)) if k not in wrong]
        without = {k: register(problem, [*wrong, k]) for k in used if _enough(problem, [*wrong, k])}
        gained = {k: fit.chi2 - each.chi2 for k, each in without.items()}
        worst = max((k for k in gained if _is_wrong(gained[k], without[k])), key=lambda k: gained[k], default=None)
        # Rough moves make the misfit up to three times as large as the tracker's sigmas allow, a wrong point over ten.
        if worst is None and fit.chi2 <= 10.0**2 * fit.freedom:
            if _fits_mirrored(SIDEWAYS, problem, fit, wrong):
                warn(MAY_BE_MIRRORED.format(SIDEWAYS))
            return wrong, fit, without
        for check in MIRRORED:
            if _fits_mirrored(check, problem, fit if worst is None else without[worst]):
                raise mirrored(check)
        if worst is None:  # no single point explains it: a unit, the order
            raise _contradiction(problem, fit, used)
        rivals = [k for k in gained if k != worst and gained[worst] - gained[k] < CLEARER_CHI2]
        if rivals or len(used) <= FEWEST_POINTS or fit.freedom < 6:
            raise _contradiction(problem, fit, [worst, *rivals] if rivals else used)
        wrong.append(worst)
        fit = without[worst]


def _fits_mirrored(
    check: str, problem: RegistrationProblem, instead: RegistrationFit, left_out: Sequence[int] = ()
) -> bool:
    """Say whether the points fit in this one of MIRRORED, and not clearly worse than `instead`."""
    fit = register(replace(problem, points=problem.points * MIRRORED[check]), left_out)
    return fit.chi2 < min(POOR_CHI2 * fit.freedom, instead.chi2 + CLEARER_CHI2)


def mirrored(check: str) -> CalibrationError:
    """Return the error that says which of MIRRORED to check."""
    return CalibrationError(f"the points fit the demonstration as in a mirror; check the sign of {check}")


def _is_wrong(gained: float, others: RegistrationFit) -> bool:
    """Say whether leaving out a point lowers chi-square as chance does once in 10,000 (F test, three coordinates)."""
    from scipy.special import fdtrc

    ratio = gained / 3.0 / variance_factor(others.chi2, others.freedom)
    return bool(fdtrc(3.0, PRIOR_FREEDOM + others.freedom, ratio) < 1e-4)


def _enough(problem: RegistrationProblem, left_out: Sequence[int]) -> bool:
    """Say whether the other points are enough for a fit, and lie far enough apart."""
    others = np.delete(problem.points, list(left_out), axis=0)
    return problem.freedom(len(others)) > 0 and not _bad_shape(others, problem.free)


def refuse_shape(points: Array, free: bool) -> None:
    """Refuse points (m, 3) that do not determine a pose, however well they are touched.

    Raises:
        CalibrationError: they are too few, two are the same place, or they lie in a line or above each other.
    """
    if len(points) < FEWEST_POINTS:
        are = "is" if len(points) == 1 else "are"
        raise CalibrationError(
            f"{amount(len(points), 'point')} {are} too few; touch {FEWEST_POINTS} or more, best 4 to 6 spread all "
            "around",
            value=len(points),
            bound=FEWEST_POINTS,
        )
    for j in range(len(points)):
        for k in range(j):
            if np.linalg.norm(points[j] - points[k]) < 1e-4:
                raise CalibrationError(
                    f"points {k + 1} and {j + 1} are the same place; remove one, or correct their unit", points=(k, j)
                )
    if bad := _bad_shape(points, free):
        raise CalibrationError(bad)


def _bad_shape(points: Array, free: bool) -> str:
    """Say why points (m, 3) do not determine a pose, or ''."""
    off = points - points.mean(axis=0)
    if free:
        spread = np.linalg.svd(off, compute_uv=False) / np.sqrt(len(points))
        if spread[1] < LEAST_SPREAD_M / 2.0:
            return (
                f"the points lie on a line (within {100.0 * spread[1]:.1f} cm), so the rotation about it is unknown; "
                "touch a point beside it, or leave out --free"
            )
        return ""
    spread_m = float(np.sqrt((off[:, :2] ** 2).sum(axis=1).mean()))
    if spread_m < LEAST_SPREAD_M:
        return (
            f"the points lie above each other (within {100.0 * spread_m:.1f} cm), so the heading is unknown; touch "
            "points at least 20 cm apart on the table, or correct their unit"
        )
    return ""


def _contradiction(problem: RegistrationProblem, fit: RegistrationFit, suspects: Sequence[int]) -> CalibrationError:
    off = np.linalg.norm(problem.points - fit.in_base(problem.touched), axis=1)
    names = " or ".join(f"{k + 1}" for k in sorted(suspects))
    known = problem.scale != 1.0 and not problem.scaled
    scale = f"and the calibration's scale of {problem.scale:g} (--find-scale finds it), " if known else ""
    return CalibrationError(
        f"the points contradict the demonstration by up to {100.0 * off.max():.1f} cm, and it is unclear which one is "
        f"wrong (row {names} of the points); check their coordinates and their order, {scale}touch more points, or "
        "move more calmly",
        points=tuple(suspects),
        value=float(off.max()),
    )
