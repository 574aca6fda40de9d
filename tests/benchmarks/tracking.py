"""How well real recordings are tracked.

python tests/benchmarks/tracking.py [--data DIR] [--method paper] [--json] [--quick]

Scores every file under DIR (broad/*.npz, walks/*.csv, strides/*.npz) against its optics, as the data folder's README
says. Default DIR: PBD_DATA, or ../shared/data. --quick leaves out the rates between.

`windows` is scored at the optical markers' origin, as that page asks. The sensor is 8 to 11 mm away from it, and
turning moves the one against the other: `windows_at_sensor` scores the same windows at the sensor, with that lever
fitted to each trial (a property of the markers, not of the tracker). Each window knows the velocity at its own two
ends. At the sensor too: `windows_alike`, where the tracker's own velocity is taken as the optics' is, as the slope of a
polynomial over 0.12 s (that loses half of a tremor of 12 Hz, which a tracker at 286 Hz sees and one at 40 Hz hardly);
`windows_jointly`, where all windows of a length share theirs, as the stops of one recording do; and `windows_free`,
where none is given: how far the trial's true stops, 17 to 34 s apart, reach.

`strides_at_heel` fits the lever from the sensor to the optics' heel, which the strides as such ignore. Strides are
scored at lower rates too (`rates_hz`).

Medians and 95th percentiles have a band (`from`, `to`): what 95 % of a thousand other sets of as many windows have,
drawn from these with replacement (bootstrap). Of 19 to 49 windows the 95th percentile is the second or third worst.

`sigma` is the share of errors inside one and two of the tracker's own sigmas, of each axis: of all windows and strides,
and by group: `at_sensor`, `alike` and `jointly` (of displacements), `rotation` (of attitudes at windows' ends).

--method paper scores the paper's attitude, stops, and equations 2 to 6 from each window's first velocity.

`refused` has the recordings that the tracker refuses, and why; the others are scored without them.
"""

import sys
import time
import warnings
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.data import Demonstration, HandPath, Recording
from pbd.errors import PbdError, PbdWarning
from pbd.files.importers import import_file
from pbd.pipeline import track
from pbd.pose import Array, quat_about_z, quat_inverse, quat_multiply, quat_to_matrix
from pbd.tracking.first_rest import find_rest
from pbd.tracking.paper import paper_acceleration, paper_attitude
from pbd.tracking.repair.repair_recording import repair_recording
from tests.benchmarks.report import add_data, arguments, finish
from tests.benchmarks.trials import RATES, Trial, at_sensor, averaged, fit_lever, kind_of, read_broad
from tests.benchmarks.windows import heading_off, motion_of, paper_windows, turn_z_scores, window_errors

HEEL_M, STRIDE_M = 0.15, 0.01
"""One sigma, m: how far the optics' heel is from the sensor along each axis, and of a stride's error besides."""

STRIDES_EVERY = (2, 3, 4)
"""Samples that are averaged: rates at which strides are scored too."""

RESAMPLES = 1000
"""Of the bootstrap."""

SCORES = {
    "windows": "own",
    "windows_at_sensor": "own",
    "windows_alike": "alike",
    "windows_jointly": "all",
    "windows_free": "none",
}
"""Score -> what velocities its windows are given."""


def main() -> None:
    """Score and print."""
    parser = arguments(str(__doc__))
    add_data(parser)
    parser.add_argument("--method", choices=("default", "paper"), default="default")
    args = parser.parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    rates = ("286", "40") if args.quick else tuple(RATES)
    finish((score_paper if args.method == "paper" else score)(args.data, rates), args.json)


def score(data: Path, rates: tuple[str, ...]) -> dict[str, Any]:
    """All figures of the data folder's README."""
    orientation: dict[str, Any] = {}
    stops: dict[str, Any] = {}
    refused: dict[str, str] = {}
    levers: dict[str, float] = {}
    errors: dict[tuple[str, str, str, str], list[float]] = defaultdict(list)
    z_scores: dict[str, list[float]] = defaultdict(list)
    speeds = [0.0]
    for file in sorted((data / "broad").glob("*.npz")):
        trials, motions, found = read_broad(file), {}, {}
        for rate in rates:
            try:
                motions[rate] = motion_of(trials[rate])
                found[rate] = stop_scores(trials[rate])
            except PbdError as error:
                refused[f"{file.stem} at {rate} Hz"] = error.message
        if not motions:
            continue
        fastest = next(iter(motions))
        trial, motion = trials[fastest], motions[fastest]
        lever = fit_lever(trial, [w for w in window_errors(trial, motion) if w.length == 1])
        levers[file.stem] = float(1e3 * np.linalg.norm(lever))
        kind = kind_of(file.stem)
        for rate in motions:
            moved = at_sensor(trials[rate], lever)
            for name, given in SCORES.items():
                for window in window_errors(trials[rate] if name == "windows" else moved, motions[rate], given=given):
                    length = f"{window.length:g}"
                    errors[name, kind, length, rate].append(100.0 * float(np.linalg.norm(window.error)))
                    groups = {
                        "windows": ("all",),
                        "windows_at_sensor": ("at_sensor", f"at_sensor.{kind}.{length}"),
                        "windows_alike": (f"alike.{kind}.{length}",),
                        "windows_jointly": (f"jointly.{kind}.{length}",),
                    }
                    for group in groups.get(name, ()):
                        z_scores[group].extend(window.z)
            z_scores[f"rotation.{kind}"].extend(turn_z_scores(trials[rate], motions[rate]))
        orientation[file.stem] = orientation_errors(trial, motion.path.wxyz)
        stops[file.stem] = found.get(fastest, {}) | {"rates_hz": {rate: {"f1": of["f1"]} for rate, of in found.items()}}
        if fastest in found:
            speeds.append(samples_per_s(trial.recording))
    windows: dict[str, Any] = {name: {} for name in SCORES}
    for (name, kind, seconds, rate), found_errors in sorted(errors.items()):
        windows[name].setdefault(kind, {}).setdefault(seconds, {})[rate] = spread(found_errors, "")
    walks: dict[str, Any] = {}
    strides: dict[str, Any] = {}
    at_heel: dict[str, Any] = {}
    for file in sorted((data / "walks").glob("*.csv")):
        try:
            walks[file.stem] = walk(track(import_file(file).recording))
        except PbdError as error:
            refused[file.stem] = error.message
    for file in sorted((data / "strides").glob("*.npz")):
        demo, slower = import_file(file), {}
        try:
            absolute, scaled, heel, heel_scaled = stride_errors(demo)
        except PbdError as error:
            refused[file.stem] = error.message
            continue
        for slow in slower_strides(demo):
            rate = f"{slow.recording.rate_hz:.0f}"
            try:
                slower[rate] = stride_errors(slow)
            except PbdError as error:
                refused[f"{file.stem} at {rate} Hz"] = error.message
        for scored, k, errors_cm in ((strides, 0, absolute), (at_heel, 2, heel)):
            at_rates = {rate: spread(of_rate[k], "_abs") for rate, of_rate in slower.items()}
            scored[file.stem] = spread(errors_cm, "_abs") | {"rates_hz": at_rates}
        z_scores["all"].extend(scaled)
        z_scores["strides"].extend(scaled)
        z_scores["strides_at_heel"].extend(heel_scaled)
    return {
        "orientation": orientation,
        **windows,
        "lever_mm": levers,
        "stops": stops,
        "walks": walks,
        "strides": strides,
        "strides_at_heel": at_heel,
        "sigma": inside(z_scores.pop("all", [])) | {"groups": {group: inside(z) for group, z in z_scores.items()}},
        "samples_per_s": max(speeds),
        "refused": refused,
    }


def score_paper(data: Path, rates: tuple[str, ...]) -> dict[str, Any]:
    """The figures of BROAD's trials by the paper's method, which needs a compass, and has no sigma of its own."""
    orientation: dict[str, Any] = {}
    stops: dict[str, Any] = {}
    refused: dict[str, str] = {}
    errors: dict[tuple[str, str, str], list[float]] = defaultdict(list)
    for file in sorted((data / "broad").glob("*.npz")):
        trials = read_broad(file)
        try:
            for rate in rates:
                trial = trials[rate]
                recording, _ = repair_recording(trial.recording)
                wxyz = paper_attitude(recording)
                a_nav = paper_acceleration(recording, wxyz, find_rest(recording).gravity)
                scores = stop_scores(trial, "paper")
                orientation.setdefault(file.stem, orientation_errors(trial, wxyz))
                stops.setdefault(file.stem, scores | {"rates_hz": {}})["rates_hz"][rate] = {"f1": scores["f1"]}
                for window in paper_windows(trial, wxyz, a_nav):
                    of = kind_of(file.stem), f"{window.length:g}", rate
                    errors[of].append(100.0 * float(np.linalg.norm(window.error)))
        except PbdError as error:
            refused[file.stem] = error.message
    windows: dict[str, Any] = {}
    for (kind, seconds, rate), found in sorted(errors.items()):
        windows.setdefault(kind, {}).setdefault(seconds, {})[rate] = spread(found, "")
    return {"orientation": orientation, "windows": windows, "stops": stops, "refused": refused}


def inside(z_scores: list[float]) -> dict[str, Any]:
    """How often the truth lies within the tracker's own one and two sigma, per axis."""
    z = np.abs(z_scores)
    return {"inside_1_sigma": float((z < 1.0).mean()), "inside_2_sigma": float((z < 2.0).mean())}


def spread(values: list[float], suffix: str) -> dict[str, float]:
    """Median and 95th percentile, each with the bootstrap's 95 % band, and count; no number where there is none."""
    if not values:
        return {f"{key}{suffix}_cm": np.nan for key in ("median", "p95")} | {"n": 0}
    again = np.random.default_rng(0).choice(values, (RESAMPLES, len(values)))
    found: dict[str, float] = {}
    for name, percent in (("median", 50.0), ("p95", 95.0)):
        found[f"{name}{suffix}_cm"] = float(np.percentile(values, percent))
        low, high = np.percentile(np.percentile(again, percent, axis=1), (2.5, 97.5))
        found |= {f"{name}{suffix}_from_cm": float(low), f"{name}{suffix}_to_cm": float(high)}
    return found | {"n": len(values)}


def orientation_errors(trial: Trial, wxyz: Array) -> dict[str, float]:
    """RMSE while moving, degrees: total, inclination and heading as BROAD defines them."""
    heading, known = heading_off(trial, wxyz)
    off = quat_multiply(quat_about_z(-heading), quat_multiply(wxyz, quat_inverse(trial.wxyz_true)))
    w, z = np.abs(off[known, 0]), np.abs(off[known, 3])
    angles = {
        "total_deg": 2.0 * np.arccos(np.minimum(w, 1.0)),
        "tilt_deg": 2.0 * np.arccos(np.minimum(np.hypot(w, z), 1.0)),
        "heading_deg": 2.0 * np.arctan2(z, w),
    }
    return {key: float(np.degrees(np.sqrt(np.mean(values**2)))) for key, values in angles.items()}


def stop_scores(trial: Trial, method: str = "default") -> dict[str, float]:
    """Still samples against not `moving`."""
    still = np.zeros(len(trial.recording), dtype=bool)
    for stop in track(trial.recording, method).stops:
        still[stop.start : stop.stop] = True
    hits = float((still & ~trial.moving).sum())
    precision, recall = hits / still.sum(), hits / (~trial.moving).sum()
    return {"precision": precision, "recall": recall, "f1": 2.0 * precision * recall / (precision + recall)}


def walk(path: HandPath) -> dict[str, float]:
    """How far the end is from the beginning, of a walk that ended where it began."""
    gone = path.p_nav_sensor[-1] - path.p_nav_sensor[0]
    return {
        "closure_cm": 100.0 * float(np.linalg.norm(gone)),
        "height_cm": 100.0 * float(abs(gone[2])),
        "path_m": float(np.linalg.norm(np.diff(path.p_nav_sensor, axis=0), axis=1).sum()),
        "stops": len(path.stops),
    }


def slower_strides(demo: Demonstration) -> Iterator[Demonstration]:
    """The strides as slower sensors record them, with the truth on their clocks."""
    for every in STRIDES_EVERY:
        recording, truth = averaged(demo.recording, every), demo.truth
        assert truth is not None
        first = recording.t[0]
        recording = replace(recording, t=recording.t - first)
        yield replace(demo, recording=recording, truth=replace(truth, t=truth.t - first))


def stride_errors(demo: Demonstration) -> tuple[list[float], ...]:
    """Of moves of 0.3 to 2 s and over 0.2 m the horizontal distance's error in cm, in sigmas, and both at the heel."""
    path, truth = track(demo.recording), demo.truth
    assert truth is not None

    def optics(t: float) -> Array:
        return np.array([np.interp(t, truth.t, axis) for axis in truth.p_nav_sensor.T])

    off, sigma, by_lever = [], [], []
    for k, (before, after) in enumerate(pairwise(path.stops)):
        first, last = before.stop - 1, after.start
        t_start, t_end = float(path.t[first]), float(path.t[last])
        true = float(np.linalg.norm((optics(t_end) - optics(t_start))[:2]))
        if not 0.3 <= t_end - t_start <= 2.0 or true < 0.2:
            continue
        gone = (path.p_nav_sensor[last] - path.p_nav_sensor[first])[:2]
        distance = float(np.linalg.norm(gone))
        turned = np.diff(quat_to_matrix(path.wxyz_nav_sensor[[first, last]]), axis=0)[0]
        off.append(distance - true)
        joint = path.covariance.joint((k, k + 1)).reshape(2, 6, 2, 6)[:, :2, :, :2]
        added = joint[1, :, 1] + joint[0, :, 0] - joint[1, :, 0] - joint[0, :, 1]
        sigma.append(float(np.sqrt(gone @ added @ gone)) / distance)
        by_lever.append(gone / distance @ turned[:2])
    error, J = np.array(off), np.array(by_lever).reshape(-1, 3)
    lever = np.linalg.solve(J.T @ J / STRIDE_M**2 + np.eye(3) / HEEL_M**2, -J.T @ error / STRIDE_M**2)
    at_heel = error + J @ lever
    values = (100.0 * np.abs(error), error / sigma, 100.0 * np.abs(at_heel), at_heel / sigma)
    return tuple(value.tolist() for value in values)


def samples_per_s(recording: Recording) -> float:
    """Speed of the whole tracker, by the processor's time: what else the machine does counts less."""
    start = time.process_time()
    track(recording)
    return len(recording) / (time.process_time() - start)


if __name__ == "__main__":
    main()
