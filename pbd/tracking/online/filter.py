"""The smoother's model as an error-state Kalman filter: the present state, from all samples so far.

Instead of all knots, the state has a copy of attitude and position at the last knot (stochastic cloning), with which
the next knot is compared.

Source: J. Sola, Quaternion kinematics for the error-state Kalman filter, arXiv 1711.02508 (2017), with errors on the
left, in nav.
"""

from __future__ import annotations

from copy import copy
from math import atan2, hypot, sqrt

import numpy as np

from pbd.pose import (
    Array,
    Pose,
    lengths,
    matrix_log,
    quat_about_z,
    quat_canonical,
    quat_from_matrix,
    quat_multiply,
    quat_rotate,
    quat_to_matrix,
    skew,
)
from pbd.tracking.first_rest import Rest
from pbd.tracking.noise import OUTLIER_SIGMAS, Noise, acc_sigma_factor
from pbd.tracking.online.strapdown import Leg, Strapdown, turn_matrix
from pbd.tracking.smoother.attitude import heading, quat_to_vertical
from pbd.tracking.smoother.factors import compass_heading
from pbd.tracking.smoother.preintegration import ACC_BIAS, ACC_MATRIX, ERRORS, GYR_BIAS, GYR_MATRIX, LAG, POS, ROT, VEL

SENSOR_ERRORS = slice(9, 9 + ERRORS)
GRAVITY_ROW, NORTH_ROW, KNOT_ROT, KNOT_POS = 31, 32, slice(33, 36), slice(36, 39)
STATES = 39
"""The error state: attitude, velocity and position; the sensor's errors; gravity; the heading of the compass' north in
nav; attitude and position at the last knot."""

LEVEL_SIGMA = 0.1
"""rad: initial sigma of roll and pitch. It is wide on purpose: the filter levels itself at once."""

UP = np.array((0.0, 0.0, 1.0))

IDENTITY = np.eye(STATES)
H_POS = IDENTITY[POS]
H_SHIFT = IDENTITY[POS] - IDENTITY[KNOT_POS]
H_MOTION = np.vstack((H_SHIFT, IDENTITY[ROT] - IDENTITY[KNOT_ROT]))
"""Measurement matrices: position; shift since the last knot; shift and turn since that knot."""

GAUSS_LEGENDRE = ((5 / 18, 0.5 - sqrt(0.15)), (8 / 18, 0.5), (5 / 18, 0.5 + sqrt(0.15)))
"""Weights and nodes of three-point quadrature on [0, 1], exact for polynomials up to the fifth power."""

BIASES = np.arange(STATES)[SENSOR_ERRORS][np.r_[GYR_BIAS, ACC_BIAS]]
OF_POSE = np.ix_(np.r_[POS, ROT], np.r_[POS, ROT])
"""Rows and columns of a pose's covariance: position, rotation."""


class ErrorStateFilter:
    """An estimate of the hand's present motion.

    Attributes:
        E: (3, 3), nav <- gyro frame.
        v, p: (3,) m/s and m, in nav.
        x: (ERRORS,), the sensor's errors in the order of `Legs.J`.
        gravity: m/s2.
        north: rad, error of the compass' north.
        P: (STATES, STATES), covariance of the error state.
        C: (3, 3), gyro frame <- sensor.
    """

    def __init__(self, noise: Noise, rest: Rest, C: Array, field: Array | None, no_gyro: bool) -> None:
        """Begin at rest at the origin, with the mean field (3,) or None; `no_gyro`: C is the device's attitude."""
        sensor = noise.sensor
        self.noise = noise
        self.E: Array = np.eye(3) if no_gyro else _level(rest.up_sensor, field)
        self.v, self.p = np.zeros(3), np.zeros(3)
        east, north, up = undisturbed = self.E @ (UP if field is None else field)
        self._strength, self._dip = float(lengths(undisturbed)), atan2(up, hypot(east, north))
        self.x, self.gravity, self.north = np.zeros(ERRORS), noise.gravity, 0.0
        self.x[LAG] = noise.lag
        self.C = C
        self._lag_is_free = no_gyro
        sigma = np.zeros(STATES)
        sigma[:2], sigma[VEL] = sqrt(2.0) * noise.device_attitude if no_gyro else LEVEL_SIGMA, noise.still_speed
        acc_factor, errors = acc_sigma_factor(noise, rest), np.zeros(ERRORS)
        errors[GYR_BIAS], errors[ACC_BIAS] = noise.gyr_bias, acc_factor * sensor.acc_bias
        errors[LAG], errors[GYR_MATRIX] = noise.lag_sigma, sensor.gyr_scale
        errors[ACC_MATRIX] = acc_factor * sensor.acc_scale
        sigma[SENSOR_ERRORS], sigma[GRAVITY_ROW], sigma[NORTH_ROW] = errors, noise.gravity_sigma, noise.compass_heading
        self.P = np.diag(sigma**2)
        self._walks = _walks(noise)
        self.clone_pose()

    def fork(self) -> ErrorStateFilter:
        """A copy that goes on from here. It is shallow, because no array is changed in place."""
        return copy(self)

    def fork_at_stop(self, sigma: float, shaking: Array, gate: float) -> tuple[ErrorStateFilter, float, float]:
        """A copy that goes on from a possible stop, with its `velocity_test`.

        If the velocity is not zero within the gate, but with a free lag it is, the copy's lag is free.
        """
        fork = self.fork()
        if (test := fork.velocity_test(sigma, shaking))[0] > gate and not self._lag_is_free:
            freed = self.fork()
            freed._free_lag()
            if (with_lag := freed.velocity_test(sigma, shaking))[0] < gate:
                fork, test = freed, with_lag
        return fork, *test

    def _free_lag(self) -> None:
        """Widen the lag's prior, as if it had always been wide: an update with negative information."""
        less = self.noise.lag_sigma**-2 - self.noise.wide_lag_sigma**-2
        self._update(IDENTITY[SENSOR_ERRORS][LAG], self.noise.lag - self.x[LAG], -1.0 / less, robust=False)
        self._lag_is_free = True

    def use_noise(self, noise: Noise) -> None:
        """Take this noise, and widen the covariance of the biases if their random walks are now larger.

        The walks grow if the readings at rest turn out to be rounded: the biases found there were then too certain. The
        accelerometer's bias also shifts tilt and gravity, because both were found with it.
        """
        more = np.maximum(_walks(noise) - self._walks, 0.0)
        self.noise, self._walks = noise, _walks(noise)
        if not more.any():
            return
        error, g = np.zeros((STATES, len(BIASES))), self.gravity
        error[BIASES, np.arange(len(BIASES))] = 1.0
        x, y, z = self._last_knot[0]
        error[ROT, 3:] = error[KNOT_ROT, 3:] = -y / g, x / g, np.zeros(3)
        error[GRAVITY_ROW, 3:] = -z
        self.P = self.P + error * more @ error.T

    def predict(self, strapdown: Strapdown) -> tuple[Array, Array, Array]:
        """wxyz_nav_sensor (4,), p_nav_sensor (3,) m and v_nav_sensor (3,) m/s at the latest sample, within a leg."""
        T, E = strapdown.T, self.E
        v = self.v + E @ strapdown.U - self.gravity * T * UP
        p = self.p + T * self.v + E @ strapdown.P - 0.5 * self.gravity * T**2 * UP
        return quat_from_matrix(E @ strapdown.C), p, v

    def propagate(self, leg: Leg) -> None:
        """Predict the state at the end of a leg."""
        T, E, e = leg.T, self.E, leg.J @ self.x
        gained, way = E @ (leg.dU + e[VEL]), E @ (leg.dP + e[POS])
        F = IDENTITY[:9].copy()  # the rows that change
        F[VEL, ROT], F[POS, ROT] = -skew(gained), -skew(way)
        F[POS, VEL] = T * IDENTITY[VEL, VEL]
        F[:, SENSOR_ERRORS] = (E @ leg.J.reshape(3, 3, ERRORS)).reshape(9, ERRORS)
        F[5, GRAVITY_ROW], F[8, GRAVITY_ROW] = -T, -0.5 * T**2
        EQ = (E @ leg.Q.reshape(3, 3, 9)).reshape(9, 9)
        FP, P = F @ self.P, self.P.copy()
        P[:9], P[9:, :9] = FP, FP[:, 9:].T
        P[:9, :9] = FP @ F.T + (E @ EQ.T.reshape(3, 3, 9)).reshape(9, 9)
        P[BIASES, BIASES] += self._walks * T
        self.P = P
        self.p = self.p + T * self.v + way - 0.5 * self.gravity * T**2 * UP
        self.v = self.v + gained - self.gravity * T * UP
        self.E = E @ turn_matrix(e[ROT])
        self.C = leg.C

    def clone_pose(self) -> None:
        """Make this a knot: copy attitude and position into the state."""
        P = self.P.copy()
        P[KNOT_ROT], P[KNOT_POS] = P[ROT], P[POS]
        P[:, KNOT_ROT], P[:, KNOT_POS] = P[:, ROT], P[:, POS]
        self.P = P
        self._last_knot: tuple[Array, Array] = (self.E @ self.C, self.p)

    def velocity_test(self, sigma: float, shaking: Array) -> tuple[float, float]:
        """Squared Mahalanobis distance of the velocity from zero within `sigma`, m/s per axis; and the speed, m/s.

        `shaking` (3,) m/s, in the gyro frame, is the velocity of the tremor, which does not move the hand.
        """
        S, v = self.P[VEL, VEL] + sigma**2 * np.eye(3), self.v - self.E @ shaking
        return float(v @ np.linalg.inv(S) @ v), float(np.sqrt(v @ v))

    def update_zero_velocity(self, sigma: float, shaking: Array, *, robust: bool) -> None:
        """The velocity without `shaking` is zero within `sigma` m/s per axis; robust by Geman-McClure's weight."""
        self._update(IDENTITY[VEL], self.E @ shaking - self.v, sigma**2, robust)

    def update_no_motion(self, turn_sigma: float) -> None:
        """Since the last knot nothing moved, and nothing turned within `turn_sigma` rad."""
        attitude, p = self._last_knot
        off = np.concatenate((p - self.p, -matrix_log(self.E @ self.C @ attitude.T)))
        self._update(H_MOTION, off, np.repeat((self.noise.still_shift**2, turn_sigma**2), 3))

    def update_compass(self, field: Array, lasted: float) -> None:
        """The mean field (3,) over `lasted` s, in the gyro frame, shows north if it is as in the first rest."""
        h = (self.E @ field)[None]
        (east,), (by_turn,), (trust,) = compass_heading(h, self._strength, self._dip, self.noise)
        if trust > 0.0:
            self._update_heading(east, by_turn, self.noise.compass_heading**2 / lasted / trust)

    def update_reach(self, lasted: float) -> None:
        """For `lasted` s the hand was within reach of its first rest; robust by Cauchy's weight, as in `factors`."""
        self._update(H_POS, -self.p, (self.noise.reach**2 + float(self.p @ self.p)) / lasted, robust=False)

    def update_device_attitude(self, turned: float) -> None:
        """Without a gyro the gyro frame is nav, but the device's attitude errs, anew as it has `turned`, rad."""
        variance = 2.0 * self.noise.device_attitude**2 / max(turned, 1e-9)
        self._update_heading(float(matrix_log(self.E)[2]), UP, variance)
        self._update(IDENTITY[:2], -matrix_log(self.E)[:2], variance, robust=False)

    def _update_heading(self, east: float, by_turn: Array, variance: float) -> None:
        H = np.zeros((1, STATES))
        H[0, ROT], H[0, NORTH_ROW] = by_turn, 1.0
        self._update(H, np.array([-east - self.north]), variance, robust=False)

    def remove_lag(self, lag: float) -> None:
        """The samples to come are without this part of the lag, s."""
        self.x = self.x - lag * np.eye(ERRORS)[LAG][0]

    def set_origin(self) -> None:
        """This position is nav's origin, and this heading is exact by definition."""
        self.p = np.zeros(3)
        P = self.P.copy()
        for known in (2, POS):
            P[known], P[:, known] = 0.0, 0.0
        self.P = P

    def add_knock_or_wrong_turn(self, duration: float, speed: float) -> None:
        """Allow for either at an unknown time in the last `duration` s; each leaves `speed` m/s rms.

        A wrong turn tilts gravity, and so the velocity error grows from then on.
        """
        P, one, tilted = self.P.copy(), np.eye(3), -self.gravity * skew(UP)
        turn = sqrt(3.0) * speed / (self.gravity * duration)
        for weight, share in GAUSS_LEGENDRE:
            since = share * duration
            knocked = speed * np.vstack((0.0 * one, one, since * one))
            turned = turn * np.vstack((one, since * tilted, 0.5 * since**2 * tilted))
            P[:9, :9] += weight * (knocked @ knocked.T + turned @ turned.T)
        self.P = P

    def sigma_if_stopped(self, sigma: float) -> tuple[float, float]:
        """One sigma, m, along the least certain axis, of the position and of the shift since the last knot, if the hand
        stopped now within `sigma` m/s."""
        found = []
        for H in (H_POS, H_SHIFT):
            PH = self.P @ H.T
            left = H @ PH - PH[VEL].T @ np.linalg.solve(self.P[VEL, VEL] + sigma**2 * np.eye(3), PH[VEL])
            found.append(float(np.sqrt(max(np.diagonal(left).max(), 0.0))))
        return found[0], found[1]

    def pose(self) -> tuple[Pose, Array]:
        """T_nav_sensor, and the covariance (6, 6) of position and rotation."""
        return Pose(self.p, quat_from_matrix(self.E @ self.C)), self.P[OF_POSE]

    def _update(self, H: Array, residual: Array, variance: float | Array, robust: bool = True) -> None:
        """Kalman update: residual (k,) = H (k, STATES) times the error state + noise of this variance."""
        PH = self.P @ H.T
        S, R = H @ PH, variance * np.eye(len(H))
        information = np.linalg.inv(S + R)
        if robust:
            off = float(residual @ information @ residual)
            information = np.linalg.inv(S + (1.0 + off / OUTLIER_SIGMAS**2) ** 2 * R)
        K = PH @ information
        d = K @ residual
        P = self.P - K @ PH.T
        self.P = 0.5 * (P + P.T)
        self.E = turn_matrix(d[ROT]) @ self.E
        self.v, self.p, self.x = self.v + d[VEL], self.p + d[POS], self.x + d[SENSOR_ERRORS]
        self.gravity, self.north = self.gravity + float(d[GRAVITY_ROW]), self.north + float(d[NORTH_ROW])
        attitude, p = self._last_knot
        self._last_knot = turn_matrix(d[KNOT_ROT]) @ attitude, p + d[KNOT_POS]


def _walks(noise: Noise) -> Array:
    """Variance (6,) of the biases' random walks, per second."""
    return np.repeat((noise.sensor.gyr_walk**2, noise.sensor.acc_walk**2), 3)


def _level(up: Array, field: Array | None) -> Array:
    """Nav <- sensor (3, 3), from the vertical and the compass' field, or without one the sensor's own axis."""
    wxyz = quat_canonical(quat_to_vertical(up))
    if field is None:
        off = -heading(wxyz[None])
    else:
        east, north, _ = quat_rotate(wxyz, field)
        off = float(np.arctan2(east, north))
    return quat_to_matrix(quat_multiply(quat_about_z(off), wxyz))
