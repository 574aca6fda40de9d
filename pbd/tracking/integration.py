"""Integrate acceleration twice, only while the hand moves, and let each stop take back the drift of its move."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pbd.data import Stop
from pbd.pose import Array, readonly
from pbd.tracking.preintegration import integral_of_means as integral_of_means
from pbd.tracking.preintegration import integral_of_values as integral_of_values

EVEN_DRIFT = 0.05
"""m/s per root second: the drift of velocity that arises in calm motion, of tilt and bias."""

MOTION_DRIFT = 0.0055
"""Per root hertz: what violent motion adds, as a share of its acceleration (scale, tilt while it lasts)."""

PEAK_DRIFT = 0.3
"""How much of a peak's variance between two samples is lost to a sensor that low-passes, but not quite enough."""

BESIDE = 1
"""So many samples on either side of a move tell how the means at its ends were spread (`integral_of_means`)."""

EDGE_S, EDGE_SHARE = 0.05, 0.33
"""At either end of a stop the hand may still creep: for half a window of the detector, and a third of a short stop; for
twice as long where the acceleration there stands out of the noise."""

STILL = readonly(np.zeros(3))


@dataclass(frozen=True, eq=False)
class Move:
    """One move, relative to where it began: v_nav (n, 3) m/s, p_nav (n, 3) m, closure (3,) m/s."""

    v_nav: Array
    p_nav: Array
    closure: Array


def integrate_move(
    t: Array, a_nav: Array, v_start: Array = STILL, v_end: Array = STILL, rows: slice = slice(None)
) -> Move:
    """Integrate a move whose velocity is known at its first and its last sample: at stops, zero.

    Then the velocity left over at the end is taken out where it most likely arose
    (`_origin_of_drift`): for a calm move linearly in time, which is exact for any constant error of the acceleration.
    (The paper's equations 5-6 are the rectangular sums without that.)

    Args:
        t: (n,) s.
        a_nav: (n, 3) m/s2.
        v_start: (3,) m/s.
        v_end: (3,) m/s.
        rows: of the move, where t and a_nav have more: half of the first and of the last sample's interval lies within
            the move, and how the mean over it was spread the samples beside it tell.
    """
    first, last, _ = rows.indices(len(t))
    wide = slice(max(first - BESIDE, 0), last + BESIDE)
    v_wide = integral_of_means(t[wide], a_nav[wide])[first - wide.start :][: last - first]
    t, a_nav = t[rows], a_nav[rows]
    v_raw = v_start + v_wide - v_wide[0]
    closure = v_raw[-1] - v_end
    v_nav = v_raw - np.outer(_origin_of_drift(t, a_nav), closure)
    return Move(v_nav, integral_of_values(t, v_nav, a_nav), closure)


def _origin_of_drift(t: Array, a_nav: Array) -> Array:
    """Which share of the drift of velocity has arisen by each instant: (n,) from 0 to 1.

    By the variance of each step's increment: a part that grows evenly with time, one that grows with the acceleration,
    and, for peaks that the sensor's rate is too low for (a foot that strikes the ground), a share of the difference
    between a trapezoid and what may lie between: the change of slope times dt / sqrt(12).
    """
    dt = np.diff(t)
    bend = np.zeros(len(t))
    bend[1:-1] = ((a_nav[2:] - 2.0 * a_nav[1:-1] + a_nav[:-2]) ** 2).sum(axis=1)
    density = MOTION_DRIFT**2 * (a_nav**2).sum(axis=1)
    variance = EVEN_DRIFT**2 * dt + 0.5 * dt * (density[1:] + density[:-1])
    variance += PEAK_DRIFT * dt**2 / 24.0 * (bend[1:] + bend[:-1])
    total = float(variance.sum())
    return np.concatenate(([0.0], np.cumsum(variance) / total)) if total > 0.0 else np.zeros(len(t))


def edge(stop: Stop, t: Array, times: float = 1.0) -> int:
    """How many of a stop's samples, at either end, are its edge of so many times EDGE_S; some are left between."""
    length = min(times * EDGE_S, EDGE_SHARE * stop.dwell_s)
    rows = int(np.searchsorted(t, t[stop.start] + length + 1e-6, side="right")) - 1 - stop.start
    return min(rows, (stop.stop - stop.start - 1) // 2)


def _edges(stop: Stop, t: Array, a_nav: Array) -> tuple[int, int]:
    """How many samples the edges are, where the hand arrives and where it leaves."""
    near, far = edge(stop, t), edge(stop, t, 2.0)
    calm = a_nav[stop.start + far : stop.stop - far]
    if far == near or len(calm) < 4:
        return near, near
    noise = float(np.linalg.norm(calm.std(axis=0))) / np.sqrt(far - near)

    def creeps(outer: Array) -> bool:
        return bool(np.linalg.norm(outer.mean(axis=0) - calm.mean(axis=0)) > 3.0 * noise)

    arriving, leaving = a_nav[stop.start + near : stop.start + far], a_nav[stop.stop - far : stop.stop - near]
    return far if creeps(arriving) else near, far if creeps(leaving) else near


def integrate_path(t: Array, a_nav: Array, stops: tuple[Stop, ...]) -> tuple[Array, Array, Array]:
    """Chain the moves between the stops; within a stop nothing moves.

    A move is integrated from inside the one stop to inside the other (`_edges`), where the velocity is zero indeed: at
    the stop's very edge a hand that slows down smoothly still has some millimetres a second.
    Before the first stop and after the last one the motion has one known end only: it is integrated from there and
    its drift stays in.

    Returns:
        p_nav_sensor (n, 3) m with the first stop as origin, v_nav_sensor (n, 3) m/s, closure (len(stops) - 1, 3) m/s.
    """
    p, v = np.zeros_like(a_nav), np.zeros_like(a_nav)
    closure = np.zeros((max(len(stops) - 1, 0), 3))
    here = np.zeros(3)
    for k, (stop, following) in enumerate(pairwise(stops)):
        p[stop.start : stop.stop] = here
        leaving, arriving = _edges(stop, t, a_nav)[1], _edges(following, t, a_nav)[0]
        rows = slice(stop.stop - 1 - leaving, following.start + 1 + arriving)
        result = integrate_move(t, a_nav, rows=rows)
        between = slice(leaving + 1, len(result.p_nav) - 1 - arriving)
        move = slice(stop.stop, following.start)
        p[move], v[move], closure[k] = here + result.p_nav[between], result.v_nav[between], result.closure
        here = here + result.p_nav[-1]
    if stops:
        head, tail = slice(stops[0].start, None, -1), slice(stops[-1].stop - 1, None)
        p[stops[-1].start : stops[-1].stop] = here
        for end, origin in ((head, np.zeros(3)), (tail, here)):
            v[end] = integral_of_means(t[end], a_nav[end])
            p[end] = origin + integral_of_values(t[end], v[end], a_nav[end])
    return p, v, closure
