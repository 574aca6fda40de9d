"""The slow sway of a hand that means to stand still, added to a simulated task."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pbd.pose import Array
from pbd.simulation.hand_motion import HandMotion, HandState
from pbd.simulation.tasks import Task

HZ, WAVES = (0.05, 1.0), 16
"""Frequency band of the sway, below the hand's tremor, Hz; number of sine waves on each axis, evenly over octaves."""


class SwayingMotion(HandMotion):
    """A motion plus a sum of sines, so its derivatives are exact too."""

    def __init__(self, task: Task, speed: float, rng: np.random.Generator) -> None:
        """Draw the waves, with an rms speed of `speed` m/s along each axis."""
        super().__init__(task.waypoints, task.start_rpy, task.p_sensor_point)
        low, high = HZ
        self._rate = 2.0 * np.pi * np.exp(rng.uniform(np.log(low), np.log(high), (WAVES, 3)))
        self._phase = rng.uniform(0.0, 2.0 * np.pi, (WAVES, 3))
        rate_rms = 2.0 * np.pi * np.sqrt((high**2 - low**2) / (2.0 * np.log(high / low)))
        self._size = speed / rate_rms * np.sqrt(2.0 / WAVES)

    def at(self, t: Array) -> HandState:  # type: ignore[override]
        state = super().at(t)
        at, rate = t[:, None, None] * self._rate + self._phase, self._rate
        sine, cosine = self._size * np.sin(at), self._size * np.cos(at)
        p, v = state.p + sine.sum(axis=1), state.v + (rate * cosine).sum(axis=1)
        return replace(state, p=p, v=v, a=state.a - (rate**2 * sine).sum(axis=1))


@dataclass(frozen=True)
class SwayingTask(Task):
    """A task whose hand sways, stops included."""

    sway_speed: float = 0.0
    sway_seed: int = 0

    @property
    def motion(self) -> HandMotion:
        rng = np.random.default_rng(self.sway_seed).spawn(6)[5]  # after the five streams of simulate()
        return SwayingMotion(self, self.sway_speed, rng)

    @property
    def closed(self) -> bool:
        return without_sway(self).closed


def with_sway(task: Task, speed: float, seed: int) -> Task:
    return SwayingTask(**vars(task), sway_speed=speed, sway_seed=seed) if speed else task


def without_sway(task: SwayingTask) -> Task:
    return Task(**{name: value for name, value in vars(task).items() if not name.startswith("sway_")})
