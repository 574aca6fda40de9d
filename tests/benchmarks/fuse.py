"""What several takes of one task gain, simulated: tests/benchmarks/fuse.py [--seeds N] [--keep FILE].

A hand does a random task of seven keyframes (moves of 0.5 to 1.5 s, a reach of 30 cm) several times with one device.
It starts at a dock, meets each other keyframe to within 0.5 mm and 1 degree per axis (`scatter_4mm`: 4 mm), at a pace
that differs by 10 % from move to move. In `turned` the sensor sits otherwise in the hand in each take: by a quarter
about the vertical, about a level axis, and so on. In `lever_10mm` it is also shifted by 10 mm per axis.

Errors are those of all keyframes but the first, mm: in the dock's frame (origin at the first keyframe, heading of the
first take there), as an arm follows them; and in `shape` after the best turn about the vertical and shift, which leaves
out the dock's own share. `plain`: each take tracked alone and registered to the first, and then the mean: it is told
no more than the joint estimate. `told`: the joint estimate with the device's true errors as its prior, and with the
true axes of its case: what no estimate from these takes alone beats by much. `exact_hand`: the hand misses nothing.
Seeds from 1000 on were never used to choose anything.
`inside`: errors per axis within one and two of their own sigma. `success`: see success.py. `learned`: the share of
scatters that are found between 3.4 and 4.4 mm, and `learned_at_best` by a tracker that errs in nothing. `thing`: the
share in which keyframes are said to move with a thing, as they do in `moved_thing` only. `fuse4_s`, `fuse10_s`: process
time of `pbd.fuse`, tracking included.
"""

import json
import sys
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from scipy.special import chdtr

from pbd.data import Demonstration, HandPath
from pbd.errors import PbdError, PbdWarning
from pbd.fusion.fuse import estimate_task
from pbd.fusion.joint_estimate import estimate_jointly
from pbd.fusion.marginals import estimate_with_device, marginal_of
from pbd.fusion.matching import Keyframes, align_takes, match_by_moves, match_by_pose, register
from pbd.fusion.result import fused_hand_path
from pbd.fusion.scatter import common_scatter
from pbd.fusion.takes import Take, initial_estimate, matched_keyframes, tracked_take
from pbd.pipeline import fuse, fused_demo
from pbd.pose import (
    Array,
    Pose,
    quat_about_z,
    quat_exp,
    quat_from_matrix,
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
from tests.benchmarks.success import reliability, said_and_happened

DEG, MM = np.pi / 180.0, 1e-3
QUARTER = 0.5 * np.pi
TURNS = [quat_exp(v) for v in ((0.0, 0.0, 0.0), (0.0, 0.0, QUARTER), (QUARTER, 0.0, 0.0), (0.0, 0.0, 2.0 * QUARTER))]
TURNS += [quat_multiply(quat_exp((0.0, QUARTER, 0.0)), turn) for turn in TURNS]
"""How the sensor sits in the hand: turned by a quarter between takes, about the vertical and about level axes."""

FIRST_SEED = 1000
TAKES = (1, 2, 4, 8)
LEARNED_MM = 3.4, 4.4
"""What a scatter of 4 mm is to be found within."""

DOCKS = 20
"""Draws of the dock's error for each fusion, of which success is counted."""


@dataclass(frozen=True)
class OneDevice(Triad):
    """A triad whose errors are those of one device, whatever the noise."""

    device: int = 0

    @property
    def errors(self) -> tuple[Array, Array]:
        """Gain (3, 3) and bias (3,), of the true values."""
        drawn = np.random.default_rng(self.device)
        gain = np.eye(3) + np.diag(self.scale * drawn.normal(size=3))
        gain += self.misalignment * drawn.normal(size=(3, 3)) * (1.0 - np.eye(3))
        return gain, self.bias * drawn.normal(size=3)

    def measure(
        self, true: Array, interval_s: Array, rng: np.random.Generator, device: np.random.Generator | None = None
    ) -> Array:
        """What it reads: see Triad. Its errors are its own."""
        gain, bias = self.errors
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
    thing: tuple[int, int] | None = None
    """First and last keyframe of a thing that stands elsewhere in each take but the first."""


SCENARIOS: dict[tuple[str, ...], Scenario] = {
    **{("sensors", sensor, "same", "4"): Scenario(sensor, 4, turned=False) for sensor in ("wt901", "phone", "os5000")},
    **{
        ("sensors", sensor, "turned", str(n)): Scenario(sensor, n)
        for sensor in ("wt901", "phone", "os5000")
        for n in TAKES
    },
    **{("scatter_4mm", "wt901", str(n)): Scenario("wt901", n, scatter_m=4.0 * MM) for n in (1, 4, 8)},
    **{
        ("exact_hand", sensor, str(n)): Scenario(sensor, n, scatter_m=0.0, tilt_rad=0.0)
        for sensor in ("wt901", "phone")
        for n in (1, 4, 8)
    },
    ("lever_10mm", "", "4"): Scenario("wt901", 4, lever_m=10.0 * MM),
    ("moved_thing", "", "3"): Scenario("wt901", 3, thing=(3, 4)),
}
"""Where each kind's figures stand."""


def main() -> None:
    """Simulate, fuse, score, print."""
    parser = arguments(str(__doc__))
    parser.add_argument("--seeds", type=int, default=12, metavar="N", help="tasks of each kind (12)")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="a line of JSON for each fusion; none is made twice")
    args = parser.parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    outcomes = _outcomes(range(FIRST_SEED, FIRST_SEED + (3 if args.quick else args.seeds)), args.keep)
    figures: dict[str, Any] = {"seeds": len(next(iter(outcomes.values())))}
    for (*held, last), each in zip(SCENARIOS, outcomes.values(), strict=True):
        at = figures
        for key in filter(None, held):
            at = at.setdefault(key, {})
        at[last] = score(each)
    turned = [one for scenario, each in outcomes.items() if _usual(scenario) for one in each if one]
    off = np.concatenate([one["sigmas"] for one in turned])
    figures |= {"inside_1_sigma": float((off < 1.0).mean()), "inside_2_sigma": float((off < 2.0).mean())}
    figures["success"] = reliability([tuple(case) for one in turned for case in one["success"]])
    figures |= {f"learned_at_best_{n}": learned_at_best(n) for n in (4, 8)}
    figures |= {f"fuse{n}_s": fuse_seconds(n) for n in (4, 10)}
    finish(figures, args.json)


def _usual(scenario: Scenario) -> bool:
    """Fused of takes that are turned, by a hand that scatters little: what sigmas and success are counted of."""
    return scenario.takes > 1 and scenario == Scenario(scenario.sensor, scenario.takes)


def _outcomes(seeds: Sequence[int], keep: Path | None) -> dict[Scenario, list[dict[str, Any]]]:
    """Of each scenario each seed's, {} where lost: those that are kept, and the others made and kept."""
    kept = {}
    if keep is not None and keep.exists():
        kept = {(line["scenario"], line["seed"]): line["outcome"] for line in map(json.loads, keep.open())}
    for seed in seeds:
        for scenario in SCENARIOS.values():
            if (str(scenario), seed) in kept:
                continue
            kept[str(scenario), seed] = made = outcome(scenario, seed)
            if keep is not None:
                with keep.open("a") as file:
                    file.write(json.dumps({"scenario": str(scenario), "seed": seed, "outcome": made}) + "\n")
    return {scenario: [kept[str(scenario), seed] for seed in seeds] for scenario in SCENARIOS.values()}


def outcome(scenario: Scenario, seed: int) -> dict[str, Any]:
    """Errors of one fusion, mm; {} where it fails or has other keyframes than the task."""
    kind = [other for other in SCENARIOS.values() if other == replace(scenario, takes=other.takes)]
    most = max(kind, key=lambda other: other.takes)
    demos, task = _shown(most, seed)
    demos = demos[: scenario.takes]
    try:
        takes = [_tracked(most, seed, k) for k in range(scenario.takes)]
        # As `fuse` does it, but that each take is tracked once for all columns.
        path = (
            fused_hand_path(fused_demo(demos), estimate_task(takes), None, False) if len(takes) > 1 else takes[0].path
        )
        plain = plain_average([take.path for take in takes])
        told = told_device(takes, one_device(SENSOR_MODELS[scenario.sensor], seed))
    except PbdError:
        return {}
    (p, sigma), (true, A) = _keyframes(path), hand_poses(task)
    if len({len(p), len(plain), len(told.p), len(true)}) > 1:
        return {}
    belongs = [Pose(*pose) for pose in zip(true, A, strict=True)]

    def in_dock(p: Array, wxyz: Array) -> Array:
        """Errors of keyframes with an attitude at the first."""
        errors: Array = (p - p[0]) - (true - true[0]) @ _turn(-yaw_toward(wxyz, A[0])).T
        return errors[1:]

    alone, there = (find_keyframes(one)[0].T_nav_sensor.wxyz for one in (takes[0].path, path))
    off = {"joint": in_dock(p, there), "plain": in_dock(plain, alone)}
    off["told"] = in_dock(told.p, quat_from_matrix(told.R[0]))
    off |= {"shape": _shape(p, true), "plain_shape": _shape(plain, true), "told_shape": _shape(told.p, true)}
    return {name: (1e3 * np.linalg.norm(each, axis=1)).tolist() for name, each in off.items()} | {
        "sigmas": (np.abs(off["joint"]) / sigma[1:]).ravel().tolist(),
        "success": said_and_happened(path, belongs, np.random.default_rng(seed), DOCKS),
        "thing": path.fusion is not None and path.fusion.thing is not None,
        "scatter": None if path.fusion is None else 1e3 * path.fusion.overall[0],
    }


@lru_cache(maxsize=1)
def _shown(scenario: Scenario, seed: int) -> tuple[list[Demonstration], Task]:
    return takes_of(scenario, seed)


@lru_cache(maxsize=max(TAKES))
def _tracked(scenario: Scenario, seed: int, k: int) -> Take:
    return tracked_take(_shown(scenario, seed)[0][k], None, accept_gap=False)


def score(outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Errors of one kind, mm."""
    there = [one for one in outcomes if one]
    names = ("joint", "plain", "told", "shape", "plain_shape", "told_shape")
    size = {name: np.concatenate([one[name] for one in there]) for name in names}
    figures: dict[str, Any] = {
        "median_mm": float(np.median(size["joint"])),
        "p95_mm": float(np.percentile(size["joint"], 95)),
        "plain_median_mm": float(np.median(size["plain"])),
        "plain_p95_mm": float(np.percentile(size["plain"], 95)),
        "shape_median_mm": float(np.median(size["shape"])),
        "plain_shape_median_mm": float(np.median(size["plain_shape"])),
        "told_median_mm": float(np.median(size["told"])),
        "told_p95_mm": float(np.percentile(size["told"], 95)),
        "told_shape_median_mm": float(np.median(size["told_shape"])),
        "lost": len(outcomes) - len(there),
        "thing": float(np.mean([one["thing"] for one in there])),
    }
    if there[0]["scatter"] is not None:
        learned = np.array([one["scatter"] for one in there])
        figures |= {
            "scatter_mm": float(np.median(learned)),
            "learned": float(((learned > LEARNED_MM[0]) & (learned < LEARNED_MM[1])).mean()),
        }
    return figures


def learned_at_best(takes: int) -> float:
    """The share of scatters found well by the six keyframes' spread alone, along three axes."""
    freedom = 3 * 6 * (takes - 1)
    low, high = (freedom * (mm * MM / SCENARIOS["scatter_4mm", "wt901", "4"].scatter_m) ** 2 for mm in LEARNED_MM)
    return float(chdtr(freedom, high) - chdtr(freedom, low))


def errors_of(device: SensorModel) -> tuple[Array, Array]:
    """A device's true errors as the smoother has them, (DEVICE_ERRORS,), and the case's axes (3, 3) in the smoother's.

    The smoother's axes are the accelerometer's: its inverse gain is a turn and a lower triangle.
    """
    assert isinstance(device.acc, OneDevice)
    assert isinstance(device.gyr, OneDevice)
    (of_acc, bias), (of_gyr, _) = device.acc.errors, device.gyr.errors
    flip = np.eye(3)[::-1]
    turn, upper = np.linalg.qr(flip @ np.linalg.inv(of_acc) @ flip)
    sign = np.sign(np.diagonal(upper))
    case_axes, lower = flip @ (turn * sign) @ flip, flip @ (sign[:, None] * upper) @ flip
    N, M = np.eye(3) - lower, np.eye(3) - case_axes.T @ np.linalg.inv(of_gyr)
    return np.concatenate(([0.0], M.ravel(), N[np.tril_indices(3)], [9.81], lower @ bias)), case_axes.T


def told_device(takes: Sequence[Take], device: SensorModel) -> Keyframes:
    """What could be had of these takes: their joint estimate, told the device's errors and the case's axes."""
    errors, case = errors_of(device)
    told = []
    for take in takes:
        marginal = marginal_of(take.solution, take.knots, estimate_with_device(take.solution, errors))
        marginal = replace(marginal, prior=1e4 * np.diag(np.diagonal(marginal.prior)), mean=errors)
        told.append(replace(take, marginal=marginal))
    found = align_takes([matched_keyframes(take) for take in told])
    parts, x = initial_estimate(told, sorted(found.registered), found, None)
    x = estimate_jointly(parts, x, common_scatter(len(x.m))).state
    return Keyframes(x.m, x.A @ case, (None,) * len(x.m), np.zeros(len(x.m)))


def plain_average(paths: Sequence[HandPath]) -> Array:
    """Keyframes (n, 3) m: each take alone, registered to the first by its keyframes, and the mean."""
    takes = []
    for path in paths:
        poses = [keyframe.T_nav_sensor for keyframe in find_keyframes(path)]
        R = quat_to_matrix(np.array([pose.wxyz for pose in poses]))
        takes.append(Keyframes(np.array([p.p for p in poses]), R, (None,) * len(R), np.full(len(R), 1.0 * MM)))
    first, places = takes[0], [takes[0].p]
    for take in takes[1:]:
        there = register(first, take, match_by_moves(first, take)).apply(take)
        pairs = dict(match_by_pose(first, there))
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
    model = SENSOR_MODELS[scenario.sensor]
    made, rng, demos = one_device(model, seed if device is None else device), np.random.default_rng(seed + 77_000), []
    for k in range(scenario.takes):
        Q = TURNS[k % len(TURNS)] if scenario.turned else TURNS[0]
        lever = scenario.lever_m * rng.normal(size=3) if k else np.zeros(3)
        shown = task if scenario.thing is None or not k else _moved(task, *scenario.thing, rng)
        demo = simulate(_take(shown, scenario, Q, lever, rng), made, 1000 * seed + k)
        info = replace(demo.recording.info, name=f"take {k + 1}")
        demos.append(replace(demo, recording=replace(demo.recording, info=info)))
    return demos, task


def hand_poses(task: Task) -> tuple[Array, Array]:
    """The task's keyframes: p (n, 3) m, wxyz (n, 4), of the hand in the simulated world."""
    wxyz = [quat_from_rpy(task.start_rpy)]
    for waypoint in task.waypoints[1:]:
        wxyz.append(quat_multiply(wxyz[-1], quat_exp(waypoint.turn)))
    return np.array([waypoint.p for waypoint in task.waypoints]), np.array(wxyz)


def _moved(task: Task, first: int, last: int, rng: np.random.Generator) -> Task:
    """The task with a thing turned about the vertical through its first keyframe, and shifted on the table."""
    p, A = hand_poses(task)
    turn, shift = quat_about_z(rng.uniform(-1.0, 1.0)), np.array([*rng.uniform(-0.1, 0.1, 2), 0.0])
    inside = ((np.arange(len(p)) >= first) & (np.arange(len(p)) <= last))[:, None]
    p = np.where(inside, p[first] + shift + quat_rotate(turn, p - p[first]), p)
    return _through(task, p, np.where(inside, quat_multiply(turn, A), A), np.ones(len(p)))


def _through(task: Task, p: Array, wxyz: Array, slower: Array) -> Task:
    """The task with other keyframes, and moves that last longer by a factor."""
    turns = np.vstack((np.zeros((1, 3)), quat_log(quat_multiply(quat_inverse(wxyz[:-1]), wxyz[1:]))))
    waypoints = [
        Waypoint(tuple(where), tuple(turn), waypoint.move_s * by, waypoint.rest_s)
        for where, turn, by, waypoint in zip(p.tolist(), turns.tolist(), slower.tolist(), task.waypoints, strict=True)
    ]
    return Task(task.name, tuple(waypoints), start_rpy=tuple(quat_to_rpy(wxyz[0]).tolist()))


def _take(task: Task, scenario: Scenario, Q: Array, lever: Array, rng: np.random.Generator) -> Task:
    """One take: the hand misses each place but the dock, its pace differs, the sensor sits turned and shifted in it."""
    p, A = hand_poses(task)
    miss, tilt, pace = rng.normal(size=p.shape), rng.normal(size=p.shape), np.exp(0.1 * rng.normal(size=len(p)))
    miss[0] = tilt[0] = 0.0
    A = quat_multiply(quat_exp(scenario.tilt_rad * tilt), A)
    p, wxyz = p + scenario.scatter_m * miss + quat_rotate(A, lever), quat_multiply(A, quat_inverse(Q))
    return _through(task, p, wxyz, pace)


if __name__ == "__main__":
    main()
