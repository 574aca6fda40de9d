"""Update a hand path with what is known of its stops: places visited twice, known positions, known heights.

The poses at the stops have the joint covariance that the smoother gives. The constraints (stop_constraints.py) are
linear in the poses, with a small noise of their own. So one Kalman update gives the best estimate of all poses.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from math import erfc, sqrt

import numpy as np

from pbd.data import Calibration, ClaimFit, HandPath, Known
from pbd.data.constraints import CalibrationUpdate
from pbd.data.covariance import PoseCovariance
from pbd.data.streams import interpolate
from pbd.errors import TrackingError
from pbd.pose import Array, Pose, quat_exp, quat_multiply
from pbd.tracking.noise import OUTLIER_SIGMAS
from pbd.tracking.smoother.path import between_stops
from pbd.tracking.stop_constraints import MOUNT_ERRORS, START_ERRORS, Claim, claims_of


def apply_constraints(
    path: HandPath, known: Known, calibration: Calibration | None = None, T_base_nav: Pose | None = None
) -> HandPath:
    """Move the stops, and the path between them, to their most likely places given what is known.

    With the claims' misfits d (m,), their Jacobian G^T for k poses (G is (k, 6, m)), the poses' covariance P and the
    claims' own R: the poses change by P G S^-1 d with S = G^T P G + R. The covariance has Joseph's form, which stays
    positive for any P and R.

    Args:
        path: as tracked, without constraints.
        known, calibration, T_base_nav: as `claims_of` takes them.

    Returns:
        The path with new poses, velocities (the derivative of position, zero in stops) and covariance, the fit of each
        claim, and what the claims say of the calibration. The velocity misclosures are unchanged.

    Raises:
        TrackingError: a claim contradicts the data, or names no stop.
    """
    if path.claims:
        raise ValueError("the path is conditioned already; give all that is known at once")
    claims = claims_of(path, known, calibration, T_base_nav)
    if not claims:
        return path
    p_stop = path.p_nav_sensor[[stop.start for stop in path.stops]]
    G, R, misfit = measurement_of(claims, p_stop, calibration)
    PG = path.covariance.multiply(G)
    S = np.einsum("kam,kan->mn", G, PG) + R
    fits = fits_of(path, claims, misfit, S)

    gain, update = PG @ np.linalg.inv(S), None
    if calibration is not None:
        update = _calibration_update(path.covariance, claims, calibration, (gain, G, R, misfit, S))
    covariance = PoseCovariance(path.covariance.count, partial(_joseph_times, path.covariance, gain, G, R))
    return replace(_move_path(path, gain @ misfit), covariance=covariance, claims=fits, calibration_update=update)


def _calibration_update(
    prior: PoseCovariance,
    claims: Sequence[Claim],
    calibration: Calibration,
    update: tuple[Array, Array, Array, Array, Array],
) -> CalibrationUpdate | None:
    """The part of start, mount and scale in the update of the poses (gain, G, R, misfit, S), as if they were three more
    poses; None if the claims say nothing of them.

    Their errors have no part in the prior covariance of the poses: their share of R is `by_calibration`.
    """
    (gain, G, R, misfit, S), by_calibration = update, _by_calibration(claims)
    errors = _calibration_errors(calibration)
    by_claim = -errors @ by_calibration.T @ np.linalg.inv(S)
    if not calibration.knows_start or not by_claim.any():
        return None
    more, themselves, parts = np.zeros((3, 6, len(S))), np.zeros((3, 6, 10)), [START_ERRORS.stop, MOUNT_ERRORS.stop]
    for i, (found, itself) in enumerate(zip(np.split(by_claim, parts), np.split(np.eye(10), parts), strict=True)):
        more[i, : len(found)], themselves[i, : len(found)] = found, itself
    gain, G = np.concatenate((gain, more)), np.concatenate((G, np.zeros((3, *G.shape[1:]))))
    remaining = gain @ by_calibration
    remaining[-3:] += themselves
    poses = PoseCovariance(prior.count + 3, partial(_with_three_exact, prior))
    own = R - by_calibration @ errors @ by_calibration.T
    covariance = PoseCovariance(poses.count, partial(_joseph_times, poses, gain, G, own))
    start, tip, share = np.split(by_claim @ misfit, parts)

    def corrected(T_base_start: Pose | None) -> Pose | None:
        """Return the dock or nav as corrected."""
        if T_base_start is None:
            return None
        return Pose(T_base_start.p + start[:3], quat_multiply(quat_exp(start[3:]), T_base_start.wxyz))

    after = replace(
        calibration,
        T_base_dock=corrected(calibration.T_base_dock),
        T_base_nav=corrected(calibration.T_base_nav),
        T_sensor_tool=Pose(calibration.T_sensor_tool.p + tip, calibration.T_sensor_tool.wxyz),
        scale=calibration.scale * (1.0 + float(share[0])),
    )
    return CalibrationUpdate(calibration, after, remaining, covariance)


def _with_three_exact(prior: PoseCovariance, columns: Array) -> Array:
    """The covariance of poses, and of three more without errors, times columns (k + 3, 6, c)."""
    return np.concatenate((prior.multiply(columns[:-3]), np.zeros_like(columns[-3:])))


def _joseph_times(prior: PoseCovariance, gain: Array, G: Array, R: Array, columns: Array) -> Array:
    """The covariance in Joseph's form, (1 - K G^T) P (1 - G K^T) + K R K^T, times columns (k, 6, c)."""
    by_claim = np.einsum("kam,kac->mc", gain, columns)
    left = prior.multiply(columns - G @ by_claim)
    conditioned: Array = left + gain @ (R @ by_claim - np.einsum("kam,kac->mc", G, left))
    return conditioned


def measurement_of(
    claims: Sequence[Claim], p_stop: Array, calibration: Calibration | None
) -> tuple[Array, Array, Array]:
    """The claims' transposed Jacobian for k poses (k, 6, m); their covariance R (m, m), m2; their misfits (m,), m."""
    rows = _rows(claims)
    m = rows[-1].stop
    G, R, misfit = np.zeros((len(p_stop), 6, m)), np.zeros((m, m)), np.concatenate([claim.value for claim in claims])
    for claim, row in zip(claims, rows, strict=True):
        for stop, lever, sign in ((claim.stop, claim.levers[0], 1.0), (claim.other, claim.levers[1], -1.0)):
            misfit[row] -= sign * claim.axes @ lever
            if stop is not None:  # axes @ (p + turn x lever)
                misfit[row] -= sign * claim.axes @ p_stop[stop]
                G[stop, :3, row] += sign * claim.axes.T
                G[stop, 3:, row] += sign * np.cross(lever, claim.axes).T
        R[row, row] += claim.own_variance * np.eye(len(claim.value))
        for relative, column in zip(claims, rows, strict=True):
            if relative.group == claim.group:
                R[row, column] += claim.shared_variance * np.eye(len(claim.value))
    if calibration is not None:
        by_calibration = _by_calibration(claims)
        R += by_calibration @ _calibration_errors(calibration) @ by_calibration.T
    return G, R, misfit


def _by_calibration(claims: Sequence[Claim]) -> Array:
    """The derivatives (m, 10) of the misfits: `Claim.by_calibration`, then by the scale's error, a share of it."""
    by_scale = [claim.axes @ (claim.levers[0] - claim.levers[1]) - claim.value for claim in claims]
    return np.column_stack((np.vstack([claim.by_calibration for claim in claims]), np.concatenate(by_scale)))


def _calibration_errors(calibration: Calibration) -> Array:
    """The covariance (10, 10) of the calibration's errors, in the columns of `_by_calibration`."""
    errors = np.zeros((10, 10))
    errors[-1, -1] = calibration.scale_sigma**2
    errors[START_ERRORS, START_ERRORS] = calibration.cov_start
    if calibration.cov_sensor_tool is not None:
        errors[MOUNT_ERRORS, MOUNT_ERRORS] = calibration.cov_sensor_tool[:3, :3]
    return errors


def _rows(claims: Sequence[Claim]) -> list[slice]:
    ends = np.cumsum([0, *(len(claim.value) for claim in claims)]).tolist()
    return [slice(start, stop) for start, stop in pairwise(ends)]


def _move_path(path: HandPath, moved: Array) -> HandPath:
    """The path with the stops moved by (k, 6): m, then rotation vector in rad, in nav.

    Between stops the rotation changes linearly with time, as from white noise of the gyro.
    """
    t = path.t
    shift, faster = between_stops(t, path.stops, moved[:, :3], moved[:, :3])
    for stop, by in zip(path.stops, moved[:, :3], strict=True):
        shift[stop.start : stop.stop] = by
    edges = t[[row for stop in path.stops for row in (stop.start, stop.stop - 1)]]
    turn = interpolate(t, edges, np.repeat(moved[:, 3:], 2, axis=0))
    return replace(
        path,
        p_nav_sensor=path.p_nav_sensor + shift,
        v_nav_sensor=path.v_nav_sensor + faster,
        wxyz_nav_sensor=quat_multiply(quat_exp(turn), path.wxyz_nav_sensor),
    )


def fits_of(path: HandPath, claims: Sequence[Claim], misfit: Array, S: Array) -> tuple[ClaimFit, ...]:
    """The fit of each claim on its own, given the covariance S (m, m) of all misfits.

    If one does not fit, or all together do not, the error names the visit without which all others fit best. Two
    visits alone can't tell which of them is off.

    Raises:
        TrackingError: a claim does not fit, or all together do not.
    """
    rows = _rows(claims)
    square = [float(misfit[row] @ np.linalg.solve(S[row, row], misfit[row])) for row in rows]
    alone = [_excess(value, row.stop - row.start) for value, row in zip(square, rows, strict=True)]
    if max(alone) > 1.0 or _excess(float(misfit @ np.linalg.solve(S, misfit)), len(misfit)) > 1.0:
        named, off, gained = _least_fitting(claims, misfit, S)
        own = next((i for i, claim in enumerate(claims) if claim is named and alone[i] > 1.0), None)
        if own is None:
            _refuse(path, named, off, gained, " against the other claims")
        else:
            _refuse(path, named, misfit[rows[own]], square[own])
    return tuple(
        ClaimFit(claim.saying, path.stops[claim.stop].middle_s(path.t), claim.stop, _length(misfit[row]), sqrt(value))
        for claim, row, value in zip(claims, rows, square, strict=True)
    )


def _least_fitting(claims: Sequence[Claim], misfit: Array, S: Array) -> tuple[Claim, Array, float]:
    """The claim without which chi-square falls most, its misfit against all others, m, and that fall.

    In a group of several claims, the visit that they all refer to is one more suspect: its error is common to them.
    """
    rows, m = _rows(claims), np.eye(len(misfit))
    suspects = [(claim, m[:, row]) for claim, row in zip(claims, rows, strict=True)]
    for first in claims:
        group = [m[:, row] for claim, row in zip(claims, rows, strict=True) if claim.group == first.group]
        if first.converse and len(group) > 1 and first.other is not None:
            suspects.append((replace(first, saying=first.converse, stop=first.other), sum(group[1:], group[0])))
    precision = np.linalg.inv(S)
    found = []
    for claim, common in suspects:
        weighted = common.T @ precision @ misfit
        off: Array = np.asarray(np.linalg.solve(common.T @ precision @ common, weighted), dtype=np.float64)
        found.append((claim, off, float(weighted @ off)))
    return max(found, key=lambda each: each[2])


def _refuse(path: HandPath, claim: Claim, misfit: Array, square: float, beside: str = "") -> None:
    off, sigmas = _length(misfit), sqrt(square)
    number = f"{sigmas:.0f}" if sigmas >= 9.95 else f"{sigmas:.1f}"
    raise TrackingError(
        f"demo.toml says that {claim.saying}, but {claim.differs.format(_cm(off))}{beside} "
        f"(sigma {_cm(off / sigmas)}, {number} sigma); remove {claim.entry}, or record again",
        t=path.stops[claim.stop].middle_s(path.t),
        stop=claim.stop,
        value=off,
        sigmas=sigmas,
    )


def _excess(square: float, dimension: int) -> float:
    """A squared misfit, divided by the chi-square that is as improbable as OUTLIER_SIGMAS along one axis.

    It is 0 if the misfit is small even for one axis. This saves loading scipy.special, which takes 0.15 s.
    """
    if square <= OUTLIER_SIGMAS**2:
        return 0.0
    from scipy.special import chdtri

    return square / float(chdtri(dimension, erfc(OUTLIER_SIGMAS / sqrt(2.0))))


def _length(vector: Array) -> float:
    return float(np.linalg.norm(vector))


def _cm(metres: float) -> str:
    return f"{100.0 * metres:.0f} cm" if metres >= 0.0995 else f"{100.0 * metres:.1f} cm"
