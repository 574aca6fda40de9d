"""How well real recordings are tracked: python tests/benchmarks/tracking.py [--data DIR] [--json] [--quick].

Scores every file under DIR (broad/*.npz, walks/*.csv, strides/*.npz) against its optics, as the data folder's README
says. Default DIR: PBD_DATA, or ../shared/data. --quick leaves out the rates between.

`windows` is scored at the optical markers' origin, as that page asks. The sensor is 8 to 11 mm away from it, and
turning moves the one against the other: `windows_at_sensor` scores the same windows at the sensor, with that lever
fitted to each trial (a property of the markers, not of the tracker).
"""

from __future__ import annotations

import sys
import time
import warnings
from collections import defaultdict
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.data import Attitude, HandPath, Recording
from pbd.errors import PbdWarning
from pbd.files.importers import import_file
from pbd.pipeline import find_motion, track
from pbd.pose import Array, quat_about_z, quat_canonical, quat_inverse, quat_multiply, quat_rotate
from pbd.tracking.integration import integrate_move
from pbd.tracking.rest import Rest, find_rest
from pbd.tracking.uncertainty import move_covariance, move_figures
from tests.benchmarks.report import add_data, arguments, finish
from tests.benchmarks.trials import (
    RATES,
    VELOCITY_SIGMA,
    Trial,
    Window,
    at_sensor,
    fit_lever,
    kind_of,
    phases,
    read_broad,
)

WINDOWS_S = (1, 2, 5)


def main() -> None:
    """Score and print."""
    parser = arguments(str(__doc__))
    add_data(parser)
    args = parser.parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    finish(score(args.data, ("286", "40") if args.quick else tuple(RATES)), args.json)


def score(data: Path, rates: tuple[str, ...]) -> dict[str, Any]:
    """All figures of the data folder's README."""
    orientation: dict[str, Any] = {}
    stops: dict[str, Any] = {}
    levers: dict[str, float] = {}
    errors: dict[tuple[str, str, str, str], list[float]] = defaultdict(list)
    z_scores: dict[str, list[float]] = defaultdict(list)
    speeds = [0.0]
    for file in sorted((data / "broad").glob("*.npz")):
        trials = read_broad(file)
        motions = {rate: motion_of(trials[rate].recording) for rate in rates}
        lever = fit_lever(trials["286"], [w for w in window_errors(trials["286"], motions["286"]) if w.length == 1])
        levers[file.stem] = float(1e3 * np.linalg.norm(lever))
        for rate in rates:
            at_markers = window_errors(trials[rate], motions[rate])
            windows_at_sensor = window_errors(at_sensor(trials[rate], lever), motions[rate])
            for name, found_windows in (("windows", at_markers), ("windows_at_sensor", windows_at_sensor)):
                for window in found_windows:
                    key = (name, kind_of(file.stem), str(window.length), rate)
                    errors[key].append(100.0 * float(np.linalg.norm(window.error)))
            z_scores["all"].extend(z for window in at_markers for z in window.z)
            z_scores["at_sensor"].extend(z for window in windows_at_sensor for z in window.z)
            for window in windows_at_sensor:
                z_scores[f"at_sensor.{kind_of(file.stem)}.{window.length}"].extend(window.z)
        found = {rate: stop_scores(trials[rate]) for rate in rates}
        orientation[file.stem] = orientation_errors(trials["286"], motions["286"][0].wxyz_nav_sensor)
        stops[file.stem] = found["286"] | {"rates_hz": {rate: {"f1": found[rate]["f1"]} for rate in rates}}
        speeds.append(samples_per_s(trials["286"].recording))
    windows: dict[str, Any] = {"windows": {}, "windows_at_sensor": {}}
    for (name, kind, seconds, rate), found_errors in sorted(errors.items()):
        windows[name].setdefault(kind, {}).setdefault(seconds, {})[rate] = spread(found_errors, "")
    walks = {file.stem: walk(track(import_file(file).recording)) for file in sorted((data / "walks").glob("*.csv"))}
    strides = {}
    for file in sorted((data / "strides").glob("*.npz")):
        absolute, scaled = stride_errors(file)
        strides[file.stem] = spread(absolute, "_abs")
        z_scores["all"].extend(scaled)
        z_scores["strides"].extend(scaled)
    return {
        "orientation": orientation,
        **windows,
        "lever_mm": levers,
        "stops": stops,
        "walks": walks,
        "strides": strides,
        "sigma": inside(z_scores.pop("all")) | {"groups": {group: inside(z) for group, z in z_scores.items()}},
        "samples_per_s": max(speeds),
    }


def inside(z_scores: list[float]) -> dict[str, Any]:
    """How often the truth lies within the tracker's own one and two sigma, per axis."""
    z = np.abs(z_scores)
    return {"inside_1_sigma": float((z < 1.0).mean()), "inside_2_sigma": float((z < 2.0).mean())}


def spread(values: list[float], suffix: str) -> dict[str, float]:
    """Median, 95th percentile and count; no number where there is none."""
    if not values:
        return {f"median{suffix}_cm": np.nan, f"p95{suffix}_cm": np.nan, "n": 0}
    return {
        f"median{suffix}_cm": float(np.median(values)),
        f"p95{suffix}_cm": float(np.percentile(values, 95)),
        "n": len(values),
    }


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


Motion = tuple[Attitude, Array, Rest]


def motion_of(recording: Recording) -> Motion:
    """The tracker's attitude and motion acceleration over a whole trial, and its first rest."""
    rest, attitude, a_nav, _ = find_motion(recording, find_rest(recording))
    return attitude, a_nav, rest


def heading_off(trial: Trial, wxyz: Array) -> tuple[float, Any]:
    """The mean heading from the optics to the estimate while moving, rad; and where both are known."""
    known = trial.moving & np.isfinite(trial.wxyz_true).all(axis=1)
    off = quat_canonical(quat_multiply(wxyz, quat_inverse(trial.wxyz_true)))
    return float(np.mean(2.0 * np.arctan2(off[known, 3], off[known, 0]))), known


def window_errors(trial: Trial, motion: Motion, lengths: Sequence[float] = WINDOWS_S) -> list[Window]:
    """All windows of a trial, tracked from one known velocity to another."""
    recording, (attitude, a_nav, rest) = trial.recording, motion
    turn = quat_about_z(heading_off(trial, attitude.wxyz_nav_sensor)[0])
    p_true, v_true = quat_rotate(turn, trial.p_true), quat_rotate(turn, trial.v_true)
    found = []
    for length in lengths:
        n = round(length * recording.rate_hz)
        for start, stop in phases(trial.moving):
            for i in range(start, stop - n, n):
                ends = [i, i + n]
                if not np.isfinite(p_true[ends]).all() or not np.isfinite(v_true[ends]).all():
                    continue
                window = slice(i, i + n + 1)
                move = integrate_move(recording.t, a_nav, v_true[i], v_true[i + n], window)
                error = move.p_nav[-1] - (p_true[i + n] - p_true[i])
                assert recording.gyr is not None
                rate = recording.gyr[window] - rest.gyro_bias
                figures = move_figures(recording.t[window], a_nav[window], rate, move.closure, move.p_nav[-1])
                cov = move_covariance(figures, rest, recording.rate_hz, end_speed=VELOCITY_SIGMA)
                sigma = np.sqrt(np.diagonal(cov))
                found.append(Window(i, i + n, length, quat_rotate(quat_inverse(turn), error), error / sigma))
    return found


def stop_scores(trial: Trial) -> dict[str, float]:
    """Still samples against not `moving`."""
    still = np.zeros(len(trial.recording), dtype=bool)
    for stop in track(trial.recording).stops:
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


def stride_errors(file: Path) -> tuple[list[float], list[float]]:
    """Of each move of 0.3 to 2 s and over 0.2 m: the horizontal distance's error, in cm and in sigmas."""
    demo = import_file(file)
    path, truth = track(demo.recording), demo.truth
    assert truth is not None

    def optics(t: float) -> Array:
        return np.array([np.interp(t, truth.t, axis) for axis in truth.p_nav_sensor.T])

    errors, z_scores = [], []
    for k, (before, after) in enumerate(pairwise(path.stops)):
        t_start, t_end = float(path.t[before.stop - 1]), float(path.t[after.start])
        true = np.linalg.norm((optics(t_end) - optics(t_start))[:2])
        if not 0.3 <= t_end - t_start <= 2.0 or true < 0.2:
            continue
        gone = (path.p_nav_sensor[after.start] - path.p_nav_sensor[before.stop - 1])[:2]
        distance = float(np.linalg.norm(gone))
        added = (path.cov[k + 1] - path.cov[k])[:2, :2]
        errors.append(100.0 * abs(distance - float(true)))
        z_scores.append((distance - float(true)) / float(np.sqrt(gone @ added @ gone) / distance))
    return errors, z_scores


def samples_per_s(recording: Recording) -> float:
    """Speed of the whole tracker."""
    start = time.perf_counter()
    track(recording)
    return len(recording) / (time.perf_counter() - start)


if __name__ == "__main__":
    main()
