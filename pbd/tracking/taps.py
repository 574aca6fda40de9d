"""Detect two quick taps on the sensor's back in the specific force, sample by sample.

A tap is a short shock along z; the hand is still before the first, between the two and after the second. Durations are
close to those of double-tap recognition in ST's accelerometers (application note AN5192).
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from math import hypot, inf, isfinite

from pbd.data import GripEvent, Recording

SHOCK = 3.0
"""Smallest peak of a tap above the mean before it, m/s2. ST's threshold is 7 at 417 Hz; at 100 Hz peaks are halved."""

ALONG_Z = 0.75
"""Smallest share of a peak along z: a tap is within 41 degrees of the normal of the sensor's back."""

SHOCK_S, QUIET_S = 0.058, 0.029
"""s: longest shock, and shortest quiet time before the next (AN5192). A tap may hide between samples that are further
apart than QUIET_S, so nothing is detected below 34 Hz."""

TOGETHER_S = 0.54
"""s: longest time from the start of the first tap to the start of the second (AN5192)."""

STILL = 0.8
"""Largest deviation, m/s2, of a hand that holds still."""

RINGS = 0.35
"""Largest ringing of the hand after a tap, as a share of the tap's peak."""

STILL_S = 0.2
"""s: time for which the hand is still before the first tap and after the second."""


@dataclass
class _Shock:
    """Start and last time above the ringing, s; norm and z component of the peak, m/s2."""

    begun: float
    loud: float
    size: float
    along_z: float

    @property
    def is_tap(self) -> bool:
        return self.size >= SHOCK and abs(self.along_z) >= ALONG_Z * self.size


class TapDetector:
    """Detects a pair of taps, once the hand has been still for STILL_S after it."""

    def __init__(self) -> None:
        self._t = -inf
        self._start_over()

    def _start_over(self) -> None:
        self._before: deque[tuple[float, float, float, float]] = deque()
        self._after: list[tuple[float, float, float]] = []
        self._sum = self._mean = (0.0, 0.0, 0.0)
        self._shocks: list[_Shock] = []
        self._held_long = False

    def feed(self, t: float, acc: Iterable[float]) -> float | None:
        """Take the next sample, (3,) m/s2 at t s. If it completes a pair of taps, return the start of the first, s."""
        x, y, z = acc
        step, self._t = t - self._t, t
        if step > QUIET_S or not isfinite(x + y + z):
            self._start_over()
            if not isfinite(x + y + z):
                return None
        if self._shocks:
            mx, my, mz = self._mean
            return self._follow(t, (x - mx, y - my, z - mz))
        sx, sy, sz = self._sum
        while self._before and self._before[0][0] < t - STILL_S:
            self._held_long = True
            _, ox, oy, oz = self._before.popleft()
            sx, sy, sz = sx - ox, sy - oy, sz - oz
        n = len(self._before)
        if self._held_long and n:
            mx, my, mz = self._mean = (sx / n, sy / n, sz / n)
            off = (x - mx, y - my, z - mz)
            if hypot(*off) > STILL:
                self._shocks = [_Shock(t, t, 0.0, 0.0)]
                return self._follow(t, off)
        self._before.append((t, x, y, z))
        self._sum = (sx + x, sy + y, sz + z)
        return None

    def _follow(self, t: float, off: tuple[float, float, float]) -> float | None:
        """Take a sample after the start of the first shock, given as deviation from the mean before it, m/s2."""
        size, shock = hypot(*off), self._shocks[-1]
        since = t - shock.begun
        if size > max(STILL, RINGS * shock.size):
            if since <= SHOCK_S:
                shock.loud = t
                if size > shock.size:
                    shock.size, shock.along_z = size, off[2]
            elif len(self._shocks) == 1 and t - shock.loud > QUIET_S and shock.is_tap:
                self._shocks.append(_Shock(t, t, size, off[2]))
            else:
                self._start_over()
        elif len(self._shocks) == 1:
            if since > TOGETHER_S:
                self._start_over()
        elif since > SHOCK_S:
            self._after.append(off)
            if since > SHOCK_S + STILL_S:
                change = hypot(*(sum(axis) / len(self._after) for axis in zip(*self._after, strict=True)))
                first, second = self._shocks
                self._start_over()
                # 0.5 m/s2: the hand turned by less than 3 degrees.
                return first.begun if change <= 0.5 and second.is_tap else None
        return None


def grip_by_taps(recording: Recording) -> tuple[GripEvent, ...]:
    """Find all pairs of taps. The first pair closes the grip, the next opens it, and so on."""
    detector = TapDetector()
    found = [detector.feed(t, acc) for t, acc in zip(recording.t.tolist(), recording.acc.tolist(), strict=True)]
    times = [t for t in found if t is not None]
    return tuple(GripEvent(t, closed=k % 2 == 0) for k, t in enumerate(times))
