"""The path of the live view: a smooth curve through the tracked positions, in pieces of bounded size."""

import numpy as np
from numpy.typing import ArrayLike

from pbd.pose import Array

SPACING_M = 0.004
"""Distance, m, between two points of the path."""
PIECE_POINTS = 32
"""Points of one piece. Only the last piece grows, so a new point costs at most one piece to send."""
MAX_NEW_POINTS = 24
"""Largest number of points added at once, so that dead reckoning that diverges costs no more than a move."""
CAMERA_REACH_M = 1.5
"""Largest distance, m, from the stops at which the camera follows the hand. Beyond it dead reckoning has diverged."""


class LivePath:
    """The path, move by move. `take` returns the pieces that are new or have changed."""

    def __init__(self) -> None:
        self._move = -1
        self._rows: list[Array] = []
        self._settled = np.empty((0, 3))  # the corners of all moves that have ended
        self._changed: dict[str, Array] = {}

    def begin(self, t: float, p_nav_sensor: ArrayLike) -> None:
        """Begin a move at t s from a stop at p_nav_sensor (3,) m."""
        self._move += 1
        self._rows = [np.array((t, *np.asarray(p_nav_sensor), 0.0))]
        self._p, self._v, self._t = np.array(p_nav_sensor, dtype=np.float64), np.zeros(3), t
        self._current = np.tile(self._p, (2, 1))

    def grow(self, t: float, p_nav_sensor: Array, v_nav_sensor: Array) -> None:
        """Extend the path to p (3,) m with v (3,) m/s at t s, once it is SPACING_M away, by a cubic."""
        step = p_nav_sensor - self._p
        chord = float(np.linalg.norm(step))
        if chord < SPACING_M:
            if len(self._rows) == 1:  # still at the stop: the move begins later
                self._rows[0][0] = self._t = t
            return
        # A rest before the move makes the time too long for the chord, so tangents are limited to three chords.
        tangents = ((t - self._t) * v for v in (self._v, v_nav_sensor))
        before, after = (x * min(1.0, 3.0 * chord / max(float(np.linalg.norm(x)), 1e-12)) for x in tangents)
        first = len(self._rows)
        share = np.linspace(0.0, 1.0, min(int(np.ceil(chord / SPACING_M)), MAX_NEW_POINTS) + 1)[1:]
        s = share[:, None]
        points = self._p + s * s * (3.0 - 2.0 * s) * step + s * (1.0 - s) * ((1.0 - s) * before - s * after)
        speeds = (1.0 - share) * np.linalg.norm(self._v) + share * np.linalg.norm(v_nav_sensor)
        self._rows += list(np.column_stack((self._t + share * (t - self._t), points, speeds)))
        self._p, self._v, self._t = np.array(p_nav_sensor), np.array(v_nav_sensor), t
        self._current = _corners(np.vstack((self._current, points)))
        self._mark(max(first - 1, 0))

    def correct(self, t: float, p_nav_sensor: ArrayLike) -> None:
        """End the move at a stop that began at t s, at p_nav_sensor (3,) m, and begin the next one there.

        Dead reckoning missed that stop. Its error is removed as if the velocity error had grown linearly with time.
        """
        rows = np.array(self._rows)
        last = int(np.searchsorted(rows[:, 0], t, side="right")) - 1
        share = (rows[: last + 1, 0] - rows[0, 0]) / max(rows[last, 0] - rows[0, 0], 1e-9)
        rows[: last + 1, 1:4] += share[:, None] ** 2 * (np.asarray(p_nav_sensor) - rows[last, 1:4])
        rows[last + 1 :, 1:4] = p_nav_sensor  # the hand stood still by then
        self._rows = list(rows)
        self._settled = _corners(np.vstack((self._settled, _near(rows[:, 1:4], rows[[0, -1], 1:4]))))
        self._mark(0)
        self.begin(t, p_nav_sensor)

    def take(self, limit: int) -> list[tuple[str, Array, Array]]:
        """Return at most `limit` changed pieces, oldest first: name, points (n, 3) m, speed (n,) m/s."""
        names = list(self._changed)[:limit]
        return [(name, rows[:, 1:4], rows[:, 4]) for name in names for rows in [self._changed.pop(name)]]

    def corners(self) -> Array:
        """Return the corners (2, 3) m of a box around the path, at most CAMERA_REACH_M around the stops."""
        return _corners(np.vstack((self._settled, _near(self._current, self._rows[0][None, 1:4]))))

    @property
    def more(self) -> bool:
        """Whether there are changed pieces left to take."""
        return bool(self._changed)

    def _mark(self, row: int) -> None:
        """Mark the piece with this row, and all pieces after it, as changed. Neighbours share a point."""
        for k in range(row // PIECE_POINTS, -(-(len(self._rows) - 1) // PIECE_POINTS)):
            self._changed[f"{self._move}/{k}"] = np.array(self._rows[k * PIECE_POINTS : (k + 1) * PIECE_POINTS + 1])


def _corners(points: Array) -> Array:
    return np.array((points.min(axis=0), points.max(axis=0)))


def _near(points: Array, stops: Array) -> Array:
    return points.clip(stops.min(axis=0) - CAMERA_REACH_M, stops.max(axis=0) + CAMERA_REACH_M)
