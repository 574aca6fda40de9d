"""Integrate a recording once, in a frame that the gyro alone holds. The smoother then needs no samples.

The attitude is R(t) = E(t) C(t). C (gyro frame <- sensor) is what the gyro's samples alone make of it. E (nav <- gyro
frame) drifts slowly and is what the smoother estimates. From one knot to the next, with E as at the first, the hand
turns by exp(J_r x), gains the velocity dU + J_v x and goes by dP + J_p x: linear in the sensor's errors x, as these are
small. So each leg is one Gaussian factor. Gravity stays in: `factors.leg_jacobian` and `path.path_of` remove it.

Source: C. Forster, L. Carlone, F. Dellaert, D. Scaramuzza, On-manifold preintegration, T-RO 33 (2017). Here all legs
share one gyro frame, and the errors are bias, scale, misalignment and lag.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array, quat_cumulative, quat_exp, quat_rotate, quat_to_matrix, skew
from pbd.tracking.moving_windows import cumulative

Rows = NDArray[np.intp]

BLOCK_S = 0.04
"""s: the sensor's errors act on a leg through means over blocks of this length, a tenth of a hand's fastest move."""

LAG, GYR_MATRIX, ACC_MATRIX = slice(0, 1), slice(1, 10), slice(10, 16)
GYR_BIAS, ACC_BIAS = slice(16, 19), slice(19, 22)
ERRORS = ACC_BIAS.stop
"""Columns x of a leg: lag; w_true = (1 - M) w; f_true = (1 - N) f, N lower; biases of gyro and accelerometer."""

OF_GYR, OF_ACC = np.r_[GYR_BIAS, GYR_MATRIX], np.r_[ACC_BIAS, ACC_MATRIX]
"""Those of each sensor."""

LOWER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))
"""Entries of N: lower triangular, as the accelerometer's axes define the sensor's."""

ROUNDING_SIGMAS = (1e-6, 3e-5, 1e-4)
"""rad, m/s, m: rounding error of a leg."""

ROT, VEL, POS = slice(0, 3), slice(3, 6), slice(6, 9)
"""Of a leg and of a knot: rotation vector (rad), velocity, position."""


@dataclass(frozen=True, eq=False)
class GyroFrame:
    """A recording in the gyro's own frame, at each row.

    Attributes:
        t: (n,) s.
        gyr: (n, 3) rad/s, in sensor axes, without the rest's mean.
        acc: (n, 3) m/s2, in sensor axes.
        wxyz: (n, 4), gyro frame <- sensor; the first is one.
        u: (n, 3) m/s2, specific force; U, UU: its integral and that one's, from the first row.
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
    """Integrate samples that are means over their intervals; `wxyz` where attitude is known otherwise.

    The mean of what turns meanwhile is not its mean in sensor axes, turned as in the middle (sculling): to the second
    order a mean is off by a 24th of the second difference.
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
    """Rotation vectors (n, 3) rad from the middle of each sample's predecessor to its own.

    The samples are means, so their sums are exact at the intervals' edges; between four edges the angle is a cubic. The
    turning of the axis of rotation meanwhile (coning) adds a twelfth of the cross product, for a rate that changes
    linearly.

    Source: P. Savage, Strapdown inertial navigation integration algorithm design, part 1, JGCD 21 (1998).
    """
    dt = np.diff(t, prepend=t[0] - interval)[:, None]
    # Outside the recording the hand turns as at its ends.
    padded = np.vstack((gyr[:1], gyr[:1], gyr, gyr[-1:]))
    earlier, before, own, later = padded[:-3], padded[1:-2], padded[2:-1], padded[3:]
    turns: Array = dt * (9.0 * (before + own) - earlier - later) / 16.0 + dt**2 / 12.0 * np.cross(before, own)
    return turns


def integral_of_means(t: Array, means: Array) -> Array:
    """Integral from the first sample's middle to each one's, of samples that are means over their intervals: (n, 3).

    Sums of means are exact at the intervals' edges; between four edges the integral is taken for a cubic, to its
    middle. Beyond both ends the first and the last mean go on.
    """
    dt = np.diff(t)[:, None]
    padded = np.vstack((means[:1], means, means[-1:]))
    return cumulative(dt * (9.0 * (means[1:] + means[:-1]) - padded[:-3] - padded[3:]) / 16.0)


def integral_of_values(t: Array, values: Array, slopes: Array) -> Array:
    """Integral from the first instant to each, of values (n, 3) whose derivatives are known: Hermite's cubic."""
    dt = np.diff(t)[:, None]
    return cumulative(0.5 * dt * (values[1:] + values[:-1]) - dt**2 / 12.0 * np.diff(slopes, axis=0))


@dataclass(frozen=True, eq=False)
class Impulse:
    """What may have been lost around one row: a sudden change of angle or velocity in sensor axes, of unknown size.

    Attributes:
        row: where.
        gyr: (3,) rad, one sigma times its axis; or zero.
        acc: (3,) m/s, the same.
    """

    row: int
    gyr: Array
    acc: Array


@dataclass(frozen=True, eq=False)
class Legs:
    """From each knot to the next, in the gyro frame.

    Attributes:
        rows: (m + 1,) the knots' rows.
        T: (m,) s.
        U: (m + 1, 3) m/s, velocity at the knots.
        dU: (m, 3) m/s, dP: (m, 3) m: velocity gained, way gone from standing.
        J: (m, 9, ERRORS), of turn, velocity and way, by the sensor's errors.
        parts: (3, m, 9, 9), covariance of turn, velocity and way, which add up: white noise, turning, motion.
    """

    rows: Rows
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
    impulses: Sequence[Impulse] = (),
    U: Array | None = None,
) -> Legs:
    """Integrate from knot to knot.

    Args:
        frame: of the recording.
        rows: (m + 1,) increasing.
        U: (m + 1, 3) m/s, the knots' own velocity in the gyro frame; by default frame.U there.
        density: (3, n) rad2/s and (3, n) m2/s3, the parts of the noise at each row.
        impulses: of unknown size.
    """
    t = frame.t
    step = max(1, round(BLOCK_S / frame.dt))
    edges = np.union1d(rows, np.arange(rows[0], rows[-1] + 1, step))
    first = np.searchsorted(edges, rows)
    starts, leg = first[:-1], np.repeat(np.arange(len(rows) - 1), np.diff(first))
    h, T = np.diff(t[edges]), np.diff(t[rows])
    togo = (t[rows[1:]][leg] - t[edges[1:]])[:, None]
    middle = togo[:, 0] + 0.5 * h  # from a block's middle to the leg's end

    def per_leg(blocks: Array) -> Array:
        return np.add.reduceat(blocks, starts, axis=0)

    def integrals(values: Array) -> Array:
        """Over each block, of values (n, ...) that change linearly."""
        dt = np.diff(t).reshape(-1, *(1,) * (values.ndim - 1))
        return np.add.reduceat(0.5 * dt * (values[1:] + values[:-1]), edges[:-1])

    # Of each block: velocity gained; and the way that it makes until the leg's end.
    at_knots, velocity = frame.U[rows] if U is None else U, frame.U[edges]
    velocity[first] = at_knots
    dU = np.diff(velocity, axis=0)
    dP = np.diff(frame.UU[edges], axis=0) - velocity[:-1] * h[:, None] + dU * togo
    C = quat_to_matrix(frame.wxyz[(edges[:-1] + edges[1:]) // 2])

    lasts = np.maximum(h, np.finfo(float).tiny)[:, None]  # samples that came at one instant make an empty block
    rate, force = integrals(frame.gyr) / lasts, integrals(frame.acc) / lasts
    by_gyr, by_acc = of_blocks_by_errors(C, rate, force, h)
    by_lag = C @ integrals(np.cross(frame.gyr, frame.acc))[:, :, None]
    turned = np.cumsum(by_gyr, axis=0) - 0.5 * by_gyr  # at the block's middle
    turned -= (turned[starts] - 0.5 * by_gyr[starts])[leg]  # since the leg's beginning
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
    _add_impulses(parts[0], frame, rows, impulses)
    return Legs(rows, T, at_knots, gained, way, J, parts)


def of_blocks_by_errors(C: Array, rate: Array, force: Array, h: Array) -> tuple[Array, Array]:
    """Turns of blocks by the gyro's errors (k, 3, 12), velocities by the accelerometer's (k, 3, 9).

    Args:
        C: (k, 3, 3), gyro frame <- sensor.
        rate: (k, 3) rad/s, and force (k, 3) m/s2: means in sensor axes.
        h: (k,) s.
    """
    i, j = np.transpose(LOWER)
    by_gyr = np.concatenate((C, (C[:, :, :, None] * rate[:, None, None, :]).reshape(-1, 3, 9)), axis=2)
    by_acc = np.concatenate((C, C[:, :, i] * force[:, None, j]), axis=2)
    return by_gyr * -h[:, None, None], by_acc * -h[:, None, None]


def block_noise(force: Array, gyr: Array, acc: Array, togo: Array, h: Array, starts: Rows) -> Array:
    """Covariance (m, 9, 9) that white noise leaves at a leg's end.

    A turn e at a time s before the end turns the specific force that comes after it: velocity -S e s, way -S e s^2 / 2,
    with S = [mean specific force]x.
    """
    moments = [  # means over each block: with less than these the covariance is not positive definite
        np.ones_like(togo),
        togo,
        togo**2 + h**2 / 12.0,
        togo**3 + togo * h**2 / 4.0,
        togo**4 + togo**2 * h**2 / 2.0 + h**4 / 80.0,
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


def _add_impulses(Q: Array, frame: GyroFrame, rows: Rows, impulses: Sequence[Impulse]) -> None:
    """Marginalise what was lost at some rows: each adds the outer product of its effect at its leg's end."""
    if not impulses:
        return
    at = np.array([impulse.row for impulse in impulses])
    k = np.clip(np.searchsorted(rows, at, side="right") - 1, 0, len(rows) - 2)
    end = rows[k + 1]
    at = np.clip(at, rows[k], end)
    togo = (frame.t[end] - frame.t[at])[:, None]
    wxyz = frame.wxyz[at]
    turn = quat_rotate(wxyz, np.array([impulse.gyr for impulse in impulses]))
    push = quat_rotate(wxyz, np.array([impulse.acc for impulse in impulses]))
    dV = frame.U[end] - frame.U[at]
    dP = frame.UU[end] - frame.UU[at] - frame.U[at] * togo
    effect = np.hstack((turn, np.cross(turn, dV) + push, np.cross(turn, dP) + push * togo))
    np.add.at(Q, k, effect[:, :, None] * effect[:, None, :])
