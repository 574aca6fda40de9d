"""A covariance whose noise fits what the recording shows: Helmert's variance components."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pbd.tracking.factors import creep, leg_jacobian, linearise, whitener
from pbd.tracking.normal_equations import ACC_BIAS, GYR_BIAS, STATE, VEL
from pbd.tracking.smoother import Solution

COMPONENTS = 3
"""Iterations for the variance components."""

NU, NU_STILL = 5.0, 30.0
"""Degrees of freedom that the priors of variance components are worth."""


def with_own_noise(solution: Solution) -> Solution:
    """The same estimate with a covariance whose noise fits what the recording shows (Helmert's variance components).

    Each part of the noise gets a factor k: k *= (sum r' W Q W r + nu) / (sum tr W Q - tr W Q W A P A' + nu), with its
    covariance Q, all of it W^-1, residuals r, Jacobian A, posterior P; nu is what the prior is worth.
    """
    problem, x, local, solved = solution.problem, solution.state, solution.local, solution.solved
    legs, device, T = problem.legs, problem.noise.device, problem.legs.T
    jacobian, weights = leg_jacobian(problem, x), solution.weights
    A = np.zeros((len(T), 15, jacobian.shape[2] - 1))  # of a leg's nine residuals, and of how the biases change
    change = np.arange(GYR_BIAS.start, ACC_BIAS.stop)
    A[:, range(9, 15), change], A[:, range(9, 15), STATE + change] = -1.0, 1.0
    whiten = whitener(problem, local)
    for _ in range(COMPONENTS):
        whitened = whiten @ jacobian
        A[:, :9], r = whitened[:, :, :-1], whitened[:, :, -1:]
        spread = solved.of_pairs(A)
        components = local.components.copy()
        for c in (1, 2):
            Q = components[c] * (whiten @ legs.parts[c] @ whiten.transpose(0, 2, 1))
            top = float((r * (Q @ r)).sum()) + NU
            bottom = float(np.trace(Q, axis1=1, axis2=2).sum() - (Q * spread[:, :9, :9]).sum()) + NU
            components[c] *= top / max(bottom, 1e-3 * NU)
        walks = local.walks.copy()
        for c, (values, walk) in enumerate(((x.gyr_bias, device.gyr_walk), (x.acc_bias, device.acc_walk))):
            w = 1.0 / (walks[c] * walk**2 * T)
            own = spread[:, range(9 + 3 * c, 12 + 3 * c), range(9 + 3 * c, 12 + 3 * c)].sum(axis=1)
            top = float((w * (np.diff(values, axis=0) ** 2).sum(axis=1)).sum()) + NU
            bottom = float((3.0 - w * own).sum()) + NU
            walks[c] *= top / max(bottom, 1e-3 * NU)
        own = np.trace(solved.of_knots()[:, VEL, VEL], axis1=1, axis2=2)
        w = weights.still / (local.still * problem.still**2)
        top = float((w * (creep(problem, x)[0] ** 2).sum(axis=1)).sum()) + NU_STILL
        bottom = float((3.0 * weights.still - w * own).sum()) + NU_STILL
        still = local.still * top / max(bottom, 1e-3 * NU_STILL)
        local = replace(local, components=components, walks=walks, still=still)
        whiten = whitener(problem, local)
        solved = linearise(problem, x, local, whiten)[0].solve()
    return replace(solution, local=local, solved=solved)
