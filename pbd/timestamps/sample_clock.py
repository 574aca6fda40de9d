"""Time stamps of samples and the count of lost ones, by the device's own clock or by arrival times on the host.

A device's time is accepted while its steps are regular. After a jump the next sample decides. If it continues from the
new time, the device restarted. If it does not, the jump was a corrupted digit (some protocols have no checksum), and
that sample is left out.

A sample without a device's time has its time of arrival, which `Stamper` corrects, and at the end `straighten`. A
packet that came twice has the time of the first, as in a recording a row that repeats another at the same time. The
times of a clock that is coarser than the sampling interval are corrected like those of samples that arrive in batches.
"""

import time
from array import array
from collections import deque
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from pbd.pose import Array
from pbd.timestamps.doubled_packets import came_twice
from pbd.timestamps.stamper import Stamper
from pbd.timestamps.straighten import LONGEST_BURST_S, LOST_SHARE, straighten

MAX_FIRST_STEP_S, MAX_TICK_S, MAX_USUAL_STEPS = 0.1, 1.0, 3.0
"""Largest accepted step of a device's time: in s, until its usual step is known; the same of a coarse clock, which may
count seconds; then as a multiple of the usual step."""

HOST_TOLERANCE_S, HOST_TOLERANCE_SHARE = 0.02, 0.1
"""A larger step is accepted if the host's clock agrees: within this time (s) plus this share of the step."""

USUAL_STEPS = 9
"""The usual step is the median of this number of latest steps."""

DOUBLED_EVERY_S, DOUBLED_SAMPLES = 0.25, 1000
"""Least time, s, between two looks whether packets come twice, and the number of latest samples that tell."""

COUNT_AFTER_S, COUNT_EVERY_S, COUNT_TIME_SHARE = 2.0, 1.0, 0.02
"""The live count of losses: when it is first made (s), its shortest period (s), and the largest share of the time that
counting may take."""

T = TypeVar("T")


class _Reading(NamedTuple, Generic[T]):
    sample: T
    t_device: float
    arrival: float


class SampleClock(Generic[T]):
    """Gives each sample its time, s since the first. The device's clock is used if the first sample has its time.

    Attributes:
        times: times of the samples so far, s: the device's times, or the arrival times on the host.
        doubted: number of samples that were left out because of their time, or, by the latest `count_lost`, came twice.
        lost: number of samples that never arrived, by the latest `count_lost`.
        straightened: (n,) s, the times as straightened by the latest count; None with a device's fine clock.
    """

    def __init__(self, usual_s: float = 0.0) -> None:
        """Start; `usual_s` is the device's interval if it is known, else 0."""
        self.times = array("d")
        self.doubted = self.lost = 0
        self.straightened: Array | None = None
        self._stamper: Stamper[list[T]] | None = None
        self._repeats: list[bool] = []  # whether each sample without a device's time repeats the one before
        self._came_twice, self._next_look = False, 0.0
        self._latest_group: list[T] = []  # the latest sample of the stamper, and those that repeat it
        self._group_t: float | None = None  # its time, s, if it is known
        self._first: float | None = None  # time of the stamper that is 0, s
        self._coarse_from = 0.0  # s, when a device's clock was first found to be coarse
        self._zero, self._usual = 0.0, usual_s
        self._last: _Reading[T] | None = None
        self._before: _Reading[T] | None = None
        self._doubt: _Reading[T] | None = None
        self._steps: deque[float] = deque(maxlen=USUAL_STEPS)
        self._latest: float | None = None
        self._next_count = 0.0

    @property
    def is_device(self) -> bool:
        """Whether the device has a clock."""
        return self._last is not None

    @property
    def stands(self) -> bool:
        """Whether all samples so far have the same time of the device."""
        return self.is_device and self.times[-1] == 0.0

    @property
    def is_straightened(self) -> bool:
        """Whether the times are straightened: those of arrival, or of a device's coarse clock."""
        return self._stamper is not None

    def take(self, sample: T, t_device: float | None, arrival: float) -> list[tuple[float, T]]:
        """Add the next sample (anything); return (time, sample) of each sample whose time is now known.

        `t_device` is s on the device's clock, None if the sample has no time; `arrival` is s on the host's.
        """
        if t_device is not None and (self.is_device or self._stamper is None):
            accepted = self._take_device_time(_Reading(sample, t_device, arrival))
            if self._stamper is None:
                return accepted
            return [each for t, one in accepted for each in self._since_first(self._stamper.stamp([one], t))]
        if self._last is None:
            self._stamper = self._stamper or Stamper()
            self.times.append(arrival)
            if self._is_doubled(sample, arrival):
                if self._group_t is not None:
                    return [(self._group_t, sample)]
                self._latest_group.append(sample)
                return []
            self._latest_group, self._group_t = [sample], None
            return self._since_first(self._stamper.stamp(self._latest_group, arrival))
        self.doubted += 1  # the packet with its time was lost
        return []

    def _take_device_time(self, now: _Reading[T]) -> list[tuple[float, T]]:
        repeats_time = now.t_device == self._latest
        self._learn_usual_step(now.t_device)
        last, doubt = self._last, self._doubt
        if last is None:
            self._zero = now.t_device
            return [self._accept(now)]
        if repeats_time and self._is_in_same_tick(last, now):
            if self._stamper is None:
                self._stamper, self._coarse_from = Stamper(), self.times[-1]
            return [self._accept(now._replace(arrival=last.arrival))]
        if self._follows(last, now):
            self.doubted += doubt is not None
            return [self._accept(now)]
        if now.t_device < last.t_device and self._before is not None and self._follows(self._before, now):
            self.doubted += 1  # the last time was wrong; this sample would come before it, so it is left out
            return []
        if doubt is None or not self._follows(doubt, now):
            self.doubted += doubt is not None
            self._doubt = now
            return []
        if not 0.0 < doubt.t_device - last.t_device < 10.0:  # s; no gap, but a clock that was reset
            elapsed = max(doubt.arrival - last.arrival, self._usual)
            self._zero += doubt.t_device - last.t_device - elapsed
        return [self._accept(doubt), self._accept(now)]

    def time_at(self, host: float) -> float:
        """Convert a time on the host's clock, s, to the samples' time, s. They may still be on their way."""
        return host - (self._first or 0.0) if self._last is None else self.times[-1] + host - self._last.arrival

    def release(self) -> list[tuple[float, T]]:
        """Return (time, sample) of each sample that is still held back, by what is known now."""
        return [] if self._stamper is None else self._since_first(self._stamper.release())

    def _is_doubled(self, sample: T, arrival: float) -> bool:
        self._repeats.append(bool(self._latest_group) and sample == self._latest_group[0])
        if arrival >= self._next_look:  # again and again: little evidence may mislead
            self._next_look = arrival + DOUBLED_EVERY_S
            latest = slice(-DOUBLED_SAMPLES, None)
            self._came_twice = came_twice(np.array(self.times[latest]), np.array(self._repeats[latest]))
        return self._repeats[-1] and self._came_twice

    def _since_first(self, stamped: list[tuple[float, list[T]]]) -> list[tuple[float, T]]:
        if stamped and self._first is None:
            self._first = stamped[0][0] - self._coarse_from
        known = [(t - (self._first or 0.0), group) for t, group in stamped]
        if known and known[-1][1] is self._latest_group:
            self._group_t = known[-1][0]
        return [(t, sample) for t, group in known for sample in group]

    def count_lost(self, if_due: bool = False) -> None:
        """Count the lost samples; `if_due`: only if the next count is due. Slow counts are made less often."""
        begun = time.monotonic()
        span = self.times[-1] - self.times[0] if self.times else 0.0
        if if_due and (begun < self._next_count or span < COUNT_AFTER_S):
            return
        times = np.array(self.times)
        if self._stamper is None:
            self.lost = count_missing(times)
        else:
            new = np.ones(len(times), dtype=bool)
            if not self.is_device:
                repeats = np.array(self._repeats, dtype=bool)
                new = ~(repeats & came_twice(times, repeats))
                self.doubted = int((~new).sum())
            even, self.lost = straighten(times[new])
            self.straightened = even[np.cumsum(new) - 1]
        ended = time.monotonic()
        self._next_count = ended + max(COUNT_EVERY_S, (ended - begun) / COUNT_TIME_SHARE)

    def _learn_usual_step(self, t_device: float) -> None:
        if self._latest is not None and t_device > self._latest:
            self._steps.append(t_device - self._latest)
            if len(self._steps) == USUAL_STEPS:
                self._usual = sorted(self._steps)[USUAL_STEPS // 2]
        self._latest = t_device

    def _follows(self, earlier: _Reading[T], now: _Reading[T]) -> bool:
        step, elapsed = now.t_device - earlier.t_device, now.arrival - earlier.arrival
        if step <= 0.0:
            return False
        believed = MAX_USUAL_STEPS * self._usual or (MAX_TICK_S if self.is_straightened else MAX_FIRST_STEP_S)
        return step <= believed or abs(step - elapsed) < HOST_TOLERANCE_S + HOST_TOLERANCE_SHARE * elapsed

    def _is_in_same_tick(self, last: _Reading[T], now: _Reading[T]) -> bool:
        """Whether a coarse clock gives another sample the same time; `last` has the arrival of the tick's first one."""
        stands = now.arrival - last.arrival > MAX_TICK_S + LONGEST_BURST_S
        return now.t_device == last.t_device and now.sample != last.sample and not stands

    def _accept(self, now: _Reading[T]) -> tuple[float, T]:
        self._before, self._last, self._doubt = self._last, now, None
        self.times.append(now.t_device - self._zero)
        return self.times[-1], now.sample


def count_missing(t: Array) -> int:
    """Count the samples that are missing between increasing times (n,) s of a device's own clock.

    A short step cancels a long one beside it: the time between them was wrong, and nothing is missing.
    """
    steps = np.diff(t)
    if not len(steps):
        return 0
    interval = steps[steps <= (1.0 + LOST_SHARE) * np.median(steps)].mean()
    return max(int((np.floor(steps / interval + 1.0 - LOST_SHARE) - 1.0).sum()), 0)
