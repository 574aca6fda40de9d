"""Time stamps of samples and the count of lost ones, by the device's own clock or by arrival times on the host.

A device's time is accepted while it goes on regularly. After a leap the next sample decides: a device that restarted
goes on from there; a broken digit (some protocols have no checksum) stands alone and is left out.

Arrival times are straightened. USB delivers in bursts and a busy host reads late, but never early. A sample arrives
after it was taken, with a delay that is smallest on an idle host. So the truth is a line under the arrivals,
one interval a sample. Where samples are lost, the arrivals that follow stay above that line for good.
"""

from __future__ import annotations

import time
from collections import deque
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from pbd.pose import Array

LOST_SHARE = 0.6
"""Share of an interval by which the next sample is late where one is lost, at least."""

LONGEST_BURST_S = 0.5
"""Longest burst of arrivals, s. A delay that lasts longer is a lost sample."""

LOSS_RISE_S = 0.1
"""s after a loss by which the least delay shows all of it."""

BLOCK_SAMPLES = 64
"""Samples per block; the least delayed one of each supports the line under the arrivals."""

FIRST_SPAN_SAMPLES = 128
"""Samples over which the interval is first estimated: few such spans have a loss in them."""

MEAN_SAMPLES = 2000
"""Samples over which a live stamp's interval is averaged."""

SETTLE_S = 1.0
"""Time constant, s, with which live stamps follow the remaining delay, which is the error of the interval. It must
exceed LONGEST_BURST_S, over which the delay is taken, or the stamps would oscillate."""

SHORTEST_STEP_S = 1e-5
"""Least increase of live stamps, s."""

BELIEVED_STEP_S = 0.1
"""Largest accepted step of a device's time, s, while its usual step is unknown."""

BELIEVED_STEPS = 3.0
"""Largest accepted step of a device's time, in usual steps."""

HOST_ROOM_S, HOST_ROOM = 0.02, 0.1
"""A larger step is accepted if it equals the host's within this time (s) and this share."""

SHORTEST_USUAL_STEP = 0.25
"""Least step of a device's time, as a share of the usual step."""

USUAL_STEPS = 9
"""Number of steps whose median is the usual one."""

LONGEST_GAP_S = 10.0
"""Longest gap, s, in a device's time. A longer leap, or one backwards, is a clock set anew."""

LONGEST_USUAL_STEP = 1.6
"""Largest step without a loss, in usual steps."""

COUNT_AFTER_S, COUNT_EVERY_S, COUNT_SHARE = 2.0, 1.0, 0.02
"""Losses are counted from this time on (s), this often (s), and in at most this share of the time."""


T = TypeVar("T")


class _Reading(NamedTuple, Generic[T]):
    sample: T
    t_device: float
    arrival: float


class SampleClock(Generic[T]):
    """Takes samples as they come and tells their times, s since the first. The first sample says whose clock counts.

    Attributes:
        times: of the samples so far: the device's, or as they arrived on the host, s.
        doubted: how many samples were left out because of their time.
        lost: how many samples never came, by the latest count.
        straightened: (n,) s, arrival times as of the latest count; None by the device's clock.
    """

    def __init__(self, usual_s: float = 0.0) -> None:
        """Begin; `usual_s` is the device's interval where it is known already."""
        self.times: list[float] = []
        self.doubted = self.lost = 0
        self.straightened: Array | None = None
        self._stamper: Stamper | None = None
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

    def take(self, sample: T, t_device: float | None, arrival: float) -> list[tuple[float, T]]:
        """Take the next sample, which arrived at `arrival` s on the host's clock; return those whose time is known now.

        `t_device` is s on the device's clock; None where it has none.
        """
        if self._last is None and (self._stamper or t_device is None):
            self._stamper = self._stamper or Stamper()
            self.times.append(arrival)
            return [(self._stamper.stamp(arrival), sample)]
        if t_device is None:  # its part with the time was lost
            self.doubted += 1
            return []
        self._learn(t_device)
        now, last, doubt = _Reading(sample, t_device, arrival), self._last, self._doubt
        if last is None:
            self._zero = now.t_device
            return [self._accept(now)]
        if self._follows(last, now):
            self.doubted += doubt is not None
            return [self._accept(now)]
        if now.t_device < last.t_device and self._before is not None and self._follows(self._before, now):
            self.doubted += 1  # the last one was wrong; what lies before it now has no place
            return []
        if doubt is None or not self._follows(doubt, now):
            self.doubted += doubt is not None
            self._doubt = now
            return []
        if not 0.0 < doubt.t_device - last.t_device < LONGEST_GAP_S:
            elapsed = max(doubt.arrival - last.arrival, self._usual)
            self._zero += doubt.t_device - last.t_device - elapsed
        return [self._accept(doubt), self._accept(now)]

    def count(self, now_and_then: bool = False) -> None:
        """Count the lost samples: at once, or only if it is time. The longer a count takes, the rarer they are."""
        begun = time.monotonic()
        span = self.times[-1] - self.times[0] if self.times else 0.0
        if now_and_then and (begun < self._next_count or span < COUNT_AFTER_S):
            return
        times = np.array(self.times)
        if self.is_device:
            self.lost = missing(times)
        else:
            self.straightened, self.lost = straighten(times)
        ended = time.monotonic()
        self._next_count = ended + max(COUNT_EVERY_S, (ended - begun) / COUNT_SHARE)

    def _learn(self, t_device: float) -> None:
        if self._latest is not None and t_device > self._latest:
            self._steps.append(t_device - self._latest)
            if len(self._steps) == USUAL_STEPS:
                self._usual = sorted(self._steps)[USUAL_STEPS // 2]
        self._latest = t_device

    def _follows(self, earlier: _Reading[T], now: _Reading[T]) -> bool:
        step, elapsed = now.t_device - earlier.t_device, now.arrival - earlier.arrival
        if step <= SHORTEST_USUAL_STEP * self._usual:
            return False
        believed = BELIEVED_STEPS * self._usual or BELIEVED_STEP_S
        return step <= believed or abs(step - elapsed) < HOST_ROOM_S + HOST_ROOM * elapsed

    def _accept(self, now: _Reading[T]) -> tuple[float, T]:
        self._before, self._last, self._doubt = self._last, now, None
        self.times.append(now.t_device - self._zero)
        return self.times[-1], now.sample


class Stamper:
    """Stamps samples as they arrive, for the screen and the first writing; `straighten` knows better at the end."""

    def __init__(self) -> None:
        self._arrivals: deque[float] = deque(maxlen=MEAN_SAMPLES + 1)
        self._t = 0.0
        self._behind: deque[tuple[float, float]] = deque()
        """(arrival, delay) of the last LONGEST_BURST_S, delays rising: the first one is the least."""

    def stamp(self, arrival: float) -> float:
        """Return the time of the next sample, s since the first, which arrived at `arrival` s on the host's clock."""
        self._arrivals.append(arrival)
        n = len(self._arrivals) - 1
        if n == 0:
            self._begun = arrival
            return self._t
        interval = max((arrival - self._arrivals[0]) / n, SHORTEST_STEP_S)
        delay = arrival - self._begun - (self._t + interval)
        while self._behind and self._behind[-1][1] >= delay:
            self._behind.pop()
        self._behind.append((arrival, delay))
        while arrival - self._behind[0][0] > LONGEST_BURST_S:
            self._behind.popleft()
        late = self._behind[0][1]
        lost = max(late / interval + 1.0 - LOST_SHARE, 0.0) // 1.0
        if lost:
            self._behind.clear()
        self._t += max(interval * (1.0 + lost) + interval / SETTLE_S * (late - lost * interval), SHORTEST_STEP_S)
        return self._t


def missing(t: Array) -> int:
    """How many samples are missing between increasing times (n,) s of a device's own clock.

    A step that is short by as much as makes a long one long is taken off again: between them a time was wrong.
    """
    steps = np.diff(t)
    if not len(steps):
        return 0
    interval = steps[steps <= LONGEST_USUAL_STEP * np.median(steps)].mean()
    return max(int((np.floor(steps / interval + 1.0 - LOST_SHARE) - 1.0).sum()), 0)


def straighten(arrival: Array) -> tuple[Array, int]:
    """Times (n,) s from 0 of samples that arrived at (n,) s, even but for lost ones; and how many were lost."""
    n = len(arrival)
    if n < 3:
        return arrival - arrival[:1], 0
    k = np.arange(n, dtype=np.float64)
    interval = _slope(k, arrival, min(n // 2, FIRST_SPAN_SAMPLES))
    lost = np.zeros(n)
    for _ in range(3):  # the interval is the better for knowing what was lost, and the other way round
        lost = _lost_before(arrival - k * interval, interval)
        interval = _slope_below(k + lost, arrival)
    t = interval * (k + lost)
    return t - t[0], int(lost[-1])


def _lost_before(delay: Array, interval: float) -> Array:
    """How many samples were lost before each, from delays (n,) s that rise and stay risen: (n,)."""
    from scipy.ndimage import find_objects, label, minimum_filter1d

    # The least delay of those that follow within a burst. The very last samples have none that could tell.
    ahead, rise = max(2, round(LONGEST_BURST_S / interval)), max(2, round(LOSS_RISE_S / interval))
    least: Array = minimum_filter1d(delay, ahead, origin=-(ahead // 2), mode="nearest")
    least[-ahead:] = least[-ahead - 1] if len(least) > ahead else least[0]
    rises = np.diff(least, prepend=least[0])
    risen = np.cumsum(rises)
    risen[rise:] -= risen[:-rise].copy()
    lost = np.zeros(len(delay))
    for (rows,) in find_objects(label(risen > LOST_SHARE * interval)[0]):
        first = max(rows.start - rise, 0)
        row = first + int(np.argmax(rises[first : rows.stop]))
        lost[row] = np.floor(risen[rows].max() / interval + 1.0 - LOST_SHARE)
    return np.asarray(np.cumsum(lost))


def _slope_below(k: Array, arrival: Array) -> float:
    """Slope of the line under the arrivals: through the least delayed sample of each block, robustly."""
    slope = _slope(k, arrival, len(k) // 2)
    delay = arrival - slope * k
    rows = [
        start + int(np.argmin(delay[start : start + BLOCK_SAMPLES])) for start in range(0, len(delay), BLOCK_SAMPLES)
    ]
    return _slope(k[rows], arrival[rows], len(rows) // 2) if len(rows) >= 8 else slope


def _slope(k: Array, arrival: Array, span: int) -> float:
    """Median slope of pairs that are `span` rows apart (Theil and Sen)."""
    return float(np.median((arrival[span:] - arrival[:-span]) / (k[span:] - k[:-span])))
