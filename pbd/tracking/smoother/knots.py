"""The smoother's problem: knots in time, the measurements at them, and the legs between them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.data.streams import interpolate
from pbd.lazy import cached_property
from pbd.pose import Array, quat_rotate, quat_to_matrix
from pbd.tracking.first_rest import Rest
from pbd.tracking.moving_windows import Rows, Spans, cumulative
from pbd.tracking.noise import Noise, densities
from pbd.tracking.smoother.preintegration import (
    ACC_MATRIX,
    BLOCK_S,
    GYR_MATRIX,
    LOWER,
    OF_GYR,
    POS,
    VEL,
    GyroFrame,
    Legs,
    LostMotion,
    preintegrate,
)
from pbd.tracking.zero_velocity import ENERGY_WINDOW_S

STOP_KNOT_S, LONG_STOP_S, LONG_STOP_KNOT_S, MOVE_KNOT_S = 0.25, 20.0, 1.0, 0.5
"""s: knots are at most STOP_KNOT_S apart in a stop, LONG_STOP_KNOT_S in a stop longer than LONG_STOP_S, and MOVE_KNOT_S
in a move. The magnetic field is averaged over STOP_KNOT_S before and after each knot."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Knots and measurements.

    Attributes:
        frame: the recording in the gyro frame.
        rest: its first rest.
        noise: parameters of sensor and hand.
        stops: spans in which the hand may stand still.
        rows: (m,) row of each knot.
        stop_of: (m,) index of the stop in which the knot lies, or -1.
        same_stop: (m - 1,) whether a knot and the next are in one stop without a gap between them.
        stood: (m - 1,) whether a person knows that the hand stood still between the two.
        legs: preintegrated from knot to knot.
        still_sigma: (m,) m/s per axis, sigma of zero velocity.
        C: (m, 3, 3), gyro frame <- sensor.
        rate: (m, 3) rad/s, mean around each knot in sensor axes; zero without a gyro.
        turn_sigma: (m - 1,) rad per axis, sigma of zero turn between a stop's knots.
        duration: (m,) s, the part of the recording that is nearest to each knot.
        field: (m, 3), mean magnetic field in the gyro frame, its largest component 1; None without a magnetometer.
        no_gyro: there is no gyro, so the attitude is the device's own.
    """

    frame: GyroFrame
    rest: Rest
    noise: Noise
    stops: Spans
    rows: Rows
    stop_of: NDArray[np.intp]
    same_stop: NDArray[np.bool_]
    stood: NDArray[np.bool_]
    legs: Legs
    still_sigma: Array
    C: Array
    rate: Array
    turn_sigma: Array
    duration: Array
    field: Array | None
    no_gyro: bool

    @property
    def t(self) -> Array:
        """(m,) s, time of each knot."""
        return self.frame.t[self.rows]


@dataclass(frozen=True, eq=False)
class Samples:
    """What the problems of a recording have in common: all but the stops.

    Attributes:
        frame, rest, noise, no_gyro: as in `Problem`.
        still: spans that look still, accepted or not.
        mag: (n, 3) in any unit, or None.
        still_sigma: (n,) m/s per axis, sigma of zero velocity.
        extra_rows, lost_motion, gaps, still_gaps: as `smooth` takes them.
    """

    frame: GyroFrame
    rest: Rest
    noise: Noise
    still: Spans
    mag: Array | None
    still_sigma: Array
    extra_rows: Sequence[int]
    lost_motion: Sequence[LostMotion]
    gaps: Sequence[tuple[int, int]]
    still_gaps: Sequence[tuple[int, int]]
    no_gyro: bool

    @cached_property
    def density(self) -> tuple[Array, Array]:
        """`densities` at each row, with the unknown motion in gaps."""
        frame, noise, rest = self.frame, self.noise, self.rest
        up = _force_at_rest(frame, self.still)
        t, (s_g, s_a) = frame.t, densities(noise, frame.gyr, frame.u, frame.dt, up)
        if self.no_gyro:
            # Half an interval of the lag is left: a filter steps once a sample. Neither part is scaled by residuals, as
            # the device's error changes smoothly: a leg shows less of it than a stop has.
            left = (0.5 * frame.dt) ** 2 / noise.device_lag * (frame.gyr**2).sum(axis=1)
            s_g[0], s_g[1] = s_g[1] + left + noise.gyr_turn**2 * noise.device_drift, 0.0
            s_a[0] = frame.dt * frame.u[rest.start : rest.stop].var(axis=0).mean()  # gravity, tilted by attitude noise
        for first, last in (*self.gaps, *self.still_gaps):
            lasts = float(t[last] - t[first])
            s_g[0, first : last + 1] += noise.unseen_rate**2 * lasts
            s_a[0, first : last + 1] += 12.0 * noise.unseen_speed**2 / lasts  # a move from rest to rest
        return s_g, s_a


def _force_at_rest(frame: GyroFrame, still: Spans) -> Array:
    """Specific force at rest (n, 3) m/s2: means from knot to knot of the still spans, linear in time between them.

    It is not constant, because the gyro frame drifts.
    """
    rows, stop_of = _place_knots(frame.t, still, ())
    within = (stop_of[1:] == stop_of[:-1]) & (stop_of[1:] >= 0)
    if not within.any():
        return np.asarray(frame.u.mean(axis=0))
    ends = np.column_stack((rows[:-1], rows[1:]))[within]
    t, gained = frame.t[ends], frame.U[ends[:, 1]] - frame.U[ends[:, 0]]
    return interpolate(frame.t, t.mean(axis=1), gained / np.diff(t, axis=1))


def build_problem(samples: Samples, stops: Spans) -> Problem:
    """Place knots, and integrate between them. `stops`: spans in which the hand may stand still."""
    frame, noise, gaps, still_gaps = samples.frame, samples.noise, samples.gaps, samples.still_gaps
    t, dt, mag = frame.t, frame.dt, samples.mag
    rows, stop_of = _place_knots(t, stops, [*samples.extra_rows, *(row for gap in (*gaps, *still_gaps) for row in gap)])
    same_stop = (stop_of[1:] == stop_of[:-1]) & (stop_of[1:] >= 0)
    for first, last in gaps:
        stop_of[(rows > first) & (rows < last)] = -1
        same_stop[(rows[1:] > first) & (rows[:-1] < last)] = False
    stood = np.zeros(len(same_stop), dtype=np.bool_)
    for first, last in still_gaps:
        stood |= same_stop & (rows[1:] > first) & (rows[:-1] < last)
    used = np.unique(stop_of[stop_of >= 0])
    stops = [stops[k] for k in used]
    stop_of = np.where(stop_of < 0, -1, np.searchsorted(used, stop_of))
    borders = np.concatenate((t[rows[:1]], 0.5 * (t[rows[1:]] + t[rows[:-1]]), t[rows[-1:]]))
    legs = preintegrate(frame, rows, samples.density, samples.lost_motion, _knot_velocity(frame, rows, stop_of))
    if samples.no_gyro:
        legs.J[:, :, OF_GYR] = 0.0  # there is none that errs
    field = None if mag is None else mean_around(quat_rotate(frame.wxyz, mag), rows, round(STOP_KNOT_S / dt))
    if field is not None:
        field /= np.abs(field).max()
    middle = quat_to_matrix(frame.wxyz[(rows[:-1] + rows[1:]) // 2])
    _fix_sway(legs, middle, np.where(same_stop, stop_of[:-1], -1))
    return Problem(
        frame,
        samples.rest,
        noise,
        stops,
        rows,
        stop_of,
        same_stop,
        stood,
        legs,
        samples.still_sigma[rows],
        quat_to_matrix(frame.wxyz[rows]),
        np.zeros((len(rows), 3)) if samples.no_gyro else mean_around(frame.gyr, rows, round(0.5 * BLOCK_S / dt)),
        _turn_sigma(frame, rows, same_stop, noise.still_turn),
        np.maximum(np.diff(borders), dt),
        field,
        samples.no_gyro,
    )


def _fix_sway(legs: Legs, C: Array, stop: NDArray[np.intp]) -> None:
    """Leave noise, sway and tremor in a stop out of what the matrices multiply (errors in variables).

    A scale factor of zero would remove them, and so fit best. What a stop shows of the matrices is only how they change
    its mean specific force.

    Source: W. A. Fuller, Measurement error models, Wiley 1987, 1.1.

    Args:
        C: (m, 3, 3), gyro frame <- sensor, in the middle of each leg.
        stop: (m,) index of the stop in which each leg lies, or -1.
    """
    within, (i, j) = stop >= 0, LOWER
    stop, C, T = stop[within], C[within], legs.T[within, None, None]
    gained = (C.transpose(0, 2, 1) @ legs.dU[within, :, None])[:, :, 0]
    total = np.zeros((stop.max(initial=-1) + 1, 4))
    np.add.at(total, stop, np.column_stack((gained, T[:, 0])))
    force = total[stop, :3] / total[stop, 3:]
    by_matrix = -T * C[:, :, i] * force[:, None, j]
    legs.J[within, :, GYR_MATRIX] = 0.0
    legs.J[within, VEL, ACC_MATRIX], legs.J[within, POS, ACC_MATRIX] = by_matrix, 0.5 * T * by_matrix


def _place_knots(t: Array, stops: Spans, extra_rows: Sequence[int]) -> tuple[Rows, NDArray[np.intp]]:
    """Rows of the knots (m,), and the index of the stop in which each lies, or -1 (m,)."""
    inner = [_without_edges(t, *span) for span in stops]
    edges = np.array([0, *(row for span in inner for row in span), len(t) - 1])
    lasts = np.diff(t[edges])
    spacing = np.full(len(lasts), MOVE_KNOT_S)
    spacing[1::2] = np.where(lasts[1::2] < LONG_STOP_S, STOP_KNOT_S, LONG_STOP_KNOT_S)
    rows = np.unique(np.concatenate((np.array([0, len(t) - 1, *extra_rows]), _evenly_spaced(t, edges, spacing))))
    rows = rows[np.diff(t[rows], prepend=-np.inf) > 0.0]
    rows[-1] = len(t) - 1
    stop_of = np.full(len(rows), -1)
    for k, (first, end) in enumerate(inner):
        stop_of[np.searchsorted(rows, first) : np.searchsorted(rows, end, side="right")] = k
    return rows, stop_of


def _without_edges(t: Array, start: int, stop: int) -> tuple[int, int]:
    """First and last row of a stop without its edges: a fifth of its duration, at most half a window, has no knots."""
    inset = min(0.5 * ENERGY_WINDOW_S, 0.2 * float(t[stop - 1] - t[start]))
    first = int(np.searchsorted(t, t[start] + inset - 1e-9))
    last = int(np.searchsorted(t, t[stop - 1] - inset + 1e-9, side="right")) - 1
    middle = (start + stop - 1) // 2
    return (first, last) if first <= last else (middle, middle)


def _evenly_spaced(t: Array, edges: Rows, spacing_s: Array) -> Rows:
    """Evenly spaced rows from each edge (k + 1,) to the next, at most `spacing_s` (k,) apart."""
    start, lasts = t[edges[:-1]], np.diff(t[edges])
    legs = np.maximum(np.ceil(lasts / spacing_s - 1e-6), 1.0).astype(np.intp)
    leg_of, ends = np.repeat(np.arange(len(legs)), legs), np.cumsum(legs)
    share = (1 + np.arange(ends[-1]) - (ends - legs)[leg_of]) / legs[leg_of]
    found: Rows = np.searchsorted(t, start[leg_of] + share * lasts[leg_of] - 1e-9)
    return found


def _knot_velocity(frame: GyroFrame, rows: Rows, stop_of: NDArray[np.intp]) -> Array:
    """Velocity (m, 3) m/s at the knots, in the gyro frame; in a stop, its mean over ENERGY_WINDOW_S / 2 (no tremor)."""
    U, reach = frame.U[rows], round(0.25 * ENERGY_WINDOW_S / frame.dt)
    still = (stop_of >= 0) & (rows >= reach) & (rows < len(frame.t) - reach)
    about = rows[still, None] + np.arange(-reach, reach + 1)
    early = (frame.t[about] - frame.t[rows[still], None]).mean(axis=1)[:, None]
    U[still] = frame.U[about].mean(axis=1) - frame.u[about].mean(axis=1) * early
    return U


def _turn_sigma(frame: GyroFrame, rows: Rows, same_stop: NDArray[np.bool_], least: float) -> Array:
    """Sigma (m - 1,) rad of zero turn between a stop's knots: twice the largest excursion of the integrated rate."""
    angle = cumulative(frame.gyr[1:] * np.diff(frame.t)[:, None])
    length = np.diff(rows)
    share = (np.arange(rows[-1]) - np.repeat(rows[:-1], length)) / np.repeat(length, length)
    turned = np.diff(angle[rows], axis=0)
    sway = angle[:-1] - np.repeat(angle[rows[:-1]], length, axis=0) - share[:, None] * np.repeat(turned, length, axis=0)
    largest = np.maximum.reduceat(np.abs(sway), rows[:-1]).max(axis=1)
    sigma: Array = np.hypot(least, 2.0 * largest * same_stop)
    return sigma


def mean_around(values: Array, rows: Rows, reach: int) -> Array:
    """Means of values (n, 3) over each row and `reach` rows on either side of it."""
    sums = cumulative(values)
    first, end = np.maximum(rows - reach, 0), np.minimum(rows + reach + 1, len(values))
    mean: Array = (sums[end] - sums[first]) / (end - first)[:, None]
    return mean
