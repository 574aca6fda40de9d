"""The hand from its first rest on: where it stops, and when that is believed."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pbd.data import Keyframe, Stop
from pbd.pose import Array, Pose, quat_canonical, quat_from_matrix, quat_multiply, quat_rotate, skew
from pbd.tracking.knots import STOP_KNOT_S
from pbd.tracking.noise import Noise
from pbd.tracking.online_filter import UP, OnlineFilter
from pbd.tracking.online_samples import Sample, Strapdown
from pbd.tracking.preintegration import POS, ROT
from pbd.tracking.rest import Rest
from pbd.tracking.smoother import SLOW
from pbd.tracking.zero_velocity import MERGE_S, WINDOW_S, energies, quiet_limits, speed_by_energies

CONFIRM_S, DOUBTED_S = 0.2, 1.0
"""s: a hand is taken to stand still once it has done so for this long; where that is in doubt, for the second."""

GATE = 14.2
"""Squared sigmas of a velocity that are more than chance: as seldom as three of one axis (chi-square, 3 degrees)."""

BOUNCE_S, BOUNCE_GAP_S, BOUNCE_M = 0.6, 0.3, 0.02
"""A stop shorter than this, this soon before the next and this near is a sensor put down that bounced."""


@dataclass(frozen=True, eq=False)
class RestFound:
    """By `t` s the sensor has rested for a second: tracking begins, at the origin of nav."""

    t: float
    rest: Rest


@dataclass(frozen=True, eq=False)
class StopBegan:
    """The hand has stood still since `t` s: the hand may move on.

    Attributes:
        index: of the stop, from 0.
        t: s, when the stop began.
        announced_t: s, when that was known: the time of the sample that brought this event.
        keyframe: where the hand stands; its time, dwell and pose are those so far.
        flaws: what was wrong with the data since the stop before, a line each.
    """

    index: int
    t: float
    announced_t: float
    keyframe: Keyframe
    flaws: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class StopEnded:
    """The hand left its stop at `t` s, and the keyframe is final."""

    index: int
    t: float
    keyframe: Keyframe


@dataclass(frozen=True, eq=False)
class DataFlaw:
    """Something is wrong with the data at `t` s (that of the last good sample): one line for a person."""

    t: float
    message: str


LiveEvent = RestFound | StopBegan | StopEnded | DataFlaw


@dataclass(frozen=True, eq=False)
class _Standing:
    """A stop so far: its first and latest sample, and the filter as it was there."""

    first: Sample
    last: Sample
    filter: OnlineFilter

    @property
    def stop(self) -> Stop:
        return Stop(self.first.row, self.last.row + 1, self.last.t - self.first.t)

    @property
    def keyframe(self) -> Keyframe:
        at, P = self.filter, self.filter.P
        order = np.r_[POS, ROT]
        return Keyframe(
            t=0.5 * (self.first.t + self.last.t),
            dwell_s=self.last.t - self.first.t,
            T_nav_sensor=Pose(at.p, quat_canonical(at.wxyz_nav_sensor)),
            cov=P[np.ix_(order, order)],
        )


@dataclass(frozen=True, eq=False)
class _Trial:
    """The hand may stand still since a sample, or, swaying, since an instant (s); and whether that is in doubt."""

    first: Sample
    since: float
    doubted: bool


class LiveHand:
    """Where the hand is, and where it stopped.

    Attributes:
        rest: what the thresholds are taken from.
        flaws: what was wrong with the data since the last stop, a line each.
    """

    def __init__(self, samples: Sequence[Sample], interval: float, rest: Rest, noise: Noise, has_gyro: bool) -> None:
        """Begin with the samples of the first rest."""
        self.flaws: list[str] = []
        self._device = not has_gyro
        bias = rest.gyro_bias if has_gyro else np.zeros(3)
        self._strapdown = Strapdown(samples[0], interval, noise, bias, self._device)
        self._n = max(2, round(WINDOW_S / interval))
        self._window: deque[tuple[Sample, Array, Array]] = deque(maxlen=self._n)
        self._left: list[_Standing] = []
        self._field: list[Array] = []
        self._angles = [np.zeros(3)]
        self._trial: _Trial | None = None
        self._ahead: OnlineFilter | None = None
        self._t_knot = self._t_compass = samples[0].t
        self.learn(rest, noise)
        E = np.eye(3) if self._device else self._level(samples, rest)
        self._filter = OnlineFilter(noise, rest, E, self._strapdown.wxyz)
        self._stop: _Standing | None = _Standing(samples[0], samples[0], self._filter.fork())
        self._still, self._t_shaken = True, samples[0].t
        for sample in samples[1:]:
            self.advance(sample)

    def learn(self, rest: Rest, noise: Noise) -> None:
        """Take thresholds and noise from a rest."""
        self.rest, self._noise, self._limits = rest, noise, quiet_limits(rest)
        if not self._device:
            self._strapdown.noise = noise

    def _level(self, samples: Sequence[Sample], rest: Rest) -> Array:
        """Nav in the sensor's axes (3, 3), by gravity, and by the compass or one of the sensor's own axes."""
        up, fields = rest.up_sensor, [sample.mag for sample in samples if sample.mag is not None]
        self._strength = self._dip = 0.0
        if fields:
            field = np.mean(fields, axis=0)
            self._strength = float(np.sqrt(field @ field))
            self._dip = float(np.arcsin(np.clip(field @ up / self._strength, -1.0, 1.0)))
            ahead = skew(field) @ up  # east
        else:
            axis = np.eye(3)[0 if abs(up[0]) < np.cos(np.radians(30.0)) else 1]
            ahead = axis - (axis @ up) * up
        ahead = ahead / np.sqrt(ahead @ ahead)
        return np.stack((ahead, skew(up) @ ahead, up))

    def advance(self, sample: Sample) -> list[LiveEvent]:
        """Take the next sample; return what it completes."""
        strapdown = self._strapdown
        strapdown.push(sample)
        seen = (sample.acc, np.zeros(3)) if self._device else (strapdown.u, strapdown.rate)
        self._window.append((sample, *seen))
        if sample.mag is not None and self._strength:
            self._field.append(quat_rotate(strapdown.wxyz, sample.mag))
        if strapdown.count < strapdown.block:
            return []
        quiet = self._look()
        still_acc = np.mean([each.acc for each, _, _ in self._window], axis=0) if quiet else None
        self._t_shaken = self._t_shaken if quiet else sample.t
        leg = strapdown.leg(still_acc, self._filter.E[2] * self._filter.gravity)
        self._angles.append(self._angles[-1] + leg.angle)
        for each in self._hypotheses():
            each.propagate(leg)
        if sample.t - self._t_compass >= STOP_KNOT_S:
            self._point(sample)
        if self._stop is not None:
            return self._standing(self._stop, sample, quiet)
        return self._moving(sample, quiet)

    def _hypotheses(self) -> list[OnlineFilter]:
        return [self._filter] if self._ahead is None else [self._filter, self._ahead]

    def _look(self) -> bool:
        """Whether the last window is quiet; and how fast a hand may be that stands so still."""
        u, rate = np.array([u for _, u, _ in self._window]), np.array([rate for _, _, rate in self._window])
        shake, turn = energies(u, rate, len(u))
        self._sigma = float(speed_by_energies(shake, turn, self.rest, self._noise)[0])
        return bool(shake[0] < self._limits[0] and turn[0] < self._limits[1]) and len(u) == self._n

    def _point(self, sample: Sample) -> None:
        """Hold the heading against the compass, or the attitude against the device's own."""
        lasted, self._t_compass = sample.t - self._t_compass, sample.t
        if self._device:
            rate = self._strapdown.rate
            sigma = np.hypot(self._noise.device_turn, self._noise.device_lag * np.sqrt(rate @ rate))
            for each in self._hypotheses():
                each.level(float(sigma))
        if not self._field:
            return
        field, self._field = np.mean(self._field, axis=0), []
        for each in self._hypotheses():
            h = each.E @ field
            level = max(float(np.hypot(h[0], h[1])), 1e-12)
            east = float(np.arctan2(h[0], h[1]))
            stronger, steeper = np.sqrt(h @ h) / self._strength - 1.0, np.arctan2(h[2], level) - self._dip
            off = (stronger**2 + steeper**2 + (np.cos(self._dip) * east) ** 2) / self._noise.field**2
            turned = -skew(h)  # d h / d theta
            by_turn = (h[1] * turned[0] - h[0] * turned[1]) / level**2
            each.point_north(east, by_turn, self._noise.compass**2 / lasted * (1.0 + off) ** 2)

    def _knot(self, at: OnlineFilter, t: float, same: bool) -> None:
        """The hand stands still; and, in the same stop, as it stood at the knot before."""
        if same:
            angle = np.array(self._angles) - self._angles[0]
            sway = angle - np.linspace(0.0, 1.0, len(angle))[:, None] * angle[-1]
            at.stay(float(np.hypot(self._noise.still_turn, 2.0 * np.abs(sway).max())))
        at.stand(self._sigma)
        if not self._left:
            at.begin_here()
        at.keep()
        self._t_knot, self._angles = t, [np.zeros(3)]

    def _standing(self, stop: _Standing, sample: Sample, quiet: bool) -> list[LiveEvent]:
        """Go on in a stop, or find that it is over.

        A hand that sets out slowly is seen late, so each knot is taken for good only at the next one.
        """
        ahead = self._ahead or self._filter
        off, speed = ahead.doubt_of_rest(self._sigma)
        self._still = quiet and not (off > GATE and speed > max(SLOW, 3.0 * self._sigma))
        if self._still:
            if sample.t - self._t_knot >= STOP_KNOT_S - 1e-6:
                self._filter, self._ahead = ahead, ahead.fork()
                self._knot(self._ahead, sample.t, same=True)
                stop = replace(stop, filter=self._ahead.fork())
            self._stop = replace(stop, last=sample)
            self._strapdown.clipped = False
        elif sample.t - stop.last.t > MERGE_S + WINDOW_S:
            self._left.append(stop)
            self._stop = self._ahead = None
            return [StopEnded(len(self._left) - 1, stop.last.t, stop.keyframe)]
        return []

    def _moving(self, sample: Sample, quiet: bool) -> list[LiveEvent]:
        """Look for a stop: try how the hand would go on if this were one."""
        trial, last, first = self._trial, self._left[-1].last, self._window[0][0]
        quiet = quiet and first.t > last.t and not any(each.unseen for each, _, _ in self._window)
        off, speed = (0.0, 0.0) if self._ahead is None else self._ahead.doubt_of_rest(self._sigma)
        if not quiet:
            self._trial = self._ahead = None
            return []
        fast = off > GATE and speed > max(SLOW, 3.0 * self._sigma)
        if trial is None or fast or (off > GATE and (trial.doubted or sample.t - trial.since < DOUBTED_S)):
            self._ahead = self._filter.fork()
            off, speed = self._ahead.doubt_of_rest(self._sigma)
            slow = trial is not None and not fast and not trial.doubted
            trial = _Trial(first, trial.since if trial and slow else sample.t, off > GATE)
            if trial.doubted:
                self._ahead.widen(sample.t - last.t, speed)
            self._knot(self._ahead, sample.t, same=False)
        self._trial = trial
        lasts = DOUBTED_S if trial.doubted and not self._knocked(trial.first) else CONFIRM_S
        if sample.t - trial.first.t >= lasts - 1e-6:
            return [self._arrive(trial, sample)]
        if sample.t - self._t_knot >= STOP_KNOT_S - 1e-6:
            self._knot(self._ahead, sample.t, same=True)
        return []

    def _arrive(self, trial: _Trial, sample: Sample) -> StopBegan:
        """The trial was right."""
        assert self._ahead is not None
        self._filter, self._trial, self._still = self._ahead, None, True
        self._ahead = self._filter.fork()
        self._knot(self._ahead, sample.t, same=True)
        before = self._left[-1]
        first, moved = trial.first, self._ahead.p - before.filter.p
        knocked = self._knocked(first)
        bounced = len(self._left) > 1 and before.stop.dwell_s < BOUNCE_S and first.t - before.last.t < BOUNCE_GAP_S
        if (knocked or bounced) and np.sqrt(moved @ moved) < BOUNCE_M:
            before = self._left.pop()
            first = before.first if knocked else first
        if self._strapdown.clipped:
            self.flaws.append("the gyro was at the end of its range; move slower, or set a larger range")
            self._strapdown.clipped = False
        self._stop = _Standing(first, sample, self._ahead.fork())
        return self.here(sample.t)

    def _knocked(self, first: Sample) -> bool:
        """Whether a stop that begins with a sample is the last one after a jolt."""
        last_t = self._left[-1].last.t
        return first.t - last_t < MERGE_S and self._t_shaken > last_t

    def here(self, t: float) -> StopBegan:
        """The stop under way, as an event at `t` s."""
        assert self._stop is not None
        flaws, self.flaws = tuple(self.flaws), []
        return StopBegan(len(self._left), self._stop.first.t, t, self._stop.keyframe, flaws)

    def stands_since(self, t: float) -> bool:
        """Whether the hand stands still, and has done so since `t` s."""
        return self._stop is not None and self._still and self._stop.first.t <= t

    @property
    def moving(self) -> bool:
        """Whether the hand moves, as far as is known."""
        return not self._still

    @property
    def _all(self) -> list[_Standing]:
        return self._left if self._stop is None else [*self._left, self._stop]

    @property
    def stops(self) -> tuple[Stop, ...]:
        """All stops; the last one is as long as it was so far, if the hand is still there."""
        return tuple(each.stop for each in self._all)

    @property
    def keyframes(self) -> tuple[Keyframe, ...]:
        """One keyframe a stop."""
        return tuple(each.keyframe for each in self._all)

    @property
    def wxyz_nav_sensor(self) -> Array:
        """(4,) at the latest sample."""
        return quat_canonical(quat_multiply(quat_from_matrix(self._filter.E), self._strapdown.wxyz))

    @property
    def p_nav_sensor(self) -> Array:
        """(3,) m: that of the stop, or from there by dead reckoning."""
        if self._stop is not None and self._still:
            return self._stop.filter.p
        at, strapdown, T = self._filter, self._strapdown, self._strapdown.T
        p: Array = at.p + T * at.v + at.E @ strapdown.dP - 0.5 * at.gravity * T**2 * UP
        return p

    @property
    def v_nav_sensor(self) -> Array:
        """(3,) m/s, by dead reckoning; zero in a stop."""
        if self._still:
            return np.zeros(3)
        at, strapdown = self._filter, self._strapdown
        v: Array = at.v + at.E @ strapdown.dU - at.gravity * strapdown.T * UP
        return v

    @property
    def sigma_now(self) -> float:
        """One sigma in m of the position if the hand stops now, from the origin on, along the least sure axis."""
        return self._sigmas()[0]

    @property
    def sigma_of_move(self) -> float:
        """One sigma in m that the move under way adds if it ends now, along the least sure axis; 0 in a stop."""
        return 0.0 if self._still else self._sigmas()[1]

    def _sigmas(self) -> tuple[float, float]:
        here, way = self._filter.if_it_stopped(self._noise.still_speed)
        return float(np.sqrt(max(np.diagonal(here).max(), 0.0))), float(np.sqrt(max(np.diagonal(way).max(), 0.0)))
