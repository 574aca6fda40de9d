"""A covariance whose noise fits what the recording shows: Helmert's variance components."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pbd.tracking.factors import leg_covariance, leg_jacobian, linearise
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
    jacobian = leg_jacobian(problem, x)
    A, r = jacobian[:, :, :-1], jacobian[:, :, -1]
    legs, noise, T = problem.legs, problem.noise, problem.legs.T
    weights = solution.weights
    for _ in range(COMPONENTS):
        joint = solved.of_pairs()
        W = np.linalg.inv(leg_covariance(problem, local))
        APA = A @ joint @ A.transpose(0, 2, 1)
        Wr = np.einsum("mij,mj->mi", W, r)
        components = local.components.copy()
        for c in (1, 2):
            Q = components[c] * legs.parts[c]
            WQ = W @ Q
            top = float(np.einsum("mi,mij,mj->", Wr, Q, Wr)) + NU
            bottom = float(np.trace(WQ, axis1=1, axis2=2).sum() - np.einsum("mij,mjk,mki->", WQ, W, APA)) + NU
            components[c] *= top / max(bottom, 1e-3 * NU)
        walks = local.walks.copy()
        for c, (block, values, walk) in enumerate(
            ((GYR_BIAS, x.gyr_bias, noise.device.gyr_walk), (ACC_BIAS, x.acc_bias, noise.device.acc_walk))
        ):
            w = 1.0 / (walks[c] * walk**2 * T)
            step = np.diff(values, axis=0)
            after = slice(STATE + block.start, STATE + block.stop)
            spread = sum(
                np.trace(joint[:, i, j], axis1=1, axis2=2) * sign
                for i, j, sign in ((block, block, 1.0), (after, after, 1.0), (after, block, -1.0), (block, after, -1.0))
            )
            top = float((w * (step**2).sum(axis=1)).sum()) + NU
            bottom = float((3.0 - w * spread).sum()) + NU
            walks[c] *= top / max(bottom, 1e-3 * NU)
        own = solved.of_knots()[:, VEL, VEL]
        w = weights.still / (local.still * problem.still**2)
        top = float((w * (x.v**2).sum(axis=1)).sum()) + NU_STILL
        bottom = float((3.0 * weights.still - w * np.trace(own, axis1=1, axis2=2)).sum()) + NU_STILL
        still = local.still * top / max(bottom, 1e-3 * NU_STILL)
        local = replace(local, components=components, walks=walks, still=still)
        equations, _ = linearise(problem, x, local)
        solved = equations.solve()
    return replace(solution, local=local, solved=solved)
