"""What several takes of one task gain, simulated: python tests/benchmarks/fuse.py [--json] [--quick] [--seeds N].

A hand does a random task of seven keyframes (moves of 0.5 to 1.5 s, a reach of 30 cm) several times with one device.
It starts at a dock, meets each other keyframe to within 0.5 mm and 1 degree per axis (`scatter_4mm`: 4 mm), at a pace
that differs by 10 % from move to move. In `turned` the sensor sits otherwise in the hand in each take: by a quarter
about the vertical, about a level axis, and so on. In `lever_10mm` it is also shifted by 10 mm per axis.

Errors are those of all keyframes but the first, mm: in the dock's frame (origin at the first keyframe, heading of the
first take there), as an arm follows them; and in `shape` after the best turn about the vertical and shift, which leaves
out the dock's own share. `plain`: each take tracked alone and registered to the first, and then the mean: it is told
no more than the joint estimate. Seeds from 1000 on were never used to choose anything.
`inside`: errors per axis within one and two of their own sigma. `learned`: the share of scatters of 4 mm that are found
between 3.4 and 4.4 mm. `fuse4_s`, `fuse10_s`: process time of `pbd.fuse`, tracking included.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.data import Demonstration, HandPath
from pbd.errors import PbdError, PbdWarning
from pbd.fusion.alignment import Keyframes, by_moves, by_pose, register
from pbd.pipeline import fuse, track
from pbd.pose import (
    Array,
    quat_about_z,
    quat_exp,
    quat_from_rpy,
    quat_inverse,
    quat_log,
    quat_multiply,
    quat_rotate,
    quat_to_matrix,
    quat_to_rpy,
    yaw_toward,
)
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.sensor_model import SENSOR_MODELS, SensorModel, Triad
from pbd.simulation.simulate import random_task, simulate
from pbd.simulation.tasks import Task
from pbd.tracking.keyframes import find_keyframes
from tests.benchmarks.report import arguments, finish

DEG, MG, MM = np.pi / 180.0, 9.80665e-3, 1e-3
PHONE = SensorModel(
    "phone",
    rate_hz=100.0,
    acc=Triad(0.1 * MG, 3.0 * MG, 0.01 * MG, 5e-3, 0.1 * DEG, 40.0),
    gyr=Triad(0.007 * DEG, 0.1 * DEG, 5e-4 * DEG, 5e-3, 0.1 * DEG, 2000.0 * DEG),
    mag=None,
)
"""A phone's chip (Bosch BMI160 and ST LSM6DSO class) after its own calibration; the magnetometer is left out."""

QUARTER = 0.5 * np.pi
TURNS = [quat_exp(v) for v in ((0.0, 0.0, 0.0), (0.0, 0.0, QUARTER), (QUARTER, 0.0, 0.0), (0.0, 0.0, 2.0 * QUARTER))]
TURNS += [quat_multiply(quat_exp((0.0, QUARTER, 0.0)), turn) for turn in TURNS]
"""How the sensor sits in the hand: turned by a quarter between takes, about the vertical and about level axes."""

FIRST_SEED = 1000
TAKES = (1, 2, 4, 8)


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


@dataclass(frozen=True)
class Scenario:
    """A hand that shows a task several times."""

    sensor: str
    takes: int
    turned: bool = True
    scatter_m: float = 0.5 * MM
    lever_m: float = 0.0
    tilt_rad: float = DEG


def main() -> None:
    """Simulate, fuse, score, print."""
    parser = arguments(str(__doc__))
    parser.add_argument("--seeds", type=int, default=12, metavar="N", help="tasks of each kind (12)")
    args = parser.parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    count = 3 if args.quick else args.seeds
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    figures: dict[str, Any] = {"seeds": count, "sensors": {}, "scatter_4mm": {}}
    inside: list[Array] = []
    for sensor in ("wt901", "phone", "os5000"):
        turned = {str(n): score(Scenario(sensor, n), seeds, inside if n > 1 else None) for n in TAKES}
        figures["sensors"][sensor] = {"same": {"4": score(Scenario(sensor, 4, turned=False), seeds)}, "turned": turned}
    figures["scatter_4mm"]["wt901"] = {
        str(n): score(Scenario("wt901", n, scatter_m=4.0 * MM), seeds) for n in (1, 4, 8)
    }
    figures["lever_10mm"] = {"4": score(Scenario("wt901", 4, lever_m=10.0 * MM), seeds)}
    off = np.concatenate([each.ravel() for each in inside])
    figures |= {"inside_1_sigma": float((off < 1.0).mean()), "inside_2_sigma": float((off < 2.0).mean())}
    figures |= {f"fuse{n}_s": fuse_seconds(n) for n in (4, 10)}
    finish(figures, args.json)


def score(scenario: Scenario, seeds: Sequence[int], inside: list[Array] | None = None) -> dict[str, Any]:
    """Errors of one kind, mm; a fusion that fails or has other keyframes than the task is counted as lost."""
    errors: dict[str, list[Array]] = {"joint": [], "plain": [], "shape": [], "plain_shape": []}
    found, lost = [], 0
    for seed in seeds:
        demos, task = takes_of(scenario, seed)
        try:
            path = fuse(demos) if scenario.takes > 1 else track(demos[0].recording)
            plain = plain_average(demos)
        except PbdError:
            lost += 1
            continue
        (p, sigma), (true, A) = _keyframes(path), hand_poses(task)
        if len(p) != len(true) or len(plain) != len(true):
            lost += 1
            continue
        true = (true - true[0]) @ _turn(-_yaw(A[0], path)).T
        off = {"joint": (p - true)[1:], "plain": (plain - true)[1:]}
        off |= {"shape": _shape(p, true), "plain_shape": _shape(plain, true)}
        for name, each in off.items():
            errors[name].append(each)
        if inside is not None:
            inside.append(np.abs(off["joint"]) / sigma[1:])
        if path.fusion is not None:
            found.append(path.fusion.overall[0])
    sizes = {name: 1e3 * np.linalg.norm(np.concatenate(each), axis=1) for name, each in errors.items()}
    figures: dict[str, Any] = {
        "median_mm": float(np.median(sizes["joint"])),
        "p95_mm": float(np.percentile(sizes["joint"], 95)),
        "plain_median_mm": float(np.median(sizes["plain"])),
        "plain_p95_mm": float(np.percentile(sizes["plain"], 95)),
        "shape_median_mm": float(np.median(sizes["shape"])),
        "plain_shape_median_mm": float(np.median(sizes["plain_shape"])),
        "lost": lost,
    }
    if found and scenario.scatter_m > 3.0 * MM:
        learned = 1e3 * np.array(found)
        figures["scatter_mm"] = float(np.median(learned))
        figures["learned"] = float(((learned > 3.4) & (learned < 4.4)).mean())
    return figures


def plain_average(demos: Sequence[Demonstration]) -> Array:
    """Keyframes (n, 3) m: each take alone, registered to the first by its keyframes, and the mean."""
    takes = []
    for demo in demos:
        keyframes = find_keyframes(track(demo.recording))
        poses = [keyframe.T_nav_sensor for keyframe in keyframes]
        R = quat_to_matrix(np.array([pose.wxyz for pose in poses]))
        takes.append(Keyframes(np.array([p.p for p in poses]), R, (None,) * len(R), np.full(len(R), 1.0 * MM)))
    first, places = takes[0], [takes[0].p]
    for take in takes[1:]:
        there = register(first, take, by_moves(first, take)).of(take)
        pairs = dict(by_pose(first, there))
        places.append(np.array([there.p[pairs[i]] if i in pairs else np.full(3, np.nan) for i in range(len(first))]))
    mean: Array = np.nanmean(places, axis=0)
    relative: Array = mean - mean[0]
    return relative


def fuse_seconds(takes: int) -> float:
    """Least process time of three, s."""
    demos, _ = takes_of(Scenario("wt901", takes), FIRST_SEED)
    times = []
    for _ in range(3):
        start = time.process_time()
        fuse(demos)
        times.append(time.process_time() - start)
    return min(times)


def _keyframes(path: HandPath) -> tuple[Array, Array]:
    sigma: Array = np.sqrt(np.diagonal(path.cov[:, :3, :3], axis1=1, axis2=2))
    return path.p_nav_sensor[[stop.start for stop in path.stops]], sigma


def _yaw(wxyz_true: Array, path: HandPath) -> float:
    """From the path's nav to the simulated world, by the first keyframe's heading: as the dock does it."""
    return yaw_toward(find_keyframes(path)[0].T_nav_sensor.wxyz, wxyz_true)


def _turn(yaw: float) -> Array:
    return quat_to_matrix(quat_about_z(yaw))


def _shape(p: Array, true: Array) -> Array:
    """Errors after the best turn about the vertical and shift."""
    a, b = p - p.mean(axis=0), true - true.mean(axis=0)
    yaw = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a[:, :2] * b[:, :2]).sum())
    off: Array = a @ _turn(float(yaw)).T - b
    return off


def one_device(model: SensorModel, seed: int) -> SensorModel:
    """A device of a model."""

    def own(triad: Triad, number: int) -> Triad:
        return OneDevice(**vars(triad), device=10 * seed + number)

    gyr, mag = model.gyr, model.mag
    return replace(
        model, acc=own(model.acc, 0), gyr=None if gyr is None else own(gyr, 1), mag=None if mag is None else own(mag, 2)
    )


def takes_of(scenario: Scenario, seed: int, device: int | None = None) -> tuple[list[Demonstration], Task]:
    """Takes of a random task of seven keyframes; by a device of their own, or another."""
    task = random_task(seed, moves=6)
    model = PHONE if scenario.sensor == "phone" else SENSOR_MODELS[scenario.sensor]
    made, rng, demos = one_device(model, seed if device is None else device), np.random.default_rng(seed + 77_000), []
    for k in range(scenario.takes):
        Q = TURNS[k % len(TURNS)] if scenario.turned else TURNS[0]
        lever = scenario.lever_m * rng.normal(size=3) if k else np.zeros(3)
        demo = simulate(_take(task, scenario, Q, lever, rng), made, 1000 * seed + k)
        info = replace(demo.recording.info, name=f"take {k + 1}")
        demos.append(replace(demo, recording=replace(demo.recording, info=info)))
    return demos, task


def hand_poses(task: Task) -> tuple[Array, Array]:
    """The task's keyframes: p (n, 3) m, wxyz (n, 4), of the hand in the simulated world."""
    wxyz = [quat_from_rpy(task.start_rpy)]
    for waypoint in task.waypoints[1:]:
        wxyz.append(quat_multiply(wxyz[-1], quat_exp(waypoint.turn)))
    return np.array([waypoint.p for waypoint in task.waypoints]), np.array(wxyz)


def _take(task: Task, scenario: Scenario, Q: Array, lever: Array, rng: np.random.Generator) -> Task:
    """One take: the hand misses each place but the dock, its pace differs, the sensor sits turned and shifted in it."""
    p, A = hand_poses(task)
    miss, tilt, pace = rng.normal(size=p.shape), rng.normal(size=p.shape), np.exp(0.1 * rng.normal(size=len(p)))
    miss[0] = tilt[0] = 0.0
    A = quat_multiply(quat_exp(scenario.tilt_rad * tilt), A)
    p, wxyz = p + scenario.scatter_m * miss + quat_rotate(A, lever), quat_multiply(A, quat_inverse(Q))
    turns = np.vstack((np.zeros((1, 3)), quat_log(quat_multiply(quat_inverse(wxyz[:-1]), wxyz[1:]))))
    waypoints = [
        Waypoint(tuple(where), tuple(turn), waypoint.move_s * slower, waypoint.rest_s)
        for where, turn, slower, waypoint in zip(p.tolist(), turns.tolist(), pace.tolist(), task.waypoints, strict=True)
    ]
    return Task(task.name, tuple(waypoints), start_rpy=tuple(quat_to_rpy(wxyz[0]).tolist()))


if __name__ == "__main__":
    main()
