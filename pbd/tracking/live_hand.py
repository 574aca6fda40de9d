"""The hand from its first rest on: each sample moves it on, each stop puts it right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pbd.data import Keyframe, Stop
from pbd.pose import Array, Pose, quat_canonical, quat_rotate
from pbd.tracking.live_attitude import LiveAttitude
from pbd.tracking.live_doubt import MISTURN_CLIPPED, MISTURN_DEVICE, Doubt, Leftover, Usual
from pbd.tracking.live_events import LiveEvent, StopBegan, StopEnded
from pbd.tracking.live_move import LiveMove
from pbd.tracking.live_samples import Sample
from pbd.tracking.live_stops import Run, StopDetector
from pbd.tracking.rest import REST_S, Rest
from pbd.tracking.stops import BOUNCE_M, BOUNCE_S, COAST_S
from pbd.tracking.uncertainty import ACC_LEVEL, ACC_LEVEL_WEIGHT, GYRO_WALK, MoveFigures, move_covariance

TILT_SIGMA, HEADING_SIGMA = np.radians(0.5), np.radians(0.6)
"""rad, of online VQF (of offline VQF: uncertainty.py)."""

CLOSING = 0.01
"""m/s2: the velocity left over at a move's end by its duration, before the first stops tell; 0.06 degrees of tilt."""


class LiveHand:
    """Where the hand is, and where it stopped.

    Attributes:
        rest: gravity, and what the thresholds are taken from.
        wxyz_nav_sensor: (4,) at the latest sample.
        flaws: what was wrong with the data since the last stop, a line each.
    """

    def __init__(self, samples: Sequence[Sample], interval: float, rest: Rest, has_gyro: bool) -> None:
        """Begin with the samples of the first rest."""
        self.rest = rest
        self.flaws: list[str] = []
        self._has_gyro, self._has_mag = has_gyro, any(sample.mag is not None for sample in samples)
        self._rate_hz = 1.0 / interval
        self._gravity = np.array((0.0, 0.0, rest.gravity))
        self._attitude = LiveAttitude(samples, interval, rest, has_gyro)
        self._detector = StopDetector(self._rate_hz, rest, has_gyro)
        self._move = LiveMove(interval, rest.gravity, has_gyro)
        self._left: list[tuple[Stop, Keyframe]] = []
        self._p_stop, self._cov_stop = np.zeros(3), np.zeros((3, 3))
        self._level_squares, self._level_seen = ACC_LEVEL_WEIGHT * ACC_LEVEL**2, ACC_LEVEL_WEIGHT
        self._doubt, self._closing = Doubt(), Usual(CLOSING)
        self._t_first, self._t = samples[0].t, samples[-1].t

        wxyz = self._attitude.wxyz_at_rest
        a_nav = quat_rotate(wxyz, [sample.acc for sample in samples]) - self._gravity
        self._run = self._detector.begin(samples, a_nav)
        for k, sample in enumerate(samples):
            self._move.add(sample, wxyz[k], a_nav[k], self._run.mean_nav)
        self._wxyz_sum = _sum_of_rotations(wxyz)
        self._move.stand()
        self._move.settle()
        self._began = (self._run, self._p_stop, self._cov_stop)
        self.wxyz_nav_sensor: Array = wxyz[-1]

    def advance(self, sample: Sample) -> list[LiveEvent]:
        """Take the next sample; return what it completes."""
        wxyz = self._attitude.update(sample)
        a_nav = quat_rotate(wxyz, sample.acc) - self._gravity
        self._t, self.wxyz_nav_sensor = sample.t, wxyz
        self._move.add(sample, wxyz, a_nav, self._run.mean_nav)
        detector = self._detector
        detector.push(sample, a_nav)
        events: list[LiveEvent] = []
        if detector.still:
            self._wxyz_sum = _sum_of_rotations((self._wxyz_sum, wxyz))
            self._move.stand()
            if self._run.age_s >= COAST_S:
                self._move.settle()
        elif detector.left(sample.t):
            events.append(self._leave())
        candidate = detector.candidate
        if candidate is not None and detector.confirmed:
            if detector.only_jolted:
                self._run = detector.begin_stop(candidate)
                self._move.stand()
            elif detector.stop is None:
                left = self._leftover(candidate)
                plausible = self._doubt.finds_plausible(left, detector.tolerance)
                if plausible:
                    self._doubt.learn(left)
                # A device's own attitude goes on turning after the hand has stopped.
                if plausible or candidate.age_s >= (REST_S if self._has_gyro else COAST_S):
                    events.append(self._arrive(candidate))
        return events

    def bridge(self, before: Sample | None, samples: Sequence[Sample], wrong: str) -> None:
        """Note what is wrong with the data, and the gap between `before` and the last of `samples`."""
        if wrong:
            self.flaws.append(wrong)
        if before is not None and len(samples) > 1:
            length_s = samples[-1].t - before.t
            self._move.add_gap(length_s, samples[-1].acc - before.acc, samples[0].unseen)

    def stands_since(self, t: float) -> bool:
        """Whether the hand stands still, and has done so since `t` s."""
        return self._detector.still and self._run.start_t <= t

    def here(self) -> StopBegan:
        """Where the hand stands, as an event."""
        flaws, self.flaws = tuple(self.flaws), []
        return StopBegan(len(self._left), self._run.start_t, self._t, self._keyframe(), flaws)

    def learn(self, rest: Rest) -> None:
        """Take the thresholds from another rest, as this one turned out not to be quiet."""
        self.rest = rest
        self._detector.learn(rest)

    def _leftover(self, candidate: Run) -> Leftover:
        """What dead reckoning is left with at the latest sample, if the hand has stood still since the candidate."""
        move = self._move
        acceleration = _norm(candidate.latest_nav - self._run.mean_nav)
        misturn = MISTURN_CLIPPED * move.clipped if self._has_gyro else MISTURN_DEVICE
        duration_s = self._t - self._run.last_t
        return Leftover(duration_s, _norm(move.v_nav), acceleration, move.turned, move.turned_s, misturn)

    def _arrive(self, candidate: Run) -> StopBegan:
        """Integrate the move that led to the candidate, at which the hand stands."""
        if self._bounced(candidate):
            self._left.pop()
        else:
            self._began = (self._run, self._p_stop, self._cov_stop)
            self._move.begin_at(self._run)
        before, p_before, cov_before = self._began
        ended = self._move.end(before, candidate)
        # How large the accelerometer's errors are, as `accelerometer_level` says.
        norm = _norm(candidate.latest_sensor)
        self._level_squares += (norm - self.rest.gravity) ** 2
        self._level_seen += _norm(candidate.latest_sensor / norm - self.rest.up_sensor) ** 2
        if self._move.clipped:
            self.flaws.append("the gyro was at the end of its range; move slower, or set a larger range")
        self._closing.see(ended.figures.closure / ended.figures.duration)
        self._p_stop = p_before + ended.displacement
        self._cov_stop = cov_before + self._cov_added(ended.figures) + ended.gap_variance * np.eye(3)
        self._wxyz_sum = _sum_of_rotations(self._move.attitudes_since(candidate.start_t))
        self._run = self._detector.begin_stop(candidate)
        self._move.stand()
        return self.here()

    def _bounced(self, candidate: Run) -> bool:
        """Whether the last stop was but the beginning of this one: the sensor is put down, the hand slows down."""
        soon = candidate.start_t - self._run.last_t < BOUNCE_S
        return len(self._left) > 1 and soon and self._run.age_s < COAST_S and _norm(self._move.p_nav) < BOUNCE_M

    def _leave(self) -> StopEnded:
        self._left.append((self._stop(), self._keyframe()))
        self._detector.end_stop()
        return StopEnded(len(self._left) - 1, self._run.last_t, self._left[-1][1])

    @property
    def moving(self) -> bool:
        """Whether the hand moves, as far as is known at the latest sample."""
        return not self._detector.still

    @property
    def stops(self) -> tuple[Stop, ...]:
        """All stops; the last one is as long as it was so far, if the hand is still there."""
        here = () if self._detector.stop is None else (self._stop(),)
        return (*(stop for stop, _ in self._left), *here)

    @property
    def keyframes(self) -> tuple[Keyframe, ...]:
        """One keyframe a stop."""
        here = () if self._detector.stop is None else (self._keyframe(),)
        return (*(keyframe for _, keyframe in self._left), *here)

    @property
    def p_nav_sensor(self) -> Array:
        """(3,) m: that of the last stop, and from there by dead reckoning."""
        p: Array = self._p_stop + self._move.p_nav
        return p

    @property
    def v_nav_sensor(self) -> Array:
        """(3,) m/s, by dead reckoning since the last stop."""
        return self._move.v_nav

    @property
    def sigma_of_move(self) -> float:
        """One sigma in m that the move under way adds if it ends now, along the least sure axis; 0 in a stop."""
        return float(np.sqrt(self._cov_now()[1].max()))

    @property
    def sigma_now(self) -> float:
        """One sigma in m of the position if the hand stops now, from the origin on, along the least sure axis."""
        return float(np.sqrt(np.diagonal(sum(self._cov_now())).max()))

    def _cov_now(self) -> tuple[Array, Array]:
        if self._detector.still:
            return self._cov_stop, np.zeros((3, 3))
        # The closure is not known before the end.
        figures = self._move.figures(self._closing.value)
        return self._cov_stop, self._cov_added(figures) + self._move.gap_variance() * np.eye(3)

    def _cov_added(self, figures: MoveFigures) -> Array:
        level = float(np.sqrt(self._level_squares / self._level_seen))
        return move_covariance(figures, self.rest, self._rate_hz, level)

    def _stop(self) -> Stop:
        return Stop(self._run.start_row, self._run.last_row + 1, self._run.age_s)

    def _keyframe(self) -> Keyframe:
        heading = HEADING_SIGMA
        if not self._has_mag:
            heading = np.hypot(heading, GYRO_WALK * (self._run.start_t - self._t_first))
        cov = np.zeros((6, 6))
        cov[:3, :3] = self._cov_stop
        # At rest acceleration is zero: what is seen there may be gravity, by a tilt that is wrong.
        tilt = np.hypot(TILT_SIGMA, _norm(self._run.mean_nav) / self.rest.gravity)
        cov[3:, 3:] = np.diag([tilt**2, tilt**2, heading**2])
        return Keyframe(
            t=0.5 * (self._run.start_t + self._run.last_t),
            dwell_s=self._run.age_s,
            T_nav_sensor=Pose(self._p_stop, quat_canonical(self._wxyz_sum)),
            cov=cov,
        )


def _sum_of_rotations(wxyz: Sequence[Array] | Array) -> Array:
    """Sum of quaternions near one another (n, 4) -> (4,), one after the other; its direction is their mean."""
    total = np.array(wxyz[0])
    for q in wxyz[1:]:
        total = total + (q if (q * total).sum() >= 0.0 else -q)
    return total


def _norm(vector: Array) -> float:
    return float(np.sqrt((vector**2).sum()))
