"""Whether a hand that seems to stand still does so, by what dead reckoning is usually left with at a stop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd.data import GRAVITY
from pbd.tracking.stops import COAST_SPEED

DRIFT, OFF, PER_TURN = 0.03, 0.03, 0.25
"""m/s2; m/s2; m/s2 per radian: what is taken to be usual before the first stops tell. They are 0.2 degrees of tilt,
the same, and a cheap accelerometer's errors."""

TIMES_USUAL = 3.0
"""Less than so many times what is usual is plausible."""

HARDLY_TURNED = 0.1
"""rad: what is seen after a smaller turn isn't put down to it."""

MISTURN_CLIPPED, MISTURN_DEVICE = 0.1, 1.0
"""By this share a turn may be wrong that was faster than the gyro's range, or that is a device's own attitude's, which
lags behind."""


@dataclass(frozen=True)
class Leftover:
    """What dead reckoning is left with where a hand seems to stand still.

    Attributes:
        duration_s: of the move.
        speed: m/s.
        acceleration: m/s2, by which it differs from that of the last stop.
        turned, turned_s: rad, how far the sensor has turned away from its attitude there, and its integral over time.
        misturn: the share by which that may be wrong.
    """

    duration_s: float
    speed: float
    acceleration: float
    turned: float
    turned_s: float
    misturn: float = 0.0


class Usual:
    """Root mean square of what has been seen; a guess counts as one sight."""

    def __init__(self, guess: float) -> None:
        self._squares, self._n = guess**2, 1

    @property
    def value(self) -> float:
        """What is usual."""
        return float(np.sqrt(self._squares / self._n))

    def see(self, value: float) -> None:
        """Take another one."""
        self._squares += value**2
        self._n += 1


class Doubt:
    """What is left at a stop: a velocity that grows with time, and an acceleration; and of both what turning adds.

    A smooth move is quiet, too: half-way, where its acceleration passes zero, and where it peaks. Half-way its velocity
    is more than what stops leave; at the peaks its acceleration is. That tells moves of a second and of 5 cm or more
    from rest. It fails for slow ones of a hand without any tremor: one of 0.3 m in 2 to 3 s is taken for a stop now and
    then, one of 0.1 m in 2.5 s (0.1 m/s2 at its peak) nearly always.
    """

    def __init__(self) -> None:
        self._drift, self._off, self._per_turn = Usual(DRIFT), Usual(OFF), Usual(PER_TURN)

    def finds_plausible(self, left: Leftover, tolerance: float) -> bool:
        """Whether a stop leaves this; `tolerance` m/s2 is what noise may do to the acceleration."""
        per_turn = TIMES_USUAL * self._per_turn.value + left.misturn * GRAVITY
        off = max(TIMES_USUAL * self._off.value, tolerance) + per_turn * left.turned
        speed = max(TIMES_USUAL * self._drift.value * left.duration_s, COAST_SPEED) + per_turn * left.turned_s
        return left.acceleration < off and left.speed < speed

    def learn(self, left: Leftover) -> None:
        """Take what was left at a stop."""
        if left.misturn > 0.0:
            return
        if left.turned_s * self._per_turn.value < COAST_SPEED:
            self._drift.see(left.speed / left.duration_s)
        if left.turned < HARDLY_TURNED:
            self._off.see(left.acceleration)
        else:
            self._per_turn.see(left.acceleration / left.turned)
