"""Messages to the person while the hand moves: the live tracker's findings in words."""

from collections import deque

import numpy as np

from pbd.calibration.sensor_changed import disagreements
from pbd.data import Keyframe, SensorErrors
from pbd.data.tracking import UNSURE_SIGMA_M
from pbd.errors import PbdError
from pbd.pose import Array
from pbd.record.session_types import Message
from pbd.sensors.decoding import Sample
from pbd.tracking.estimate import has_grip, is_where_it_was
from pbd.tracking.online.tracker import LiveEvent, LiveTracker, RestFound, StopBegan, StopEnded
from pbd.tracking.repair.gyro_consistency import UPSIDE_DOWN_COS


class Feedback:
    """Feeds the live tracker and collects messages for the person."""

    def __init__(self, tolerance_m: float, errors: SensorErrors | None = None, sensor: str = "") -> None:
        self.tracker = LiveTracker(sensor, errors)
        self._announced = 0
        self._left: StopEnded | None = None
        self._moves: dict[int, tuple[float, float, bool]] = {}  # began, ended, led back to where it began
        self._grips: list[float] = []
        self._tolerance_m = tolerance_m
        self._errors = errors
        self._field: deque[tuple[float, Array]] = deque()  # magnetometer readings of the last second
        self._block: list[tuple[float, Sample]] = []
        self._said: list[Message] = []
        self._reminded = False
        self._warned = False  # that the present move needs a pause
        self._last_error = ""
        self._t = -1.0

    @property
    def stops(self) -> int:
        """Number of stops so far. A stop that a grip interrupts, as two taps do, counts once, as in `pbd.track`."""
        moves = self._moves.values()
        return self._announced - sum(back and has_grip(left, arrived, self._grips) for left, arrived, back in moves)

    def mark_grip(self, t: float) -> None:
        """Note that the grip changed at t s."""
        self._grips.append(t)

    def feed(self, t: float, sample: Sample) -> None:
        """Take the next sample, at t s. Faster ones than 250 Hz are averaged to it, without loss for the tracker."""
        interval, self._t = t - self._t, t
        self._block.append((t, sample))
        if t + 1.5 * interval - self._block[0][0] < 1.0 / 250.0:  # the nearest number of samples
            return
        block, self._block = self._block, []

        def mean(name: str) -> Array | None:
            values = [value for _, each in block if (value := getattr(each, name)) is not None]
            return np.mean(values, axis=0) if values else None

        at, acc = float(np.mean([at for at, _ in block])), mean("acc")
        assert acc is not None
        mag = mean("mag")
        if mag is not None and self._errors is not None:  # kept to compare the first rest with the calibration
            self._field.append((at, mag if self._errors.mag is None else self._errors.mag.correct(mag)))
            while self._field[0][0] < at - 1.0:
                self._field.popleft()
        try:
            events = self.tracker.feed(at, acc, mean("gyr"), mag, mean("rpy"))
        except PbdError as error:  # recording goes on: the data may be repaired later
            if error.message != self._last_error:
                self.say(t, error.message)
            self._last_error = error.message
            return
        for event in events:
            self._report(event)
        if self.tracker.waiting and not self._reminded and t >= 1.5:  # one second of rest is enough
            self._reminded = True
            self.say(t, self.tracker.waiting, bell=True)
        sigma = self.tracker.sigma_of_move
        if self.tracker.moving and sigma > self._tolerance_m and not self._warned:
            self._warned = True
            self.say(t, f"pause now: {in_cm(sigma)}", bell=True)

    def say(self, t: float, text: str, bell: bool = False) -> None:
        """Add a message."""
        self._said.append(Message(t, text, bell))

    def take_messages(self) -> tuple[Message, ...]:
        """Return the messages since the last call."""
        messages, self._said = tuple(self._said), []
        return messages

    def _report(self, event: LiveEvent) -> None:
        if isinstance(event, RestFound):
            self.say(event.t, "the rest at the start is found: you may move", bell=True)
            if event.rest.up_sensor[2] < UPSIDE_DOWN_COS:
                mounted = "if it is mounted like that, [dock] and [mount] must say so (docs/calibration.md)"
                self.say(event.t, f"the sensor lies upside down: turn it over; {mounted}")
            mag, rest = np.mean([mag for _, mag in self._field], axis=0) if self._field else None, event.rest
            for line in disagreements(self._errors, rest.gravity * rest.up_sensor, rest.gyro_bias, mag):
                self.say(event.t, line, bell=True)
            self._field.clear()
        elif isinstance(event, StopBegan):
            self._announced, self._warned = event.index + 1, False
            if self._left is not None and not event.continues:
                shift = self._left.keyframe.T_nav_sensor.distance(event.keyframe.T_nav_sensor)
                self._moves[event.index] = self._left.t, event.t, is_where_it_was(*shift)
            self._moves = {index: move for index, move in self._moves.items() if index <= event.index}
            if event.index:
                text = f"stop {event.index} at {describe_stop(event.keyframe)}"
                lost = position_sigma(event.keyframe) > UNSURE_SIGMA_M
                advice = "very uncertain: pause in long moves, or begin again" if lost else "you may move on"
                # The same stop, with a better position, rings no second bell.
                self.say(event.announced_t, text if event.continues else f"{text}: {advice}", bell=not event.continues)
        elif isinstance(event, StopEnded):
            self._left = event
        else:
            self.say(event.t, event.message)


def describe_stop(keyframe: Keyframe) -> str:
    """Write a stop's position in nav, and one sigma along its least certain axis, in cm."""
    return f"{position_text(keyframe.T_nav_sensor.p)}, sigma {100.0 * position_sigma(keyframe):.1f} cm"


def position_text(p_nav: Array) -> str:
    """Write a position, given in m, as (1.0, 0.0, -2.0) cm, without a minus before zero."""
    x, y, z = np.round(100.0 * p_nav, 1) + 0.0
    return f"({x:.1f}, {y:.1f}, {z:.1f}) cm"


def position_sigma(keyframe: Keyframe) -> float:
    """Return one sigma of a keyframe's position along its least certain axis, m."""
    return float(np.sqrt(np.diagonal(keyframe.cov)[:3].max()))


def in_cm(length: float) -> str:
    """Write a length, given in m, as 2 cm or 0.4 cm."""
    return f"{100.0 * length:.0f} cm" if length >= 0.01 else f"{100.0 * length:.1f} cm"
