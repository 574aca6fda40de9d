"""Which rates of a phone suffice, simulated: python tests/benchmarks/phones.py [--json] [--quick].

Over 40 seeds a hand makes seven moves of 0.5 to 2.5 s, with rests of 0.5 to 1.2 s between (random_task), and a phone in
it (the sensor model `phone`) reads at 25 to 400 Hz. `acc200_gyr420` has its sensors at rates of their own, joined on
the gyro's clock, as Android's phones give them. `browser` is what a web page gets: 60 Hz, rounded to 0.1 m/s2 and to
0.1 deg/s (W3C, DeviceOrientation Event, section 5). `wt901` is the wired sensor of a few tens of euros.
Errors of keyframes but the first, mm: median and 95th percentile; `inside_2_sigma` is the share of errors, per axis,
within twice the path's own sigma; `other_stops` are recordings in which not just the eight stops are found.
`taps` are two taps in every rest of a second or more, of 30 to 60 m/s2, 0.15 to 0.3 s apart: how many there are, are
found, and are found where there were none.
"""

import sys
import warnings
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.data import Demonstration, Recording, RecordingInfo
from pbd.data.streams import Stream, joined
from pbd.errors import PbdWarning, TrackingError
from pbd.pipeline import track
from pbd.simulation.simulate import SENSOR_MODELS, random_task, simulate
from pbd.simulation.tasks import Task
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.taps import grip_by_taps
from tests.benchmarks.known import keyframe_errors
from tests.benchmarks.report import arguments, finish
from tests.tracking.tapping import tapped

NO_COMPASS = replace(SENSOR_MODELS["phone"], mag=None, rate_hz=60.0)
RATES_HZ = (25.0, 50.0, 100.0, 200.0, 400.0)
ACC_STEP, GYR_STEP = 0.1, np.radians(0.1)


def main() -> None:
    """Simulate, track, print."""
    args = arguments(str(__doc__)).parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    tasks = [
        random_task(seed, moves=7, max_turn=np.radians(40.0), move_s=(0.5, 2.5))
        for seed in range(8 if args.quick else 40)
    ]
    figures: dict[str, Any] = {"seeds": len(tasks)}
    for rate_hz in RATES_HZ:
        demos = [simulate(task, "phone", seed, rate_hz=rate_hz) for seed, task in enumerate(tasks)]
        figures[f"{rate_hz:g}_hz"] = score(demos) | taps(demos, tasks)
    figures["acc200_gyr420"] = score([unequal(task, seed) for seed, task in enumerate(tasks)])
    figures["browser"] = score([rounded(simulate(task, NO_COMPASS, seed)) for seed, task in enumerate(tasks)])
    figures["wt901"] = score([simulate(task, "wt901", seed) for seed, task in enumerate(tasks)])
    finish(figures, args.json)


def score(demos: Sequence[Demonstration]) -> dict[str, Any]:
    """Errors of the keyframes."""
    off, inside, other_stops = [], [], 0
    for demo in demos:
        try:
            path = track(demo.recording)
        except TrackingError:
            path = None
        if path is None or len(path.stops) != 8 or demo.truth is None:
            other_stops += 1
            continue
        errors = keyframe_errors(path, demo.truth)
        sigma = np.sqrt([np.diagonal(keyframe.cov)[:3] for keyframe in find_keyframes(path)[1:]])
        off.append(np.linalg.norm(errors, axis=1))
        inside.append(np.abs(errors) < 2.0 * sigma)
    mm = 1e3 * np.concatenate(off) if off else np.array([np.nan])
    return {
        "median_mm": float(np.median(mm)),
        "p95_mm": float(np.percentile(mm, 95)),
        "inside_2_sigma": float(np.mean(inside)) if inside else float("nan"),
        "other_stops": other_stops,
    }


def unequal(task: Task, seed: int) -> Demonstration:
    """The same phone's sensors at 200, 420 and 100 Hz, joined. A seed draws the same device whatever its rate."""
    acc, gyr, mag = (simulate(task, "phone", seed, rate_hz=hz) for hz in (200.0, 420.0, 100.0))
    given = {"acc": acc, "gyr": gyr, "mag": mag}
    t, at = joined({kind: Stream(each.recording.t, getattr(each.recording, kind)) for kind, each in given.items()})
    info = RecordingInfo(sensor=gyr.recording.info.sensor)
    return replace(gyr, recording=Recording(t, at["acc"], at["gyr"], at["mag"], info=info))


def rounded(demo: Demonstration) -> Demonstration:
    """What a web page is given of it."""
    recording = demo.recording
    assert recording.gyr is not None
    acc, gyr = ACC_STEP * np.round(recording.acc / ACC_STEP), GYR_STEP * np.round(recording.gyr / GYR_STEP)
    return replace(demo, recording=replace(recording, acc=acc, gyr=gyr))


def taps(demos: Sequence[Demonstration], tasks: Sequence[Task]) -> dict[str, int]:
    """Pairs of taps that were made, found, and found where none was."""
    made = found = wrong = 0
    for seed, (demo, task) in enumerate(zip(demos, tasks, strict=True)):
        rng = np.random.default_rng(seed)
        ends = list(accumulate(w.move_s + w.rest_s for w in task.waypoints))
        # In the first part of a long rest: the hand has come to stand still, and stands still after it.
        at = [end - w.rest_s + 0.32 for end, w in zip(ends, task.waypoints, strict=True) if w.rest_s > 1.0]
        blows = [(t + late, rng.uniform(30.0, 60.0)) for t in at for late in (0.0, rng.uniform(0.15, 0.3))]
        marks = [event.t for event in grip_by_taps(tapped(demo.recording, blows))]
        made += len(at)
        found += sum(any(abs(mark - t) < 0.1 for mark in marks) for t in at)
        wrong += sum(all(abs(mark - t) >= 0.1 for t in at) for mark in marks) + len(grip_by_taps(demo.recording))
    return {"taps": made, "taps_found": found, "taps_wrong": wrong}


if __name__ == "__main__":
    main()
