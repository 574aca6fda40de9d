"""How much memory tracking takes, and how long: python tests/benchmarks/memory.py [--json] [--quick].

A simulated demonstration of some twenty seconds, which ends where it began, is repeated to recordings of one hour at
286 Hz, the half and the quarter of it (--quick: of an eighth of an hour), and of ten million samples (not with
--quick; given up after a quarter of an hour), each in a process of its own. Of each: `seconds` and `samples_per_s` of
the whole track(); `process_mb`, the peak of the whole process (ru_maxrss), recording and libraries included;
`track_mb`, the peak of what track() itself allocates beyond the recording (tracemalloc, in a second run; not of the
longest); `stops` found, and how many the repeated demonstration has.

`bytes_per_sample` is how process_mb grows from the quarter to the whole; `linear` is the growth of track_mb over the
second half against that over the second quarter, per sample: 1 where memory grows linearly. `hour_mb` is process_mb
for one hour, which is to be under 1000.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.benchmarks.report import arguments, finish

RATE_HZ = 286.0
HOUR = round(3600.0 * RATE_HZ)
TEN_MILLION = 10_000_000
GIVE_UP_S = 900.0


def main() -> None:
    """Measure and print; with --samples, one recording in this process."""
    parser = arguments(str(__doc__))
    parser.add_argument("--samples", type=int, help="measure one recording of so many samples, in this process")
    args = parser.parse_args()
    if args.samples:
        print(json.dumps(measure(args.samples)))
        return
    longest = HOUR // 8 if args.quick else HOUR
    parts = {"quarter": longest // 4, "half": longest // 2, "whole": longest}
    figures: dict[str, Any] = {name: in_a_process(samples) for name, samples in parts.items()}
    quarter, half, whole = figures.values()
    overall = growth(quarter, whole, "process_mb")
    figures["bytes_per_sample"] = 1e6 * overall
    figures["linear"] = growth(half, whole, "track_mb") / growth(quarter, half, "track_mb")
    figures["hour_mb"] = whole["process_mb"] + overall * (HOUR - longest)
    if not args.quick:
        try:
            figures["ten_million"] = in_a_process(TEN_MILLION)
        except subprocess.TimeoutExpired:
            figures["ten_million"] = {"given_up_after_s": GIVE_UP_S}
    finish(figures, args.json)


def growth(shorter: dict[str, Any], longer: dict[str, Any], key: str) -> float:
    """Megabytes a sample."""
    return float((longer[key] - shorter[key]) / (longer["samples"] - shorter["samples"]))


def in_a_process(samples: int) -> dict[str, Any]:
    """Measure in a process of its own: a peak is never forgotten. (So this one imports nothing large.)"""
    command = [sys.executable, str(Path(__file__)), "--samples", str(samples)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, timeout=GIVE_UP_S)
    figures: dict[str, Any] = json.loads(done.stdout)
    return figures


def measure(samples: int) -> dict[str, Any]:
    """All figures of one recording."""
    import warnings

    import numpy as np

    from pbd.data import Recording
    from pbd.errors import PbdWarning
    from pbd.pipeline import track
    from pbd.pose import Array
    from pbd.sensors.simulate import simulate

    warnings.simplefilter("ignore", PbdWarning)
    demo = simulate("pour", "modern", rate_hz=RATE_HZ).recording
    times = -(-samples // len(demo))

    def tiled(values: Array | None) -> Array | None:
        return None if values is None else np.tile(values, (times, 1))[:samples]

    t = np.arange(samples, dtype=np.float64) / RATE_HZ
    acc = tiled(demo.acc)
    assert acc is not None
    recording = Recording(t, acc, tiled(demo.gyr), tiled(demo.mag))
    del t, acc
    begin = time.perf_counter()
    stops = len(track(recording).stops)
    seconds = time.perf_counter() - begin
    process_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
    # Where one demonstration ends and the next begins, its last rest and their first are one.
    each = len(track(demo).stops) - 1
    figures = {
        "samples": samples,
        "seconds": seconds,
        "samples_per_s": samples / seconds,
        "process_mb": process_mb,
        "stops": stops,
        "stops_of_tiles": round(samples / len(demo) * each) + 1,
    }
    if samples <= HOUR:
        tracemalloc.start()
        track(recording)
        figures["track_mb"] = tracemalloc.get_traced_memory()[1] / 1e6
    return figures


if __name__ == "__main__":
    main()
