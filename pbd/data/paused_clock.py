"""A clock that stops in pauses, as phyphox' experiment time does, and the time that has really passed."""

from dataclasses import dataclass
from math import inf

import numpy as np

from pbd.pose import Array


@dataclass(frozen=True)
class ClockEvent:
    """A start (or, if not `started`, a pause) of phyphox' measurement: experiment time, s, and the phone's clock, s."""

    started: bool
    t: float
    system: float


class PausedClock:
    """The starts and pauses so far. They convert experiment time, which stops in pauses, to elapsed time."""

    def __init__(self) -> None:
        self.known: tuple[ClockEvent, ...] = ()
        self._begun: float | None = None

    def take(self, events: tuple[ClockEvent, ...]) -> bool:
        """Take the latest list; return whether the measurement was cleared since, so that experiment time restarted."""
        before, self.known = self.known, events
        if self._begun is None and events:
            self._begun = events[0].system
        return bool(before) and events[:1] != before[:1]

    @property
    def paused_at(self) -> float:
        """Experiment time of the present pause, s; infinite while it measures."""
        return self.known[-1].t if self.known and not self.known[-1].started else inf

    def to_elapsed(self, t: Array) -> Array:
        """Convert experiment time (n,) s to s since the first start, with pauses counted."""
        starts = [each for each in self.known if each.started]
        if not starts or self._begun is None:
            return t
        paused = np.array([each.system - self._begun - each.t for each in starts])
        return t + paused[np.maximum(np.searchsorted([each.t for each in starts], t) - 1, 0)]  # type: ignore[no-any-return]
