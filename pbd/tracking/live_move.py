"""The move under way: dead reckoning, and what it takes to integrate the move once it has ended."""

from __future__ import annotations

from array import array
from dataclasses import dataclass

import numpy as np

from pbd.data import Attitude, Recording
from pbd.pose import Array
from pbd.tracking.gravity import motion_acceleration
from pbd.tracking.integration import EDGE_S, integrate_move
from pbd.tracking.live_samples import Sample
from pbd.tracking.live_stops import CONFIRM_S, Run
from pbd.tracking.uncertainty import MoveFigures, move_figures, shaking_speed

CLIPPED_RATE, CLIPPED_SAMPLES = 3.0, 3
"""rad/s: where an axis of the gyro reads the same for so many samples, at least this and more than ever, its range
ends."""

HARDLY_TURNED = 0.02
"""rad: less than this counts as no turn."""

COLUMNS = 11
"""Of what is kept of a sample: t, acc, gyr, wxyz."""


@dataclass(frozen=True, eq=False)
class Ended:
    """A move that has ended: displacement (3,) m, closure (3,) m/s, what its covariance follows from,
    and m2 that gaps add to the variance of each axis."""

    displacement: Array
    closure: Array
    figures: MoveFigures
    gap_variance: float


def error_on_the_way(t: Array, wxyz: Array, a_nav: Array, move: slice) -> Array:
    """Error of motion acceleration (n, 3) m/s2, over a move's samples from what it is at rest before and after.

    At rest acceleration is zero; what is seen there is the accelerometer's error and gravity put wrong by tilt. The one
    turns with the sensor, the other arises while it turns, or slowly: between the rests the error is taken to change
    as the attitude does from the one to the other, or, where it doesn't, evenly with time.
    """
    before, after = a_nav[: move.start + 1].mean(axis=0), a_nav[move.stop - 1 :].mean(axis=0)
    t, wxyz = t[move], wxyz[move]
    from_first = turned_by(wxyz, wxyz[0])
    to_last = turned_by(wxyz, wxyz[-1])
    even = (t - t[0]) / (t[-1] - t[0])
    share = np.zeros(len(a_nav))
    share[move] = (from_first + HARDLY_TURNED * even) / (from_first + to_last + HARDLY_TURNED)
    share[move.stop :] = 1.0
    error: Array = before + share[:, None] * (after - before)
    return error


class LiveMove:
    """Dead reckoning from the last stop.

    Attributes:
        v_nav, p_nav: (3,) m/s and m since the last stop. The mean acceleration of that stop, which an error of tilt or
            of the accelerometer leaves, is taken off; at the move's end this makes next to no difference.
        turned, turned_s: rad, how far the attitude is from that of the last stop (small angles), and its integral.
        clipped: whether the move was too fast for the gyro.
    """

    def __init__(self, interval: float, gravity: float, has_gyro: bool) -> None:
        self._edge, self._kept = round(EDGE_S / interval), round(CONFIRM_S / interval) + 1
        self._gravity, self._has_gyro = gravity, has_gyro
        self._rows = array("d")
        self._a_nav = np.zeros(3)
        self._wxyz_stop, self.turned, self.turned_s = np.array((1.0, 0.0, 0.0, 0.0)), 0.0, 0.0
        self._t = self._t_stop = self._power = self._turning = 0.0
        self.clipped, self._same, self._fastest, self._gyr = False, 0, 0.0, np.zeros(3)
        self._gaps: list[tuple[float, float, bool]] = []
        self.v_nav, self.p_nav = np.zeros(3), np.zeros(3)

    def add(self, sample: Sample, wxyz: Array, a_nav: Array, at_stop: Array) -> None:
        """Take the next sample, its attitude and motion acceleration; `at_stop` (3,) is that of the last stop."""
        dt = sample.t - self._t if self._rows else 0.0
        v_before = self.v_nav
        self.v_nav = v_before + dt * (0.5 * (a_nav + self._a_nav) - at_stop)
        self.p_nav = self.p_nav + 0.5 * dt * (v_before + self.v_nav)
        self._same = self._same + 1 if self._rows and self._repeats(sample.gyr) else 0
        self._fastest = max(self._fastest, float(np.abs(sample.gyr).max()))
        self.clipped = self.clipped or self._same >= CLIPPED_SAMPLES - 1
        self.turned = float(turned_by(wxyz, self._wxyz_stop))
        self.turned_s += dt * self.turned
        self._power += dt * float((a_nav**2).sum())
        self._turning += dt * float(np.sqrt((sample.gyr**2).sum()))
        self._t, self._a_nav, self._gyr = sample.t, a_nav, sample.gyr
        self._rows.extend((sample.t, *sample.acc, *sample.gyr, *wxyz))

    def _repeats(self, gyr: Array) -> bool:
        return bool(((gyr == self._gyr) & (np.abs(gyr) >= max(CLIPPED_RATE, self._fastest))).any())

    def add_gap(self, length_s: float, change: Array, unseen: bool) -> None:
        """Note that samples were put back for so long, over which acceleration changed by (3,) m/s2."""
        self._gaps.append((length_s, float(np.sqrt((change**2).sum())), unseen))

    def stand(self) -> None:
        """The hand stands still: dead reckoning begins anew."""
        self.clipped, self._same = False, 0
        self._t_stop, self._power, self._turning = self._t, 0.0, 0.0
        self._wxyz_stop, self.turned, self.turned_s = np.array(self._rows[-4:]), 0.0, 0.0
        self.v_nav, self.p_nav = np.zeros(3), np.zeros(3)

    def settle(self) -> None:
        """Forget all but as much of the stop as the next move's beginning needs."""
        del self._rows[: -COLUMNS * self._kept]
        self._gaps.clear()

    def begin_at(self, before: Run) -> None:
        """Forget all but the move that began at this stop."""
        start = int(np.searchsorted(self._table()[:, 0], before.last_t)) - self._kept + 1
        del self._rows[: COLUMNS * max(start, 0)]

    def _table(self) -> Array:
        return np.array(self._rows).reshape(-1, COLUMNS)

    def end(self, before: Run, after: Run) -> Ended:
        """Integrate from inside one stop to inside the next, as the batch tracker does."""
        rows = self._table()
        start = int(np.searchsorted(rows[:, 0], before.last_t)) - self._kept + 1
        rows = rows[max(start, int(np.searchsorted(rows[:, 0], before.start_t))) :]
        t, acc, gyr, wxyz = rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7:11]
        recording = Recording(t, acc, gyr if self._has_gyro else None)
        a_nav = motion_acceleration(recording, Attitude(wxyz, np.zeros((len(t), 3))), self._gravity)
        last, first = int(np.searchsorted(t, before.last_t)), int(np.searchsorted(t, after.start_t))
        inner = slice(max(last - self._edge, 0), first + self._edge + 1)
        a_nav = a_nav - error_on_the_way(t, wxyz, a_nav, inner)
        move = integrate_move(t, a_nav, rows=inner)
        speeds = shaking_speed(a_nav[: inner.start + 1]), shaking_speed(a_nav[inner.stop - 1 :])
        shaken = float(np.hypot(*speeds)) / np.sqrt(2.0)
        figures = move_figures(t[inner], a_nav[inner], gyr[inner], move.closure, move.p_nav[-1], shaken)
        return Ended(move.p_nav[-1], move.closure, figures, self.gap_variance())

    def attitudes_since(self, t: float) -> Array:
        """Attitudes (n, 4) of the samples from `t` s on."""
        rows = self._table()
        wxyz: Array = rows[rows[:, 0] >= t, 7:11]
        return wxyz

    def gap_variance(self) -> float:
        """Variance in m2 that gaps add to each axis of the displacement, if the move ends now.

        An error dv of the velocity that arises at any instant of a move of duration T leaves, once the velocity left
        over is taken out linearly, a displacement of variance (dv T)^2 / 12. Between neighbours that differ by da
        acceleration may lie anywhere, da / sqrt(12); in a gap too long to be bridged it is as large as in all the move.
        """
        if not self._gaps:
            return 0.0
        duration_s = self._t - self._t_stop
        power = self._power / max(duration_s, 1e-3)
        dv2 = sum(length**2 * (change**2 / 12.0 + power * unseen) for length, change, unseen in self._gaps)
        return dv2 * duration_s**2 / 12.0

    def figures(self, drift: float) -> MoveFigures:
        """The figures of the move under way, if it ends now with a closure of `drift` m/s2 times its duration."""
        duration_s = self._t - self._t_stop
        distance = float(np.sqrt((self.p_nav**2).sum()))
        return MoveFigures(duration_s, drift * duration_s, self._turning, self._power, distance)


def turned_by(wxyz: Array, other: Array) -> Array:
    """2 sin(half the angle) between attitudes (..., 4) and another (4,): a vector that is fixed in the sensor changes
    by so much of its length."""
    cosine = (wxyz * other).sum(axis=-1)
    turned: Array = 2.0 * np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    return turned
