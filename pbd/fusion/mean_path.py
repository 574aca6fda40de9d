"""The mean path of several takes: each move is averaged at equal fractions of its own duration."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pbd.calibration.demonstrated_path import with_ends_at
from pbd.data import Stop
from pbd.data.streams import interpolate
from pbd.errors import TrackingError
from pbd.pose import Array, Pose, quat_canonical, quat_from_matrix, quat_slerp


@dataclass(frozen=True, eq=False)
class TakePath:
    """The path of one take in the task's nav, with the sensor held as in the first take.

    Attributes:
        t, p, wxyz: (n,) s, (n, 3) m and (n, 4).
        stops: (J, 2) s, start and end of the stop at each of the task's keyframes; NaN where the take has none.
        weight: (J,) certainty of each stop.
    """

    t: Array
    p: Array
    wxyz: Array
    stops: Array
    weight: Array


class MeanPath(NamedTuple):
    """The mean path in nav: t (n,) s; p, v, a (n, 3) m, m/s, m/s2; wxyz (n, 4).

    `t_first` (n,) s is the time in the first take that corresponds to each row.
    """

    t: Array
    p: Array
    v: Array
    a: Array
    wxyz: Array
    stops: tuple[Stop, ...]
    t_first: Array


def average_paths(paths: Sequence[TakePath], m: Array, A: Array, interval: float) -> MeanPath:
    """Average takes between keyframes, each move over those that have both its ends; times are medians.

    Args:
        m, A: (J, 3) m and (J, 3, 3), the task's keyframes, at which the mean path stops.
        interval: s, time between two rows.

    Raises:
        TrackingError: no take has both ends of a move.
    """
    edges = np.array([path.stops for path in paths])  # (K, J, 2)
    moves = np.isfinite(edges[:, :-1] + edges[:, 1:]).all(axis=2).any(axis=0)
    if not moves.all():
        j = int(np.argmin(moves))
        raise TrackingError(
            f"no take that agrees with the others has both keyframe {j} and {j + 1}; record another take"
        )
    dwell = np.nanmedian(edges[:, :, 1] - edges[:, :, 0], axis=0)
    move = np.nanmedian(edges[:, 1:, 0] - edges[:, :-1, 1], axis=0)
    rest_rows = (np.maximum(np.round(dwell / interval), 1.0).astype(int) + 1).tolist()
    move_rows = (np.maximum(np.round(move / interval), 2.0).astype(int) - 1).tolist()
    weight = np.max([path.weight for path in paths], axis=0).tolist()
    keyframes = list(map(Pose, m, quat_from_matrix(A)))
    parts, stops, row = [], list[Stop](), 0
    for j, (keyframe, rows) in enumerate(zip(keyframes, rest_rows, strict=True)):
        rest = np.linspace(edges[0, j, 0], edges[0, j, 1], rows)
        parts.append((np.tile(keyframe.p, (rows, 1)), np.zeros((rows, 3)), np.tile(keyframe.wxyz, (rows, 1)), rest))
        stops.append(Stop(row, row + rows, (rows - 1.0) * interval, weight[j]))
        if j + 1 == len(m):
            break
        row += rows + move_rows[j]
        share = np.arange(move_rows[j] + 2) / (move_rows[j] + 1.0)
        having = [path for path in paths if np.isfinite(path.stops[j : j + 2]).all()]
        p, wxyz = _mean_move(having, j, share, keyframe, keyframes[j + 1])
        t_first = edges[0, j, 1] + share * (edges[0, j + 1, 0] - edges[0, j, 1])
        parts.append((p[1:-1], np.gradient(p, interval, axis=0)[1:-1], wxyz[1:-1], t_first[1:-1]))
    p, v, wxyz, t_first = map(np.concatenate, zip(*parts, strict=True))
    every, known = np.arange(float(len(p))), np.isfinite(t_first)
    t_first = np.interp(every, every[known], t_first[known])
    a: Array = np.asarray(np.gradient(v, interval, axis=0))
    return MeanPath(interval * every, p, v, a, wxyz, tuple(stops), t_first)


def _mean_move(paths: Sequence[TakePath], j: int, share: Array, start: Pose, end: Pose) -> tuple[Array, Array]:
    """Return the mean p and wxyz of takes from keyframe j to the next, at shares (n,) of the move's duration."""
    places, attitudes = [], []
    for path in paths:
        t = path.stops[j, 1] + share * (path.stops[j + 1, 0] - path.stops[j, 1])
        p = interpolate(t, path.t, path.p)
        after = np.clip(np.searchsorted(path.t, t), 1, len(path.t) - 1)
        fraction = (t - path.t[after - 1]) / (path.t[after] - path.t[after - 1])
        wxyz = quat_slerp(path.wxyz[after - 1], path.wxyz[after], fraction)
        p, wxyz = with_ends_at(share, p, wxyz, start, end)
        places.append(p)
        attitudes.append(wxyz)
    same_side = [np.where((each * attitudes[0]).sum(axis=1, keepdims=True) < 0.0, -each, each) for each in attitudes]
    return np.mean(places, axis=0), quat_canonical(np.mean(same_side, axis=0))
