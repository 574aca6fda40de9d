"""Integrate samples in the gyro frame, one at a time, into legs of BLOCK_S."""

from collections import deque
from dataclasses import dataclass
from math import inf, sin, sqrt

import numpy as np

from pbd.pose import Array, matrix_log, quat_from_rpy, quat_to_matrix, skew
from pbd.tracking.moving_windows import rows_of_mean
from pbd.tracking.noise import Noise, densities
from pbd.tracking.online.sample_repair import RepairedSample
from pbd.tracking.repair.channel_faults import REPEATED_ROWS
from pbd.tracking.repair.saturation import LEAST_RANGE, TOP_TOLERANCE, by_clipping
from pbd.tracking.smoother.knots import MOVE_KNOT_S
from pbd.tracking.smoother.preintegration import (
    BLOCK_S,
    ERRORS,
    LAG,
    OF_ACC,
    OF_GYR,
    POS,
    ROT,
    ROUNDING_SIGMAS,
    VEL,
    block_noise,
    of_blocks_by_errors,
)

ROUNDING_PER_S = np.diag(np.repeat(np.square(ROUNDING_SIGMAS), 3)) / MOVE_KNOT_S
"""Variance (9, 9) of the rounding error of the smoother's legs, per second."""

CLIPPED_SHARE = 0.2
"""One sigma of what is lost by clipping, as a share of the largest reading."""


Floats = list[float]


class EndOfRange:
    """Finds where a channel is at the end of its range, as `find_clips` does of a whole recording.

    There an axis repeats its largest reading, `least` or more, more often than a rounded peak would by chance.
    """

    def __init__(self, first: Floats, least: float) -> None:
        """Begin with the first reading (3,)."""
        self._readings = deque([first], maxlen=3)
        self._largest, self._step, self._fall, self._same = least, inf, 0.0, 0

    def lost(self, now: Floats, dt: float) -> float:
        """Variance that the next reading (3,) adds to the channel's integral over `dt` s; 0 within the range."""
        before, least_step, largest = self._readings[-1], TOP_TOLERANCE * self._largest, max(map(abs, now))
        for x, y in zip(now, before, strict=True):
            if least_step < abs(x - y) < self._step:
                self._step = abs(x - y)
        tops = (k for k in range(3) if now[k] == before[k] and abs(now[k]) >= self._largest)
        top = None if largest < self._largest else next(tops, None)
        if top is not None and self._same == 0:  # how far its side falls in the two readings before the top
            self._fall = max(abs(now[top] - each[top]) for each in self._readings)
        self._same = 0 if top is None else self._same + 1
        self._largest = max(self._largest, largest)
        self._readings.append(now)
        if self._same < REPEATED_ROWS - 1 or not by_clipping(self._fall, self._step, self._same + 1):
            return 0.0
        # All to one side: variance grows as the square of the duration.
        return (CLIPPED_SHARE * dt * self._largest) ** 2 * (2.0 * self._same + 1.0)


@dataclass(frozen=True, eq=False)
class Leg:
    """A block of samples with the fields of `Legs`; Q (9, 9), covariance of its noise; C (3, 3), gyro frame <- sensor
    at its end; angle (3,) rad, the integral of its rate."""

    T: float
    dU: Array  # noqa: N815
    dP: Array  # noqa: N815
    J: Array
    Q: Array
    C: Array
    angle: Array


class Strapdown:
    """The gyro frame of `preintegration`, one sample at a time.

    `preintegration` integrates a cubic that also uses the next sample; here it uses the edges of the last three
    intervals. Differences of consecutive steps have opposite signs, so they do not add up.

    Attributes:
        C: (3, 3) gyro frame <- sensor.
        u: (3,) m/s2, specific force in the gyro frame.
        rate: (3,) rad/s, without the first rest's mean.
        lag: s, time constant of the low-pass of the device's own attitude, as far as it is undone.
        T, U, P: the block so far: duration s, change of velocity (3,) m/s, displacement from standing (3,) m.
        clipped: "gyro" or "accelerometer" if it was at the end of its range, else ""; the reader resets it.
    """

    def __init__(self, first: RepairedSample, interval: float, noise: Noise, gyro_bias: Array, no_gyro: bool) -> None:
        self.noise = noise
        self._interval, self._bias, self._no_gyro = interval, gyro_bias, no_gyro
        self.block = max(1, round(BLOCK_S / interval))
        self.lag = 0.0
        self._device: Array = _device_attitude(first) if no_gyro else np.eye(3)
        self.C = self._device
        self.rate = first.gyr - gyro_bias
        self._acc, self._t = first.acc, first.t
        self._before = self.rate
        self.u: Array = self.C @ first.acc
        self._u_before = self.u
        self._latest: tuple[Floats, ...] = tuple(each.tolist() for each in first.readings)
        self._gyr_range, self._acc_range = map(EndOfRange, self._latest, (LEAST_RANGE["gyr"], LEAST_RANGE["acc"]))
        self.clipped = ""
        # Rows of u and rate that `densities` needs before and after each row. So noise is added this many rows late.
        self._beside = 3 * rows_of_mean(1.0 / interval) - 1
        first_rows = [(self.u, self.rate)] * (2 * self._beside)
        self._recent: deque[tuple[Array, Array]] = deque(first_rows, maxlen=self.block + len(first_rows))
        self._begin()

    def _begin(self) -> None:
        self.count, self.T = 0, 0.0
        self.U, self.P = np.zeros(3), np.zeros(3)
        self._Cs, self._rates, self._accs = [self.C], [self.rate], [self._acc]
        self._by_lag = _cross(self.rate, self._acc)
        self._gap_noise = np.zeros(2)

    def push(self, sample: RepairedSample) -> None:
        """Take the next sample."""
        dt = sample.t - self._t
        if self._no_gyro:
            before, self._device = self._device, _device_attitude(sample)
            rate = matrix_log(before.T @ self._device) / dt
            self.C = self._device @ turn_matrix(self.lag * rate)
        else:
            rate = sample.gyr - self._bias
            turn = _middles(dt, self._before, self.rate, rate) + dt**2 / 12.0 * _cross(self.rate, rate)
            self.C = self.C @ turn_matrix(turn)
            self._detect_clipping(sample, dt)
        self._before, self.rate, self._acc, self._t = self.rate, rate, sample.acc, sample.t
        u = self.C @ sample.acc
        gained = _middles(dt, self._u_before, self.u, u)
        self.P = self.P + dt * (self.U + 0.5 * gained) - dt**2 / 12.0 * (u - self.u)
        self.U = self.U + gained
        self._u_before, self.u = self.u, u
        if any(sample.gap_noise):
            self._gap_noise += dt * np.array(sample.gap_noise)
        self.T += dt
        self.count += 1
        self._Cs.append(self.C)
        self._rates.append(rate)
        self._accs.append(sample.acc)
        self._by_lag = self._by_lag + _cross(rate, sample.acc)
        self._recent.append((self.u, rate))

    def _detect_clipping(self, sample: RepairedSample, dt: float) -> None:
        gyr, acc = latest = tuple(each.tolist() for each in sample.readings)
        if latest == self._latest:  # a sample that was read twice
            return
        self._latest = latest
        lost = self._gyr_range.lost(gyr, dt), self._acc_range.lost(acc, dt)
        if any(lost):
            self.clipped = "gyro" if lost[0] else "accelerometer"
            self._gap_noise += lost

    def leg(self, up: Array, quiet: bool = False) -> Leg:
        """The leg since the last call; `up` (3,) m/s2 is specific force at rest, in the gyro frame.

        If `quiet`, the derivatives by the scales are those of a rest. Derivatives from the readings would contain
        noise, and its product with the same noise in the residuals would change the scales.
        """
        T, n = self.T, self.count
        C = self._Cs[n // 2]
        rate, force = (np.add.reduce(each) / (n + 1) for each in (self._rates, self._accs))
        J = np.zeros((9, ERRORS))
        w, f = (np.zeros(3), up @ C) if quiet else (rate, force)
        (by_gyr,), (J[VEL, OF_ACC],) = of_blocks_by_errors(C[None], w[None], f[None], np.array([T]))
        J[ROT, OF_GYR] = 0.0 if self._no_gyro else by_gyr
        J[VEL, OF_GYR] = -0.5 * skew(self.U) @ J[ROT, OF_GYR]
        J[VEL, LAG] = (T / (n + 1) * (C @ self._by_lag))[:, None]
        J[POS] = 0.5 * T * J[VEL]
        leg = Leg(T, self.U, self.P, J, self._noise(n, T, up), self.C, T * rate)
        self._begin()
        return leg

    def _noise(self, n: int, T: float, up: Array) -> Array:
        """Covariance (9, 9) of rotation, velocity and position of the block."""
        dt = T / n
        edge = self._beside
        recent = np.array(self._recent)[-(n + 2 * edge) :]
        u, rate = recent[:, 0], recent[:, 1]
        s_g, s_a = (each[:, edge:-edge].sum() * dt for each in densities(self.noise, rate, u, self._interval, up))
        g, a = np.add((s_g, s_a), self._gap_noise)
        g, a, to_end, h = np.array([g, a, 0.5 * T, T])[:, None]
        white: Array = block_noise(self.U[None] / T, g, a, to_end, h, np.array([0]))[0]
        return white + T * ROUNDING_PER_S


def _middles(dt: float, earlier: Array, before: Array, own: Array) -> Array:
    """Integral from the middle of the interval `before` to that of `own`, given means over three intervals of dt s."""
    return dt * (6.0 * before + 3.0 * own - earlier) / 8.0


def _device_attitude(sample: RepairedSample) -> Array:
    return quat_to_matrix(quat_from_rpy(np.asarray(sample.device_rpy, dtype=np.float64)))


def turn_matrix(turn: Array) -> Array:
    """Matrix (3, 3) of a rotation vector (3,) rad, by Rodrigues' formula. With numpy it takes several times as long."""
    x, y, z = turn.tolist()
    angle = max(sqrt(x * x + y * y + z * z), 1e-12)
    a, b = sin(angle) / angle, 2.0 * (sin(0.5 * angle) / angle) ** 2
    ax, ay, az = a * x, a * y, a * z
    bx, by, bz = b * x, b * y, b * z
    return np.array(
        (
            (1.0 - by * y - bz * z, bx * y - az, bx * z + ay),
            (bx * y + az, 1.0 - bx * x - bz * z, by * z - ax),
            (bx * z - ay, by * z + ax, 1.0 - bx * x - by * y),
        )
    )


def _cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors (3,). With numpy it takes ten times as long."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array((y * w - z * v, z * u - x * w, x * v - y * u))
