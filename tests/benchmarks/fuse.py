"""What several takes of one task gain, simulated: python tests/benchmarks/fuse.py [--json] [--quick] [--seeds N]."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.data import Demonstration
from pbd.pose import Array, quat_exp, quat_from_matrix, quat_from_rpy, quat_inverse, quat_log, quat_multiply, quat_rotate, quat_to_matrix, quat_to_rpy
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.sensor_model import SENSOR_MODELS, SensorModel, Triad
from pbd.simulation.simulate import random_task, simulate
from pbd.simulation.tasks import Task

DEG, MG = np.pi / 180.0, 9.80665e-3
PHONE = SensorModel(
    "phone",
    rate_hz=100.0,
    acc=Triad(0.1 * MG, 3.0 * MG, 0.01 * MG, 5e-3, 0.1 * DEG, 40.0),
    gyr=Triad(0.007 * DEG, 0.1 * DEG, 5e-4 * DEG, 5e-3, 0.1 * DEG, 2000.0 * DEG),
    mag=None,
)
scenario_tilt = 0.0
QUARTER = np.pi / 2.0
TURNS = [quat_exp(v) for v in ((0.0, 0.0, 0.0), (0.0, 0.0, QUARTER), (QUARTER, 0.0, 0.0), (0.0, 0.0, 2 * QUARTER))]
TURNS += [quat_multiply(quat_exp((0.0, QUARTER, 0.0)), turn) for turn in TURNS]
"""How the sensor sits in the hand: turned by a quarter between takes, about the vertical and about level axes."""


@dataclass(frozen=True)
class OneDevice(Triad):
    """A triad whose errors are those of one device, whatever the noise."""

    device: int = 0

    def measure(self, true: Array, interval_s: Array, rng: np.random.Generator) -> Array:
        """What it reads: see Triad."""
        drawn = np.random.default_rng(self.device)
        gain = np.eye(3) + np.diag(self.scale * drawn.normal(size=3))
        gain += self.misalignment * drawn.normal(size=(3, 3)) * (1.0 - np.eye(3))
        bias = self.bias * drawn.normal(size=3)
        rest = Triad(self.noise, 0.0, self.bias_walk, 0.0, 0.0, self.limit, self.step)
        return rest.measure(true @ gain.T + bias, interval_s, rng)


def one_device(model: SensorModel, seed: int) -> SensorModel:
    """A device of a model."""

    def own(triad: Triad | None, number: int) -> Triad | None:
        return None if triad is None else OneDevice(**vars(triad), device=10 * seed + number)

    acc = own(model.acc, 0)
    assert acc is not None
    return replace(model, acc=acc, gyr=own(model.gyr, 1), mag=own(model.mag, 2))


@dataclass(frozen=True)
class Scenario:
    """A hand that shows a task several times."""

    sensor: str
    takes: int
    turned: bool = True
    scatter_m: float = 0.002
    lever_m: float = 0.0


def takes_of(scenario: Scenario, seed: int) -> tuple[list[Demonstration], Task, list[list[int]]]:
    """Takes of a random task of seven keyframes."""
    task = random_task(seed, moves=6)
    model = PHONE if scenario.sensor == "phone" else SENSOR_MODELS[scenario.sensor]
    device = one_device(model, seed)
    rng = np.random.default_rng(seed + 77_000)
    demos = []
    for k in range(scenario.takes):
        Q = TURNS[k % len(TURNS)] if scenario.turned else TURNS[0]
        lever = scenario.lever_m * rng.normal(size=3) if k else np.zeros(3)
        demos.append(simulate(_take(task, Q, lever, scenario.scatter_m, k > 0 or True, rng), device, 1000 * seed + k))
    return demos, task


def hand_poses(task: Task) -> tuple[Array, Array]:
    wxyz = [quat_from_rpy(task.start_rpy)]
    for w in task.waypoints[1:]:
        wxyz.append(quat_multiply(wxyz[-1], quat_exp(w.turn)))
    return np.array([w.p for w in task.waypoints]), np.array(wxyz)


def _take(task: Task, Q: Array, lever: Array, scatter_m: float, scattered: bool, rng: np.random.Generator) -> Task:
    """One take: the hand misses each place but the dock, its pace differs, the sensor sits turned and shifted in it."""
    p, A = hand_poses(task)
    miss, tilt, pace = rng.normal(size=p.shape), rng.normal(size=p.shape), np.exp(0.1 * rng.normal(size=len(p)))
    miss[0] = tilt[0] = 0.0
    p = p + scatter_m * miss
    A = quat_multiply(quat_exp(scenario_tilt * DEG * tilt), A)
    wxyz = quat_multiply(A, quat_inverse(Q))
    p = p + quat_rotate(A, lever)
    turns = quat_log(quat_multiply(quat_inverse(wxyz[:-1]), wxyz[1:]))
    waypoints = [
        Waypoint(tuple(p[i].tolist()), tuple(turns[i - 1].tolist()) if i else (0.0, 0.0, 0.0), w.move_s * pace[i], w.rest_s)
        for i, w in enumerate(task.waypoints)
    ]
    return Task(task.name, tuple(waypoints), start_rpy=tuple(quat_to_rpy(wxyz[0]).tolist()))
