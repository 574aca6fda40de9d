"""The slow sway of a hand that means to stand still, added to a simulated task."""

from dataclasses import dataclass

import numpy as np

from pbd.pose import Array, quat_exp, quat_inverse, quat_multiply, quat_rotate
from pbd.simulation.hand_motion import HandMotion, HandState
from pbd.simulation.tasks import Task

HZ, WAVES = (0.05, 1.0), 16
"""Frequency band of the sway, below the hand's tremor, Hz; number of sine waves on each axis, evenly over octaves."""


class Waves:
    """A sum of sines on each of three axes, with an rms speed of `speed` (per s) along each."""

    def __init__(self, speed: float, rng: np.random.Generator) -> None:
        low, high = HZ
        self._rate = 2.0 * np.pi * np.exp(rng.uniform(np.log(low), np.log(high), (WAVES, 3)))
        self._phase = rng.uniform(0.0, 2.0 * np.pi, (WAVES, 3))
        rate_rms = 2.0 * np.pi * np.sqrt((high**2 - low**2) / (2.0 * np.log(high / low)))
        self._size = speed / rate_rms * np.sqrt(2.0 / WAVES)

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """Values (n, 3) at t (n,) s, and their first and second derivatives."""
        at, rate = t[:, None, None] * self._rate + self._phase, self._rate
        sine, cosine = self._size * np.sin(at), self._size * np.cos(at)
        return sine.sum(axis=1), (rate * cosine).sum(axis=1), -(rate**2 * sine).sum(axis=1)


class SwayingMotion(HandMotion):
    """A motion plus sway, so its derivatives are exact too. The sensor also turns about itself by a small angle."""

    def __init__(self, task: Task, speed: float, turn: float, rng: np.random.Generator) -> None:
        """Draw the waves, of rms `speed` m/s along and `turn` rad/s about each axis."""
        super().__init__(task.waypoints, task.start_rpy, task.p_sensor_point)
        self._along, self._about = Waves(speed, rng), Waves(turn, rng)

    def at(self, t: Array) -> HandState:  # type: ignore[override]
        state = super().at(t)
        p, v, a = self._along.at(t)
        angle, rate, _ = self._about.at(t)
        swung = quat_exp(angle)
        return HandState(
            *(state.p + p, state.v + v, state.a + a),
            quat_multiply(state.wxyz, swung),
            quat_rotate(quat_inverse(swung), state.w) + rate - 0.5 * np.cross(angle, rate),
        )


@dataclass(frozen=True)
class SwayingTask(Task):
    """A task whose hand sways, stops included."""

    sway_speed: float = 0.0
    sway_turn: float = 0.0
    sway_seed: int = 0

    @property
    def motion(self) -> HandMotion:
        rng = np.random.default_rng(self.sway_seed).spawn(6)[5]  # after the five streams of simulate()
        return SwayingMotion(self, self.sway_speed, self.sway_turn, rng)

    @property
    def closed(self) -> bool:
        return without_sway(self).closed


def with_sway(task: Task, speed: float, seed: int, turn: float = 0.0) -> Task:
    """The task with sway of `speed` m/s along and `turn` rad/s about each axis (rms)."""
    swaying = SwayingTask(**vars(task), sway_speed=speed, sway_turn=turn, sway_seed=seed)
    return swaying if speed or turn else task


def without_sway(task: SwayingTask) -> Task:
    return Task(**{name: value for name, value in vars(task).items() if not name.startswith("sway_")})
