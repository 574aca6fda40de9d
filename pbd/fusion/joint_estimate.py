"""One estimate of a task from all its takes: keyframes, hands and devices together.

A take k has keyframe j at p, R in its own nav, which go with the errors of its device. Its nav is turned by a yaw about
the vertical and shifted by c, its sensor sits in the hand turned by Q and shifted by a lever l against the first take:
    Rz p + c = m + A l + N(0, scatter),   Rz R Q = exp(N(0, scatter)) A
with the task's keyframes m, A in the first take's nav, of its sensor. Those of a thing that stood elsewhere have a yaw
and a shift of their own in each take.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pbd.fusion.devices import BIAS_REPEATS
from pbd.fusion.marginals import BIAS, DEVICE, Marginal
from pbd.fusion.scatter import Scatter
from pbd.pose import Array, matrix_log, quat_about_z, quat_exp, quat_to_matrix, skew
from pbd.tracking.estimate import relative_to_first
from pbd.tracking.smoother.preintegration import ACC_MATRIX, GYR_MATRIX
from pbd.tracking.smoother.state import lower_matrix

LEVER_M, LEVER_WORTH = 0.005, 3.0
"""Prior of the lever between takes: sigma along each axis, m, and its degrees of freedom."""

WEAK = 0.01
"""Damping (1/m2, 1/rad2) of poses and levers in each step, so that no matrix is singular."""

MAX_ITERATIONS, CONVERGED, CONVERGED_LOG = 25, 1e-6, 0.01
"""Gauss-Newton: most iterations; convergence of the keyframes (m, rad) and of the scatter's logarithms."""


@dataclass(frozen=True, eq=False)
class State:
    """The unknowns: of the task, of each take, of each device.

    Attributes:
        m, A: (J, 3) m and (J, 3, 3), the task's keyframes.
        yaw, c: (F, K) rad and (F, K, 3) m, nav of each take in the task's frame 0, and in frame 1, a moved thing's.
        Q, lever: (K, 3, 3) and (K, 3) m, how the sensor sits in the hand, against the first take.
        devices: (D, DEVICE), the devices' errors.
    """

    m: Array
    A: Array
    yaw: Array
    c: Array
    Q: Array
    lever: Array
    devices: Array

    @property
    def turn(self) -> Array:
        """(F, K, 3, 3), Rz of each take."""
        return quat_to_matrix(quat_about_z(self.yaw))

    def of_case(self, device: int) -> State:
        """The same for the axes of the sensor's case instead of the accelerometer's, of the first take's device.

        The smoother takes the accelerometer's axes as exact, in that N has no upper half. If they and the gyro's
        lean alike, at random, the case is turned by a quarter of (M + N) - (M + N)'.
        """
        M, N = self.devices[device][GYR_MATRIX].reshape(3, 3), lower_matrix(self.devices[device][ACC_MATRIX])
        both = M + N - (M + N).T
        turn = quat_to_matrix(quat_exp(0.25 * np.array((both[1, 2], both[2, 0], both[0, 1]))))
        return replace(self, A=self.A @ turn, Q=self.Q @ turn, lever=self.lever @ turn)


@dataclass(frozen=True, eq=False)
class Parts:
    """What takes show of the task. The first take defines the frame.

    Attributes:
        marginals: of each take.
        take, at, own: (n,) each keyframe of a take that is used: which take's, in their order; which of the task's it
            is; which of the take's.
        device: of each take.
        frame: (J,) of each of the task's keyframes.
    """

    marginals: tuple[Marginal, ...]
    take: NDArray[np.intp]
    at: NDArray[np.intp]
    own: NDArray[np.intp]
    device: tuple[int, ...]
    frame: NDArray[np.intp]

    def only(self, keep: NDArray[np.bool_]) -> Parts:
        """Some of the keyframes, (n,)."""
        return replace(self, take=self.take[keep], at=self.at[keep], own=self.own[keep])

    @property
    def rows(self) -> list[slice]:
        """Of each take's residuals."""
        ends = 6 * np.searchsorted(self.take, np.arange(len(self.marginals) + 1))
        return [slice(start, end) for start, end in pairwise(ends.tolist())]


@dataclass(frozen=True, eq=False)
class Joint:
    """The estimate: state, covariance (6J, 6J) of position and turn of the task's keyframes in nav, the hand's scatter.

    Attributes:
        residuals: (N,) of all takes.
        precision: (N, N) of them, the unknowns integrated out.
        of_devices: (D, DEVICE, DEVICE), covariance of their errors.
        turn_sigma: (K,) rad, of how each sensor is turned in the hand, about the axis of which least is known.
    """

    state: State
    cov: Array
    scatter: Scatter
    residuals: Array
    precision: Array
    of_devices: Array
    turn_sigma: Array

    def squares(self, rows: Sequence[NDArray[np.intp]]) -> Array:
        """For each set of residuals how much it adds to the misfit: chi-square with as many degrees of freedom."""
        weighted = self.precision @ self.residuals
        return np.array([weighted[i] @ np.linalg.solve(self.precision[np.ix_(i, i)], weighted[i]) for i in rows])


def estimate_jointly(parts: Parts, x: State, scatter: Scatter) -> Joint:
    """Gauss-Newton over all unknowns, with the scatter's marginal likelihood in step."""
    columns = _Columns(len(x.m), len(x.yaw), len(parts.marginals), len(x.devices))
    group = scatter.group[parts.at].ravel()
    covs = [_relative(marginal, parts.own[parts.take == k]) for k, marginal in enumerate(parts.marginals)]
    known, of_devices = _known(parts, columns)
    devices = slice(columns.devices, columns.count)
    of_takes = columns.take(np.arange(1, len(parts.marginals)))[:, None]
    turns, levers = of_takes + np.arange(3), (of_takes + np.arange(3, 6)).ravel()
    lever_variance = LEVER_M**2
    for _ in range(MAX_ITERATIONS):
        r, J = _residuals(parts, x, columns)
        W, WJ, drift = np.zeros((len(r), len(r))), np.empty_like(J), np.zeros((len(r), len(r)))
        hand = scatter.sigma[parts.at].ravel() ** 2
        for rows, own in zip(parts.rows, _drift(parts, covs, x.turn), strict=True):
            drift[rows, rows] = scatter.tracker * own
            W[rows, rows] = np.linalg.inv(drift[rows, rows] + np.diag(hand[rows]))
            WJ[rows] = W[rows, rows] @ J[rows]
        information, gradient = known.copy(), WJ.T @ r
        gradient[devices] += known[devices, devices] @ x.devices.ravel() - of_devices
        information[levers, levers] += 1.0 / lever_variance
        gradient[levers] += x.lever[1:].ravel() / lever_variance
        cov: Array = np.asarray(np.linalg.inv(J.T @ WJ + information), dtype=np.float64)
        step = -cov @ gradient
        precision = W - WJ @ cov @ WJ.T
        weighted = W @ (r + J @ step)
        x = _moved(x, step, columns)
        square = float((x.lever**2).sum() + np.diagonal(cov)[levers].sum())
        lever_variance = (square + LEVER_WORTH * LEVER_M**2) / (len(levers) + LEVER_WORTH)
        before, scatter = scatter, scatter.improved(precision, weighted, group, drift)
        if np.abs(step[columns.poses]).max() < CONVERGED and scatter.change(before) < CONVERGED_LOG:
            break
    poses, each = columns.poses, [columns.device(d) for d in range(len(x.devices))]
    turn_sigma = np.zeros(len(parts.marginals))  # against the first
    turn_sigma[1:] = np.sqrt(np.linalg.eigvalsh(cov[turns[:, :, None], turns[:, None]])[:, -1])
    return Joint(
        x, cov[poses, poses], scatter, r + J @ step, precision, np.array([cov[d, d] for d in each]), turn_sigma
    )


def _drift(parts: Parts, covs: Sequence[Array], turns: Array) -> Iterator[Array]:
    """Covariance (6n, 6n) of each take's residuals by its tracking, from `_relative`; turns (F, K, 3, 3) of nav."""
    for k, cov in enumerate(covs):
        turn = turns[parts.frame[parts.at[parts.take == k]], k, None]
        for _ in range(2):  # rows, then columns
            cov = (turn @ cov.T.reshape(len(turn), 2, 3, len(cov))).reshape(cov.shape)
        yield cov


def _relative(marginal: Marginal, own: NDArray[np.intp]) -> Array:
    """Covariance (6n, 6n) of some of a take's keyframes relative to its first and its heading, its device given.

    All of a nav is shifted and turned alike by the errors of those, as by another yaw and another origin.
    """
    by_bias, i = marginal.by_device[:, BIAS], (6 * own[:, None] + np.arange(6)).ravel()
    cov = marginal.cov + BIAS_REPEATS**2 * by_bias @ by_bias.T
    for _ in range(2):  # rows, then columns
        cov = relative_to_first(cov.T.reshape(-1, 6, len(cov)), marginal.p - marginal.p[0]).reshape(cov.shape)
    return np.asarray(cov[np.ix_(i, i)])


class _Columns:
    """Where unknowns stand: keyframes (m, A, m, A ...), takes but the first (Q, l, each frame's yaw and c), devices."""

    def __init__(self, keyframes: int, frames: int, takes: int, devices: int) -> None:
        self.poses = slice(0, 6 * keyframes)
        self.of_take = 6 + 4 * frames
        self.devices = 6 * keyframes + self.of_take * (takes - 1)
        self.count = self.devices + DEVICE * devices

    def take(self, k: NDArray[np.intp]) -> NDArray[np.intp]:
        """The first of takes (n,)."""
        return np.asarray(self.poses.stop + self.of_take * (k - 1))

    def device(self, d: int) -> slice:
        return slice(self.devices + DEVICE * d, self.devices + DEVICE * (d + 1))


def _known(parts: Parts, columns: _Columns) -> tuple[Array, Array]:
    """Information of what is known beside the keyframes, and that of the devices times their errors as known."""
    information = np.diag(np.where(np.arange(columns.count) < columns.devices, WEAK, 0.0))
    constant = np.zeros(columns.count)
    for d in sorted(set(parts.device)):
        own = [marginal for marginal, device in zip(parts.marginals, parts.device, strict=True) if device == d]
        at = columns.device(d)
        # The widest of the takes' priors: if one take doubts an accelerometer, all do.
        widest = min(own, key=lambda marginal: float(np.trace(marginal.prior[BIAS, BIAS])))
        information[at, at] += widest.prior + sum(marginal.information for marginal in own)
        constant[at] = widest.prior @ widest.mean + sum(marginal.gradient for marginal in own)
    return information, constant[columns.devices :]


def _residuals(parts: Parts, x: State, columns: _Columns) -> tuple[Array, Array]:
    """Residuals (6n,), and how they go with the unknowns, (6n, columns.count)."""
    take, at, count = parts.take, parts.at, len(parts.at)
    frame, device = parts.frame[at], np.take(parts.device, take)
    shown = [
        (*marginal.placed(x.devices[d]), marginal.by_device.reshape(-1, 6, DEVICE))
        for marginal, d in zip(parts.marginals, parts.device, strict=True)
    ]
    where = list(zip(take.tolist(), parts.own.tolist(), strict=True))
    p, R, by_device = (np.array([shown[k][value][i] for k, i in where]) for value in range(3))
    turn = x.turn[frame, take]
    p, R = (turn @ p[..., None])[..., 0], turn @ R @ x.Q[take]
    A = x.A[at]
    arm = (A @ x.lever[take][..., None])[..., 0]
    r = np.concatenate((p + x.c[frame, take] - x.m[at] - arm, matrix_log(R @ A.transpose(0, 2, 1))), axis=1)
    J = np.zeros((count, 6, columns.count))

    def put(which: NDArray[np.intp], row: int, first: NDArray[np.intp], block: Array) -> None:
        """Derivatives (w, 3, c) of some keyframes' residuals from a row on, by unknowns from a first one (w,) on."""
        J[which[:, None, None], row + np.arange(3)[:, None], first[:, None, None] + np.arange(block.shape[2])] = block

    every, later = np.arange(count), np.flatnonzero(take)
    one, up = np.eye(3)[None], np.array((0.0, 0.0, 1.0))
    put(every, 0, 6 * at, -one)
    put(every, 0, 6 * at + 3, skew(arm))
    put(every, 3, 6 * at + 3, -one)
    own = columns.take(take[later])
    put(later, 3, own, R[later])
    put(later, 0, own + 3, -A[later])
    yaw = own + 6 + 4 * frame[later]
    put(later, 0, yaw, np.cross(up, p[later])[..., None])
    put(later, 3, yaw, up[None, :, None])
    put(later, 0, yaw + 1, one)
    errors = columns.devices + DEVICE * device
    put(every, 0, errors, turn @ by_device[:, :3])
    put(every, 3, errors, turn @ by_device[:, 3:])
    return r.ravel(), J.reshape(6 * count, -1)


def _moved(x: State, step: Array, columns: _Columns) -> State:
    poses = step[columns.poses].reshape(-1, 6)
    takes = np.zeros((x.yaw.shape[1], columns.of_take))
    takes[1:] = step[columns.poses.stop : columns.devices].reshape(-1, columns.of_take)
    frames = takes[:, 6:].reshape(len(takes), -1, 4).transpose(1, 0, 2)
    return State(
        x.m + poses[:, :3],
        quat_to_matrix(quat_exp(poses[:, 3:])) @ x.A,
        x.yaw + frames[..., 0],
        x.c + frames[..., 1:],
        x.Q @ quat_to_matrix(quat_exp(takes[:, :3])),
        x.lever + takes[:, 3:6],
        x.devices + step[columns.devices :].reshape(-1, DEVICE),
    )
