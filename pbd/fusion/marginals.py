"""One take's normal equations, reduced to its keyframes and its device: all else is marginalised.

The device's priors are not in it, so that takes of one device can share them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pbd.fusion.errors_in_variables import without_noise
from pbd.pose import Array, quat_exp, quat_to_matrix
from pbd.tracking.noise import acc_sigma_factor
from pbd.tracking.smoother.factors import linearise, shared_prior, whitener
from pbd.tracking.smoother.gauss_newton import CONVERGED_RAD, MAX_ITERATIONS
from pbd.tracking.smoother.normal_equations import ACC_BIAS, STATE, NormalEquations, Solved
from pbd.tracking.smoother.preintegration import POS, ROT
from pbd.tracking.smoother.smooth import Solution
from pbd.tracking.smoother.state import GRAVITY, State

SHARED = slice(0, GRAVITY.stop)
"""The device's unknowns among those that a take's knots share: lag, gyro matrix, accelerometer matrix, gravity."""

BIAS = slice(SHARED.stop, SHARED.stop + 3)
"""The accelerometer's bias among the device's unknowns: that of a take's first knot."""

DEVICE = BIAS.stop
"""Number of unknowns of a device."""


@dataclass(frozen=True, eq=False)
class Marginal:
    """A take's keyframes (n) and its device, linearised where the take was estimated.

    Attributes:
        p: (n, 3) m, in the take's own nav.
        R: (n, 3, 3), nav <- sensor.
        by_device: (6n, DEVICE), how position and rotation vector (in nav) at each keyframe go with the device's errors.
        cov: (6n, 6n) of them, the device given.
        device: (DEVICE,) its errors where p and R hold.
        information: (DEVICE, DEVICE), gradient: (DEVICE,): what the take knows of the device, without its prior.
        prior: (DEVICE, DEVICE) information, mean: (DEVICE,): of the class.
    """

    p: Array
    R: Array
    by_device: Array
    cov: Array
    device: Array
    information: Array
    gradient: Array
    prior: Array
    mean: Array

    def placed(self, device: Array) -> tuple[Array, Array]:
        """p and R, where its device has other errors, (DEVICE,)."""
        return _moved(self.p, self.R, self.by_device @ (device - self.device))

    @property
    def of_poses(self) -> Array:
        """(6n, 6n), their covariance with what the take and the class know of the device."""
        return np.asarray(self.cov + self.by_device @ self._of_device @ self.by_device.T)

    @property
    def _of_device(self) -> Array:
        return np.asarray(np.linalg.inv(self.information + self.prior))


def marginal_of(solution: Solution, knots: Sequence[int], x: State | None = None) -> Marginal:
    """Marginalise a take onto its keyframes and its device.

    Args:
        solution: of the smoother, with its own noise.
        knots: of the keyframes.
        x: where to linearise, the device's errors given; None: at the solution.
    """
    problem, solved = solution.problem, solution.solved
    if x is None:
        x = solution.state
    else:
        if not problem.device:
            problem = without_noise(problem, x, solution.fixed)
        equations, _ = linearise(problem, x, solution.fixed, whitener(problem, solution.fixed))
        solved = equations.solve()
        x = x.moved(solved)
    device = np.concatenate((x.shared[SHARED], x.acc_bias[0]))
    R = x.E[list(knots)] @ problem.C[list(knots)]
    return _split(x.p[list(knots)], R, device, _joint(solved, knots), *_prior(solution, x))


def _split(p: Array, R: Array, device: Array, cov: Array, prior: Array, mean: Array) -> Marginal:
    """A marginal by the joint covariance (6n + DEVICE) of its keyframes and its device, prior included."""
    n = 6 * len(p)
    known = np.linalg.inv(cov[n:, n:])
    by_device = cov[:n, n:] @ known
    given = cov[:n, :n] - by_device @ cov[n:, :n]
    told = known @ device - prior @ mean
    return Marginal(p, R, by_device, 0.5 * (given + given.T), device, known - prior, told, prior, mean)


def conditioned(marginal: Marginal, dependence: Array, noise: Array, misfit: Array) -> Marginal:
    """The same with a linear measurement of its keyframes: a Kalman update in Joseph's form.

    Args:
        marginal: without it.
        dependence: (6n, m), of what is measured on each position and rotation vector.
        noise: (m, m), its own.
        misfit: (m,), by which it is missed.
    """
    n, cross = len(dependence), marginal.by_device @ marginal._of_device
    cov = np.block([[marginal.of_poses, cross], [cross.T, marginal._of_device]])
    seen = cov[:, :n] @ dependence
    gain = seen @ np.linalg.inv(dependence.T @ seen[:n] + noise)
    left = np.eye(len(cov))
    left[:, :n] -= gain @ dependence.T
    moved = gain @ misfit
    return _split(
        *_moved(marginal.p, marginal.R, moved[:n]),
        marginal.device + moved[n:],
        left @ cov @ left.T + gain @ noise @ gain.T,
        marginal.prior,
        marginal.mean,
    )


def _moved(p: Array, R: Array, by: Array) -> tuple[Array, Array]:
    """Poses (n, 3) and (n, 3, 3) elsewhere: by shifts and rotation vectors, (6n,)."""
    by = by.reshape(-1, 6)
    return p + by[:, :3], quat_to_matrix(quat_exp(by[:, 3:])) @ R


def pinned(solution: Solution, device: Array) -> State:
    """The take estimated with its device's errors given, (DEVICE,)."""
    problem, fixed, x = solution.problem, solution.fixed, solution.state
    whiten = whitener(problem, fixed)
    shared = np.concatenate((device[SHARED], x.shared[SHARED.stop :]))
    x = replace(x, shared=shared, acc_bias=x.acc_bias + device[BIAS] - x.acc_bias[0])
    for _ in range(MAX_ITERATIONS):
        equations, _ = linearise(problem, x, fixed, whiten)
        _hold(equations)
        step = equations.solve()
        x = x.moved(step)
        if np.abs(step.d[:, ROT]).max() < CONVERGED_RAD:
            break
    return x


def _hold(equations: NormalEquations) -> None:
    """Make the device's errors no unknowns: their step is zero."""
    i, b = np.arange(SHARED.stop), np.arange(ACC_BIAS.start, ACC_BIAS.stop)
    for of_device in (equations.corner, equations.corner.T, equations.border.T):
        of_device[SHARED] = 0.0
    for of_device in (equations.border[0], equations.diagonal[0], equations.diagonal[0].T, equations.below[0].T):
        of_device[ACC_BIAS] = 0.0
    equations.corner[i, i] = equations.diagonal[0, b, b] = 1.0


def _prior(solution: Solution, x: State) -> tuple[Array, Array]:
    """Information and mean of the device's errors by its class, as the take's own solution has them."""
    problem = solution.problem
    noise = problem.noise
    of_shared = shared_prior(problem, x, solution.fixed.prior)[SHARED]
    information = np.zeros((DEVICE, DEVICE))
    information[SHARED, SHARED] = of_shared[:, SHARED]
    b = np.arange(BIAS.start, BIAS.stop)
    information[b, b] = (acc_sigma_factor(noise, problem.rest) * noise.device.acc_bias) ** -2.0
    mean = np.zeros(DEVICE)
    mean[SHARED] = x.shared[SHARED] - np.linalg.solve(of_shared[:, SHARED], of_shared[:, -1])
    return information, mean


def _joint(solved: Solved, knots: Sequence[int]) -> Array:
    """Covariance of position and turn at some knots (6 each), and of the device."""
    n, at = 6 * len(knots), list(knots)
    right = np.zeros((len(solved.scale), STATE, n + 3))
    for k, knot in enumerate(at):
        right[knot, POS, 6 * k : 6 * k + 3] = np.eye(3)
        right[knot, ROT, 6 * k + 3 : 6 * k + 6] = np.eye(3)
    right[0, ACC_BIAS, n:] = np.eye(3)
    left, by_shared = solved.columns(right), -solved.by_shared @ solved.shared

    def picked(values: Array) -> Array:
        poses = np.concatenate((values[at, POS], values[at, ROT]), axis=1).reshape(n, -1)
        return np.vstack((poses, values[0, ACC_BIAS]))

    own, shared = picked(left), picked(by_shared)[:, SHARED]
    order = np.r_[:n, n + 3 : n + 3 + SHARED.stop, n : n + 3]
    whole = np.block([[own, shared], [shared.T, solved.shared[SHARED, SHARED]]])[np.ix_(order, order)]
    return np.asarray(0.5 * (whole + whole.T))
