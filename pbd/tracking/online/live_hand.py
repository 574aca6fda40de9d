"""Track the live hand from its first rest on: where it stops, and when a stop is announced."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pbd.pose import Array, quat_from_matrix, quat_to_matrix
from pbd.tracking.estimate import BOUNCE_M, BOUNCE_RAD, BOUNCE_S, is_where_it_was
from pbd.tracking.first_rest import REST_S, STILL_ACC, Rest
from pbd.tracking.moving_windows import PASSES, rows_of_mean
from pbd.tracking.noise import Noise
from pbd.tracking.online.events import DataFlaw, LiveEvent, StopBegan, StopEnded
from pbd.tracking.online.filter import ErrorStateFilter
from pbd.tracking.online.live_stops import CONFIRM_DOUBTED_S, CONFIRM_NO_GYRO_S, CONFIRM_S, LiveStop, StopTrial
from pbd.tracking.online.sample_repair import RepairedSample
from pbd.tracking.online.strapdown import Strapdown
from pbd.tracking.online.sway import deviation_from_line, sway_of
from pbd.tracking.smoother.doubtful_stops import SLOW_SPEED
from pbd.tracking.smoother.knots import STOP_KNOT_S
from pbd.tracking.smoother.preintegration import BLOCK_S, GYR_BIAS, LAG, integral_of_means
from pbd.tracking.zero_velocity import ENERGY_WINDOW_S, SHORTEST_MOVE_S, QuietWindows, energies, zero_velocity_sigma

VELOCITY_GATE = 14.2
"""The 99.7 % quantile of a velocity's squared Mahalanobis distance (chi-square, 3 degrees of freedom; mean 3)."""


class LiveHand:
    """The hand's present state and its stops.

    Attributes:
        rest: the rest that sets the thresholds.
        still: whether the hand seems to stand still.
        set_out: whether the hand certainly moved in what seemed a stop.
    """

    def __init__(
        self, samples: Sequence[RepairedSample], interval: float, rest: Rest, noise: Noise, has_gyro: bool
    ) -> None:
        """Begin with the samples of the first rest."""
        self._no_gyro = not has_gyro
        bias = rest.gyro_bias if has_gyro else np.zeros(3)
        self._strapdown = Strapdown(samples[0], interval, noise, bias, self._no_gyro)
        self._interval, self._n = interval, max(2, round(ENERGY_WINDOW_S / interval))
        self._beside = PASSES * (rows_of_mean(1.0 / interval) - 1) // 2  # rows beside a window, for the moving means
        # The means of slow motion need a window on each side of one.
        self._window: deque[tuple[RepairedSample, Array, Array]] = deque(maxlen=3 * self._n)
        self._past_stops: list[LiveStop] = []
        self._attitudes: deque[Array] = deque(maxlen=self._n)  # gyro frame <- sensor
        self._shaking: Array = np.zeros(3)
        self._angles = [(samples[0].t, np.zeros(3))]  # of the present stop's last second
        t, gyr = np.array([sample.t for sample in samples]), np.array([sample.gyr for sample in samples])
        self._sway = sway_of(t, integral_of_means(t, gyr))
        self._trial: StopTrial | None = None
        self._trial_filter: ErrorStateFilter | None = None
        self._without_last: ErrorStateFilter | None = None  # as if the last stop were none; None if it is certainly one
        self._turned = 0.0  # rad, since the device's own attitude was last used
        self._peak = 0.0  # m/s2, largest acceleration of a block since the hand stood still
        self._t_knot, self._t_compass = samples[0].t, samples[0].t
        fields = [sample.mag for sample in samples if sample.mag is not None]
        self._field: list[Array] | None = [] if fields else None
        north = np.mean(fields, axis=0) if fields else None
        self._filter = ErrorStateFilter(noise, rest, self._strapdown.C, north, self._no_gyro)
        self.use_rest(rest, noise)
        self._stop: LiveStop | None = LiveStop(samples[0], samples[0], *self._filter.pose())
        self.still, self._settled = True, True
        self.set_out = False
        for sample in samples[1:]:
            self.advance(sample)

    def use_rest(self, rest: Rest, noise: Noise) -> None:
        """Take thresholds and noise from this rest."""
        self.rest, self._noise = rest, noise
        self._quiet = QuietWindows(rest, round(2 * self._n / self._strapdown.block))
        if not self._no_gyro:
            self._strapdown.noise = noise
        for each in self._filters():
            each.use_noise(noise)

    def advance(self, sample: RepairedSample) -> list[LiveEvent]:
        """Take the next sample; return the events that it completes."""
        strapdown = self._strapdown
        strapdown.push(sample)
        seen = (sample.acc, np.zeros(3)) if self._no_gyro else (strapdown.u, strapdown.rate)
        self._window.append((sample, *seen))
        self._attitudes.append(strapdown.C)
        if sample.mag is not None and self._field is not None:
            self._field.append(strapdown.C @ sample.mag)
        if strapdown.count < strapdown.block:
            return []
        quiet = self._measure_stillness()
        up = self._filter.E[2] * self._filter.gravity
        leg = strapdown.leg(up, quiet)
        self._peak = max(self._peak, float(np.linalg.norm(leg.dU / leg.T - up)))
        self._angles.append((sample.t, self._angles[-1][1] + leg.angle))
        self._turned += float(np.linalg.norm(leg.angle))
        for each in self._filters():
            each.propagate(leg)
        events = (
            self._look_for_stop(sample, quiet) if self._stop is None else self._continue_stop(self._stop, sample, quiet)
        )
        # No update at a sample with a knot: that sample takes longest to compute already.
        if sample.t - self._t_compass >= STOP_KNOT_S and self._t_knot < sample.t:
            self._update_between_knots(sample)
        return events

    def _measure_stillness(self) -> bool:
        """Whether the last window is quiet. Also sets sigma and tremor of a zero-velocity update."""
        force, rate = (np.array(seen) for seen in zip(*((u, rate) for _, u, rate in self._window), strict=True))
        rate = rate - self._filter.x[GYR_BIAS]  # it drifts while the gyro warms up
        energy = energies(force, rate, min(self._n, len(force))).latest(self._beside)
        self._sigma = float(zero_velocity_sigma(energy, self._interval, self._noise))
        if not self._no_gyro:
            # The tremor's velocity is the residual of a straight line through the velocity in the window.
            t = np.array([sample.t for sample, _, _ in self._window])[-self._n :]
            self._shaking = deviation_from_line(t, integral_of_means(t, force[-self._n :]))
        return self._quiet.take(energy) and len(force) >= self._n + 2 * self._beside

    def _filters(self) -> list[ErrorStateFilter]:
        """The filter, and those under other hypotheses."""
        return [each for each in (self._filter, self._trial_filter, self._without_last) if each is not None]

    def _update_between_knots(self, sample: RepairedSample) -> None:
        """Update the heading by the compass, or the attitude by the device's own; bound the position in a long move."""
        for each in self._filters():
            if sample.t - self._t_knot > 0.5 * self._noise.stride_time:
                each.update_reach(sample.t - self._t_compass)
            if self._no_gyro:
                each.update_device_attitude(self._turned)
            if self._field:
                each.update_compass(np.mean(self._field, axis=0), sample.t - self._t_compass)
        self._turned = 0.0
        self._t_compass, self._field = sample.t, None if self._field is None else []

    def _add_knot(self, kalman: ErrorStateFilter, t: float, same: bool, robust: bool = True) -> None:
        """Add a knot of zero velocity; `same`: it is in the last knot's stop, so nothing moved since then."""
        if self._no_gyro:  # undoing the lag makes noise of what one sample is off
            kalman.C = quat_to_matrix(quat_from_matrix(np.mean(self._attitudes, axis=0)))
        if same:
            at, angle = (np.array(values) for values in zip(*self._angles, strict=True))
            seen = sway_of(at, angle)
            self._sway = seen if t - at[0] > REST_S - 1e-6 else max(self._sway, seen)  # a short stop hides slow sway
            kalman.update_no_motion(float(np.hypot(self._noise.still_turn, self._sway * np.sqrt(t - self._t_knot))))
        kalman.update_zero_velocity(self._sigma, self._shaking, robust=robust)
        if not self._past_stops:
            kalman.set_origin()
        kalman.clone_pose()
        self._t_knot = t
        self._angles = [each for each in self._angles if same and t - each[0] < REST_S] or self._angles[-1:]

    def _knot_is_due(self, sample: RepairedSample) -> bool:
        return sample.t - self._t_knot >= STOP_KNOT_S - 1e-6

    def _is_moving(self, kalman: ErrorStateFilter) -> tuple[float, bool]:
        """Squared Mahalanobis distance of the velocity from zero; whether the hand certainly moves."""
        off, speed = kalman.velocity_test(self._sigma, self._shaking)
        return off, off > VELOCITY_GATE and speed > SLOW_SPEED

    def _continue_stop(self, stop: LiveStop, sample: RepairedSample, quiet: bool) -> list[LiveEvent]:
        """Continue a stop, or find that it is over.

        A slow start is seen late, so each knot becomes final only at the next one. A hand that arrives slowly seems to
        stand still too early, so its second knot replaces the first. The attitude after a gap may show that it moved.
        """
        if sample.unseen:
            return []
        ahead = self._filter if self._trial_filter is None else self._trial_filter
        off, fast = self._is_moving(ahead)
        gap = sample.t - stop.last.t > ENERGY_WINDOW_S
        turned = gap and float(np.linalg.norm(sample.acc - stop.last.acc)) > STILL_ACC
        self.still, self.set_out = quiet and not (fast or turned), self.set_out or fast
        if sample.t - stop.first.t > CONFIRM_DOUBTED_S:
            self._without_last = None
        if self.still:
            self._peak = 0.0
            if self._knot_is_due(sample):
                if self._settled:
                    self._filter = ahead
                ahead = self._trial_filter = self._filter.fork()
                self._add_knot(ahead, sample.t, same=self._settled)
                self._settled, stop = True, LiveStop(stop.first, sample, *ahead.pose())
            self._stop = replace(stop, last=sample)
            if self._settled and off < 3.0 and sample.t > self._t_knot:
                self._filter, self._trial_filter = ahead, None
            self._strapdown.clipped = ""
        elif sample.t - stop.last.t > SHORTEST_MOVE_S + ENERGY_WINDOW_S:
            self._past_stops.append(stop)
            self._filter = self._filter if self._settled else ahead
            self._stop = self._trial_filter = None
            return [StopEnded(len(self._past_stops) - 1, stop.last.t, stop.keyframe)]
        return []

    def _look_for_stop(self, sample: RepairedSample, quiet: bool) -> list[LiveEvent]:
        """Test for a stop: run a copy of the filter under the hypothesis that the hand stands still."""
        trial = self._trial
        if (
            not quiet
            or (first := self._window[-self._n - self._beside][0]).t <= self._past_stops[-1].last.t
            or any(self._window[-i - 1][0].unseen for i in range(self._n + 2 * self._beside))
        ):
            self._trial = self._trial_filter = None
            return []
        off = 0.0 if self._trial_filter is None else self._is_moving(self._trial_filter)[0]
        if trial is None or off > VELOCITY_GATE:
            trial, off = self._begin_trial(first, sample.t), 0.0
        self._trial = trial = replace(trial, worst=max(trial.worst, off))
        if sample.t - trial.first.t >= trial.confirm_s - 1e-6:
            return self._begin_stop(trial, sample)
        if self._trial_filter is not None and self._knot_is_due(sample):
            self._add_knot(self._trial_filter, sample.t, same=True)
        return []

    def _begin_trial(self, first: RepairedSample, t: float) -> StopTrial:
        """Test whether the velocity at `t` s is zero: if not, after a jolt; else without the last stop.

        The hand may have turned back slowly in what seemed the last stop. Of two that exclude each other, the longer
        is the stop.
        """
        last = self._past_stops[-1]
        since, test = t - last.last.t, (self._sigma, self._shaking, VELOCITY_GATE)
        kalman, off, speed = self._filter.fork_at_stop(*test)
        doubted = off > VELOCITY_GATE
        # A jolt is short, and its peak acceleration would reach the hand's speed within one window.
        soon = since < SHORTEST_MOVE_S + 2.0 * ENERGY_WINDOW_S and speed < ENERGY_WINDOW_S * self._peak
        confirm_s, jolted, replaces_last = CONFIRM_S, doubted and soon, False
        if doubted and not soon and self._without_last is not None:
            without, off, _ = self._without_last.fork_at_stop(*test)
            if replaces_last := off <= VELOCITY_GATE:
                kalman, doubted, confirm_s = without, False, last.duration_s
        if doubted:
            kalman.add_knock_or_wrong_turn(since, speed)
            if not jolted:
                confirm_s = CONFIRM_NO_GYRO_S if self._no_gyro else CONFIRM_DOUBTED_S
        self._trial_filter = kalman
        self._add_knot(kalman, t, same=jolted, robust=False)
        return StopTrial(first, confirm_s, doubted, jolted, replaces_last)

    def _begin_stop(self, trial: StopTrial, sample: RepairedSample) -> list[LiveEvent]:
        """Accept the hypothesis: a stop."""
        if trial.replaces_last and self._without_last is not None:
            self._past_stops.pop()
            self._filter, self._without_last = self._without_last, None
        without_this = self._filter.fork()
        self._trial, self.still, self._settled = None, True, trial.doubted or trial.worst < 3.0
        if self._settled and self._trial_filter is not None:
            self._filter = self._trial_filter
        self._trial_filter = self._filter.fork()
        self._add_knot(self._trial_filter, sample.t, same=self._settled)
        before, first = self._past_stops[-1], trial.first
        pose, cov = self._trial_filter.pose()
        moved, turned = before.pose.distance(pose)
        # As `_join_stops` does; but how long the hand will stand here is not known yet.
        short_gap = (gap := first.t - before.last.t) < BOUNCE_S
        # Both ends of a knock are seen up to a block too far away from it.
        knocked = gap < BOUNCE_S + 2.0 * BLOCK_S and is_where_it_was(moved, turned)
        bounced = short_gap and before.duration_s < BOUNCE_S
        continues = (trial.jolted or knocked or bounced) and moved < BOUNCE_M and turned < BOUNCE_RAD
        if continues:
            self._past_stops.pop()
            first = first if bounced else before.first
        else:
            self._without_last = without_this
        flaw = ""
        if clipped := self._strapdown.clipped:
            flaw = f"the {clipped} was at the end of its range; move slower, or set a larger range"
            self._strapdown.clipped = ""
        elif trial.doubted and not (trial.jolted or self._no_gyro):
            flaw = (
                f"no motion fits the data from {before.last.t:.1f} to {trial.first.t:.1f} s: samples are lost or wrong "
                "there, and stops may be missing; record again"
            )
        self._stop = LiveStop(first, sample, pose, cov)
        if self._no_gyro:  # at a stop the attitude does not jump
            self._strapdown.lag += (lag := float(self._trial_filter.x[LAG][0]))
            for each in self._filters():
                each.remove_lag(lag)
        return [*([DataFlaw(before.last.t, flaw)] if flaw else []), self.current_stop(sample.t, continues)]

    def current_stop(self, t: float, continues: bool = False) -> StopBegan:
        """The present stop, as an event at `t` s."""
        stop = self.stops[-1]
        return StopBegan(len(self.stops) - 1, stop.first.t, t, stop.keyframe, continues)

    @property
    def stops(self) -> tuple[LiveStop, ...]:
        """All stops; the last one as it is so far, if the hand is still there."""
        return (*self._past_stops, *(() if self._stop is None else (self._stop,)))

    def latest(self) -> tuple[Array, Array, Array]:
        """wxyz_nav_sensor (4,), p_nav_sensor (3,) m and v_nav_sensor (3,) m/s at the latest sample."""
        wxyz, p, v = self._filter.predict(self._strapdown)
        return (wxyz, self._stop.pose.p, np.zeros(3)) if self._stop is not None and self.still else (wxyz, p, v)

    def sigmas(self) -> tuple[float, float]:
        """One sigma, m, of the position if the hand stops now; and the part that the present move adds, 0 in a stop."""
        position, shift = self._filter.sigma_if_stopped(self._noise.still_speed)
        return position, 0.0 if self.still else shift
