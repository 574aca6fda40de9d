"""Nav into base from touched points: least squares, weighed by how the tracker's errors grow and hang together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbd.calibration.alignment import align
from pbd.data import Keyframe
from pbd.data.freeze import freeze
from pbd.errors import CalibrationError
from pbd.pose import Array, Pose, quat_about_z, quat_exp, quat_multiply, quat_rotate, quat_to_matrix

TOUCH_M = 0.001
"""m per axis: by so much a tip misses the point that it is put on."""

FEWEST = 3

LEAST_SPREAD_M = 0.05
"""m: points must lie at least so far apart (rms about their middle or line) in each direction that is needed."""

WRONG_CHI2 = 21.1
"""A point whose misfit against all the others is as improbable as this (chi-square of 3, one in 10,000) is wrong."""

CLEARER_CHI2 = 9.0
"""... and is named where no other point would explain it so well, by this much chi-square."""

POOR_CHI2 = 2.5
"""Per degree of freedom; a fit above it is not to be trusted."""

TRUSTED = 4.0
"""Degrees of freedom; a fit's own misfit outweighs the tracker's sigmas from two or three points on."""


@dataclass(frozen=True, eq=False)
class Touches:
    """Where a demonstration's tip stood when it touched points.

    Attributes:
        p_nav_sensor: (m, 3) m, in the order of time.
        lever: (m, 3) m, from the sensor to the tip, in nav.
        cov: (3 m, 3 m) m2, of the tips' positions.
        stops: (m,) indices.
    """

    p_nav_sensor: Array
    lever: Array
    cov: Array
    stops: tuple[int, ...]

    def __post_init__(self) -> None:
        m = len(self.stops)
        freeze(self, p_nav_sensor=(m, 3), lever=(m, 3), cov=(3 * m, 3 * m))

    def only(self, keep: Sequence[int]) -> Touches:
        """Some of them."""
        rows = (3 * np.asarray(keep)[:, None] + np.arange(3)).ravel()
        return Touches(
            self.p_nav_sensor[list(keep)],
            self.lever[list(keep)],
            self.cov[np.ix_(rows, rows)],
            tuple(self.stops[k] for k in keep),
        )


@dataclass(frozen=True, eq=False)
class PointFit:
    """Nav in base, from touched points.

    Attributes:
        T_base_nav: the pose.
        cov: (6, 6) m and rad, position and rotation vector in base; no tilt where gravity gave it.
        scale: of the hand's positions; 1 where it was not asked for.
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


def touches(keyframes: Sequence[Keyframe], stops: Sequence[int], p_sensor_tip: Array) -> Touches:
    """Where the tip stood at some stops.

    The moves' errors are independent and add up, so that the errors at two stops have in common what arose up to the
    earlier one: cov(j, k) = cov of the earlier. The attitude's errors turn the lever at each stop.

    Args:
        keyframes: all of a path that is not conditioned on known places.
        stops: indices of those that touch a point, increasing.
        p_sensor_tip: (3,) m, the tip in sensor axes.
    """
    touched = [keyframes[k] for k in stops]
    m = len(touched)
    cov = np.zeros((m, 3, m, 3))
    for j in range(m):
        for k in range(m):
            cov[j, :, k] = touched[min(j, k)].cov[:3, :3]
    lever = np.array([quat_rotate(keyframe.T_nav_sensor.wxyz, p_sensor_tip) for keyframe in touched])
    for k, keyframe in enumerate(touched):
        swing = np.cross(np.eye(3), lever[k]).T  # lever moves by turn x lever
        cov[k, :, k] += swing @ keyframe.cov[3:, 3:] @ swing.T
    p = np.array([keyframe.T_nav_sensor.p for keyframe in touched])
    return Touches(p, lever, cov.reshape(3 * m, 3 * m), tuple(stops))


def fit_points(
    touched: Touches, points: Array, *, free: bool = False, scaled: bool = False, touch_m: float = TOUCH_M
) -> PointFit:
    """Find nav in base; a point that contradicts the others is left out and marked.

    A wrong point is found by leaving each one out in turn: its misfit is then tested against what the others say, with
    all correlations (Baarda, A testing procedure for use in geodetic networks, 1968).

    Args:
        touched: m touches.
        points: (m, 3) m in base, in the same order.
        free: nav's tilt too (6 unknowns); else both have z up (yaw and position: 4 unknowns).
        scaled: the scale of the hand's positions too.
        touch_m: m per axis, how well the tip meets a point.

    Raises:
        CalibrationError: too few points, in a line, above each other; or they contradict each other and which one is at
            fault can't be told.
    """
    if len(points) != len(touched.stops):
        raise ValueError(f"{len(touched.stops)} touches and {len(points)} points must be as many")
    refuse_shape(points, free)
    m, unknowns = len(points), (6 if free else 4) + scaled
    keep = list(range(m))
    while True:
        fit = _least_squares(touched.only(keep), points[keep], free, scaled, touch_m)
        without = {k: _without(touched, points, keep, k, free, scaled, touch_m) for k in keep}
        known = {k: each for k, each in without.items() if each is not None}
        gained = {k: fit.chi2 - each.chi2 for k, each in known.items()}
        worst = max(gained, key=lambda k: gained[k], default=None)
        if worst is None or gained[worst] < WRONG_CHI2:
            break
        rivals = [k for k in gained if k != worst and gained[worst] - gained[k] < CLEARER_CHI2]
        if rivals or len(keep) <= FEWEST or 3 * (len(keep) - 1) < unknowns + 3:
            raise _contradiction(touched, points, fit, [worst, *rivals] if rivals else keep)
        keep.remove(worst)
    freedom = max(3 * len(keep) - unknowns, 1)
    alone = [without.get(k) or _without(touched, points, [*keep, k], k, free, scaled, touch_m) for k in range(m)]
    left_out = [_predict(each or fit, touched, points, k, touch_m) for k, each in enumerate(alone)]
    # How far the tracker's sigmas are off is estimated too: their own word counts as TRUSTED degrees of freedom.
    cov = fit.cov * (TRUSTED + fit.chi2) / (TRUSTED + freedom)
    return PointFit(
        T_base_nav=fit.pose,
        cov=cov[:6, :6],
        scale=fit.scale,
        scale_sigma=float(np.sqrt(cov[6, 6])),
        residuals=points - _in_base(fit, touched),
        left_out=np.array([off for off, _ in left_out]),
        left_out_sigma=np.array([sigma for _, sigma in left_out]),
        used=tuple(k in keep for k in range(m)),
        chi2=fit.chi2 / freedom,
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    """chi2 is the whole sum; cov (7, 7) of position, rotation vector in base, and scale."""

    pose: Pose
    scale: float
    cov: Array
    chi2: float


def _least_squares(touched: Touches, points: Array, free: bool, scaled: bool, touch_m: float) -> _Fit:
    """Minimise what is left of p_nav_sensor, whitened: there the noise does not turn with the unknown rotation."""
    from scipy.linalg import solve_triangular
    from scipy.optimize import least_squares

    start = align(touched.p_nav_sensor + touched.lever, points, free)
    root = np.linalg.cholesky(touched.cov + touch_m**2 * np.eye(3 * len(points)))

    def pose_of(x: Array) -> Pose:
        turn = quat_exp(x[3:6]) if free else quat_about_z(float(x[3]))
        return Pose(start.p + x[:3], quat_multiply(turn, start.wxyz))

    def whitened(x: Array) -> Array:
        scale = float(np.exp(x[-1])) if scaled else 1.0
        tip = pose_of(x).inverse().act(points)
        off = touched.p_nav_sensor - (tip - touched.lever) / scale
        return np.asarray(solve_triangular(root, off.ravel(), lower=True))

    unknowns = (6 if free else 4) + scaled
    result = least_squares(whitened, np.zeros(unknowns), method="lm", x_scale="jac")
    jacobian = np.asarray(result.jac)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    where = [0, 1, 2, *((3, 4, 5) if free else (5,)), *((6,) if scaled else ())]
    cov = np.zeros((7, 7))
    cov[np.ix_(where, where)] = inverse
    scale = float(np.exp(result.x[-1])) if scaled else 1.0
    cov[6] *= scale
    cov[:, 6] *= scale
    return _Fit(pose_of(result.x), scale, cov, 2.0 * float(result.cost))


def _without(
    touched: Touches, points: Array, keep: Sequence[int], k: int, free: bool, scaled: bool, touch_m: float
) -> _Fit | None:
    """The fit of the others; None where they are too few or lie badly."""
    others = [other for other in keep if other != k]
    if 3 * len(others) < (6 if free else 4) + scaled or _bad_shape(points[others], free, len(others)):
        return None
    return _least_squares(touched.only(others), points[others], free, scaled, touch_m)


def _in_base(fit: _Fit, touched: Touches) -> Array:
    return fit.pose.act(fit.scale * touched.p_nav_sensor + touched.lever)


def _predict(fit: _Fit, touched: Touches, points: Array, k: int, touch_m: float) -> tuple[Array, Array]:
    """Point k less where the touch lies by a fit, (3,) m in base, and its sigma (the fit's own and the touch's)."""
    tip = _in_base(fit, touched)[k]
    by_turn = np.cross(np.eye(3), tip - fit.pose.p).T
    jacobian = np.hstack((np.eye(3), by_turn, quat_rotate(fit.pose.wxyz, touched.p_nav_sensor[k])[:, None]))
    R = quat_to_matrix(fit.pose.wxyz)
    own = R @ touched.cov[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] @ R.T + touch_m**2 * np.eye(3)
    sigma: Array = np.sqrt(np.diagonal(jacobian @ fit.cov @ jacobian.T + own))
    return points[k] - tip, sigma


def refuse_shape(points: Array, free: bool) -> None:
    """Refuse points (m, 3) from which no pose follows, however well they are touched.

    Raises:
        CalibrationError: too few, two in one place, in a line, above each other.
    """
    if len(points) < FEWEST:
        raise CalibrationError(
            f"{len(points)} points are too few; touch {FEWEST} or more, best 4 to 6 that lie all around",
            value=len(points),
            bound=FEWEST,
        )
    for j in range(len(points)):
        for k in range(j):
            if np.linalg.norm(points[j] - points[k]) < 1e-4:
                raise CalibrationError(f"points {k + 1} and {j + 1} are the same place; take one out", points=(k, j))
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
                f"the points lie in a line (to {100.0 * spread[1]:.1f} cm), so the turn about it is unknown; touch one "
                "beside it, or leave out --free"
            )
        return ""
    spread_m = float(np.sqrt((off[:, :2] ** 2).sum(axis=1).mean()))
    if spread_m < LEAST_SPREAD_M:
        return (
            f"the points lie above each other (to {100.0 * spread_m:.1f} cm), so the heading is unknown; touch points "
            "at least 20 cm apart on the table"
        )
    return ""


def _contradiction(touched: Touches, points: Array, fit: _Fit, suspects: Sequence[int]) -> CalibrationError:
    off = np.linalg.norm(points - _in_base(fit, touched), axis=1)
    names = " or ".join(f"{k + 1}" for k in sorted(suspects))
    return CalibrationError(
        f"the points contradict the demonstration by up to {100.0 * off.max():.1f} cm, and which one is wrong can't be "
        f"told (point {names}); check their coordinates and their order, touch more points, or move more calmly",
        points=tuple(suspects),
        value=float(off.max()),
    )
