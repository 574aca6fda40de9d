"""How much memory tracking takes, and how long: python tests/benchmarks/memory.py [--json] [--quick].

A simulated demonstration of some minutes, which ends where it began, is repeated to recordings of one hour at 286 Hz,
the half and the quarter of it (--quick: of an eighth of an hour), and of ten million samples, 9.7 h (not with --quick),
each tracked in a process of its own. Three kinds:

- `moves`: pouring again and again, a move and a rest in two seconds;
- `rests`: the hand never moves;
- `faults`: faster moves, which clip the accelerometer and the gyro; of each pouring ten rows are missing in a move, and
  0.3 s in a rest.

--samples N [--kind K] measures one recording alone, and prints JSON. Of each:

- `seconds` of processor time, and `samples_per_s`, of the whole track();
- `process_mb`, the peak of the whole process (ru_maxrss), recording and libraries included;
- `track_mb`, the peak of what track() itself allocates beyond the recording (tracemalloc, in a second run; up to an
  hour);
- `stops` found, and how many there are;
- `off_m`, by how much the last keyframe is off, and `off_sigma`, by how many sigmas the worst one is (the norm of each,
  along three axes: 2.8 is rare).

`bytes_per_sample` is how process_mb grows from the quarter of moves to the whole; `linear` is the growth of track_mb
over the second half against that over the second quarter, per sample: 1 where memory grows linearly. `hour_mb` is
process_mb for one hour, which is to be under 1000.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.benchmarks.report import arguments, finish
from tests.not_none import not_none

if TYPE_CHECKING:
    from pbd.data import Demonstration, Recording, Stop
    from pbd.pose import Array

RATE_HZ = 286.0
HOUR = round(3600.0 * RATE_HZ)
TEN_MILLION = 10_000_000
GIVE_UP_S = 900.0
KINDS = ("moves", "rests", "faults")

WARM_UP = 5000
"""Samples that are tracked first, and not counted."""

ROUNDING = 1e-6
"""m/s2, rad/s, uT: by up to this much a repeated recording's rows differ from those before."""

TIMES = 16
"""The hand pours so often in one demonstration."""

HASTE, ACC_LIMIT, GYR_LIMIT = 0.6, 12.0, 2.6
"""Of faults: so much of the usual time for each move, and where the ranges end, m/s2 and rad/s."""

HOLE, HOLE_IN_REST = (0.2, 0.235), (-1.0, -0.7)
"""Of faults: what the gyro leaves out, and the accelerometer, in s from where the hand sets out to pour."""


def main() -> None:
    """Measure and print; with --samples, one recording in this process."""
    parser = arguments(str(__doc__))
    parser.add_argument("--samples", type=int, help="measure one recording of so many samples, in this process")
    parser.add_argument("--kind", choices=KINDS, default="moves", help="of which kind (moves)")
    args = parser.parse_args()
    if args.samples:
        print(json.dumps(measure(args.samples, args.kind)))
        return
    longest = HOUR // 8 if args.quick else HOUR
    parts = {"quarter": longest // 4, "half": longest // 2, "whole": longest}
    figures: dict[str, Any] = {name: in_a_process(samples, "moves") for name, samples in parts.items()}
    quarter, half, whole = figures.values()
    overall = growth(quarter, whole, "process_mb")
    figures["bytes_per_sample"] = 1e6 * overall
    figures["linear"] = growth(half, whole, "track_mb") / growth(quarter, half, "track_mb")
    figures["hour_mb"] = whole["process_mb"] + overall * (HOUR - longest)
    for kind in KINDS:
        figures[kind] = {"short": in_a_process(longest // 4, kind)}
        if not args.quick:
            figures[kind]["ten_million"] = in_a_process(TEN_MILLION, kind)
    finish(figures, args.json)


def growth(shorter: dict[str, Any], longer: dict[str, Any], key: str) -> float:
    """Megabytes a sample."""
    return float((longer[key] - shorter[key]) / (longer["samples"] - shorter["samples"]))


def in_a_process(samples: int, kind: str) -> dict[str, Any]:
    """Measure in a process of its own: a peak is never forgotten. (So this one imports nothing large.)"""
    command = [sys.executable, str(Path(__file__)), "--samples", str(samples), "--kind", kind]
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, timeout=GIVE_UP_S)
    except subprocess.TimeoutExpired:
        return {"given_up_after_s": GIVE_UP_S}
    figures: dict[str, Any] = json.loads(done.stdout)
    return figures


def measure(samples: int, kind: str) -> dict[str, Any]:
    """All figures of one recording."""
    import warnings

    import numpy as np

    from pbd.errors import PbdWarning
    from pbd.pipeline import track

    warnings.simplefilter("ignore", PbdWarning)
    with ProcessPoolExecutor(1) as elsewhere:  # what it takes to simulate is not to be counted
        once, true, stops = elsewhere.submit(made, kind).result()
    track(repeated(once, WARM_UP), accept_gap=True)  # imports what is imported late
    recording = repeated(once, samples)
    begin = time.process_time()
    path = track(recording, accept_gap=True)  # of faults
    seconds = time.process_time() - begin
    process_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6

    rows = np.array([(stop.start + stop.stop - 1) // 2 for stop in path.stops])
    off = np.linalg.norm(path.p_nav_sensor[rows] - true[rows % len(true)], axis=1)
    sigma = np.sqrt(np.trace(path.cov[:, :3, :3], axis1=1, axis2=2))
    figures = {
        "samples": samples,
        "seconds": seconds,
        "samples_per_s": samples / seconds,
        "process_mb": process_mb,
        "stops": len(path.stops),
        "stops_there_are": there_are(stops, len(true), samples),
        "off_m": float(off[-1]),
        "off_sigma": float((off[1:] / sigma[1:]).max(initial=0.0)),
    }
    if samples <= HOUR:
        del path
        tracemalloc.start()
        track(recording, accept_gap=True)
        figures["track_mb"] = tracemalloc.get_traced_memory()[1] / 1e6
    return figures


def made(kind: str) -> tuple[Recording, Array, tuple[Stop, ...]]:
    """One demonstration of a kind, its true positions, and its stops."""
    from pbd.pipeline import track

    demo = simulated(kind)
    return demo.recording, not_none(demo.truth).p_nav_sensor, track(demo.recording, accept_gap=True).stops


def simulated(kind: str, rate_hz: float = RATE_HZ) -> Demonstration:
    """One demonstration of a kind."""
    from dataclasses import replace

    from pbd.simulation.simulate import SENSOR_MODELS, TASKS, simulate

    task, model = TASKS["pour"], SENSOR_MODELS["modern"]
    if kind == "faults":
        task = replace(task, waypoints=tuple(replace(w, move_s=HASTE * w.move_s) for w in task.waypoints))
        model = replace(
            model, acc=replace(model.acc, limit=ACC_LIMIT), gyr=replace(not_none(model.gyr), limit=GYR_LIMIT)
        )
    dock, pouring = task.waypoints[0], task.waypoints[1:]
    if kind == "rests":
        return simulate(
            replace(task, waypoints=(replace(dock, rest_s=TIMES * task.duration_s),)), model, rate_hz=rate_hz
        )
    demo = simulate(replace(task, waypoints=(dock, *(TIMES * pouring))), model, rate_hz=rate_hz)
    if kind == "moves":
        return demo
    once_s = task.duration_s - dock.rest_s
    sets_out = [round((dock.rest_s + k * once_s) * rate_hz) for k in range(TIMES)]
    acc, gyr = demo.recording.acc.copy(), not_none(demo.recording.gyr).copy()
    for values, hole in ((gyr, HOLE), (acc, HOLE_IN_REST)):
        for row in sets_out:
            values[row + round(hole[0] * rate_hz) : row + round(hole[1] * rate_hz)] = float("nan")
    return replace(demo, recording=replace(demo.recording, acc=acc, gyr=gyr))


def repeated(recording: Recording, samples: int, rate_hz: float = RATE_HZ) -> Recording:
    """Again and again, each time with other rounding: a block that comes twice to the bit is refused."""
    import numpy as np

    from pbd.data import Recording

    rng = np.random.default_rng(0)

    def again(values: Array | None) -> Array | None:
        return None if values is None else np.resize(values, (samples, 3)) + rng.uniform(0.0, ROUNDING, (samples, 1))

    t = np.arange(samples, dtype=np.float64) / rate_hz
    acc = again(recording.acc)
    return Recording(t, not_none(acc), again(recording.gyr), again(recording.mag))


def there_are(stops: Sequence[Stop], n: int, samples: int) -> int:
    """How many stops have begun in a repeated demonstration of n samples: its last rest and its first one are one."""
    whole, rest = divmod(samples, n)
    return whole * (len(stops) - 1) + max(sum(stop.start < rest for stop in stops), 1)


if __name__ == "__main__":
    main()
