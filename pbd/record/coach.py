"""What the person is told while the hand moves: the live tracker's findings in words."""

from __future__ import annotations

import numpy as np

from pbd.errors import PbdError
from pbd.pose import Array
from pbd.record.told import Say
from pbd.sensors.decoding import Sample
from pbd.tracking.live import LiveTracker, RestFound, StopBegan
from pbd.tracking.live_events import DataFlaw, LiveEvent

TRACKED_HZ = 250.0
"""The tracker is fed no faster than this: means over blocks lose nothing that it could use."""


class Coach:
    """Feeds the live tracker and collects what is worth a line."""

    def __init__(self, tolerance_m: float) -> None:
        self.tracker = LiveTracker()
        self.stops = 0
        self._tolerance_m = tolerance_m
        self._block: list[tuple[float, Sample]] = []
        self._said: list[Say] = []
        self._warned_after = -1
        self._failed = ""
        self._t = -1.0

    def feed(self, t: float, sample: Sample) -> None:
        """Take the next sample, at t s."""
        interval, self._t = t - self._t, t
        self._block.append((t, sample))
        if t + interval - self._block[0][0] < 1.0 / TRACKED_HZ:
            return
        block, self._block = self._block, []

        def mean(name: str) -> Array | None:
            values = [value for _, each in block if (value := getattr(each, name)) is not None]
            return np.mean(values, axis=0) if values else None

        at, acc = float(np.mean([at for at, _ in block])), mean("acc")
        assert acc is not None
        try:
            events = self.tracker.feed(at, acc, mean("gyr"), mean("mag"), mean("rpy"))
        except PbdError as error:  # recording goes on; what can't be tracked now may be mended later
            if error.message != self._failed:
                self.say(t, error.message)
            self._failed = error.message
            return
        for event in events:
            self._tell(event)
        sigma = self.tracker.sigma_of_move
        if self.tracker.moving and sigma > self._tolerance_m and self._warned_after != self.stops:
            self._warned_after = self.stops
            self.say(t, f"pause now: {100.0 * sigma:.0f} cm", bell=True)

    def say(self, t: float, text: str, bell: bool = False) -> None:
        """Add a line."""
        self._said.append(Say(t, text, bell))

    def said(self) -> tuple[Say, ...]:
        """Return what is new; it is told once."""
        said, self._said = tuple(self._said), []
        return said

    def _tell(self, event: LiveEvent) -> None:
        if isinstance(event, RestFound):
            self.say(event.t, "the rest at the start is found: you may move", bell=True)
        elif isinstance(event, StopBegan):
            self.stops = event.index + 1
            if event.index:
                x, y, z = 100.0 * event.keyframe.T_nav_sensor.p
                sigma = 100.0 * float(np.sqrt(np.diagonal(event.keyframe.cov)[:3].max()))
                text = f"stop {event.index} at ({x:.1f}, {y:.1f}, {z:.1f}) cm, sigma {sigma:.1f} cm: you may move on"
                self.say(event.announced_t, text, bell=True)
        elif isinstance(event, DataFlaw):
            self.say(event.t, event.message)
