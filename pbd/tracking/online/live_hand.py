"""The live hand from its first rest on: where it stops, and when a stop is announced."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pbd.data import Keyframe, Stop
from pbd.pose import Array, Pose
from pbd.tracking.estimate import BOUNCE_M, BOUNCE_S
from pbd.tracking.first_rest import STILL_ACC, Rest, restlessness
from pbd.tracking.noise import OUTLIER_SIGMAS, Noise
from pbd.tracking.online.events import LiveEvent, StopBegan, StopEnded
from pbd.tracking.online.filter import OnlineFilter
from pbd.tracking.online.samples import Sample
from pbd.tracking.online.strapdown import Strapdown
from pbd.tracking.smoother.doubtful_stops import SLOW_SPEED
from pbd.tracking.smoother.knots import STOP_KNOT_S
from pbd.tracking.smoother.preintegration import integral_of_means
from pbd.tracking.zero_velocity import ENERGY_WINDOW_S, SHORTEST_MOVE_S, energies, quiet_limits, speed_by_energies

CONFIRM_S, CONFIRM_DOUBTED_S, CONFIRM_DEVICE_S = 0.2, 2.0, 0.6
"""s at rest before a stop is announced: a clear one; a doubtful one, longer than half of the slowest move of a hand; a
doubtful one by a device's own attitude."""

VELOCITY_GATE, VELOCITY_MEAN = 14.2, 3.0
"""Squared Mahalanobis distance of a velocity from zero (chi-square with 3 degrees of freedom): its 99.7 % quantile, and
its mean."""


@dataclass(frozen=True, eq=False)
class Standing:
    """A stop so far: its first and latest sample, and the pose at its last knot with its covariance (6, 6)."""

    first: Sample
    last: Sample
    pose: Pose
    cov: Array

    @property
    def stop(self) -> Stop:
        """In rows."""
        return Stop(self.first.row, self.last.row + 1, self.last.t - self.first.t)

    @property
    def keyframe(self) -> Keyframe:
        """In nav."""
        return Keyframe(0.5 * (self.first.t + self.last.t), self.last.t - self.first.t, self.pose, self.cov)


@dataclass(frozen=True, eq=False)
class Trial:
    """A stop on trial: since a sample; whether it is doubted; whether it continues the last stop after a jolt; the
    largest squared Mahalanobis distance of its velocity from zero."""

    first: Sample
    doubted: bool
    knocked: bool
    worst: float = 0.0


class LiveHand:
    """Where the hand is, and where it stopped.

    Attributes:
        rest: the rest that sets the thresholds.
        flaws: what was wrong with the data since the last stop, a line each.
        still: whether the hand seems to stand still.
        restless: the energy of the last window, relative to a hand at rest.
    """

    def __init__(self, samples: Sequence[Sample], interval: float, rest: Rest, noise: Noise, has_gyro: bool) -> None:
        """Begin with the samples of the first rest."""
        self.flaws: list[str] = []
        self._device = not has_gyro
        bias = rest.gyro_bias if has_gyro else np.zeros(3)
        self._strapdown = Strapdown(samples[0], interval, noise, bias, self._device)
        self._n = max(2, round(ENERGY_WINDOW_S / interval))
        self._window: deque[tuple[Sample, Array, Array]] = deque(maxlen=self._n)
        self._past_stops: list[Standing] = []
        self._shaking: Array = np.zeros(3)
        self._angles = [np.zeros(3)]
        self._trial: Trial | None = None
        self._trial_filter: OnlineFilter | None = None
        self._t_knot, self._t_compass, self._acc_knot = samples[0].t, samples[0].t, samples[0].acc
        self.learn(rest, noise)
        fields = [sample.mag for sample in samples if sample.mag is not None]
        self._field: list[Array] | None = [] if fields else None
        north = np.mean(fields, axis=0) if fields else None
        self._filter = OnlineFilter(noise, rest, self._strapdown.C, north, self._device)
        self._stop: Standing | None = Standing(samples[0], samples[0], *self._filter.pose())
        self.still, self._settled = True, True
        for sample in samples[1:]:
            self.advance(sample)

    def learn(self, rest: Rest, noise: Noise) -> None:
        """Take thresholds and noise from a rest."""
        self.rest, self._noise, self._limits = rest, noise, quiet_limits(rest)
        if not self._device:
            self._strapdown.noise = noise

    def advance(self, sample: Sample) -> list[LiveEvent]:
        """Take the next sample; return what it completes."""
        strapdown = self._strapdown
        strapdown.push(sample)
        seen = (sample.acc, np.zeros(3)) if self._device else (strapdown.u, strapdown.rate)
        self._window.append((sample, *seen))
        if sample.mag is not None and self._field is not None:
            self._field.append(strapdown.C @ sample.mag)
        if strapdown.count < strapdown.block:
            return []
        quiet = self._measure_stillness()
        leg = strapdown.leg(self._filter.E[2] * self._filter.gravity)
        self._angles.append(self._angles[-1] + leg.angle)
        for each in self._known():
            each.propagate(leg)
        events = (
            self._look_for_stop(sample, quiet) if self._stop is None else self._continue_stop(self._stop, sample, quiet)
        )
        # Not at a knot: that is enough work for one sample.
        if sample.t - self._t_compass >= STOP_KNOT_S and self._t_knot < sample.t:
            self._update_heading(sample)
        return events

    def _measure_stillness(self) -> bool:
        """Whether the last window is quiet. Also sets what a zero-velocity update needs."""
        force, rate = (np.array(seen) for seen in zip(*((u, rate) for _, u, rate in self._window), strict=True))
        (shake,), (turn,) = energies(force, rate, len(force))
        self.restless = float(restlessness(shake, turn))
        self._sigma = float(speed_by_energies(shake, turn, self.rest, self._noise))
        if not self._device:
            # Shaking moves the hand nowhere: its velocity is what a constant acceleration leaves over in the window.
            t = np.array([sample.t for sample, _, _ in self._window])
            self._shaking = off_line(t - t[-1], integral_of_means(t, force))
        return bool(shake < self._limits[0] and turn < self._limits[1]) and len(force) == self._n

    def _known(self) -> list[OnlineFilter]:
        """Both filters."""
        return [self._filter] if self._trial_filter is None else [self._filter, self._trial_filter]

    def _update_heading(self, sample: Sample) -> None:
        """Hold the heading against the compass, or the attitude against the device's own."""
        for each in self._known():
            if self._device:
                each.update_device_attitude(self._strapdown.rate)
            if self._field:
                each.update_compass(np.mean(self._field, axis=0), sample.t - self._t_compass)
        self._t_compass, self._field = sample.t, None if self._field is None else []

    def _add_knot(self, at: OnlineFilter, t: float, same: bool, robust: bool = True) -> None:
        """The hand stands still; and, in the same stop, as it stood at the knot before."""
        if same:
            angle = np.array(self._angles) - self._angles[0]
            sway = angle - np.linspace(0.0, 1.0, len(angle))[:, None] * angle[-1]
            at.update_no_motion(float(np.hypot(self._noise.still_turn, 2.0 * np.abs(sway).max())))
        at.update_zero_velocity(self._sigma, self._shaking, robust)
        if not self._past_stops:
            at.set_origin()
        at.clone_pose()
        self._t_knot, self._angles, self._acc_knot = t, [np.zeros(3)], self._window[-1][0].acc

    def _knot_is_due(self, sample: Sample) -> bool:
        return sample.t - self._t_knot >= STOP_KNOT_S - 1e-6

    def _is_moving(self, at: OnlineFilter) -> tuple[float, bool]:
        """Squared Mahalanobis distance of the velocity from zero; whether the hand moves for certain."""
        off, speed = at.velocity_test(self._sigma, self._shaking)
        return off, off > VELOCITY_GATE and speed > max(SLOW_SPEED, OUTLIER_SIGMAS * self._sigma)

    def _continue_stop(self, stop: Standing, sample: Sample, quiet: bool) -> list[LiveEvent]:
        """Go on in a stop, or find that it is over.

        A slow start is seen late, so each knot becomes final only at the next one. A hand that
        arrives slowly seems to stand too soon, so its second knot replaces the first.
        """
        ahead = self._filter if self._trial_filter is None else self._trial_filter
        off, fast = self._is_moving(ahead)
        if self._device:  # its attitude goes on turning after the hand has stopped
            fast = float(np.square(sample.acc - self._acc_knot).sum()) > STILL_ACC**2
        self.still = quiet and not fast
        if self.still:
            if self._knot_is_due(sample):
                if self._settled:
                    self._filter = ahead
                ahead = self._trial_filter = self._filter.fork()
                self._add_knot(ahead, sample.t, same=self._settled)
                self._settled, stop = True, Standing(stop.first, sample, *ahead.pose())
            self._stop = replace(stop, last=sample)
            if self._settled and off < VELOCITY_MEAN and sample.t > self._t_knot:
                self._filter, self._trial_filter = ahead, None
            self._strapdown.clipped = False
        elif sample.t - stop.last.t > SHORTEST_MOVE_S + ENERGY_WINDOW_S:
            self._past_stops.append(stop)
            self._filter = self._filter if self._settled else ahead
            self._stop = self._trial_filter = None
            return [StopEnded(len(self._past_stops) - 1, stop.last.t, stop.keyframe)]
        return []

    def _look_for_stop(self, sample: Sample, quiet: bool) -> list[LiveEvent]:
        """Look for a stop: run a copy of the filter as if this were one."""
        trial, last, first = self._trial, self._past_stops[-1].last, self._window[0][0]
        if not quiet or first.t <= last.t or any(each.unseen for each, _, _ in self._window):
            self._trial = self._trial_filter = None
            return []
        # A device's own attitude goes on turning after the hand has stopped.
        off, fast = (0.0, False) if self._trial_filter is None or self._device else self._is_moving(self._trial_filter)
        if trial is None or fast or off > VELOCITY_GATE:
            self._trial_filter = self._filter.fork()
            off, speed = self._trial_filter.velocity_test(self._sigma, self._shaking)
            # Quiet but for a jolt since the last stop?
            soon = sample.t - last.t < SHORTEST_MOVE_S + 2.0 * ENERGY_WINDOW_S
            knocked = off > VELOCITY_GATE and soon
            trial = Trial(first, off > VELOCITY_GATE, knocked)
            if trial.doubted:
                self._trial_filter.add_velocity_error(sample.t - last.t, speed)
            self._add_knot(self._trial_filter, sample.t, same=knocked, robust=False)
            off = 0.0
        self._trial = trial = replace(trial, worst=max(trial.worst, off))
        lasts = (
            CONFIRM_S if trial.knocked or not trial.doubted else CONFIRM_DEVICE_S if self._device else CONFIRM_DOUBTED_S
        )
        if sample.t - trial.first.t >= lasts - 1e-6:
            return [self._begin_stop(trial, sample)]
        if self._trial_filter is not None and self._knot_is_due(sample):
            self._add_knot(self._trial_filter, sample.t, same=True)
        return []

    def _begin_stop(self, trial: Trial, sample: Sample) -> StopBegan:
        """Accept the trial as a stop."""
        self._trial, self.still, self._settled = None, True, trial.doubted or trial.worst < VELOCITY_MEAN
        if self._settled and self._trial_filter is not None:
            self._filter = self._trial_filter
        self._trial_filter = self._filter.fork()
        self._add_knot(self._trial_filter, sample.t, same=self._settled)
        before = self._past_stops[-1]
        first, moved = trial.first, self._trial_filter.p - before.pose.p
        bounced = len(self._past_stops) > 1 and first.t - before.last.t < BOUNCE_S
        if (trial.knocked or bounced) and np.sqrt(moved @ moved) < BOUNCE_M:
            before = self._past_stops.pop()
            first = before.first if trial.knocked else first
        if self._strapdown.clipped:
            self.flaws.append("the gyro was at the end of its range; move slower, or set a larger range")
            self._strapdown.clipped = False
        self._stop = Standing(first, sample, *self._trial_filter.pose())
        return self.here(sample.t)

    def here(self, t: float) -> StopBegan:
        """The stop under way, as an event at `t` s."""
        stop, flaws, self.flaws = self.standing[-1], tuple(self.flaws), []
        return StopBegan(len(self.standing) - 1, stop.first.t, t, stop.keyframe, flaws)

    @property
    def standing(self) -> tuple[Standing, ...]:
        """All stops; the last one as long as it was so far, if the hand is still there."""
        return (*self._past_stops, *(() if self._stop is None else (self._stop,)))

    def now(self) -> tuple[Array, Array, Array]:
        """wxyz_nav_sensor (4,), p_nav_sensor (3,) m and v_nav_sensor (3,) m/s at the latest sample."""
        wxyz, p, v = self._filter.predict(self._strapdown)
        return (wxyz, self._stop.pose.p, np.zeros(3)) if self._stop is not None and self.still else (wxyz, p, v)

    def sigmas(self) -> tuple[float, float]:
        """One sigma in m of the position if the hand stops now; and what the move under way adds, 0 in a stop."""
        here, way = self._filter.sigma_if_stopped(self._noise.still_speed)
        return here, 0.0 if self.still else way


def off_line(s: Array, values: Array) -> Array:
    """By how much the last of values (n, 3) is off the straight line through all of them; there s (n,) is 0."""
    about = s - s.mean()
    mean = values.mean(axis=0)
    slope = about @ values / max(float(about @ about), np.finfo(float).tiny)
    off: Array = values[-1] - mean - about[-1] * slope
    return off
