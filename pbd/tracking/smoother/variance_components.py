"""Scale the noise until it fits the recording's residuals (Helmert's variance components), for the covariance only."""

from dataclasses import replace

import numpy as np

from pbd.pose import Array
from pbd.tracking.moving_windows import squares
from pbd.tracking.smoother.factors import leg_jacobian, linearise, pivot_velocity, whitener
from pbd.tracking.smoother.knots import Problem
from pbd.tracking.smoother.normal_equations import STATE_ACC_BIAS, STATE_GYR_BIAS, Solved, batches
from pbd.tracking.smoother.preintegration import VEL
from pbd.tracking.smoother.smooth import Solution
from pbd.tracking.smoother.state import Fixed

PRIOR_FREEDOM, PRIOR_FREEDOM_STILL = 1.0, 30.0
"""Weight of the prior of a variance component, in degrees of freedom: of the sensor's noise, as much as one observation
(R. E. Kass and L. Wasserman, JASA 90, 1995); of zero velocity, which two stops of a coarse sensor hardly show."""


def with_own_noise(solution: Solution) -> Solution:
    """The same estimate, with a covariance whose noise fits the residuals.

    Each part of the noise has a factor k on its variance. Each iteration multiplies k by
    (sum r' W Q W r + nu / k) / (sum tr W Q - tr W Q W A P A' + nu), where Q is the covariance of this part and W^-1
    that of all parts, r are the residuals, A is the Jacobian, P the posterior covariance and nu the weight of the
    prior k = 1.
    """
    problem, x, fixed, solved = solution.problem, solution.state, solution.fixed, solution.solved
    sensor, T, still = problem.noise.sensor, problem.legs.T, solution.still_weight
    walks = ((STATE_GYR_BIAS, x.gyr_bias, sensor.gyr_walk), (STATE_ACC_BIAS, x.acc_bias, sensor.acc_walk))
    nu = np.array((*4 * (PRIOR_FREEDOM,), PRIOR_FREEDOM_STILL))
    stood, whiten = still / problem.still_sigma**2, whitener(problem, fixed)
    jacobian = leg_jacobian(problem, x)
    residuals = (whiten @ jacobian[:, :, -1:])[:, :, 0]
    for iteration in range(3):
        top, bottom, spread = _of_legs(problem, fixed, whiten, solved, jacobian)
        drifts = []
        for (block, values, walk), k in zip(walks, fixed.components[3:], strict=False):
            w = 1.0 / (k * walk**2 * T)
            drift = w * squares(np.diff(values, axis=0))
            redundant = 3.0 - w * np.trace(solved.covariance_of_changes(block), axis1=1, axis2=2)
            drifts.append((drift, redundant))
            top.append(drift.sum())
            bottom.append(redundant.sum())
        if iteration == 0:
            solution = replace(solution, leg_residuals=(residuals, spread), leg_drifts=np.array(drifts))
        w = stood / fixed.components[5]
        top.append(w @ squares(pivot_velocity(problem, x)[0]))
        bottom.append((3.0 * still - w * np.trace(solved.covariance_of_knots(VEL), axis1=1, axis2=2)).sum())
        factors = (top + nu / fixed.components[1:]) / np.maximum(bottom + nu, 1e-3 * nu)
        fixed = replace(fixed, components=fixed.components * (1.0, *factors))
        whiten = whitener(problem, fixed)
        solved.forget()
        del solved  # of a long recording it is large
        solved = linearise(problem, x, fixed, whiten, legs=jacobian)[0].solve()
    return replace(solution, fixed=fixed, solved=solved)


def _of_legs(
    problem: Problem, fixed: Fixed, whiten: Array, solved: Solved, jacobian: Array
) -> tuple[list[float], list[float], Array]:
    """Sums of squared residuals (2,) and redundancies (2,) of the legs' noise from turning and from motion; and the
    covariance A P A' (m - 1, 9, 9) of each leg's whitened prediction."""
    top, bottom, spread = np.zeros(2), np.zeros(2), np.empty(whiten.shape)
    for at in batches(len(whiten)):
        A, back = whiten[at] @ jacobian[at], whiten[at].transpose(0, 2, 1)
        spread[at] = solved.covariance_of_legs(A[:, :, :-1], at.start)
        r, redundant = back @ A[:, :, -1:], back @ (np.eye(9) - spread[at]) @ whiten[at]
        parts = fixed.components[1:3, None, None, None] * problem.legs.parts[1:, at]
        top += (r * (parts @ r)).sum(axis=(1, 2, 3))
        bottom += (parts * redundant).sum(axis=(1, 2, 3))
    return top.tolist(), bottom.tolist(), spread
