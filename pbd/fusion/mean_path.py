"""The mean way of several takes from keyframe to keyframe, each move at its own share of time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pbd.data import Stop
from pbd.pose import (
    Array,
    quat_canonical,
    quat_exp,
    quat_from_matrix,
    quat_inverse,
    quat_log,
    quat_multiply,
    quat_slerp,
)


@dataclass(frozen=True, eq=False)
class Way:
    """One take in the task's nav, of the sensor as in the first take: t (n,) s, p (n, 3) m, wxyz (n, 4).

    `stops` (J, 2) s: from when to when it stands at each of the task's keyframes, NaN where it has none; `weight` (J,):
    how sure that is.
    """

    t: Array
    p: Array
    wxyz: Array
    stops: Array
    weight: Array


class MeanWay(NamedTuple):
    """t (n,) s; p, v, a (n, 3) in nav; wxyz (n, 4); the stops; and the first take's instant at each row, (n,) s."""

    t: Array
    p: Array
    v: Array
    a: Array
    wxyz: Array
    stops: tuple[Stop, ...]
    at_first: Array


def mean_way(ways: Sequence[Way], m: Array, A: Array, interval: float) -> MeanWay:
    """Average takes between keyframes.

    Args:
        ways: the takes; a move is the mean of those that have both its ends.
        m, A: (J, 3) m and (J, 3, 3), the task's keyframes, at which the mean way stands.
        interval: s, between two rows.
    """
    edges = np.array([way.stops for way in ways])  # (K, J, 2)
    dwell = np.nanmedian(edges[:, :, 1] - edges[:, :, 0], axis=0)
    move = np.nanmedian(edges[:, 1:, 0] - edges[:, :-1, 1], axis=0)
    still = np.maximum(np.round(dwell / interval), 1.0).astype(int) + 1
    going = np.maximum(np.round(move / interval), 2.0).astype(int) - 1
    count = int(still.sum() + going.sum())
    p, wxyz, at_first = np.empty((count, 3)), np.empty((count, 4)), np.full(count, np.nan)
    v, stops, row = np.zeros((count, 3)), [], 0
    poses, weight = quat_from_matrix(A), np.max([way.weight for way in ways], axis=0).tolist()
    for j in range(len(m)):
        here = slice(row, row + int(still[j]))
        p[here], wxyz[here] = m[j], poses[j]
        at_first[here] = np.linspace(edges[0, j, 0], edges[0, j, 1], int(still[j]))
        stops.append(Stop(here.start, here.stop, float(still[j] - 1) * interval, weight[j]))
        row = here.stop
        if j + 1 == len(m):
            break
        between = slice(row, row + int(going[j]))
        u = np.arange(1, going[j] + 1) / (going[j] + 1.0)
        mean = _move([way for way in ways if np.isfinite(way.stops[j : j + 2]).all()], j, u, m, poses)
        p[between], wxyz[between] = mean
        at_first[between] = edges[0, j, 1] + u * (edges[0, j + 1, 0] - edges[0, j, 1])
        v[between] = np.gradient(_closed(p, between, m[j + 1]), interval, axis=0)[1:-1]
        row = between.stop
    known = np.isfinite(at_first)
    rows = np.arange(count)
    return MeanWay(
        np.asarray(interval * rows, dtype=np.float64),
        p,
        v,
        np.asarray(np.gradient(v, interval, axis=0)),
        wxyz,
        tuple(stops),
        np.interp(rows, rows[known], at_first[known]),
    )


def _closed(p: Array, between: slice, end: Array) -> Array:
    """A move with the rows on either side of it."""
    return np.vstack((p[between.start - 1 : between.stop], end))


def _move(ways: Sequence[Way], j: int, u: Array, m: Array, poses: Array) -> tuple[Array, Array]:
    """The mean of takes from keyframe j to the next, at shares u (n,) of the time, each led from end to end."""
    places, turns = [], []
    for way in ways:
        start, end = way.stops[j, 1], way.stops[j + 1, 0]
        t = np.concatenate(([start], start + u * (end - start), [end]))
        p = np.column_stack([np.interp(t, way.t, axis) for axis in way.p.T])
        after = np.clip(np.searchsorted(way.t, t), 1, len(way.t) - 1)
        lasts = way.t[after] - way.t[after - 1]
        wxyz = quat_slerp(way.wxyz[after - 1], way.wxyz[after], (t - way.t[after - 1]) / lasts)
        s = np.concatenate(([0.0], u, [1.0]))[:, None]
        led = s**2 * (3.0 - 2.0 * s)  # keeps velocity zero at both ends
        places.append((p + (1.0 - led) * (m[j] - p[0]) + led * (m[j + 1] - p[-1]))[1:-1])
        off = [quat_log(quat_multiply(poses[j + i], quat_inverse(wxyz[-i]))) for i in (0, 1)]  # -0 and -1: both ends
        turns.append(quat_multiply(quat_exp((1.0 - led) * off[0] + led * off[1]), wxyz)[1:-1])
    aligned = [np.where((turn * turns[0]).sum(axis=1, keepdims=True) < 0.0, -turn, turn) for turn in turns]
    return np.mean(places, axis=0), quat_canonical(np.mean(aligned, axis=0))
