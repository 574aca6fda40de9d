"""Register nav in base by least squares, with the joint covariance of the touches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbd.data import Keyframe
from pbd.data.covariance import PoseCovariance
from pbd.data.keyframe import require_keyframes
from pbd.errors import WrongValueError, require_kind
from pbd.pose import (
    Array,
    Pose,
    quat_about_z,
    quat_exp,
    quat_from_xyzw,
    quat_multiply,
    quat_rotate,
    quat_to_matrix,
    skew,
)

PRIOR_FREEDOM = 2.0
"""Degrees of freedom of the prior that the tracker's sigmas are right, because few points may fit well by chance."""


@dataclass(frozen=True, eq=False)
class PointObservations:
    """Positions of the tip at m stops, where it touched points.

    Attributes:
        p_nav_sensor: (m, 3) m.
        lever: (m, 3) m, from the sensor to the tip, in nav.
        cov: (3 m, 3 m) m2, joint covariance of the tip's positions.
        stops: (m,) indices of the stops.
    """

    p_nav_sensor: Array
    lever: Array
    cov: Array
    stops: tuple[int, ...]

    def only(self, keep: Sequence[int]) -> PointObservations:
        """Return the observations with these indices."""
        rows = (3 * np.asarray(keep)[:, None] + np.arange(3)).ravel()
        return PointObservations(
            self.p_nav_sensor[list(keep)],
            self.lever[list(keep)],
            self.cov[np.ix_(rows, rows)],
            tuple(self.stops[k] for k in keep),
        )


def observe_points(
    keyframes: Sequence[Keyframe], covariance: PoseCovariance, p_sensor_tip: Array, cov_tip: Array | None = None
) -> PointObservations:
    """Return the tip's positions p + R l at all stops, with errors of p, R and l.

    Args:
        keyframes: all keyframes of a path that is not conditioned on known places.
        covariance: that path's joint covariance of the poses at its stops.
        p_sensor_tip: (3,) m, the tip l in sensor axes.
        cov_tip: (3, 3) m2, covariance of l; None: l is exact.

    Raises:
        WrongTypeError: an argument is something else.
        WrongValueError: some of the path's keyframes are left out; choose among the result, with `only`.
    """
    require_keyframes(keyframes)
    require_kind("covariance", covariance, "that of a HandPath", isinstance(covariance, PoseCovariance))
    if len(keyframes) != covariance.count:
        what = f"observe_points takes all {covariance.count} keyframes of the path, got {len(keyframes)}"
        raise WrongValueError(f"{what}; choose among its result, with .only([1, 2])", value=len(keyframes))
    m, poses = len(keyframes), [keyframe.T_nav_sensor for keyframe in keyframes]
    R = quat_to_matrix(np.array([pose.wxyz for pose in poses]))
    lever = R @ p_sensor_tip
    by_pose = np.concatenate((np.tile(np.eye(3), (m, 1, 1)), -skew(lever)), axis=2)
    joint = covariance.joint(range(m)).reshape(m, 6, m, 6)
    cov = np.einsum("jab,jbkc,kdc->jakd", by_pose, joint, by_pose).reshape(3 * m, 3 * m)
    if cov_tip is not None:
        by_tip = R.reshape(-1, 3)
        cov += by_tip @ cov_tip @ by_tip.T
    return PointObservations(np.array([pose.p for pose in poses]), lever, cov, tuple(range(m)))


@dataclass(frozen=True, eq=False)
class RegistrationProblem:
    """A registration problem: m touches, and the points that were touched.

    Attributes:
        touched: the touches.
        points: (m, 3) m in base.
        free: nav's tilt is unknown too. Otherwise both frames have z up.
        scaled: the scale of the hand's positions is unknown too.
        scale: the known scale; where it is unknown, the first guess.
    """

    touched: PointObservations
    points: Array
    free: bool = False
    scaled: bool = False
    scale: float = 1.0

    @property
    def unknowns(self) -> list[int]:
        """Indices of the unknowns in position (0 to 2), rotation vector in base (3 to 5), log of the scale (6)."""
        return [0, 1, 2, *((3, 4, 5) if self.free else (5,)), *((6,) if self.scaled else ())]

    def freedom(self, used: int) -> int:
        """Return the degrees of freedom with `used` points."""
        return 3 * used - len(self.unknowns)


@dataclass(frozen=True, eq=False)
class RegistrationFit:
    """A least-squares solution. Covariances assume the tracker's sigmas.

    Attributes:
        pose: T_base_nav.
        scale: factor on the hand's positions.
        cov: (7, 7), covariance of position, rotation vector in base and log of the scale.
        chi2: sum of the squared residuals, in sigmas.
        freedom: degrees of freedom.
        left_out: (l, 3) m in base, each point that was left out, minus its touch by the fit of the others.
        cov_left_out: (l, 3, 3) m2, covariance of `left_out`.
    """

    pose: Pose
    scale: float
    cov: Array
    chi2: float
    freedom: int
    left_out: Array
    cov_left_out: Array

    def in_base(self, touched: PointObservations) -> Array:
        """Return the tip's positions in base, (m, 3) m."""
        return self.pose.act(self.scale * touched.p_nav_sensor + touched.lever)


def variance_factor(chi2: float, freedom: int) -> float:
    """Estimate the factor by which the tracker's variances are too small, from a fit's residuals and a prior of 1."""
    return (PRIOR_FREEDOM + chi2) / (PRIOR_FREEDOM + freedom)


def widened(cov: Array, chi2: float, freedom: int) -> Array:
    """Widen a covariance that assumes the tracker's sigmas, so that two sigma hold 95 %.

    If the sigmas are right up to a factor, whose prior has PRIOR_FREEDOM degrees of freedom, the unknowns have
    Student's t distribution (A. Zellner, An introduction to Bayesian inference in econometrics, 1971, III).
    """
    from scipy.special import ndtr, stdtrit

    wider = 0.5 * float(stdtrit(PRIOR_FREEDOM + freedom, float(ndtr(2.0))))
    return np.asarray(cov * variance_factor(chi2, freedom) * wider**2)


def align(p_from: Array, p_to: Array, free: bool = False) -> Pose:
    """Return the pose T_to_from that brings points (m, 3) closest to others, in the sum of squares.

    `free` allows any rotation (Kabsch 1976, by scipy). Otherwise both frames have z up, and the yaw follows in closed
    form from the horizontal cross-covariance.
    """
    from scipy.spatial.transform import Rotation

    middle_from, middle_to = p_from.mean(axis=0), p_to.mean(axis=0)
    if free:
        wxyz = quat_from_xyzw(Rotation.align_vectors(p_to - middle_to, p_from - middle_from)[0].as_quat())
    else:
        cross = (p_to - middle_to).T @ (p_from - middle_from)
        wxyz = quat_about_z(float(np.arctan2(cross[1, 0] - cross[0, 1], cross[0, 0] + cross[1, 1])))
    return Pose(middle_to - quat_rotate(wxyz, middle_from), wxyz)


def register(problem: RegistrationProblem, left_out: Sequence[int] = ()) -> RegistrationFit:
    """Fit by least squares. The touch of a point that is left out has an additional error, estimated too.

    That error is estimated with all correlations, so it does not include tracking errors that the other points show.
    Residuals are whitened in nav, where the noise does not depend on the unknown rotation.
    """
    from scipy.optimize import least_squares

    touched, where = problem.touched, problem.unknowns
    used = np.delete(np.arange(len(problem.points)), left_out)
    start = align((problem.scale * touched.p_nav_sensor + touched.lever)[used], problem.points[used], problem.free)
    whiten = np.linalg.inv(np.linalg.cholesky(touched.cov))
    by_error = whiten.reshape(len(whiten), -1, 3)[:, list(left_out)].reshape(len(whiten), -1)

    def at(x: Array) -> tuple[Pose, float]:
        step = np.zeros(7)
        step[where] = x[: len(where)]
        return moved(start, problem.scale, step)

    def residuals(x: Array) -> Array:
        return whiten @ misfit(problem, *at(x)).ravel() - by_error @ x[len(where) :]

    def derivative(x: Array) -> Array:
        """By a further step from there: exact if the rotation is about one axis or small; the minimum is the same."""
        return np.hstack((whiten @ jacobian(problem, *at(x)), -by_error))

    first = np.zeros(len(where) + 3 * len(left_out))
    found = least_squares(residuals, first, derivative, method="lm", xtol=1e-12, ftol=1e-12)
    pose, scale = at(found.x)
    by_unknown = np.asarray(found.jac)
    inverse = np.linalg.inv(by_unknown.T @ by_unknown)
    cov = np.zeros((7, 7))
    cov[np.ix_(where, where)] = inverse[: len(where), : len(where)]
    to_base = -scale * quat_to_matrix(pose.wxyz)
    cov_errors = [inverse[k : k + 3, k : k + 3] for k in range(len(where), len(inverse), 3)]
    return RegistrationFit(
        pose,
        scale,
        cov,
        chi2=2.0 * float(found.cost),
        freedom=problem.freedom(len(used)),
        left_out=found.x[len(where) :].reshape(-1, 3) @ to_base.T,
        cov_left_out=to_base @ np.reshape(cov_errors, (-1, 3, 3)) @ to_base.T,
    )


def misfit(problem: RegistrationProblem, pose: Pose, scale: float) -> Array:
    """Return the error of each touch in nav, (m, 3) m: tracked position minus the point's."""
    tips = pose.inverse().act(problem.points)
    return problem.touched.p_nav_sensor - (tips - problem.touched.lever) / scale


def jacobian(problem: RegistrationProblem, pose: Pose, scale: float) -> Array:
    """Return the Jacobian of `misfit`, (3 m, unknowns)."""
    R_nav_base = quat_to_matrix(pose.wxyz).T
    from_nav = problem.points - pose.p
    by_turn = -R_nav_base @ skew(from_nav)
    by_scale = (from_nav @ R_nav_base.T - problem.touched.lever)[:, :, None]
    by_place = np.broadcast_to(R_nav_base, by_turn.shape)
    every = np.concatenate((by_place, by_turn, by_scale), axis=2).reshape(-1, 7) / scale
    return np.asarray(every[:, problem.unknowns])


def moved(pose: Pose, scale: float, step: Array) -> tuple[Pose, float]:
    """Return pose and scale after a step (7,): position, rotation vector in base, log of the scale."""
    stepped = Pose(pose.p + step[:3], quat_multiply(quat_exp(step[3:6]), pose.wxyz))
    return stepped, scale * float(np.exp(step[6]))
