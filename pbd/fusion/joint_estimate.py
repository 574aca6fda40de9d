"""One estimate of a task from all its takes: keyframes, sensor poses in the hand, and sensor errors of each device.

Take k has keyframe j at position p and attitude R in its own nav; both depend on the errors of its device. Relative to
the first take, its nav is rotated by a yaw about the vertical (Rz) and shifted by c, and its sensor is rotated in the
hand by Q and shifted by a lever l. With the task's keyframes m, A in the first take's nav, of the first take's sensor:
    Rz p + c = m + A l + N(0, scatter),   Rz R Q H = exp(N(0, scatter)) A
In the dock H is 1. Away from it the hand holds the sensor a few degrees otherwise in each take: N(0, sigma) about each
axis, so that the task's attitudes are the mean of all takes, and do not tilt the dock.
Keyframes of an object that stood elsewhere have a yaw and a shift c of their own in each take: frame 1 besides frame 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pbd.fusion.elimination import Part, Precision, by_take, solve
from pbd.fusion.marginals import BIAS_PART, DEVICE_ERRORS, Marginal
from pbd.fusion.scatter import HAND_RAD, LEVER_M, Scatter
from pbd.pose import Array, matrix_log, quat_about_z, quat_exp, quat_to_matrix, skew
from pbd.tracking.estimate import relative_to_first
from pbd.tracking.smoother.preintegration import ACC_MATRIX, GYR_MATRIX
from pbd.tracking.smoother.state import lower_matrix

LARGEST_LEVER_M = 0.05
"""Largest sigma of the levers along each axis, m: half a hand's width. Without a bound, differing takes get levers of
metres."""

LARGEST_HOLD_RAD = np.radians(10.0)
"""Largest sigma of H about each axis, rad. If takes differ by more, the sensor was turned between the dock and the
task, so that the dock does not show how it sits in the hand."""

PRIOR_FREEDOM = 3.0
"""Degrees of freedom of the priors of the levers' and of H's sigma."""

DAMPING = 0.01
"""Damping (1/m2, 1/rad2) of all unknowns but the devices' errors, so that no matrix is singular."""

MAX_ITERATIONS, CONVERGED, CONVERGED_LOG = 25, 1e-3, 0.01
"""Gauss-Newton: largest number of iterations; largest last fall of chi-square, and last change of the scatter's
logarithms."""

TURN, LEVER, HOLD = slice(0, 3), slice(3, 6), slice(6, 9)
"""Q, l and H among a take's own unknowns."""


@dataclass(frozen=True, eq=False)
class TaskState:
    """The unknowns of a task with J keyframes, K takes, F frames and D devices.

    Attributes:
        m, A: (J, 3) m and (J, 3, 3), the task's keyframes.
        yaw, c: (F, K) rad and (F, K, 3) m, each take's nav in frame 0, and in frame 1 for a moved object's keyframes.
        Q, lever: (K, 3, 3) and (K, 3) m, the sensor's rotation and shift in the hand, relative to the first take.
        H: (K, 3, 3), its further rotation in the hand away from the dock.
        devices: (D, DEVICE_ERRORS), the devices' errors.
    """

    m: Array
    A: Array
    yaw: Array
    c: Array
    Q: Array
    H: Array
    lever: Array
    devices: Array

    @property
    def Rz(self) -> Array:
        """Rotation of each take's nav, (F, K, 3, 3)."""
        return quat_to_matrix(quat_about_z(self.yaw))

    def in_case_axes(self, device: int) -> TaskState:
        """Return the state for the axes of the case instead of the accelerometer's, of the first take's `device`.

        The smoother defines the accelerometer's axes as exact: its matrix N has no upper half. If the axes of both
        sensors are misaligned with the case at random, and equally much, then the best estimate of the case's rotation
        is a quarter of (M + N) - (M + N)', with M the gyro's matrix.
        """
        M, N = self.devices[device][GYR_MATRIX].reshape(3, 3), lower_matrix(self.devices[device][ACC_MATRIX])
        skewed = M + N - (M + N).T
        rotation = quat_to_matrix(quat_exp(0.25 * np.array((skewed[1, 2], skewed[2, 0], skewed[0, 1]))))
        H = rotation.T @ self.H @ rotation
        return replace(self, A=self.A @ rotation, Q=self.Q @ rotation, H=H, lever=self.lever @ rotation)


@dataclass(frozen=True, eq=False)
class Observations:
    """What takes show of a task. The first take defines the frame.

    Attributes:
        marginals: one for each take.
        take, at, own: (n,) for each observed keyframe: index of its take (ascending), of the task's keyframe, and of
            the take's own keyframe.
        device: number of each take's device.
        frame: (J,) frame of each of the task's keyframes.
    """

    marginals: tuple[Marginal, ...]
    take: NDArray[np.intp]
    at: NDArray[np.intp]
    own: NDArray[np.intp]
    device: tuple[int, ...]
    frame: NDArray[np.intp]

    def subset(self, keep: NDArray[np.bool_]) -> Observations:
        """Return those observed keyframes where `keep` (n,) is true."""
        return replace(self, take=self.take[keep], at=self.at[keep], own=self.own[keep])

    @property
    def rows(self) -> list[slice]:
        """Rows of each take's residuals."""
        ends = 6 * np.searchsorted(self.take, np.arange(len(self.marginals) + 1))
        return [slice(start, end) for start, end in pairwise(ends.tolist())]


@dataclass(frozen=True, eq=False)
class JointEstimate:
    """The joint estimate of a task.

    Attributes:
        state: the estimate.
        cov: (6J, 6J), covariance of the keyframes' positions (m) and rotation vectors (rad) in nav.
        scatter: the hand's scatter.
        residuals: (N,), those of all takes.
        precision: their inverse covariance.
        cov_devices: (D, DEVICE_ERRORS, DEVICE_ERRORS), covariance of each device's errors.
        turn_sigma: (K,) rad, sigma of each sensor's rotation in the hand about its least certain axis.
    """

    state: TaskState
    cov: Array
    scatter: Scatter
    residuals: Array
    precision: Precision
    cov_devices: Array
    turn_sigma: Array

    def chi_squares(self, sets: Sequence[NDArray[np.intp]]) -> Array:
        """Return the fall of chi-square without each set of one take's residuals; the set's size is its degrees of
        freedom."""
        weighted = self.precision.times(self.residuals)
        return np.array([weighted[i] @ np.linalg.solve(self.precision.within_take(i), weighted[i]) for i in sets])


def estimate_jointly(
    observations: Observations, x: TaskState, scatter: Scatter, iterations: int = MAX_ITERATIONS
) -> JointEstimate:
    """Estimate all unknowns by Gauss-Newton; each iteration also improves the scatter by its marginal likelihood.

    From an estimate with another scatter, one iteration suffices for the fit to this scatter.
    """
    takes = len(observations.marginals)
    group = scatter.group[observations.at].ravel()
    covs = [
        _relative_covariance(marginal, observations.own[observations.take == k])
        for k, marginal in enumerate(observations.marginals)
    ]
    for _ in range(iterations):
        r, J = _residuals(observations, x)
        hand = scatter.sigma[observations.at].ravel() ** 2
        tracking = [scatter.tracker * cov for cov in _in_task_frame(observations, covs, x.Rz)]
        rows_covs = zip(observations.rows, tracking, strict=True)
        weights: list[Array] = [np.asarray(np.linalg.inv(cov + np.diag(hand[rows]))) for rows, cov in rows_covs]
        solved = solve(_parts(observations, x, *scatter.own_variances), weights, J, r)
        x = _updated(x, solved.steps)
        weighted = by_take(weights, solved.residuals)
        before, scatter = scatter, scatter.improved(solved.precision, weighted, group, tracking)
        own = np.array([np.diagonal(cov)[: HOLD.stop] for cov in solved.covs[:takes]])
        scatter = replace(scatter, own_variances=_own_variances(x, own))
        if solved.fall < CONVERGED and scatter.change(before) < CONVERGED_LOG:
            break
    turn_sigma = np.sqrt([np.linalg.eigvalsh(cov[TURN, TURN])[-1] for cov in solved.covs[:takes]])
    turn_sigma[0] = 0.0  # relative to the first take
    *cov_devices, cov = solved.covs[takes:]
    return JointEstimate(x, cov, scatter, solved.residuals, solved.precision, np.array(cov_devices), turn_sigma)


def _own_variances(x: TaskState, own: Array) -> tuple[float, float]:
    """Return the variances of the levers (m2) and of H (rad2), given the variances (K, 9) of the takes' own unknowns.

    The first take's lever is zero by definition.
    """
    found = []
    for value, part, first, prior, largest in (
        (x.lever, LEVER, 1, LEVER_M, LARGEST_LEVER_M),
        (matrix_log(x.H), HOLD, 0, HAND_RAD, LARGEST_HOLD_RAD),
    ):
        squares = (value**2 + own[:, part])[first:]
        shown = (float(squares.sum()) + PRIOR_FREEDOM * prior**2) / (squares.size + PRIOR_FREEDOM)
        found.append(min(shown, largest**2))
    return found[0], found[1]


def _in_task_frame(observations: Observations, covs: Sequence[Array], Rz: Array) -> Iterator[Array]:
    """Yield each take's `_relative_covariance` (6n, 6n), rotated from its nav by Rz (F, K, 3, 3)."""
    for k, cov in enumerate(covs):
        rotation = Rz[observations.frame[observations.at[observations.take == k]], k, None]
        for _ in range(2):  # rows, then columns
            cov = (rotation @ cov.T.reshape(len(rotation), 2, 3, len(cov))).reshape(cov.shape)
        yield cov


def _relative_covariance(marginal: Marginal, own: NDArray[np.intp]) -> Array:
    """Return the covariance (6n, 6n) of some of a take's keyframes relative to its first one, given its device.

    Errors of the first keyframe's position and heading move all of nav, which yaw and c absorb.
    """
    one, rows = np.eye(len(marginal.cov)), (6 * own[:, None] + np.arange(6)).ravel()
    relative = relative_to_first(one.reshape(-1, 6, len(one)), marginal.p - marginal.p[0]).reshape(one.shape)[rows]
    return np.asarray(relative @ marginal.cov @ relative.T)


def _parts(observations: Observations, x: TaskState, lever_variance: float, hold_variance: float) -> list[Part]:
    """Return the unknowns: each take's own (Q, l, H, each frame's yaw and c), each device's, the keyframes (m, A)."""
    own, poses = slice(0, HOLD.stop + 4 * len(x.yaw)), 6 * len(x.m)
    damping, gradient = np.full(own.stop, DAMPING), np.zeros((len(x.lever), own.stop))
    for part, value, variance in ((LEVER, x.lever, lever_variance), (HOLD, matrix_log(x.H), hold_variance)):
        damping[part] += 1.0 / variance
        gradient[:, part] = value / variance
    parts = [Part(rows, own, np.diag(damping), one) for rows, one in zip(observations.rows, gradient, strict=True)]
    device, of_row = np.array(observations.device), np.take(observations.device, observations.take).repeat(6)
    at = slice(own.stop, own.stop + DEVICE_ERRORS)
    for d, errors in enumerate(x.devices):
        shown = [observations.marginals[k] for k in np.flatnonzero(device == d)]
        # The widest prior counts: if one take casts doubt on an accelerometer, the doubt holds for all its takes.
        widest = min(shown, key=lambda marginal: float(np.trace(marginal.prior[BIAS_PART, BIAS_PART])))
        information = widest.prior + sum(marginal.information for marginal in shown)
        product = widest.prior @ widest.mean + sum(marginal.gradient for marginal in shown)
        parts.append(Part(np.flatnonzero(of_row == d), at, information, information @ errors - product))
    return [*parts, Part(slice(None), slice(at.stop, at.stop + poses), DAMPING * np.eye(poses), np.zeros(poses))]


def _residuals(observations: Observations, x: TaskState) -> tuple[Array, Array]:
    """Return the residuals (6n,) and their Jacobian (6n, C) by the `_parts` of their take, its device and all takes."""
    take, at, count = observations.take, observations.at, len(observations.at)
    frame = observations.frame[at]
    shown = [
        (*marginal.poses_with_device(x.devices[d]), marginal.by_device.reshape(-1, 6, DEVICE_ERRORS))
        for marginal, d in zip(observations.marginals, observations.device, strict=True)
    ]
    where = list(zip(take.tolist(), observations.own.tolist(), strict=True))
    p, R, by_device = (np.array([shown[k][value][i] for k, i in where]) for value in range(3))
    Rz = x.Rz[frame, take]
    p, R = (Rz @ p[..., None])[..., 0], Rz @ R @ x.Q[take]
    docked = at == 0
    held, A = np.where(docked[:, None, None], R, R @ x.H[take]), x.A[at]
    lever = (A @ x.lever[take][..., None])[..., 0]
    r = np.concatenate((p + x.c[frame, take] - x.m[at] - lever, matrix_log(held @ A.transpose(0, 2, 1))), axis=1)
    by_hand, by_nav = np.zeros((count, 6, HOLD.stop)), np.zeros((count, 6, 4))
    by_pose = np.tile(-np.eye(6), (count, 1, 1))
    by_hand[:, 3:, TURN], by_hand[:, :3, LEVER] = R, -A
    up = np.array((0.0, 0.0, 1.0))
    by_nav[:, :3, 0], by_nav[:, 3:, 0], by_nav[:, :3, 1:] = np.cross(up, p), up, np.eye(3)
    by_pose[:, :3, 3:] = skew(lever)
    by_navs, by_poses = np.zeros((count, 6, len(x.yaw), 4)), np.zeros((count, 6, len(x.m), 6))
    by_navs[np.arange(count), :, frame], by_poses[np.arange(count), :, at] = by_nav, by_pose
    by_take = np.concatenate((by_hand, by_navs.reshape(count, 6, -1)), axis=2)
    by_take[take == take[0]] = 0.0  # the first take that is left defines the frame
    by_take[~docked, 3:, HOLD] = held[~docked]
    by_device = (Rz[:, None] @ by_device.reshape(count, 2, 3, -1)).reshape(by_device.shape)
    J = np.concatenate((by_take, by_device, by_poses.reshape(count, 6, -1)), axis=2)
    return r.ravel(), J.reshape(6 * count, -1)


def _updated(x: TaskState, steps: Sequence[Array]) -> TaskState:
    """Return the state after a step of each of its `_parts`."""
    own, devices, poses = np.array(steps[: len(x.lever)]), np.array(steps[len(x.lever) : -1]), steps[-1].reshape(-1, 6)
    frames = own[:, HOLD.stop :].reshape(len(own), -1, 4).transpose(1, 0, 2)
    return TaskState(
        x.m + poses[:, :3],
        quat_to_matrix(quat_exp(poses[:, 3:])) @ x.A,
        x.yaw + frames[..., 0],
        x.c + frames[..., 1:],
        x.Q @ quat_to_matrix(quat_exp(own[:, TURN])),
        x.H @ quat_to_matrix(quat_exp(own[:, HOLD])),
        x.lever + own[:, LEVER],
        x.devices + devices,
    )
