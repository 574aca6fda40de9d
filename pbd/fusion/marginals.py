"""Marginalise one take's normal equations onto its keyframes and its device's errors.

The prior of the device's errors is kept apart, so that takes of one device count it once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pbd.pose import Array, quat_exp, quat_to_matrix
from pbd.tracking.noise import acc_sigma_factor
from pbd.tracking.smoother.factors import linearise, shared_prior, whitener
from pbd.tracking.smoother.gauss_newton import descend
from pbd.tracking.smoother.normal_equations import STATE, STATE_ACC_BIAS, NormalEquations, Solved
from pbd.tracking.smoother.preintegration import POS, ROT
from pbd.tracking.smoother.smooth import Solution
from pbd.tracking.smoother.state import SHARED_GRAVITY, State

SHARED_PART = slice(0, SHARED_GRAVITY.stop)
"""The device's unknowns that all knots of a take share: lag, gyro matrix, accelerometer matrix, gravity."""

BIAS_PART = slice(SHARED_PART.stop, SHARED_PART.stop + 3)
"""The accelerometer's bias among the device's unknowns: that of a take's first knot, the same in all takes of a device.
Letting it differ between takes gained nothing in simulations with bias shifts of 0 to 3 mg."""

DEVICE_ERRORS = BIAS_PART.stop
"""Number of unknowns of a device."""


@dataclass(frozen=True, eq=False)
class Marginal:
    """A take's n keyframes and its device's errors, linearised where the take was estimated.

    Attributes:
        p: (n, 3) m, in the take's own nav.
        R: (n, 3, 3), nav <- sensor.
        by_device: (6n, DEVICE_ERRORS), derivatives of position and rotation vector in nav by the device's errors.
        cov: (6n, 6n) m and rad, of position and rotation vector, given the device's errors.
        device: (DEVICE_ERRORS,) the device's errors that p and R assume.
        information, gradient: (DEVICE_ERRORS, DEVICE_ERRORS) and (DEVICE_ERRORS,), what the take shows of the device,
            without the prior; gradient is information times the errors that the take shows.
        prior, mean: (DEVICE_ERRORS, DEVICE_ERRORS) information and (DEVICE_ERRORS,), the prior of the device's class.
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

    def poses_with_device(self, device: Array) -> tuple[Array, Array]:
        """Return p and R for other errors (DEVICE_ERRORS,) of the device."""
        return _moved(self.p, self.R, self.by_device @ (device - self.device))

    @property
    def cov_poses(self) -> Array:
        """Covariance (6n, 6n) of the keyframes with the device's errors (take and prior) marginalised out."""
        return np.asarray(self.cov + self.by_device @ self._cov_device @ self.by_device.T)

    @property
    def _cov_device(self) -> Array:
        return np.asarray(np.linalg.inv(self.information + self.prior))


def marginal_of(solution: Solution, knots: Sequence[int], x: State | None = None) -> Marginal:
    """Marginalise a take onto its keyframes and its device's errors.

    Args:
        solution: the take's, as tracked alone.
        knots: indices of the keyframes' knots.
        x: linearisation point, estimated with given device errors; None: that of the solution.
    """
    problem, solved = solution.problem, solution.solved
    if x is None:
        x = solution.state
    else:
        equations, _ = linearise(problem, x, solution.fixed, whitener(problem, solution.fixed))
        solved = equations.solve()
        x = x.moved(solved)
    device = np.concatenate((x.shared[SHARED_PART], x.acc_bias[0]))
    R = x.E[list(knots)] @ problem.C[list(knots)]
    return _from_joint(x.p[list(knots)], R, device, _joint_covariance(solved, knots), *_prior(solution, x))


def _from_joint(p: Array, R: Array, device: Array, cov: Array, prior: Array, mean: Array) -> Marginal:
    """Make a marginal from the covariance (6n + DEVICE_ERRORS) of keyframes and device, which includes the prior."""
    n = 6 * len(p)
    information = np.linalg.inv(cov[n:, n:])
    by_device = cov[:n, n:] @ information
    given = cov[:n, :n] - by_device @ cov[n:, :n]
    gradient = information @ device - prior @ mean
    return Marginal(p, R, by_device, 0.5 * (given + given.T), device, information - prior, gradient, prior, mean)


def conditioned(marginal: Marginal, H: Array, noise: Array, misfit: Array) -> Marginal:
    """Return the marginal after a linear measurement of its n keyframes: a Kalman update in Joseph's form.

    Args:
        H: (6n, m), derivatives of the measurement by each position and rotation vector.
        noise, misfit: (m, m) covariance of the measurement; (m,) measured minus predicted value.
    """
    n, cross = len(H), marginal.by_device @ marginal._cov_device
    cov = np.block([[marginal.cov_poses, cross], [cross.T, marginal._cov_device]])
    cov_H = cov[:, :n] @ H
    gain = cov_H @ np.linalg.inv(H.T @ cov_H[:n] + noise)
    joseph = np.eye(len(cov))
    joseph[:, :n] -= gain @ H.T
    step = gain @ misfit
    return _from_joint(
        *_moved(marginal.p, marginal.R, step[:n]),
        marginal.device + step[n:],
        joseph @ cov @ joseph.T + gain @ noise @ gain.T,
        marginal.prior,
        marginal.mean,
    )


def _moved(p: Array, R: Array, by: Array) -> tuple[Array, Array]:
    """Move poses, (n, 3) and (n, 3, 3), by shifts and rotation vectors (6n,)."""
    by = by.reshape(-1, 6)
    return p + by[:, :3], quat_to_matrix(quat_exp(by[:, 3:])) @ R


def estimate_with_device(solution: Solution, device: Array) -> State:
    """Return the smoother's state of a take, estimated again with given errors (DEVICE_ERRORS,) of its device."""
    x = solution.state
    shared = np.concatenate((device[SHARED_PART], x.shared[SHARED_PART.stop :]))
    x = replace(x, shared=shared, acc_bias=x.acc_bias + device[BIAS_PART] - x.acc_bias[0])
    return descend(solution.problem, x, solution.fixed, change=_fix_device).x


def _fix_device(equations: NormalEquations) -> None:
    """Fix the device's errors: rows and columns of the identity make their step zero."""
    i, b = np.arange(SHARED_PART.stop), np.arange(STATE_ACC_BIAS.start, STATE_ACC_BIAS.stop)
    for rows in (equations.corner, equations.corner.T, equations.border.T):
        rows[SHARED_PART] = 0.0
    for rows in (equations.border[0], equations.diagonal[0], equations.diagonal[0].T, equations.below[0].T):
        rows[STATE_ACC_BIAS] = 0.0
    equations.corner[i, i] = equations.diagonal[0, b, b] = 1.0


def _prior(solution: Solution, x: State) -> tuple[Array, Array]:
    """Return information and mean of the prior of the device's errors, as used in the take's own solution."""
    problem = solution.problem
    noise = problem.noise
    prior = shared_prior(problem, x, solution.fixed.prior)[SHARED_PART]
    information = np.zeros((DEVICE_ERRORS, DEVICE_ERRORS))
    information[SHARED_PART, SHARED_PART] = prior[:, SHARED_PART]
    b = np.arange(BIAS_PART.start, BIAS_PART.stop)
    information[b, b] = (acc_sigma_factor(noise, problem.rest) * noise.sensor.acc_bias) ** -2.0
    mean = np.zeros(DEVICE_ERRORS)
    mean[SHARED_PART] = x.shared[SHARED_PART] - np.linalg.solve(prior[:, SHARED_PART], prior[:, -1])
    return information, mean


def _joint_covariance(solved: Solved, knots: Sequence[int]) -> Array:
    """Return the covariance (6n + DEVICE_ERRORS) of position and rotation at some knots, and of the device's errors."""
    n, at = 6 * len(knots), list(knots)
    right = np.zeros((len(solved.scale), STATE, n + 3))
    for k, knot in enumerate(at):
        right[knot, POS, 6 * k : 6 * k + 3] = np.eye(3)
        right[knot, ROT, 6 * k + 3 : 6 * k + 6] = np.eye(3)
    right[0, STATE_ACC_BIAS, n:] = np.eye(3)
    columns, by_shared = solved.covariance_times(right), -solved.by_shared @ solved.shared

    def picked(values: Array) -> Array:
        poses = np.concatenate((values[at, POS], values[at, ROT]), axis=1).reshape(n, -1)
        return np.vstack((poses, values[0, STATE_ACC_BIAS]))

    own, shared = picked(columns), picked(by_shared)[:, SHARED_PART]
    order = np.r_[:n, n + 3 : n + 3 + SHARED_PART.stop, n : n + 3]
    cov = np.block([[own, shared], [shared.T, solved.shared[SHARED_PART, SHARED_PART]]])[np.ix_(order, order)]
    return np.asarray(0.5 * (cov + cov.T))
