"""The smoother's problem: knots in time, and the measurements at and between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array, quat_rotate, quat_to_matrix
from pbd.tracking.first_rest import Rest
from pbd.tracking.moving_windows import cumulative
from pbd.tracking.noise import Noise, densities
from pbd.tracking.smoother.preintegration import BLOCK_S, GyroFrame, Impulse, Legs, Rows, preintegrate
from pbd.tracking.zero_velocity import ENERGY_WINDOW_S, Spans

INSET_SHARE = 0.2
"""Share of a short stop that is left out at either end; of a longer one half an energy window is."""

STOP_KNOT_S, LONG_STOP_S, LONG_STOP_KNOT_S, MOVE_KNOT_S = 0.25, 20.0, 1.0, 0.5
"""s: distance of knots in a stop, also on either side the averaging time of the magnetic field; a stop that is longer
than LONG_STOP_S has knots LONG_STOP_KNOT_S apart; in a move they are MOVE_KNOT_S apart at most."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Knots and measurements.

    Attributes:
        frame: the recording in the gyro frame.
        rest: its first quiet second.
        noise: of the sensor and the hand.
        stops: where the hand may stand still.
        rows: (m,) of the knots.
        stop_of: (m,) index of the stop that a knot is in, or -1.
        within: (m - 1,) whether two neighbouring knots are in one stop, and nothing is missing between them.
        legs: between the knots.
        still: (m,) m/s along each axis, speed allowed for a hand at rest.
        C: (m, 3, 3), gyro frame <- sensor.
        rate: (m, 3) rad/s, about each knot, in sensor axes; zero without a gyro.
        turn_sigma: (m - 1,) rad, turn allowed for a hand at rest.
        share: (m,) s, that each knot stands for.
        field: (m, 3), the mean magnetic field in the gyro frame, in a unit of its own; None without a magnetometer.
        device: whether the attitude is the device's own, and there is no gyro.
    """

    frame: GyroFrame
    rest: Rest
    noise: Noise
    stops: Spans
    rows: Rows
    stop_of: NDArray[np.intp]
    within: NDArray[np.bool_]
    legs: Legs
    still: Array
    C: Array
    rate: Array
    turn_sigma: Array
    share: Array
    field: Array | None
    device: bool

    @property
    def t(self) -> Array:
        """(m,) s, of the knots."""
        return self.frame.t[self.rows]


def row_noise(
    frame: GyroFrame, rest: Rest, noise: Noise, unseen: Sequence[tuple[int, int]], device: bool
) -> tuple[Array, Array]:
    """`densities` at each row; `unseen` are the first and last row of each hole, `device` as `Problem` has it."""
    t, (s_g, s_a) = frame.t, densities(noise, frame.gyr, frame.u, frame.dt)
    if device:  # it follows a turn late, and catches up
        s_g[0] = noise.device_lag * (frame.gyr**2).sum(axis=1)
        s_a[0] = frame.dt * frame.u[rest.start : rest.stop].var(axis=0).mean()  # its steps and noise tilt gravity
    for first, last in unseen:
        lasts = float(t[last] - t[first])
        s_g[0, first : last + 1] += noise.unseen_rate**2 * lasts
        s_a[0, first : last + 1] += 12.0 * noise.unseen_speed**2 / lasts  # from rest to rest
    return s_g, s_a


def pose_problem(
    frame: GyroFrame,
    mag: Array | None,
    rest: Rest,
    noise: Noise,
    stops: Spans,
    calm: Spans,
    speed: Array,
    density: tuple[Array, Array],
    asked: Sequence[int] = (),
    impulses: Sequence[Impulse] = (),
    unseen: Sequence[tuple[int, int]] = (),
    *,
    device: bool = False,
) -> Problem:
    """Place knots and integrate between them.

    Args:
        frame: the recording in the gyro frame.
        mag: (n, 3) in any unit, or None.
        rest: its first quiet second.
        noise: parameters.
        stops: candidates.
        calm: of each, where the hand stands still without a doubt.
        speed: (n,) m/s along each axis, speed allowed for a hand at rest.
        density: of `row_noise`.
        device: the attitude is the device's own.
        impulses: what was lost above a sensor's range.
        unseen: first and last row of each hole in the data.
        asked: rows at which a knot is wanted beside.
    """
    t, dt = frame.t, frame.dt
    rows, stop_of = _place(t, calm, [*asked, *(row for hole in unseen for row in hole)])
    within = (stop_of[1:] == stop_of[:-1]) & (stop_of[1:] >= 0)
    for first, last in unseen:
        stop_of[(rows > first) & (rows < last)] = -1
        within[(rows[1:] > first) & (rows[:-1] < last)] = False
    seen = np.unique(stop_of[stop_of >= 0])
    stops = [stops[k] for k in seen]
    stop_of = np.where(stop_of < 0, -1, np.searchsorted(seen, stop_of))
    borders = np.concatenate((t[rows[:1]], 0.5 * (t[rows[1:]] + t[rows[:-1]]), t[rows[-1:]]))
    return Problem(
        frame,
        rest,
        noise,
        stops,
        rows,
        stop_of,
        within,
        preintegrate(frame, rows, density, impulses, _velocity(frame, rows, stop_of)),
        speed[rows],
        quat_to_matrix(frame.wxyz[rows]),
        np.zeros((len(rows), 3)) if device else _mean_about(frame.gyr, rows, round(0.5 * BLOCK_S / dt)),
        _turn_sigma(frame, rows, within, noise.still_turn),
        np.maximum(np.diff(borders), dt),
        None if mag is None else _field(frame, mag, rows, max(1, round(STOP_KNOT_S / dt))),
        device,
    )


def _place(t: Array, calm: Spans, asked: Sequence[int]) -> tuple[Rows, NDArray[np.intp]]:
    """Rows of knots (m,), and of each the stop that it is in (m,)."""
    inner = [_inner(t, *span) for span in calm]
    edges = np.array([0, *(row for span in inner for row in span), len(t) - 1])
    lasts = np.diff(t[edges])
    apart = np.full(len(lasts), MOVE_KNOT_S)
    apart[1::2] = np.where(lasts[1::2] < LONG_STOP_S, STOP_KNOT_S, LONG_STOP_KNOT_S)
    rows = np.unique(np.concatenate((np.array([0, len(t) - 1, *asked]), _evenly(t, edges, apart))))
    rows = rows[np.diff(t[rows], prepend=-np.inf) > 0.0]
    rows[-1] = len(t) - 1
    stop_of = np.full(len(rows), -1)
    for k, (first, end) in enumerate(inner):
        stop_of[np.searchsorted(rows, first) : np.searchsorted(rows, end, side="right")] = k
    return rows, stop_of


def _inner(t: Array, start: int, stop: int) -> tuple[int, int]:
    """First and last row of a stop without its edges."""
    inset = min(0.5 * ENERGY_WINDOW_S, INSET_SHARE * float(t[stop - 1] - t[start]))
    first = int(np.searchsorted(t, t[start] + inset - 1e-9))
    last = int(np.searchsorted(t, t[stop - 1] - inset + 1e-9, side="right")) - 1
    middle = (start + stop - 1) // 2
    return (first, last) if first <= last else (middle, middle)


def _evenly(t: Array, edges: Rows, apart_s: Array) -> Rows:
    """Rows from each of (k + 1,) to the next, no further apart than (k,) s."""
    start, lasts = t[edges[:-1]], np.diff(t[edges])
    legs = np.maximum(np.ceil(lasts / apart_s - 1e-6), 1.0).astype(np.intp)
    of, ends = np.repeat(np.arange(len(legs)), legs), np.cumsum(legs)
    share = (1 + np.arange(ends[-1]) - (ends - legs)[of]) / legs[of]
    found: Rows = np.searchsorted(t, start[of] + share * lasts[of] - 1e-9)
    return found


def _velocity(frame: GyroFrame, rows: Rows, stop_of: NDArray[np.intp]) -> Array:
    """Velocity (m, 3) m/s at the knots, in the gyro frame. In a stop it is the mean of half an energy window.

    What shakes a hand at rest has a velocity at any instant, but moves it nowhere.
    """
    U, reach = frame.U[rows], round(0.25 * ENERGY_WINDOW_S / frame.dt)
    still = (stop_of >= 0) & (rows >= reach) & (rows < len(frame.t) - reach)
    about = rows[still, None] + np.arange(-reach, reach + 1)
    early = (frame.t[about] - frame.t[rows[still], None]).mean(axis=1)[:, None]
    U[still] = frame.U[about].mean(axis=1) - frame.u[about].mean(axis=1) * early
    return U


def _turn_sigma(frame: GyroFrame, rows: Rows, within: NDArray[np.bool_], least: float) -> Array:
    """How far a hand may turn from knot to knot of a stop: twice the largest excursion of the integrated rate."""
    angle = cumulative(frame.gyr[1:] * np.diff(frame.t)[:, None])
    length = np.diff(rows)
    share = (np.arange(rows[-1]) - np.repeat(rows[:-1], length)) / np.repeat(length, length)
    turned = np.diff(angle[rows], axis=0)
    sway = angle[:-1] - np.repeat(angle[rows[:-1]], length, axis=0) - share[:, None] * np.repeat(turned, length, axis=0)
    largest = np.maximum.reduceat(np.abs(sway), rows[:-1]).max(axis=1)
    sigma: Array = np.hypot(least, 2.0 * largest * within)
    return sigma


def _field(frame: GyroFrame, mag: Array, rows: Rows, reach: int) -> Array:
    mean = _mean_about(quat_rotate(frame.wxyz, mag), rows, reach)
    largest = float(np.abs(mean).max())
    return mean / largest if largest > 0.0 else mean


def _mean_about(values: Array, rows: Rows, reach: int) -> Array:
    """Means of values (n, 3) over `reach` rows on either side of some rows."""
    sums = cumulative(values)
    first, end = np.maximum(rows - reach, 0), np.minimum(rows + reach + 1, len(values))
    mean: Array = (sums[end] - sums[first]) / (end - first)[:, None]
    return mean
