"""The smoother's factors: residuals, weights and Jacobians of measurements and priors.

Rotations are perturbed on the left, in nav: E <- exp(theta) E.
"""

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array, lengths, matrix_log, quat_exp, quat_to_matrix, skew
from pbd.tracking.moving_windows import squares
from pbd.tracking.noise import OUTLIER_SIGMAS, Noise, acc_sigma_factor
from pbd.tracking.smoother.knots import Problem
from pbd.tracking.smoother.normal_equations import (
    BAND,
    STATE,
    STATE_ACC_BIAS,
    STATE_GYR_BIAS,
    NormalEquations,
    batches,
)
from pbd.tracking.smoother.preintegration import ACC_MATRIX, GYR_MATRIX, LAG, POS, ROT, VEL
from pbd.tracking.smoother.state import SHARED, SHARED_GRAVITY, SHARED_PIVOT, Fixed, Prior, State

GAUGE_WEIGHT = 1e10
"""Weight that fixes what is chosen, not measured: the origin (1/m2), and without a compass the heading (1/rad2)."""


def linearise(
    problem: Problem, x: State, fixed: Fixed, whiten: Array, anneal: float = 1.0, legs: Array | None = None
) -> tuple[NormalEquations, Array]:
    """Linearise all factors: the normal equations, and the robust weight (m,), 0 to 1, of zero velocity at each knot.

    `whiten` is from `whitener`; `anneal` widens the robust factors of stops and of the hand's reach; `legs` is
    `leg_jacobian` at this state, if it is already known.
    """
    equations = NormalEquations.empty(len(problem.rows), SHARED)
    _add_legs(equations, problem, x, fixed, whiten, legs)
    still = _add_stops(equations, problem, x, fixed, anneal)
    _add_reach(equations, problem, x, still > 0.5, anneal)
    if problem.no_gyro:
        _add_device_attitude(equations, problem, x)
    elif problem.field is not None:
        _add_compass(equations, problem, problem.field, x, fixed)
    _add_priors(equations, problem, x, fixed)
    return equations, still


def sensor_errors(x: State) -> Array:
    """The sensor's errors in each leg, (m - 1, ERRORS), in the order of the columns of `Legs.J`."""
    shared = np.broadcast_to(x.shared[: SHARED_GRAVITY.start], (len(x.p) - 1, SHARED_GRAVITY.start))
    return np.hstack((shared, x.gyr_bias[:-1], x.acc_bias[:-1]))


def whitener(problem: Problem, fixed: Fixed) -> Array:
    """Inverse Cholesky factor (m - 1, 9, 9) of each leg's noise covariance, in the gyro frame."""
    root = np.linalg.cholesky(np.tensordot(fixed.components[:3], problem.legs.parts, axes=1))
    return np.asarray(np.linalg.inv(root), dtype=np.float64)


def leg_jacobian(problem: Problem, x: State, at: slice = slice(None)) -> Array:
    """Jacobians (m - 1, 9, 15 + 9 + SHARED) and, as last column, residuals of the legs, in the gyro frame.

    Rows: rotation, velocity, position. With a = v' - v + g T and b = p' - p - v T + g T^2 / 2 (g points up in nav), E
    at the first knot, E' at the second: r_rotation = log(E^T E' exp(-J_r x)), r_velocity = E^T a - dU - J_v x,
    r_position = E^T b - dP - J_p x.
    """
    legs, J = problem.legs, problem.legs.J[at]
    T, ET, g = legs.T[at, None], x.E[:-1][at].transpose(0, 2, 1), float(x.shared[SHARED_GRAVITY][0])
    by_errors = (J @ sensor_errors(x)[at, :, None])[:, :, 0]
    up = np.array([0.0, 0.0, 1.0])
    a = np.diff(x.v, axis=0)[at] + g * T * up
    b = np.diff(x.p, axis=0)[at] - x.v[:-1][at] * T + 0.5 * g * T**2 * up
    out = np.zeros((len(T), 9, BAND + SHARED + 1))

    for block in (ROT, VEL, POS):
        out[:, block, block], out[:, block, STATE + block.start : STATE + block.stop] = -ET, ET
    out[:, VEL, ROT], out[:, POS, ROT], out[:, POS, VEL] = ET @ skew(a), ET @ skew(b), -ET * T[:, :, None]
    gravity = BAND + SHARED_GRAVITY.start
    out[:, :, BAND:gravity], out[:, :, STATE_GYR_BIAS.start : STATE_ACC_BIAS.stop] = np.split(
        -J, (SHARED_GRAVITY.start,), axis=2
    )
    out[:, VEL, gravity], out[:, POS, gravity] = ET[:, :, 2] * T, ET[:, :, 2] * (0.5 * T**2)
    out[:, ROT, -1] = matrix_log(ET @ x.E[1:][at] @ quat_to_matrix(quat_exp(-by_errors[:, ROT])))
    out[:, VEL, -1] = np.einsum("kij,kj->ki", ET, a) - legs.dU[at] - by_errors[:, VEL]
    out[:, POS, -1] = np.einsum("kij,kj->ki", ET, b) - legs.dP[at] - by_errors[:, POS]
    return out


def _add_legs(
    equations: NormalEquations, problem: Problem, x: State, fixed: Fixed, whiten: Array, legs: Array | None
) -> None:
    """Motion from knot to knot, and the random walk of the biases."""
    for at in batches(len(whiten)):
        equations.add_legs(whiten[at] @ (leg_jacobian(problem, x, at) if legs is None else legs[at]), at.start)
    noise, T = problem.noise, problem.legs.T
    for block, values, walk, k in (
        (STATE_GYR_BIAS, x.gyr_bias, noise.sensor.gyr_walk, fixed.components[3]),
        (STATE_ACC_BIAS, x.acc_bias, noise.sensor.acc_walk, fixed.components[4]),
    ):
        equations.add(np.diff(values, axis=0), 1.0 / (k * walk**2 * T), (1, block, 1.0), (0, block, -1.0))


def pivot_velocity(problem: Problem, x: State) -> tuple[Array, Array]:
    """Velocity (m, 3) of the pivot, v - R (w x r), and derivative (m, 3, 3) by r, the lever from pivot to sensor."""
    swing = -(x.E @ problem.C @ skew(problem.rate))
    return x.v + swing @ x.shared[SHARED_PIVOT], swing


def _add_stops(equations: NormalEquations, problem: Problem, x: State, fixed: Fixed, anneal: float) -> Array:
    """In a stop the pivot stands still, and from knot to knot nothing moves or turns.

    Returns the robust weights (m,) of zero velocity.
    """
    noise, within, R = problem.noise, problem.same_stop, x.E @ problem.C
    # Annealing adds a speed that does not depend on tremor: a coasting hand is as fast with or without it.
    variance = fixed.components[5] * problem.still_sigma**2 + (anneal**2 - 1.0) * noise.still_speed**2
    v, swing = pivot_velocity(problem, x)
    still = robust_weights(squares(v) / variance) * (problem.stop_of >= 0)
    equations.add(v, still / variance, (0, VEL, 1.0), (0, ROT, skew(x.v)), (None, SHARED_PIVOT, swing))
    swing, sigma_shift = -np.diff(R, axis=0), anneal * noise.still_shift
    shift = np.diff(x.p, axis=0) + swing @ x.shared[SHARED_PIVOT]
    stay = np.maximum(robust_weights(squares(shift) / sigma_shift**2), problem.stood) * within
    equations.add(shift, stay / sigma_shift**2, (1, POS, 1.0), (0, POS, -1.0), (None, SHARED_PIVOT, swing))
    turned = matrix_log(R[1:] @ R[:-1].transpose(0, 2, 1))
    same_attitude = np.maximum(robust_weights(squares(turned) / problem.turn_sigma**2), problem.stood) * within
    equations.add(turned, same_attitude / problem.turn_sigma**2, (1, ROT, 1.0), (0, ROT, -1.0))
    return still


def _add_reach(equations: NormalEquations, problem: Problem, x: State, still: NDArray[np.bool_], anneal: float) -> None:
    """Weak prior: a hand that moves for long stays near where it began (Cauchy).

    Knots within half a stride of one that stands still (`still`, (m,)) are left out: the prior would pull all stops
    together, and at a foot's stops work against zero velocity. Annealing keeps the full weight further away, by the
    square of `anneal`: after minutes of motion, dead reckoning with a wrong tilt may end a kilometre away.
    """
    reach, t, half = problem.noise.reach, problem.t, 0.5 * problem.noise.stride_time
    count = np.concatenate(([0], np.cumsum(still)))
    bounded = count[np.searchsorted(t, t + half, side="right")] > count[np.searchsorted(t, t - half)]
    near = problem.duration / reach**2 / (1.0 + squares(x.p) / (anneal**2 * reach) ** 2)
    equations.add(x.p, near * ~bounded, (0, POS, 1.0))


def _add_compass(equations: NormalEquations, problem: Problem, field: Array, x: State, fixed: Fixed) -> None:
    """The field's horizontal part points north, with a weight that drops where the field is not the earth's."""
    h = np.einsum("kij,kj->ki", x.E, field)
    east, jacobian, trust = compass_heading(h, fixed.strength, fixed.dip, problem.noise, fixed.azimuth)
    weight = trust * problem.duration / problem.noise.compass_heading**2
    equations.add(east[:, None], weight, (0, ROT, jacobian[:, None]))


def compass_heading(
    h: Array, strength: float, dip: float, noise: Noise, azimuth: float = 0.0
) -> tuple[Array, Array, Array]:
    """Angle of fields h (k, 3) in nav east of north, rad (k,); its derivative by rotation (k, 3); weight, 0 to 1 (k,).

    `strength` (unit of h), `dip` and `azimuth` (rad) are those of the undisturbed field, which shows north.
    """
    level = np.maximum(np.hypot(h[:, 0], h[:, 1]), 1e-12)
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    east = np.arctan2(cos * h[:, 0] - sin * h[:, 1], sin * h[:, 0] + cos * h[:, 1])
    steeper = np.arctan2(h[:, 2], level) - dip
    with np.errstate(over="ignore"):  # a field that is stronger beyond all measure has no weight
        stronger = lengths(h) / strength - 1.0
        off = (stronger**2 + steeper**2 + (np.cos(dip) * east) ** 2) / noise.field_change**2
    dh = -skew(h)  # d h / d theta
    by_turn = (h[:, 1:2] * dh[:, 0] - h[:, :1] * dh[:, 1]) / level[:, None] ** 2
    return east, by_turn, shows_north(dip) * (1.0 / (1.0 + off)) ** 2


def shows_north(dip: float) -> bool:
    """Whether an undisturbed field of this dip, rad, shows north: not within 6 degrees of the vertical."""
    return bool(np.cos(dip) > 0.1)


def _add_device_attitude(equations: NormalEquations, problem: Problem, x: State) -> None:
    """The error of the device's own attitude is a Gauss-Markov process in the angle turned (`Noise.device_attitude`).

    Its density is that of a random walk, which the legs have, times 1 / (2 sigma^2) for each rad and for both ends.
    """
    C = problem.C
    turned = lengths(matrix_log(C[:-1].transpose(0, 2, 1) @ C[1:])) + problem.noise.device_drift * problem.legs.T
    about = 0.5 * (np.append(2.0, turned) + np.append(turned, 2.0))
    equations.add(matrix_log(x.E), 0.5 * about / problem.noise.device_attitude**2, (0, ROT, 1.0))


def _add_priors(equations: NormalEquations, problem: Problem, x: State, fixed: Fixed) -> None:
    noise, origin = problem.noise, fixed.origin
    acc_bias = acc_sigma_factor(noise, problem.rest) * noise.sensor.acc_bias
    equations.add(x.gyr_bias[:1], np.array([noise.gyr_bias**-2.0]), (0, STATE_GYR_BIAS, 1.0))
    equations.add(x.acc_bias[:1], np.array([acc_bias**-2.0]), (0, STATE_ACC_BIAS, 1.0))
    equations.add(x.p[origin : origin + 1], np.array([GAUGE_WEIGHT]), (origin, POS, 1.0))
    if not (problem.no_gyro or shows_north(fixed.dip)):
        equations.diagonal[origin, 2, 2] += GAUGE_WEIGHT
    equations.corner += shared_prior(problem, x, fixed.prior)


def shared_prior(problem: Problem, x: State, prior: Prior) -> Array:
    """Information and, as last column, gradient (SHARED, SHARED + 1) of the prior of the shared unknowns."""
    noise, mean = problem.noise, np.zeros(SHARED)
    mean[LAG], mean[SHARED_GRAVITY] = prior.lag, noise.gravity
    covariance = np.zeros((SHARED, SHARED))
    i = np.arange(SHARED)
    covariance[i[LAG], i[LAG]] = prior.lag_sigma**2
    covariance[i[GYR_MATRIX], i[GYR_MATRIX]] = noise.sensor.gyr_scale**2
    covariance[i[ACC_MATRIX], i[ACC_MATRIX]] = (acc_sigma_factor(noise, problem.rest) * noise.sensor.acc_scale) ** 2
    covariance[i[SHARED_GRAVITY], i[SHARED_GRAVITY]] = noise.gravity_sigma**2
    covariance[i[SHARED_PIVOT], i[SHARED_PIVOT]] = noise.pivot_distance**2
    diagonal = i[GYR_MATRIX][::4]
    covariance[np.ix_(diagonal, diagonal)] += prior.common_scale**2
    information = np.linalg.inv(covariance)
    return np.column_stack((information, information @ (x.shared - mean)))


def robust_weights(squares: Array) -> Array:
    """Geman-McClure weights of residuals, given their squared lengths in sigmas."""
    return 1.0 / (1.0 + squares / OUTLIER_SIGMAS**2) ** 2
