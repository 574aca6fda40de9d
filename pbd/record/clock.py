"""When samples were taken: by the device's own clock where it has one, else by their arrival.

The first sample says which. A device's time is believed where it goes on as it did. One that leaps is put off until the
next sample: a device that began anew goes on from there, a broken digit (there are protocols without a checksum) stands
alone and is left out.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from pbd.sensors.decoding import Sample
from pbd.timestamps import Stamper

USUAL_S, USUAL_STEPS = 0.1, 3.0
"""A step of so many usual ones is believed; so long a one until it is known what is usual."""

FEW = 9
"""So many steps tell what is usual."""

SHORTEST = 0.25
"""A step of a smaller share of the usual one is none."""

AGREES_S, AGREES = 0.02, 0.1
"""A longer step is believed where it took as long on the host, give or take this and this share of it."""

GAP_S = 10.0
"""A leap onwards by less, from which the clock goes on, is a gap; by more, or backwards, a clock that was set anew."""


@dataclass(frozen=True)
class _Reading:
    sample: Sample
    t_device: float
    arrival: float


class Clock:
    """Takes samples as they come and tells their times, s since the first.

    `usual_s` is the device's interval, if it is known already.

    Attributes:
        stamper: what arrival times alone tell.
        doubted: how many samples were left out because of their time.
    """

    def __init__(self, usual_s: float = 0.0) -> None:
        self.stamper = Stamper()
        self.doubted = 0
        self._zero = 0.0
        self._last: _Reading | None = None
        self._before: _Reading | None = None
        self._doubt: _Reading | None = None
        self._usual = usual_s
        self._steps: deque[float] = deque(maxlen=FEW)
        self._latest: float | None = None

    @property
    def is_device(self) -> bool:
        """Whether the device has one."""
        return self._last is not None

    def take(self, sample: Sample, arrival: float) -> list[tuple[float, Sample]]:
        """Take the next sample, which arrived at `arrival` s on the host's clock; return those that have a time now."""
        if self.stamper.arrivals or (sample.t_device is None and not self.is_device):
            return [(self.stamper.stamp(arrival), sample)]
        if sample.t_device is None:  # its part with the time was lost
            self.doubted += 1
            return []
        self._learn(sample.t_device)
        now, last, doubt = _Reading(sample, sample.t_device, arrival), self._last, self._doubt
        if last is None:
            self._zero = now.t_device
            return [self._accept(now)]
        if self._follows(last, now):
            self.doubted += doubt is not None
            return [self._accept(now)]
        if now.t_device < last.t_device and self._before is not None and self._follows(self._before, now):
            self.doubted += 1  # it was the last one that was wrong; what lies before it now has no place
            return []
        if doubt is None or not self._follows(doubt, now):
            self.doubted += doubt is not None
            self._doubt = now
            return []
        if not 0.0 < doubt.t_device - last.t_device < GAP_S:
            elapsed = max(doubt.arrival - last.arrival, self._usual)
            self._zero += doubt.t_device - last.t_device - elapsed
        return [self._accept(doubt), self._accept(now)]

    def _learn(self, t_device: float) -> None:
        """The usual step is the median of a few, whatever is made of each."""
        if self._latest is not None and t_device > self._latest:
            self._steps.append(t_device - self._latest)
            if len(self._steps) == FEW:
                self._usual = sorted(self._steps)[FEW // 2]
        self._latest = t_device

    def _follows(self, earlier: _Reading, now: _Reading) -> bool:
        step = now.t_device - earlier.t_device
        if step <= SHORTEST * self._usual:
            return False
        usual = USUAL_STEPS * self._usual if self._usual else USUAL_S
        elapsed = now.arrival - earlier.arrival
        return step <= usual or abs(step - elapsed) < AGREES_S + AGREES * elapsed

    def _accept(self, now: _Reading) -> tuple[float, Sample]:
        self._before, self._last, self._doubt = self._last, now, None
        return now.t_device - self._zero, now.sample
