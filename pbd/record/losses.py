"""How many samples never came: from the device's own times of those that did, or from when they arrived."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence

import numpy as np

from pbd.pose import Array
from pbd.timestamps import straighten

SPAN, EVERY = 200, 25
"""The interval is that of so many samples, and looked at again so often."""

LOST_SHARE = 0.6
"""What comes later than expected by more than this share of an interval lacks a sample before it."""

WITH_LOSS = 1.6
"""A step of so many usual ones has a loss in it; one of 3 ms beside others of 2 ms, on a clock of whole ones, has not.
(Above 500 Hz such a clock can't tell.)"""

FORGOTTEN = 0.2
"""Of a sample's lateness, with the next one: a clock that counts whole milliseconds is late and early by turns."""


FIRST_S = 2.0
"""Backup so much has arrived the interval is not known well enough to tell what is late from what is lost."""

LOOK_S, SHARE = 1.0, 0.02
"""Arrivals are counted anew after so long, and in no more than this share of the time."""


class Losses:
    """Takes times as they come; `lost` is the count so far."""

    def __init__(self) -> None:
        self.lost = 0
        self._last: float | None = None
        self._steps: deque[float] = deque(maxlen=SPAN)
        self._unjudged: list[float] = []
        self._interval, self._until_looked = 0.0, EVERY
        self._late = 0.0

    def take(self, t: float) -> None:
        """Take the next sample's time, s."""
        if self._last is not None:
            self._steps.append(t - self._last)
            self._unjudged.append(t - self._last)
            self._until_looked -= 1
        self._last = t
        if self._interval > 0.0 or self._until_looked <= 0:
            self.judge()

    def judge(self) -> None:
        """Count what is missing up to the last sample; at first that waits for a few of them."""
        if self._interval == 0.0 or self._until_looked <= 0:
            self._interval, self._until_looked = _interval(self._steps), EVERY
        if self._interval > 0.0:
            for step in self._unjudged:
                self._late = (1.0 - FORGOTTEN) * self._late + step / self._interval - 1.0
                if abs(self._late) > LOST_SHARE:  # early: what was taken for lost was a wrong time
                    missing = round(self._late) or (1 if self._late > 0.0 else -1)
                    missing = max(missing, -self.lost)
                    self.lost += missing
                    self._late -= missing
        self._unjudged.clear()


class LateLosses:
    """Counts from arrivals as `straighten` does at the end, so that what is shown on the way is what will be told.

    Attributes:
        lost: the count at the latest look.
        times: (n,) s, the samples' times by it.
    """

    def __init__(self) -> None:
        self.lost = 0
        self.times: Array = np.zeros(0)
        self._next = 0.0

    def look(self, arrivals: Sequence[float]) -> None:
        """Count anew, if it is time: the longer a count takes, the rarer they are."""
        begun = time.monotonic()
        if begun >= self._next and arrivals and arrivals[-1] - arrivals[0] >= FIRST_S:
            self.judge(arrivals)
            ended = time.monotonic()
            self._next = ended + max(LOOK_S, (ended - begun) / SHARE)

    def judge(self, arrivals: Sequence[float]) -> None:
        """Count anew."""
        self.times, self.lost = straighten(np.array(arrivals))


def _interval(steps: deque[float]) -> float:
    """Mean of the steps without a loss in them, s; 0 where there is none."""
    forward = np.array([step for step in steps if step > 0.0])
    return float(forward[forward < WITH_LOSS * np.median(forward)].mean()) if len(forward) else 0.0
