"""When a sample was taken, where the device has no clock: arrival times on the host, straightened.

USB delivers in bursts and a busy host reads late, but never early: a sample arrives after it was taken, by a delay that
is smallest when nothing is in the way. So the truth is a line under the arrivals, one interval a sample; where samples
are lost, the arrivals that follow stay above it for good.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from pbd.pose import Array

CAUGHT_UP_S = 0.5
"""No burst lasts longer: a delay that stays is a sample that was lost."""

BURST_S = 0.1
"""Within this time of a loss the least delay has risen by all of it."""

LOST_SHARE = 0.6
"""A delay that stays for more than this share of an interval is a lost sample."""

SPAN, SHORTEST_S, SLOWLY = 2000, 1e-5, 0.02
"""Of `Stamper`: the interval is a mean over so many samples; none is shorter; and how much of an error at a time."""

SHORT_SPAN = 128
"""Samples over which the interval is taken at first."""

BLOCK = 64
"""Samples of which the least delayed one is looked at."""


def straighten(arrival: Array) -> tuple[Array, int]:
    """Time stamps of samples that arrived at (n,) s: evenly spaced but for lost ones, from 0.

    Returns:
        (n,) s and how many samples were lost.
    """
    n = len(arrival)
    if n < 3:
        return arrival - arrival[:1], 0
    k = np.arange(n, dtype=np.float64)
    # Over short spans first: few of them have a loss in them.
    interval = _slope(k, arrival, min(n // 2, SHORT_SPAN))
    lost = np.zeros(n)
    for _ in range(3):  # the interval is the better for knowing what was lost, and the other way round
        lost = _lost(arrival - k * interval, interval)
        interval = _slope_below(k + lost, arrival)
    t = interval * (k + lost)
    return t - t[0], int(lost[-1])


def _lost(delay: Array, interval: float) -> Array:
    """How many samples were lost before each, from delays that rise and stay risen: (n,)."""
    from scipy.ndimage import minimum_filter1d

    # The least delay of those that follow within CAUGHT_UP_S. The very last samples have none that could tell.
    ahead, burst = max(2, round(CAUGHT_UP_S / interval)), max(2, round(BURST_S / interval))
    least: Array = minimum_filter1d(delay, ahead, origin=-(ahead // 2), mode="nearest")
    least[-ahead:] = least[-ahead - 1] if len(least) > ahead else least[0]
    rises = np.diff(least, prepend=least[0])
    over_burst = np.cumsum(rises)
    over_burst[burst:] -= over_burst[:-burst].copy()
    missing = np.zeros(len(delay))
    risen = np.concatenate(([False], over_burst > LOST_SHARE * interval, [False]))
    edges = np.flatnonzero(np.diff(risen.astype(np.int8)))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        row = max(start - burst, 0) + int(np.argmax(rises[max(start - burst, 0) : stop]))
        missing[row] = np.floor(over_burst[start:stop].max() / interval + 1.0 - LOST_SHARE)
    return np.asarray(np.cumsum(missing))


def _slope_below(k: Array, arrival: Array) -> float:
    """Slope of the line under the arrivals: through the least delayed sample of each block, robustly."""
    slope = _slope(k, arrival, len(k) // 2)
    rows = _least_of_blocks(arrival - slope * k)
    return _slope(k[rows], arrival[rows], len(rows) // 2) if len(rows) >= 8 else slope


def _slope(k: Array, arrival: Array, span: int) -> float:
    """Median slope of pairs that are `span` rows apart (Theil and Sen)."""
    return float(np.median((arrival[span:] - arrival[:-span]) / (k[span:] - k[:-span])))


def _least_of_blocks(delay: Array) -> NDArray[np.intp]:
    starts = np.arange(0, len(delay), BLOCK)
    return np.array([start + np.argmin(delay[start : start + BLOCK]) for start in starts], dtype=np.intp)


class Stamper:
    """Time stamps as the samples come, for the screen and the first writing; `straighten` knows better at the end."""

    def __init__(self) -> None:
        self.arrivals: list[float] = []
        self.t: list[float] = []
        self._least: deque[tuple[float, float]] = deque()
        """(arrival, delay) of the last CAUGHT_UP_S, delays rising: the first one is the least."""

    def stamp(self, arrival: float) -> float:
        """Return the time of the next sample, s since the first, which arrived at `arrival` s on the host's clock."""
        n = len(self.arrivals)
        self.arrivals.append(arrival)
        if n == 0:
            self.t.append(0.0)
            return 0.0
        first = max(0, n - SPAN)
        interval = max((arrival - self.arrivals[first]) / (n - first), SHORTEST_S)
        delay = arrival - self.arrivals[0] - (self.t[-1] + interval)
        while self._least and self._least[-1][1] >= delay:
            self._least.pop()
        self._least.append((arrival, delay))
        while arrival - self._least[0][0] > CAUGHT_UP_S:
            self._least.popleft()
        late = self._least[0][1]
        missing = max(np.floor(late / interval + 1.0 - LOST_SHARE), 0.0)
        if missing:
            self._least.clear()
        # What is neither lost nor noise is the interval's own error: it is let in slowly.
        self.t.append(self.t[-1] + max(interval * (1.0 + missing) + SLOWLY * (late - missing * interval), SHORTEST_S))
        return self.t[-1]
