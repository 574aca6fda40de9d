"""Times of samples as they arrive: even times, with gaps where samples were lost.

No sample arrives before it was taken, so the true times lie on a line below the arrivals (`straighten`). A sample that
is on time shows that none was lost before it. One that is late may have waited, or another was lost: what comes next
decides, and until then it is held back.
"""

from collections import deque
from math import log
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from pbd.pose import Array
from pbd.timestamps.straighten import (
    BURST_BATCHES,
    LONGEST_BURST_S,
    LOST_SHARE,
    WITHIN_BATCH,
    first_slope,
)

RECENT_BATCHES = 64
"""Where the line is, and how many batches are late, is found from this number of latest batches."""

LATE_BATCHES = 16
"""Lateness is measured from the least delayed of this number of batches. Among so few, a sample is rarely lost."""

LEAST_LATE_SHARE = 0.02
"""Smallest share of late batches that is assumed: a link may hold one back at any time."""

T = TypeVar("T")


class _Held(NamedTuple, Generic[T]):
    sample: T
    arrival: float  # s
    batch: int  # number of its batch


class _End(NamedTuple):
    """The last sample of a batch."""

    arrived: int  # of the samples before it that arrived
    position: int  # on the line; lost ones count
    arrival: float  # s


class Stamper(Generic[T]):
    """Gives samples their times, in order, once they are known."""

    def __init__(self) -> None:
        self._held: list[_Held[T]] = []
        self._batch = 0
        self._longest_wait = 0.0  # s, between two arrivals, until the line is laid
        self._begin, self._interval = 0.0, 0.0  # the line, s; not laid yet
        self._count, self._index = 0, 0  # of the first sample held, as in `_End`
        self._t, self._t_index = 0.0, 0  # the latest time given, s; its index
        self._late = LEAST_LATE_SHARE  # share of batches that are late
        self._ends: deque[_End] = deque(maxlen=1000)  # the interval is fitted to these latest batches
        self._next_fit = 0.0  # s

    def stamp(self, sample: T, arrival: float) -> list[tuple[float, T]]:
        """Take the next sample, which arrived at `arrival` s; return (time in s, sample) of those now known."""
        before = self._held[-1].arrival if self._held else -np.inf
        self._batch += arrival - before > WITHIN_BATCH * self._interval
        self._held.append(_Held(sample, arrival, self._batch))
        if not self._interval:
            self._longest_wait = max(self._longest_wait, arrival - before) if len(self._held) > 1 else 0.0
            is_enough = arrival - self._held[0].arrival >= max(1.0, (BURST_BATCHES - 1) * self._longest_wait)  # 1 s
            return self._start() if is_enough else []
        if self._is_on_time(len(self._held) - 1):
            self._begin += min(self._delay(len(self._held) - 1), 0.0)
            return self._give(len(self._held))
        stamped: list[tuple[float, T]] = []
        while self._held and self._is_lost():
            least = min(self._delay(k) for k in range(len(self._held)))
            self._index += max(int(least / self._interval + 1.0 - LOST_SHARE), 1)
            stamped += self._give(max(k for k in range(len(self._held)) if self._is_on_time(k)) + 1)
        return stamped

    def release(self) -> list[tuple[float, T]]:
        """Return (time in s, sample) of all held, by what is known now."""
        stamped = [] if self._interval else self._start()
        return stamped + self._give(len(self._held))

    def _delay(self, k: int) -> float:
        """Delay of sample k of those held behind the line, s, if none was lost among them."""
        return self._held[k].arrival - self._begin - self._interval * (self._index + k)

    def _is_on_time(self, k: int) -> bool:
        return self._delay(k) < LOST_SHARE * self._interval

    def _is_lost(self) -> bool:
        """Whether a sample was lost before the first held: without a loss, the chance of so many late ones is 1e-5."""
        first, last = self._held[0], self._held[-1]
        batches = last.batch - first.batch  # the last one may not be complete
        lasts = last.arrival - first.arrival > LONGEST_BURST_S and batches >= BURST_BATCHES
        return lasts or batches * log(self._late) < log(1e-5)

    def _give(self, n: int) -> list[tuple[float, T]]:
        """Give the first n samples held their times."""
        given, self._held = self._held[:n], self._held[n:]
        interval = self._interval
        stamped: list[tuple[float, T]] = []
        for k, (sample, arrival, batch) in enumerate(given):
            index = self._index + k
            line, due = self._begin + interval * index, self._t + interval * (index - self._t_index)
            # Where the line has moved, the times follow in about 1 s, by 0.5 to 50 % of a step.
            shift = interval * min(max(0.005, abs(line - due)), 0.5)
            self._t = min(max(line, due - shift), due + shift)
            self._t_index = index
            stamped.append((self._t, sample))
            if k == n - 1 or given[k + 1].batch != batch:
                self._ends.append(_End(self._count + k, index, arrival))
        self._count, self._index = self._count + n, self._index + n
        if given and given[-1].arrival >= self._next_fit:
            counts, indices, arrivals = (np.array(each, dtype=np.float64) for each in zip(*self._ends, strict=True))
            self._fit(counts, indices, arrivals, slice(-RECENT_BATCHES, None))
        return stamped

    def _start(self) -> list[tuple[float, T]]:
        """Lay the line below the samples held, and take them once more."""
        held, self._held = self._held, []
        arrival = np.array([each.arrival for each in held])
        soon = WITHIN_BATCH * (arrival[-1] - arrival[0]) / max(len(arrival) - 1, 1)
        ends = np.flatnonzero(np.append(np.diff(arrival) > soon, True))
        self._fit(ends.astype(np.float64), ends.astype(np.float64), arrival[ends], slice(RECENT_BATCHES))
        self._t = self._begin
        return [stamped for sample, at, _ in held for stamped in self.stamp(sample, at)]

    def _fit(self, counts: Array, index: Array, arrival: Array, near: slice) -> None:
        """Learn the interval from ends of batches (n,), as in `_End`; the rest from those `near`."""
        soon = WITHIN_BATCH * (arrival[-1] - arrival[0]) / max(counts[-1] - counts[0], 1)
        whole = np.append(np.diff(arrival) > soon * np.diff(counts), True)  # a burst is read in several pieces
        counts, index, arrival = counts[whole], index[whole], arrival[whole]
        if len(counts) < BURST_BATCHES:
            interval = (arrival[-1] - arrival[0]) / max(counts[-1] - counts[0], 1)
        else:
            interval = first_slope(counts, arrival, int(np.median(np.diff(counts))))
        self._interval = max(float(interval), 1e-5)  # s; equal times have none
        delay = (arrival - self._interval * index)[near]
        self._begin = float(delay.min())
        blocks = [delay[k : k + LATE_BATCHES] for k in range(0, len(delay), LATE_BATCHES)]
        late = np.concatenate([block - block.min() >= LOST_SHARE * self._interval for block in blocks])
        self._late = max(float(late.mean()), LEAST_LATE_SHARE)
        self._next_fit = float(arrival[-1]) + LONGEST_BURST_S
