"""Integrate a recording once, in the gyro frame. After that the smoother needs no samples.

The attitude is R(t) = E(t) C(t). C (gyro frame <- sensor) integrates the gyro's samples alone; E (nav <- gyro frame)
drifts slowly, and the smoother estimates it. Over a leg, from one knot to the next, E turns by exp(J_r x), the velocity
changes by dU + J_v x and the position by dP + J_p x, in the gyro frame as at the first knot, with the sensor's errors
x. dU and dP include gravity, which `factors.leg_jacobian` and `path.path_of` remove.

Source: C. Forster, L. Carlone, F. Dellaert, D. Scaramuzza, On-manifold preintegration, T-RO 33 (2017). Here all legs
share one gyro frame, and the errors are bias, scale, misalignment and lag.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbd.lazy import cached_property
from pbd.pose import Array, cross, quat_cumulative, quat_exp, quat_rotate, quat_to_matrix, skew
from pbd.tracking.moving_windows import Rows, cumulative

BLOCK_S = 0.04
"""s: the Jacobians by the sensor's errors use means over blocks of this length, a fifth of a hand's fastest move."""

LAG, GYR_MATRIX, ACC_MATRIX = slice(0, 1), slice(1, 10), slice(10, 16)
GYR_BIAS, ACC_BIAS = slice(16, 19), slice(19, 22)
ERRORS = ACC_BIAS.stop
"""The sensor's errors x: lag; M with w_true = (1 - M) w; lower triangular N with f_true = (1 - N) f; both biases."""

OF_GYR, OF_ACC = np.r_[GYR_BIAS, GYR_MATRIX], np.r_[ACC_BIAS, ACC_MATRIX]
"""Indices of each sensor's own errors."""

LOWER = np.tril_indices(3)
"""Rows and columns of N's entries. N is lower triangular, because the accelerometer's axes define the sensor's."""

ROUNDING_SIGMAS = (1e-6, 3e-5, 1e-4)
"""rad, m/s, m per axis: rounding error of a leg. Without it covariances may become indefinite."""

ROT, VEL, POS = slice(0, 3), slice(3, 6), slice(6, 9)
"""Rows of a leg and unknowns of a knot: rotation vector (rad), velocity, position."""


@dataclass(frozen=True, eq=False)
class GyroFrame:
    """A recording in the gyro frame, at each row.

    Attributes:
        t: (n,) s.
        gyr: (n, 3) rad/s, in sensor axes, without the first rest's mean.
        acc: (n, 3) m/s2, in sensor axes.
        wxyz: (n, 4), gyro frame <- sensor; the first is the identity, or the device's own attitude.
        u: (n, 3) m/s2, specific force.
        U, UU: (n, 3) m/s and m, the integral and the double integral of u from the first row.
    """

    t: Array
    gyr: Array
    acc: Array
    wxyz: Array
    u: Array
    U: Array
    UU: Array

    @cached_property
    def dt(self) -> float:
        """s, the median sampling interval."""
        return float(np.median(np.diff(self.t)))


def gyro_frame(t: Array, gyr: Array, acc: Array, interval: float, wxyz: Array | None = None) -> GyroFrame:
    """Integrate samples that are means over their intervals. If given, `wxyz` (n, 4) replaces the gyro's attitude.

    While the sensor turns, mean specific force is not the mean in sensor axes rotated by the attitude at the interval's
    middle (sculling). To second order, a mean exceeds the middle's value by a 24th of the second difference.
    """
    if wxyz is None:
        turns = turns_between_middles(t, gyr, interval)
        turns[0] = 0.0
        wxyz = quat_cumulative(quat_exp(turns))
    u = quat_rotate(wxyz, acc)
    u[1:-1] += (np.diff(u, n=2, axis=0) - quat_rotate(wxyz[1:-1], np.diff(acc, n=2, axis=0))) / 24.0
    U = integral_of_means(t, u)
    return GyroFrame(t, gyr, acc, wxyz, u, U, integral_of_values(t, U, u))


def turns_between_middles(t: Array, gyr: Array, interval: float) -> Array:
    """Rotation vectors (n, 3) rad from the middle of the interval before each sample's own to the middle of its own.

    The samples are means, so their sums are exact at the intervals' edges; through four edges the angle is a cubic. The
    axis turns meanwhile (coning). For a rate that changes linearly this adds a twelfth of the cross product.

    Source: P. Savage, Strapdown inertial navigation integration algorithm design, part 1, JGCD 21 (1998).
    """
    dt = np.diff(t, prepend=t[0] - interval)[:, None]
    # Beyond its ends the recording is continued with the first and the last rate.
    padded = np.vstack((gyr[:1], gyr[:1], gyr, gyr[-1:]))
    earlier, before, own, later = padded[:-3], padded[1:-2], padded[2:-1], padded[3:]
    return dt * (9.0 * (before + own) - earlier - later) / 16.0 + dt**2 / 12.0 * cross(before, own)


def integral_of_means(t: Array, means: Array) -> Array:
    """Integral (n, 3) from the middle of the first sample to that of each, of samples that are means over intervals.

    Sums of means are exact at the intervals' edges; through four edges the integral is a cubic. Beyond both ends the
    first and the last mean are continued.
    """
    dt = np.diff(t)[:, None]
    padded = np.vstack((means[:1], means, means[-1:]))
    return cumulative(dt * (9.0 * (means[1:] + means[:-1]) - padded[:-3] - padded[3:]) / 16.0)


def integral_of_values(t: Array, values: Array, slopes: Array) -> Array:
    """Integral (n, 3) from the first time to each, of values (n, 3) with known slopes (n, 3): Hermite cubics."""
    dt = np.diff(t)[:, None]
    return cumulative(0.5 * dt * (values[1:] + values[:-1]) - dt**2 / 12.0 * np.diff(slopes, axis=0))


@dataclass(frozen=True, eq=False)
class LostMotion:
    """Motion lost at one row: a sudden change of angle or velocity of unknown size, in sensor axes.

    Attributes:
        row: the row.
        turn: (3,) rad, one sigma along the axis of the turn, or zero.
        dv: (3,) m/s, one sigma along the change of velocity, or zero.
    """

    row: int
    turn: Array
    dv: Array


@dataclass(frozen=True, eq=False)
class Legs:
    """Preintegrated motion from each knot to the next, in the gyro frame.

    Attributes:
        T: (m,) s, duration.
        U: (m + 1, 3) m/s, integral of specific force up to each knot.
        dU, dP: (m, 3) m/s and m, change of velocity, and displacement if the leg begins at rest.
        J: (m, 9, ERRORS), Jacobian of rotation, velocity and position by the sensor's errors.
        parts: (3, m, 9, 9), covariances that add up: from white noise, turning, motion.
    """

    T: Array
    U: Array
    dU: Array  # noqa: N815
    dP: Array  # noqa: N815
    J: Array
    parts: Array


def preintegrate(
    frame: GyroFrame,
    rows: Rows,
    density: tuple[Array, Array],
    lost_motion: Sequence[LostMotion] = (),
    U: Array | None = None,
) -> Legs:
    """Integrate the recording, n rows, from knot to knot.

    Args:
        rows: (m + 1,) rows of the knots, increasing.
        density: (3, n) rad2/s and (3, n) m2/s3, the parts of the noise at each row.
        lost_motion: what clipped samples hide.
        U: (m + 1, 3) m/s, integral of specific force up to each knot; by default frame.U there.
    """
    t = frame.t
    step = max(1, round(BLOCK_S / frame.dt))
    edges = np.union1d(rows, np.arange(rows[0], rows[-1] + 1, step))
    first = np.searchsorted(edges, rows)
    starts, leg = first[:-1], np.repeat(np.arange(len(rows) - 1), np.diff(first))
    h, T = np.diff(t[edges]), np.diff(t[rows])
    to_end = (t[rows[1:]][leg] - t[edges[1:]])[:, None]
    middle = to_end[:, 0] + 0.5 * h  # from a block's middle to the leg's end

    def per_leg(blocks: Array) -> Array:
        return np.add.reduceat(blocks, starts, axis=0)

    def integrals(values: Array) -> Array:
        """Trapezoidal integral of values (n, ...) over each block."""
        dt = np.diff(t).reshape(-1, *(1,) * (values.ndim - 1))
        return np.add.reduceat(0.5 * dt * (values[1:] + values[:-1]), edges[:-1])

    # Of each block: its change of velocity, and the displacement at the leg's end that it causes.
    at_knots, velocity = frame.U[rows] if U is None else U, frame.U[edges]
    velocity[first] = at_knots
    dU = np.diff(velocity, axis=0)
    dP = np.diff(frame.UU[edges], axis=0) - velocity[:-1] * h[:, None] + dU * to_end
    C = quat_to_matrix(frame.wxyz[(edges[:-1] + edges[1:]) // 2])

    lasts = np.maximum(h, np.finfo(float).tiny)[:, None]  # samples with equal time stamps make an empty block
    rate, force = integrals(frame.gyr) / lasts, integrals(frame.acc) / lasts
    by_gyr, by_acc = of_blocks_by_errors(C, rate, force, h)
    by_lag = C @ integrals(cross(frame.gyr, frame.acc))[:, :, None]
    turned = np.cumsum(by_gyr, axis=0) - 0.5 * by_gyr  # at the block's middle
    turned -= (turned[starts] - 0.5 * by_gyr[starts])[leg]  # since the leg's start
    swung = skew(-dU) @ turned
    J = np.zeros((len(T), 9, ERRORS))
    J[:, ROT, OF_GYR] = per_leg(by_gyr)
    J[:, VEL, OF_GYR] = per_leg(swung)
    J[:, POS, OF_GYR] = per_leg(swung * middle[:, None, None])
    J[:, VEL, OF_ACC] = per_leg(by_acc)
    J[:, POS, OF_ACC] = per_leg(by_acc * middle[:, None, None])
    J[:, VEL, LAG], J[:, POS, LAG] = per_leg(by_lag), per_leg(by_lag * middle[:, None, None])

    gained, way = per_leg(dU), per_leg(dP)
    of_blocks = [[integrals(part) if part.any() else 0.0 * h for part in each] for each in density]
    parts = np.stack(
        [
            block_noise(gained / T[:, None], gyr_noise, acc_noise, middle, h, starts)
            for gyr_noise, acc_noise in zip(*of_blocks, strict=True)
        ]
    )
    for block, floor in zip((ROT, VEL, POS), ROUNDING_SIGMAS, strict=True):
        parts[0, :, block, block] += floor**2 * np.eye(3)
    _add_lost_motion(parts[0], frame, rows, lost_motion)
    return Legs(T, at_knots, gained, way, J, parts)


def of_blocks_by_errors(C: Array, rate: Array, force: Array, h: Array) -> tuple[Array, Array]:
    """Jacobians of k blocks: rotation by the gyro's errors (k, 3, 12), velocity by the accelerometer's (k, 3, 9).

    C (k, 3, 3) is gyro frame <- sensor; rate and force (k, 3) rad/s and m/s2 are means in sensor axes; h (k,) is s.
    """
    i, j = LOWER
    by_gyr = np.concatenate((C, (C[:, :, :, None] * rate[:, None, None, :]).reshape(-1, 3, 9)), axis=2)
    by_acc = np.concatenate((C, C[:, :, i] * force[:, None, j]), axis=2)
    return by_gyr * -h[:, None, None], by_acc * -h[:, None, None]


def block_noise(force: Array, gyr: Array, acc: Array, to_end: Array, h: Array, starts: Rows) -> Array:
    """Covariance (m, 9, 9) of white noise at the end of m legs.

    A rotation error e at a time s before the end also rotates the specific force after it. This adds the velocity -S e
    s and the position -S e s^2 / 2, with S = [mean specific force]x.

    Args:
        force: (m, 3) m/s2, mean specific force of each leg.
        gyr, acc: (b,) rad2 and m2/s2, variance of each block.
        to_end: (b,) s, from each block's middle to the end of its leg.
        h: (b,) s, duration of each block.
        starts: (m,) first block of each leg.
    """
    moments = [  # exact means over each block: with values at its middle the covariance may be indefinite
        np.ones_like(to_end),
        to_end,
        to_end**2 + h**2 / 12.0,
        to_end**3 + to_end * h**2 / 4.0,
        to_end**4 + to_end**2 * h**2 / 2.0 + h**4 / 80.0,
    ]
    g = [np.add.reduceat(gyr * moment, starts)[:, None, None] for moment in moments]
    a = [np.add.reduceat(acc * moment, starts)[:, None, None] for moment in moments[:3]]
    S, one = skew(force), np.eye(3)
    SS = S @ S.transpose(0, 2, 1)
    Q = np.empty((len(force), 9, 9))
    Q[:, ROT, ROT] = g[0] * one
    Q[:, ROT, VEL], Q[:, ROT, POS] = g[1] * S, 0.5 * g[2] * S
    Q[:, VEL, VEL] = a[0] * one + g[2] * SS
    Q[:, VEL, POS] = a[1] * one + 0.5 * g[3] * SS
    Q[:, POS, POS] = a[2] * one + 0.25 * g[4] * SS
    Q[:, VEL, ROT], Q[:, POS, ROT] = -Q[:, ROT, VEL], -Q[:, ROT, POS]
    Q[:, POS, VEL] = Q[:, VEL, POS].transpose(0, 2, 1)
    return Q


def _add_lost_motion(Q: Array, frame: GyroFrame, rows: Rows, lost_motion: Sequence[LostMotion]) -> None:
    """Marginalise lost motion: each adds the outer product of its effect at the end of its leg to Q (m, 9, 9)."""
    if not lost_motion:
        return
    at = np.array([impulse.row for impulse in lost_motion])
    k = np.minimum(np.searchsorted(rows, at, side="right") - 1, len(rows) - 2)
    end = rows[k + 1]
    at = np.minimum(at, end)
    to_end = (frame.t[end] - frame.t[at])[:, None]
    wxyz = frame.wxyz[at]
    turn = quat_rotate(wxyz, np.array([impulse.turn for impulse in lost_motion]))
    push = quat_rotate(wxyz, np.array([impulse.dv for impulse in lost_motion]))
    dV = frame.U[end] - frame.U[at]
    dP = frame.UU[end] - frame.UU[at] - frame.U[at] * to_end
    effect = np.hstack((turn, cross(turn, dV) + push, cross(turn, dP) + push * to_end))
    np.add.at(Q, k, effect[:, :, None] * effect[:, None, :])
