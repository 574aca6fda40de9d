"""The live tracker: time a sample, how soon stops are told, how good they are.

python tests/benchmarks/live.py [--data DIR] [--json] [--quick]

Simulated tasks with truth, and the stops of the trials under DIR/broad (default: PBD_DATA, or ../shared/data), each
beside the batch tracker. --quick: one seed a task, no trials.
"""

import sys
import time
import warnings
from collections.abc import Sequence
from math import radians
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from numpy.typing import NDArray

from pbd.data import Demonstration, Keyframe, Recording, Stop
from pbd.errors import PbdError, PbdWarning
from pbd.pipeline import track
from pbd.simulation.simulate import TASKS, random_task, simulate
from pbd.simulation.tasks import Task
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.online.tracker import LiveTracker, StopBegan
from tests.benchmarks.report import add_data, arguments, finish
from tests.benchmarks.trials import read_broad
from tests.scenarios import truth_at

SIMULATED_HZ = (40.0, 100.0, 286.0)
SENSORS = ("modern", "os5000", "wt901")

AT_REST = 0.01
"""m/s: a hand faster than this when its stop is told did not stop."""


def main() -> None:
    """Measure and print."""
    parser = arguments(str(__doc__))
    add_data(parser)
    args = parser.parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    seeds = range(1 if args.quick else 10)
    figures: dict[str, Any] = {"sample_us": {f"{rate:g}": times_us(rate) for rate in SIMULATED_HZ}}
    everyday = [(task, seed) for seed in seeds for task in (*TASKS.values(), random_task(seed))]
    slow = [(random_task(seed, move_s=(1.5, 3.0), max_turn=radians(20.0)), seed) for seed in seeds]
    for name, tasks in (("everyday", everyday), ("slow", slow)):
        figures[name] = {
            f"{sensor}_{rate:g}": quality([simulate(task, sensor, seed, rate_hz=rate) for task, seed in tasks], tasks)
            for sensor in SENSORS
            for rate in SIMULATED_HZ
        }
    if not args.quick:
        figures["stops_f1"] = {file.stem: f1_scores(file) for file in sorted((args.data / "broad").glob("*.npz"))}
    finish(figures, args.json)


def run(recording: Recording) -> tuple[LiveTracker, list[StopBegan], list[float]]:
    """Feed a recording row by row: the tracker, its stops as they were told, and the time of each row in us."""
    tracker, told, times = LiveTracker(recording.info.sensor), [], []
    for k in range(len(recording)):
        row = (
            None if channel is None else channel[k]
            for channel in (recording.acc, recording.gyr, recording.mag, recording.device_rpy)
        )
        start = time.perf_counter()
        events = tracker.feed(recording.t[k], *row)  # type: ignore[arg-type]
        times.append(1e6 * (time.perf_counter() - start))
        told += [event for event in events if isinstance(event, StopBegan)]
    return tracker, told, times


def times_us(rate_hz: float) -> dict[str, float]:
    """What a sample takes, over one everyday task: of three runs the shortest, which other programs disturbed least."""
    recording = simulate("pour", "modern", 0, rate_hz=rate_hz).recording
    times = np.min([run(recording)[2] for _ in range(3)], axis=0)
    return {"median": float(np.median(times)), "p99": float(np.percentile(times, 99)), "max": float(times.max())}


def quality(demos: Sequence[Demonstration], tasks: Sequence[tuple[Task, int]]) -> dict[str, float]:
    """How soon stops are told after they began, which ones, and how far keyframes are from the truth."""
    late: list[float] = []
    errors: dict[str, list[float]] = {"live": [], "batch": []}
    scaled: list[float] = []
    stops = false = missed = batch_off = 0
    for demo, (task, _) in zip(demos, tasks, strict=True):
        assert demo.truth is not None
        t, speed = demo.truth.t, np.linalg.norm(np.gradient(demo.truth.p_nav_sensor, demo.truth.t, axis=0), axis=1)
        ends = np.cumsum([w.move_s + w.rest_s for w in task.waypoints])
        starts = ends - [w.rest_s for w in task.waypoints]
        tracker, told, _ = run(demo.recording)
        met: dict[int, float] = {}
        for event in {event.index: event for event in reversed(told)}.values():
            if event.index == 0:
                continue
            nearest = int(np.argmin(np.maximum(starts - event.announced_t, event.announced_t - ends)))
            if nearest in met or np.interp(event.announced_t, t, speed) > AT_REST:
                false += 1
            else:
                met[nearest] = event.announced_t - starts[nearest]
        late += met.values()
        stops += len(starts) - 1
        missed += len(starts) - 1 - len(met)
        batch = find_keyframes(track(demo.recording))
        batch_off += len(batch) != len(starts)
        for name, keyframes in (("live", tracker.keyframes), ("batch", batch)):
            errors[name] += [100.0 * float(np.linalg.norm(off(demo, keyframe))) for keyframe in keyframes[1:]]
        for keyframe in tracker.keyframes[1:]:
            scaled += (off(demo, keyframe) / np.sqrt(np.diagonal(keyframe.cov)[:3])).tolist()
    inside = np.abs(scaled)
    return {
        "stops": stops,
        "missed": missed,
        "false": false,
        "tasks_where_batch_differs": batch_off,
        "late_s_median": float(np.median(late)),
        "late_s_p95": float(np.percentile(late, 95)),
        "late_s_max": max(late),
        "live_cm_median": float(np.median(errors["live"])),
        "live_cm_p95": float(np.percentile(errors["live"], 95)),
        "batch_cm_median": float(np.median(errors["batch"])),
        "batch_cm_p95": float(np.percentile(errors["batch"], 95)),
        "inside_1_sigma": float((inside < 1.0).mean()),
        "inside_2_sigma": float((inside < 2.0).mean()),
    }


def off(demo: Demonstration, keyframe: Keyframe) -> NDArray[np.float64]:
    """By how much a keyframe is off the truth, (3,) m."""
    assert demo.truth is not None
    return keyframe.T_nav_sensor.p - truth_at(demo.truth, keyframe.t)


def f1_scores(file: Path) -> dict[str, dict[str, float]]:
    """F1 of the still samples of a trial at each of its rates, live and batch; no number where it is refused."""
    scores = {}
    for rate, trial in read_broad(file).items():
        live = run(trial.recording)[0].stops
        try:
            batch = f1(track(trial.recording).stops, trial.moving)
        except PbdError:
            batch = np.nan
        scores[rate] = {"live": f1(live, trial.moving), "batch": batch}
    return scores


def f1(stops: tuple[Stop, ...], moving: NDArray[np.bool_]) -> float:
    """Of still samples against not `moving`."""
    still = np.zeros(len(moving), dtype=bool)
    for stop in stops:
        still[stop.start : stop.stop] = True
    return float(2.0 * (still & ~moving).sum() / (still.sum() + (~moving).sum()))


if __name__ == "__main__":
    main()
