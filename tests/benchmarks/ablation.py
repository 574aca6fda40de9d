"""What each idea of the tracker gains: python tests/benchmarks/ablation.py [--data DIR] [--json] [--quick].

The figures of tracking.py, windows scored at the sensor, and the median error of keyframes on simulated tasks, with one
idea at a time taken out: a constant set to where it does nothing, or a function replaced by the plain one. The last row
shows how much of the windows' error is the reference's own: the optics' velocity is known from their positions only.
"""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.errors import PbdError, PbdWarning
from pbd.pose import Array, quat_exp, quat_log, quat_multiply
from pbd.sensors.simulate import random_task, simulate
from pbd.tracking import integration, lag, legs, orientation, smoothing, stops
from tests.benchmarks import trials
from tests.benchmarks.report import add_data, arguments, print_machine
from tests.benchmarks.tracking import score
from tests.scenarios import keyframes_and_errors

SENSORS = ("modern", "os5000", "wt901")


def half_and_half(t: Array, gyr: Array, interval: float) -> Array:
    """Turn from one middle to the next as half of each sample's own turn, in place of the cubic."""
    dt = np.diff(t, prepend=t[0] - interval)[:, None]
    before = np.vstack((gyr[:1], gyr[:-1]))
    return quat_log(quat_multiply(quat_exp(0.5 * dt * before), quat_exp(0.5 * dt * gyr)))


def own_turn(t: Array, gyr: Array, interval: float) -> Array:
    """Turn of the sample's own interval: the attitude is that of its end, half a sample late."""
    return np.asarray(np.diff(t, prepend=t[0] - interval)[:, None] * gyr)


def trapezoids(t: Array, means: Array) -> Array:
    """Integrate samples as values at their instants."""
    steps = 0.5 * np.diff(t)[:, None] * (means[1:] + means[:-1])
    return np.vstack((np.zeros((1, 3)), np.cumsum(steps, axis=0)))


Change = tuple[ModuleType, str, object]

WITHOUT: dict[str, tuple[Change, ...]] = {
    "nothing": (),
    "half-sample alignment": tuple((m, "turns_between_middles", own_turn) for m in (orientation, smoothing)),
    "cubic turns, coning": tuple((m, "turns_between_middles", half_and_half) for m in (orientation, smoothing)),
    "cubic velocity": tuple((m, "integral_of_means", trapezoids) for m in (integration, smoothing, legs)),
    "samples beside a move": ((integration, "BESIDE", 0),),
    "tilt time constant 6 s (then VQF's 3 s)": ((orientation, "VQF", orientation.VQF | {"tauAcc": 3.0}),),
    "attitude held by the stops": ((smoothing, "_hold_tilt", lambda r, attitude, *_: attitude.wxyz_nav_sensor),),
    "gyro bias from calm stops": ((smoothing, "_bias_left", lambda *_: np.zeros(3)),),
    "gyro's lag from the closures (then none)": (
        (smoothing, "LAG_S", 0.0),
        (smoothing, "find_lag", lambda *_: 0.0),
    ),
    "gyro's lag from the closures (then 1 ms)": ((smoothing, "find_lag", lambda *_: lag.LAG_S),),
    "acceleration zero at stops": ((smoothing, "_zero_at_stops", lambda t, a_nav, *_: a_nav),),
    "stops' edges left out": ((integration, "EDGE_S", 0.0),),
    "drift where it arose (then evenly)": ((integration, "EVEN_DRIFT", 1e6),),
    "drift by acceleration": ((integration, "MOTION_DRIFT", 0.0),),
    "lulls between strides": ((stops, "PEAK_SHARE", 0.0),),
    "coasting found out": ((stops, "COAST_SPEED", 1e6),),
    "steadiness asked of a rest": ((stops, "STEADY_ACC", 1e6),),
    "(nothing, but the optics' velocity over 25 samples)": ((trials, "VELOCITY_SAMPLES", 25),),
}
"""Idea taken out -> what is put in its place."""


@contextmanager
def changed(changes: tuple[Change, ...]) -> Iterator[None]:
    """Put other values in the place of modules' own for a while."""
    kept = [(module, name, getattr(module, name)) for module, name, _ in changes]
    try:
        for module, name, value in changes:
            setattr(module, name, value)
        yield
    finally:
        for module, name, value in kept:
            setattr(module, name, value)


def main() -> None:
    """Score with each idea taken out, and print."""
    parser = arguments(str(__doc__))
    add_data(parser)
    args = parser.parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    rows = {}
    for name, changes in WITHOUT.items():
        with changed(changes):
            rows[name] = row(score(args.data, ("286", "40"))) | simulated(range(3 if args.quick else 12))
    if args.json:
        print(json.dumps(rows))
        return
    print_machine()
    columns = list(rows["nothing"])
    print("| taken out | " + " | ".join(columns) + " |")
    print("|---" * (len(columns) + 1) + "|")
    for name, values in rows.items():
        print(f"| {name} | " + " | ".join(f"{value:.3g}" for value in values.values()) + " |")


def row(figures: dict[str, Any]) -> dict[str, float]:
    """The figures that tell the ideas apart, cm at 40 Hz; F1 is that of the worst trial."""
    windows = figures["windows_at_sensor"]
    slow, turning, fast = (windows[f"{kind}"] for kind in ("slow_translation", "slow_rotation", "fast_translation"))
    (strides,), (walk,) = figures["strides"].values(), figures["walks"].values()
    return {
        "slow 1 s": slow["1"]["40"]["median_cm"],
        "slow 5 s p95": slow["5"]["40"]["p95_cm"],
        "rotation 1 s": turning["1"]["40"]["median_cm"],
        "rotation 2 s": turning["2"]["40"]["median_cm"],
        "fast 1 s": fast["1"]["40"]["median_cm"],
        "fast 1 s p95": fast["1"]["40"]["p95_cm"],
        "strides": strides["median_abs_cm"],
        "strides p95": strides["p95_abs_cm"],
        "walk": walk["closure_cm"],
        "F1": min(trial["rates_hz"]["40"]["f1"] for trial in figures["stops"].values()),
    }


def simulated(seeds: range) -> dict[str, float]:
    """Median error of all keyframes of everyday and random tasks, mm."""
    medians = {}
    for sensor in SENSORS:
        errors: list[float] = []
        for seed in seeds:
            for task in ("pick-and-place-stops", "pour", random_task(seed, moves=5)):
                try:
                    errors.extend(keyframes_and_errors(simulate(task, sensor, seed))[1][1:])
                except PbdError:  # an idea taken out may leave no path at all
                    errors.append(np.inf)
        medians[f"{sensor}, mm"] = 1e3 * float(np.median(errors))
    return medians


if __name__ == "__main__":
    main()
