"""What each part of the tracker gains: python tests/benchmarks/ablation.py [--data DIR] [--quick] [--only WORD].

One part at a time is taken out: a parameter set to where it does nothing, or a function replaced by the plain one.

- Windows of real recordings at the sensor, 40 Hz, cm, as tracking.py has them; `inside`: the share of their errors
  inside one sigma. Strides: at the heel, cm, and how many are found.
- `iron`, `drift`, `taps`: the attitude's largest RMSE of these recordings, degrees, if a magnet of half the earth's
  field is beside the sensor, if the gyro's bias walks as its class may, and if the sensor is tapped (286 Hz).
- Keyframes of simulated tasks by three sensors: position in mm, attitude in degrees, 95th percentiles.
- `slow`: stops missed or too many in tasks three times as slow.
- `air`: the same of a hand that trembles in the air.
- `creep`: rms error of the keyframes in tasks with moves of 4 to 8 s, in the tracker's own sigmas (1 is right).
- `faults`: of some cases of the fault matrix, how many are silent and wrong.

The last row shows how much of the windows' error is the reference's own: the optics know velocity from positions only.
"""

import sys
import warnings
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import fields, replace
from functools import cache
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd import track_recording
from pbd.cli.console import print_json
from pbd.data import Demonstration, Recording
from pbd.errors import PbdError, PbdWarning
from pbd.files.importers import import_file
from pbd.pipeline import track
from pbd.pose import Array, quat_canonical, quat_exp, quat_inverse, quat_log, quat_multiply
from pbd.simulation.simulate import TASKS, random_task, simulate
from pbd.tracking import zero_velocity
from pbd.tracking.first_rest import Rest
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.noise import Noise, noise_of
from pbd.tracking.repair import splices
from pbd.tracking.smoother import doubtful_stops, factors, large_errors, preintegration, variance_components
from pbd.tracking.smoother import smooth as smoother
from tests.benchmarks import trials, windows
from tests.benchmarks.report import add_data, arguments, print_machine
from tests.benchmarks.tracking import inside, orientation_errors, stride_errors
from tests.benchmarks.trials import (
    Trial,
    at_sensor,
    fit_lever,
    kind_of,
    read_broad,
    with_drift,
    with_hard_iron,
    with_taps,
)
from tests.benchmarks.windows import motion_of, window_errors
from tests.tracking import fault_matrix
from tests.tracking.nees import demonstration, errors_of, nees
from tests.tracking.trembling import STRONG, USUAL, trembling

SENSORS, POUR = ("modern", "os5000", "wt901"), TASKS["pour"]

SLOWER = 3.0
"""How much slower slow hands are."""

STEP, STEP_NAMED, NAMED = 194, 24, ("lag", "low-pass", "clock off", "all axes scaled", "magnet")
"""One case in so many of the fault matrix is tried, and of these faults one in fewer."""


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


SLOW, TURNING, FAST = "slow_translation", "slow_rotation", "fast_translation"

COLUMNS = (
    ("slow 5 s p95", (SLOW, 5.0), 95.0),
    ("rotation 5 s", (TURNING, 5.0), 50.0),
    ("fast 1 s p95", (FAST, 1.0), 95.0),
)
"""Of the windows: what it is called, which, percentile."""

Change = tuple[ModuleType | type, str, object]


def of_noise(**values: float) -> tuple[Change, ...]:
    """Change parameters of noise, of the sensor's class too."""

    def changed(recording: Recording, rest: Rest, *given: Any) -> Noise:
        found = noise_of(recording, rest, *given)
        of_class = {field.name for field in fields(found.sensor)}
        sensor = replace(found.sensor, **{name: value for name, value in values.items() if name in of_class})
        return replace(found, sensor=sensor, **{name: v for name, v in values.items() if name not in of_class})

    return (track_recording, "noise_of", changed), (windows, "noise_of", changed)


TINY, LARGE = 1e-6, 1e6

WITHOUT: dict[str, tuple[Change, ...]] = {
    "nothing": (),
    "half-sample alignment": ((preintegration, "turns_between_middles", own_turn),),
    "cubic turns, coning": ((preintegration, "turns_between_middles", half_and_half),),
    "cubic velocity": ((preintegration, "integral_of_means", trapezoids),),
    "annealing": ((smoother, "ANNEALING", (1.0,)),),
    "robust stops": ((factors, "OUTLIER_SIGMAS", LARGE),),
    "doubted stops looked at again": ((smoother, "MAX_RECUTS", 0),),
    "slow ends of moves": tuple(
        (module, "without_slow_ends", lambda t, spans, *_: spans) for module in (zero_velocity, doubtful_stops)
    ),
    "tremor, sway at a stop": of_noise(tremor_hz=LARGE, pivot_scatter=0.0),
    "place held in a stop": of_noise(still_shift=LARGE),
    "attitude held in a stop": of_noise(still_turn=LARGE),
    "tremor in the air": ((zero_velocity, "SWAY_GYR", 0.0),),
    "lulls between strides": ((zero_velocity, "LULL_SHARE", 0.0),),
    "(lulls, but 10^-2.6 of a move)": ((zero_velocity, "LULL_SHARE", 10.0**-2.6),),
    "(lulls, but 10^-1.4 of a move)": ((zero_velocity, "LULL_SHARE", 10.0**-1.4),),
    "gyro's lag (then none)": of_noise(lag=0.0, lag_sigma=TINY, wide_lag_sigma=TINY),
    "gyro's lag (then 1 ms)": of_noise(lag_sigma=TINY, wide_lag_sigma=TINY),
    "a large lag taken out": ((large_errors, "REMOVED_LAG", LARGE),),
    "knocks kept": ((splices, "_knocked", lambda recording, rows, reach: np.zeros(len(rows), dtype=bool)),),
    "hard iron found": ((large_errors, "find_hard_iron", lambda problem, mag, x: None),),
    "gyro's common scale found": ((smoother, "WIDE_SCALE_SIGMA", TINY),),
    "gyro's matrix": (*of_noise(gyr_scale=TINY), (smoother, "WIDE_SCALE_SIGMA", TINY)),
    "accelerometer's matrix": of_noise(acc_scale=TINY),
    "accelerometer's bias": of_noise(acc_bias=TINY, acc_walk=TINY),
    "walk of the gyro's bias": of_noise(gyr_walk=TINY),
    "walk of the accelerometer's bias": of_noise(acc_walk=TINY),
    "gravity unknown": of_noise(gravity_sigma=TINY),
    "noise by turning": of_noise(gyr_turn=TINY),
    "noise by motion": of_noise(acc_motion=TINY),
    "noise between samples": of_noise(acc_bend=0.0),
    "knee of that noise": of_noise(bend_knee=TINY),
    "compass robust": of_noise(field_change=LARGE),
    "reach of a hand": of_noise(reach=LARGE),
    "pivot": of_noise(pivot_distance=TINY),
    "variance components": tuple(
        (variance_components, name, LARGE) for name in ("PRIOR_FREEDOM", "PRIOR_FREEDOM_STILL")
    ),
    "(nothing, but the optics' velocity over 25 samples)": ((trials, "VELOCITY_S", 25 / 286.0),),
}
"""Part taken out -> what is put in its place."""


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
    """Score with each part taken out, and print."""
    parser = arguments(str(__doc__))
    add_data(parser)
    parser.add_argument("--only", default="", help="rows whose name has this in it")
    args = parser.parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    for file in sorted((args.data / "broad").glob("*.npz")):
        lever(file)
    rows: dict[str, dict[str, float]] = {}
    seeds, stops = range(1 if args.quick else 3), len(POUR.waypoints)
    for name, changes in WITHOUT.items():
        if args.only not in name:
            continue
        with changed(changes):
            rows[name] = (
                real(args.data)
                | simulated(range(2, 3 if args.quick else 6))
                | {"slow": wrong_stops(slow_hands(seeds), stops), "air": wrong_stops(trembling_hands(seeds), stops)}
                | {"creep": rms_in_sigmas("creeping", seeds)}
                | {"faults": silent_and_wrong(4 if args.quick else 1)}
            )
        if not args.json:
            print_row(name, rows)
    if args.json:
        print_json(rows)


def print_row(name: str, rows: dict[str, dict[str, float]]) -> None:
    """Print one row of the table, before the first one its head."""
    columns = rows[name]
    if len(rows) == 1:
        print_machine()
        print("| taken out | " + " | ".join(columns) + " |")
        print("|---" * (len(columns) + 1) + "|")
    print(f"| {name} | " + " | ".join(f"{value:.3g}" for value in columns.values()) + " |", flush=True)


@cache
def lever(file: Path) -> Array | None:
    """From the markers to the sensor, (3,) m, by the tracker as it is: first of all, before anything is taken out.

    None of a trial that it refuses.
    """
    trial = read_broad(file)["40"]
    try:
        return fit_lever(trial, window_errors(trial, motion_of(trial, (1.0,)), (1.0,)))
    except PbdError:
        return None


def real(data: Path) -> dict[str, float]:
    """The figures that tell the parts apart, cm at 40 Hz."""
    errors: dict[tuple[str, float], list[float]] = defaultdict(list)
    z_scores: list[float] = []
    iron, drift, taps = 0.0, 0.0, 0.0
    for file in sorted((data / "broad").glob("*.npz")):
        offset, at_rates = lever(file), read_broad(file)
        if offset is None:
            continue
        trial, fast = at_rates["40"], at_rates["286"]
        taps = max(taps, attitude_error(fast, with_taps(fast.recording)))
        for window in window_errors(at_sensor(trial, offset), motion_of(trial)):
            errors[kind_of(file.stem), window.length].append(100.0 * float(np.linalg.norm(window.error)))
            z_scores.extend(window.z)
        for seed in range(3):
            if trial.recording.mag is not None:
                iron = max(iron, attitude_error(trial, with_hard_iron(trial.recording, seed)))
            drift = max(drift, attitude_error(trial, with_drift(trial.recording, 1.0, seed)))
    found = {name: float(np.percentile(errors[window] or [np.nan], percent)) for name, window, percent in COLUMNS}
    files = sorted((data / "strides").glob("*.npz"))
    strides = [error for file in files for error in stride_errors(import_file(file))[2]]
    return found | {
        "inside": inside(z_scores)["inside_1_sigma"],
        "at the heel p95": float(np.percentile(strides, 95)) if strides else np.inf,
        "strides": float(len(strides)),
        "iron": iron,
        "drift": drift,
        "taps": taps,
    }


def attitude_error(trial: Trial, recording: Recording) -> float:
    """RMSE of the attitude while moving, degrees; infinite if the recording is refused."""
    try:
        return orientation_errors(trial, track(recording).wxyz_nav_sensor)["total_deg"]
    except PbdError:
        return np.inf


def simulated(seeds: range) -> dict[str, float]:
    """Errors of all keyframes of everyday and random tasks."""
    off: list[float] = []
    turns: list[float] = []
    for sensor in SENSORS:
        for seed in seeds:
            for task in ("pick-and-place-stops", "pour", random_task(seed, moves=5)):
                try:
                    errors = np.array(keyframe_errors(simulate(task, sensor, seed)))
                    off.extend(errors[1:, 0])
                    turns.extend(errors[1:, 1])
                except PbdError:  # a part taken out may leave no path at all
                    off.append(np.inf)
    return {
        "keyframes, mm": 1e3 * float(np.percentile(off, 95)),
        "degrees": float(np.degrees(np.percentile(turns, 95))),
    }


def keyframe_errors(demo: Demonstration) -> list[tuple[float, float]]:
    """Of each keyframe, m and rad, relative to the first."""
    truth = demo.truth
    assert truth is not None
    found, turned_first = [], None
    for keyframe in find_keyframes(track(demo.recording)):
        i = int(np.searchsorted(truth.t, keyframe.t))
        off = quat_multiply(keyframe.T_nav_sensor.wxyz, quat_inverse(truth.wxyz_nav_sensor[i]))
        turned_first = off if turned_first is None else turned_first
        turn = quat_log(quat_canonical(quat_multiply(quat_inverse(turned_first), off)))
        p = keyframe.T_nav_sensor.p - truth.p_nav_sensor[i]
        found.append((float(np.linalg.norm(p)), float(np.linalg.norm(turn))))
    return found


def wrong_stops(recordings: Iterable[Recording], stops: int) -> float:
    """How many are missed or too many of the `stops` of each recording."""
    wrong = 0
    for recording in recordings:
        try:
            wrong += abs(len(track(recording).stops) - stops)
        except PbdError:  # a part taken out may leave no path at all
            wrong += stops
    return float(wrong)


def slow_hands(seeds: range) -> Iterator[Recording]:
    """The everyday task by hands that are so much slower."""
    slow = replace(POUR, waypoints=tuple(replace(w, move_s=SLOWER * w.move_s) for w in POUR.waypoints))
    yield from (simulate(slow, sensor, seed).recording for sensor in SENSORS for seed in seeds)


def trembling_hands(seeds: range) -> Iterator[Recording]:
    """The same by hands that tremble in the air as usual, and half again as much."""
    for sensor, seed, rms in product(SENSORS, seeds, (USUAL, STRONG)):
        yield trembling(sensor, seed, rms).recording


def rms_in_sigmas(task: str, seeds: Iterable[int]) -> float:
    """Root mean square of the keyframes' position errors, whitened."""
    runs = product(SENSORS, seeds)
    return float(np.sqrt(nees(errors_of(demonstration(task, s, seed, Noise.still_speed)).position for s, seed in runs)))


def silent_and_wrong(fewer: int = 1) -> float:
    """Cases of the fault matrix that come out wrong without a word, of those that can be told."""
    every = [case for case in fault_matrix.cases(1) if case.untellable is None]
    cases = every[:: STEP * fewer] + [case for case in every if case.fault.name in NAMED][:: STEP_NAMED * fewer]
    return float(sum(fault_matrix.outcome(case).verdict == fault_matrix.SILENT_WRONG for case in cases))


if __name__ == "__main__":
    main()
