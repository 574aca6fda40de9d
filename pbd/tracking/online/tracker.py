"""Track a hand one sample at a time: attitude, still or moving, stops and keyframes."""

from collections import deque
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from pbd.data import Keyframe, Recording, RecordingInfo, SensorErrors, Stop
from pbd.data.recording import resolution_of
from pbd.errors import PbdError, TrackingError, WrongTypeError
from pbd.frozen_arrays import numeric, readonly
from pbd.pose import Array
from pbd.tracking.first_rest import QUIET_ACC, QUIET_GYR, QUIET_RATIO, REST_S, STILL_ACC, Rest, find_rest
from pbd.tracking.noise import Noise, noise_of
from pbd.tracking.online.events import DataFlaw, LiveEvent, RestFound, StopBegan, StopEnded
from pbd.tracking.online.live_hand import LiveHand
from pbd.tracking.online.sample_repair import RepairedSample, SampleRepair
from pbd.tracking.repair.clock import SLOWEST_HZ
from pbd.tracking.smoother.attitude import NO_ORIENTATION
from pbd.tracking.zero_velocity import ENERGY_WINDOW_S

__all__ = ["DataFlaw", "LiveEvent", "LiveTracker", "RestFound", "StopBegan", "StopEnded"]


class LiveTracker:
    """Tracks a hand sample by sample, once the sensor has rested for a second.

    Feed it rows as they come. Results don't depend on how many rows a call gets. Only the filter's state, a second of
    rest and the list of stops are kept.

        tracker = LiveTracker()
        for t, acc, gyr in port:
            for event in tracker.feed(t, acc, gyr):
                if isinstance(event, StopBegan):
                    print(f"stop {event.index}: {event.keyframe.T_nav_sensor.p} m; you may move on")

    Look at `waiting` until it is "": it says what is missing. Readings in other units give no event, they show there.
    A tracker is for one thread.

    A stop is announced 0.2 s after it began if the velocity is then zero within its sigma, else after two seconds
    (0.6 s without a gyro). It ends once the hand has moved for 0.2 s. The same index may be announced again, and
    the newer keyframe replaces the earlier: it was the beginning of the same stop (the sensor bounced when put down, or
    was knocked), or no stop but a slow turn back, as the newer and longer one shows.

    Model and noise are those of `pbd.track`. Only `pbd.track` uses later stops, the quietest second of the whole
    recording, known places, and a foot's short pauses, which are too restless for a stop here. Only it corrects clipped
    axes, and finds the slow ends of moves. Here these ends may count as rest, and then a move of three seconds or more
    is off by tens of centimetres, several times its sigma. A large lag of the gyro is estimated once a stop shows it.
    """

    def __init__(self, sensor: str = "", errors: SensorErrors | None = None, *, straightened: bool = False) -> None:
        """Begin.

        Args:
            sensor: its name, as in `Recording.info`; it selects the error model.
            errors: a calibration's. They are corrected; the error model is what they leave.
            straightened: the times are arrival times that were straightened as they came. They are taken as they are.
        """
        self._sensor, self._errors = sensor, errors
        self._repair = SampleRepair(straightened=straightened)
        self._has_gyro: bool | None = None
        self._recent: deque[RepairedSample] = deque()
        self._t_next_look = -np.inf
        self._waiting = f"waiting for {REST_S:g} s of rest"
        self._hand: LiveHand | None = None
        self._steps = (np.inf, np.inf)  # as `steps_of` the samples seen so far
        self._still: tuple[Recording, Rest] | None = None  # the second that sets thresholds and noise

    def feed(
        self,
        t: ArrayLike,
        acc: ArrayLike,
        gyr: ArrayLike | None = None,
        mag: ArrayLike | None = None,
        device_rpy: ArrayLike | None = None,
    ) -> tuple[LiveEvent, ...]:
        """Take rows, and return the events that they complete.

        A row with a missing number, or whose time does not increase, is left out. Gaps of up to 50 ms are interpolated.
        A longer gap gives a `DataFlaw`, and the next keyframe's sigma is wider. Two seconds of such rows give one too.
        If the times jitter, as those of arrival do, a `DataFlaw` says so, and evenly spaced ones are used, as in
        `pbd.track`. A row that is late is then held back, half a second at most, until the next ones show whether
        another was lost before it.

        Args:
            t: s, of one row or (n,); any origin, increasing.
            acc: (3,) or (n, 3) m/s2, specific force.
            gyr: (3,) or (n, 3) rad/s, or None without a gyro. The first call decides whether there is one.
            mag: (3,) or (n, 3) uT, or None; NaN in rows without a reading.
            device_rpy: (3,) or (n, 3) rad, as in `Recording`; used if there is no gyro.

        Raises:
            TrackingError: there is neither a gyro nor the device's attitude.
            WrongTypeError: an argument is not numbers, or not three for each t.
        """
        times = np.atleast_1d(numeric("t", t))
        rows = [
            None if values is None and name != "acc" else _triples(name, values, len(times))
            for name, values in (("acc", acc), ("gyr", gyr), ("mag", mag), ("device_rpy", device_rpy))
        ]
        if self._has_gyro is None and len(times):
            if gyr is None and device_rpy is None:
                raise TrackingError(NO_ORIENTATION)
            self._has_gyro = gyr is not None
            if self._errors is not None and not self._has_gyro:  # zeros stand for the rates: no bias is in them
                self._errors = replace(self._errors, gyr=None)
        events: list[LiveEvent] = []
        for k, at in enumerate(times.tolist()):
            events += self._take(at, *(None if values is None else values[k] for values in rows))
        return tuple(events)

    def _take(
        self, t: float, acc: Array | None, gyr: Array | None, mag: Array | None, device_rpy: Array | None
    ) -> list[LiveEvent]:
        before = self._recent[-1] if self._recent else None
        turn = np.full(3, np.nan) if gyr is None else gyr
        samples, wrong = self._repair.take(t, acc, turn if self._has_gyro else None, mag, device_rpy)
        events: list[LiveEvent] = [DataFlaw(t if before is None else before.t, each) for each in wrong]
        for sample in (each.corrected(self._errors) for each in samples):
            if self._hand is not None:
                events += (news := self._hand.advance(sample))
                # A coarse sensor's readings may be equal at rest. Once the hand has set out, they show their step.
                if any(isinstance(event, StopEnded) for event in news) and self._learn_steps(self._recent):
                    assert self._still is not None
                    self._hand.use_rest(self._hand.rest, self._noise_of(*self._still))
            self._keep_last_second(sample)
            if sample.t >= self._t_next_look and self._recent[-1].t - self._recent[0].t >= REST_S:
                events += self._look_for_rest(list(self._recent))
        return events

    def _keep_last_second(self, sample: RepairedSample) -> None:
        """Keep the samples of the last second; after a gap, only those since."""
        recent = self._recent
        if recent and (sample.unseen or sample.t - recent[-1].t > 1.0 / SLOWEST_HZ):
            if self._hand is None:
                self._waiting = (
                    f"waiting for {REST_S:g} s of rest without a gap: {sample.t - recent[-1].t:.3g} s lie between two "
                    "samples; the time must be in seconds, or its unit given (--unit t=ms)"
                )
            recent.clear()
        recent.append(sample)
        while len(recent) > 2 and sample.t - recent[1].t >= REST_S:
            recent.popleft()

    def _look_for_rest(self, samples: list[RepairedSample]) -> list[LiveEvent]:
        """Start tracking at the first 1 s rest; later, take thresholds from a far quieter rest."""
        hand, t = self._hand, samples[-1].t
        self._t_next_look = t + (ENERGY_WINDOW_S if hand is None else REST_S)
        if hand is not None and (not hand.still or hand.stops[-1].first.t > samples[0].t):
            return []
        recording = self._recording_of(samples)
        try:
            rest = find_rest(recording, shortest_s=REST_S)
        except PbdError as error:
            self._waiting = _rest_advice(error)
            return []
        self._learn_steps(samples)
        still, noise = (recording, rest), self._noise_of(recording, rest)
        rest = replace(rest, start=samples[0].row, stop=samples[-1].row + 1)
        if hand is None:
            interval = float(np.median(np.diff(recording.t)))
            hand = LiveHand(samples, interval, rest, noise, bool(self._has_gyro))
            loud = rest.acc_var > QUIET_ACC**2 or rest.gyr_var > QUIET_GYR**2
            if len(hand.stops) > 1 or not hand.still or (hand.set_out and loud):
                self._waiting = f"hold still for {REST_S:g} s: the hand moves"
                return []
            self._repair.interval = interval
            self._hand, self._still = hand, still
            return [RestFound(t, rest), self._hand.current_stop(t)]
        if rest.restless < hand.rest.restless / QUIET_RATIO:
            self._still = still
            hand.use_rest(rest, noise)
        return []

    def _learn_steps(self, samples: Iterable[RepairedSample]) -> bool:
        """Take these samples' readings; return whether their steps are smaller than all before."""
        read, before = zip(*(each.readings for each in samples), strict=True), self._steps
        gyr, acc = (min(step, resolution_of(np.array(each))) for step, each in zip(before, read, strict=True))
        self._steps = gyr, acc
        return self._steps != before

    def _noise_of(self, recording: Recording, rest: Rest) -> Noise:
        return noise_of(recording, rest, self._errors, self._steps)

    def _recording_of(self, samples: list[RepairedSample]) -> Recording:
        return Recording(
            np.array([sample.t for sample in samples]),
            np.array([sample.acc for sample in samples]),
            np.array([sample.gyr for sample in samples]) if self._has_gyro else None,
            info=RecordingInfo(sensor=self._sensor),
        )

    @property
    def waiting(self) -> str:
        """What tracking still waits for, one line for a person; "" once it has begun."""
        return self._waiting if self._hand is None else ""

    @property
    def rest(self) -> Rest | None:
        """The rest that sets the thresholds: the first, or a later one that was far quieter."""
        return None if self._hand is None else self._hand.rest

    @property
    def moving(self) -> bool:
        """Whether the hand seems to move at the latest sample; False until tracking begins."""
        return self._hand is not None and not self._hand.still

    @property
    def stops(self) -> tuple[Stop, ...]:
        """The stops so far, in rows as fed; the last one grows while the hand is still there."""
        return () if self._hand is None else tuple(each.stop for each in self._hand.stops)

    @property
    def keyframes(self) -> tuple[Keyframe, ...]:
        """One keyframe a stop."""
        return () if self._hand is None else tuple(each.keyframe for each in self._hand.stops)

    @property
    def wxyz_nav_sensor(self) -> Array:
        """(4,) at the latest sample; until tracking begins, the identity."""
        return readonly((1.0, 0.0, 0.0, 0.0) if self._hand is None else self._hand.latest()[0])

    @property
    def p_nav_sensor(self) -> Array:
        """(3,) m at the latest sample: by dead reckoning since the last stop."""
        return readonly(np.zeros(3) if self._hand is None else self._hand.latest()[1])

    @property
    def v_nav_sensor(self) -> Array:
        """(3,) m/s at the latest sample, by dead reckoning; zero in a stop."""
        return readonly(np.zeros(3) if self._hand is None else self._hand.latest()[2])

    @property
    def sigma_now(self) -> float:
        """The position's sigma along its least certain axis, m, if the hand stopped now."""
        return 0.0 if self._hand is None else self._hand.sigmas()[0]

    @property
    def sigma_of_move(self) -> float:
        """The part of `sigma_now`, m, that the present move adds; it grows until the hand stops."""
        return 0.0 if self._hand is None else self._hand.sigmas()[1]


def _rest_advice(error: PbdError) -> str:
    """Why the last second was no rest, for the person who holds the sensor."""
    if error.fields.get("bound") == STILL_ACC:
        shakes, hold = error.fields["value"], f"hold still for {REST_S:g} s: the hand"
        if isinstance(shakes, float) and shakes > STILL_ACC:
            return f"{hold} shakes with {shakes:.2f} m/s2"
        turns = f"{hold} turns with {error.fields['turn']:.2f} rad/s"
        return f"{turns}; if it does not, end the recording, and give the gyro's unit: --unit gyr=..."
    if unit := error.fields.get("unit"):
        return f"the accelerometer's values are likely in {unit}: end the recording, and give --unit acc={unit}"
    return error.message


def _triples(name: str, values: ArrayLike | None, count: int) -> Array:
    try:
        return np.asarray(values, dtype=np.float64).reshape(count, 3)
    except (TypeError, ValueError):
        raise WrongTypeError(f"{name} must be three numbers for each t, got {values!r:.60}") from None
