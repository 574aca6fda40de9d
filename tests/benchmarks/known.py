"""What known places and heights gain, simulated: python tests/benchmarks/known.py [--json] [--quick].

Over 200 seeds a hand leaves its dock, sets a thing down on a table (stop 1), and elsewhere on it (3), comes back to the
first spot (5), and to the dock (7); stops 2, 4 and 6 lie anywhere. It meets a place only to within 2 mm per axis. In
`alike` moves take 0.5 to 2.5 s and rests 0.5 to 1.2 s, in `uneven` 0.4 to 4 s and 0.4 to 6 s, as many short as long.
Keyframe errors in cm (all but the first, which is the origin): as tracked, with each kind of claim by its uncertainty
(apply_constraints.py), and with the same claim shared out by a straight line in time, as exact. Of `contacts`
the error in height only. `inside` are the shares of errors (per axis) within the path's own sigmas. All of it is of the
same `recordings`: left out are those in which not just the eight stops are found (`other_stops`), and those of which a
kind of claim is refused (`refused`), though all are true. `worst_cm` is the median over recordings of the largest
keyframe error as tracked, of those left out and of those used.
`heading`, degrees rms: of the same recordings without their magnetometer, the heading's error at the end, and what is
left of it if the hand's heading, which comes back to within 3 degrees, is taken as exact, or weighed as well as can be.
"""

import sys
import warnings
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.data import Contact, Demonstration, HandPath, Known, Place, Truth
from pbd.errors import PbdWarning, TrackingError
from pbd.pipeline import track
from pbd.pose import Array, quat_exp, quat_inverse, quat_log, quat_multiply
from pbd.simulation.simulate import random_task, simulate
from pbd.simulation.tasks import Task
from pbd.tracking.apply_constraints import apply_constraints
from pbd.tracking.keyframes import find_keyframes
from tests.benchmarks.report import arguments, finish

SENSORS = ("wt901", "os5000", "modern")
MISS_M, TURN_MISS = 0.002, np.radians(3.0)
ANCHORS = {"closed": (0, 7), "revisit": (1, 5), "contacts": (1, 3, 5)}
"""The stops that each kind of claim ties together."""


def main() -> None:
    """Simulate, track, condition, print."""
    args = arguments(str(__doc__)).parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    seeds = range(20 if args.quick else 200)
    figures: dict[str, Any] = {"seeds": len(seeds)}
    for sensor in SENSORS:
        figures[sensor] = {
            name: score([demonstration(seed, sensor, uneven) for seed in seeds])
            for name, uneven in (("alike", False), ("uneven", True))
        }
    finish(figures, args.json)


def demonstration(seed: int, sensor: str, uneven: bool) -> Demonstration:
    """A simulated demonstration that returns to places, as nearly as a hand does."""
    drawn = random_task(seed, moves=7, max_turn=np.radians(40.0), move_s=(0.5, 2.5))
    rng = np.random.default_rng(seed)
    miss = rng.normal(scale=MISS_M, size=(4, 3))
    points = [np.array(waypoint.p) for waypoint in drawn.waypoints]
    table = points[1][2]
    points[3] = np.array((*points[3][:2], table + miss[0, 2]))
    points[5], points[7] = points[1] + miss[1], points[0] + miss[2]
    turned = quat_exp(np.zeros(3))
    for waypoint in drawn.waypoints[:-1]:
        turned = quat_multiply(turned, quat_exp(waypoint.turn))
    back = quat_log(quat_multiply(quat_inverse(turned), quat_exp(rng.normal(scale=TURN_MISS, size=3))))
    last = replace(drawn.waypoints[-1], turn=tuple(back.tolist()), move_s=2.0)
    waypoints = [replace(w, p=tuple(p.tolist())) for w, p in zip((*drawn.waypoints[:-1], last), points, strict=True)]
    if uneven:
        move_s, rest_s = np.exp(rng.uniform(np.log(0.4), np.log([[4.0], [6.0]]), (2, 7)))
        times = zip(waypoints[1:], move_s.tolist(), rest_s.tolist(), strict=True)
        waypoints[1:] = [replace(w, move_s=move, rest_s=rest) for w, move, rest in times]
    task = Task(drawn.name, tuple(waypoints), start_rpy=drawn.start_rpy)
    ends = list(accumulate(w.move_s + w.rest_s for w in task.waypoints))
    t = [end - 0.5 * w.rest_s for end, w in zip(ends, task.waypoints, strict=True)]
    return replace(
        simulate(task, sensor, seed),
        closed=True,
        places=(Place((t[1], t[5])),),
        contacts=(Contact(t[1]), Contact(t[3]), Contact(t[5])),
    )


def score(demos: Sequence[Demonstration]) -> dict[str, Any]:
    """All figures of one sensor."""
    errors: dict[str, list[Array]] = defaultdict(list)
    sigmas: dict[str, list[Array]] = defaultdict(list)
    refused = {"closed": 0, "revisit": 0, "contacts": 0, "all": 0}
    headings, worst, other_stops = [], {"refused": list[float](), "used": list[float]()}, 0
    for demo in demos:
        path, truth = track(demo.recording), demo.truth
        assert truth is not None
        if len(path.stops) != 8:
            other_stops += 1
            continue
        known = demo.known
        kinds = {
            "closed": Known(closed=True),
            "revisit": Known(places=known.places),
            "contacts": Known(contacts=known.contacts),
            "all": known,
        }
        paths = {"none": path}
        for kind, claims in kinds.items():
            try:
                paths[kind] = apply_constraints(path, claims)
            except TrackingError:
                refused[kind] += 1
        headings.append(heading_off(demo, truth))
        used = len(paths) > len(kinds)
        worst["used" if used else "refused"].append(float(np.linalg.norm(keyframe_errors(path, truth), axis=1).max()))
        if not used:
            continue
        for kind, stops in ANCHORS.items():
            paths[f"{kind}_in_time"] = shared_in_time(path, stops)
        for name, found in paths.items():
            errors[name].append(keyframe_errors(found, truth))
            sigmas[name].append(np.sqrt(np.diagonal(found.cov[1:, :3, :3], axis1=1, axis2=2)))
    figures: dict[str, Any] = {"recordings": len(errors["none"]), "other_stops": other_stops, "refused": refused}
    figures["worst_cm"] = {name: 100.0 * float(np.median(values)) for name, values in worst.items() if values}
    for name in ("none", "closed", "closed_in_time", "revisit", "revisit_in_time", "all"):
        figures[name] = spread(np.concatenate([np.linalg.norm(error, axis=1) for error in errors[name]]))
    for name in ("none", "contacts", "contacts_in_time"):
        figures[f"{name}_height"] = spread(np.concatenate([np.abs(error[:, 2]) for error in errors[name]]))
    for name in ("none", *kinds):
        figures[name] = figures.get(name, {}) | inside(np.concatenate(errors[name]), np.concatenate(sigmas[name]))
    return figures | {"heading": heading_figures(np.array(headings))}


def shared_in_time(path: HandPath, stops: tuple[int, ...]) -> HandPath:
    """The path with stops tied to the first of `stops`, exactly, the misfit growing linearly in time between them.

    Three stops are on one table: their heights are tied only.
    """
    t = np.array([0.5 * (path.t[stop.start] + path.t[stop.stop - 1]) for stop in path.stops])
    p = path.p_nav_sensor[[stop.start for stop in path.stops]]
    misfit = p[stops[0]] - p[list(stops)]
    if len(stops) > 2:
        misfit[:, :2] = 0.0
    shifted = path.p_nav_sensor.copy()
    shift = np.column_stack([np.interp(t, t[list(stops)], axis) for axis in misfit.T])
    for stop, by in zip(path.stops, shift, strict=True):
        shifted[stop.start : stop.stop] += by
    return replace(path, p_nav_sensor=shifted)


def keyframe_errors(path: HandPath, truth: Truth) -> Array:
    """Position error (k - 1, 3) m of all keyframes but the first."""
    keyframes = find_keyframes(path)[1:]
    true = [[np.interp(keyframe.t, truth.t, axis) for axis in truth.p_nav_sensor.T] for keyframe in keyframes]
    return np.array([keyframe.T_nav_sensor.p for keyframe in keyframes]) - np.array(true)


def heading_off(demo: Demonstration, truth: Truth) -> tuple[float, float]:
    """Of the last stop without a magnetometer, rad: error of the heading gained since the first, and its true value."""
    path = track(replace(demo.recording, mag=None))
    first, last = path.stops[0].start, path.stops[-1].start

    def gained(wxyz: Array) -> float:
        w, _, _, z = quat_multiply(wxyz[last], quat_inverse(wxyz[first]))
        return float((2.0 * np.arctan2(z, w) + np.pi) % (2.0 * np.pi) - np.pi)

    true = gained(truth.wxyz_nav_sensor)
    return gained(path.wxyz_nav_sensor) - true, true


def heading_figures(off: Array) -> dict[str, float]:
    """Of (k, 2) `heading_off`: as tracked; the gain taken as zero; weighed by the mean squares of both errors."""
    error, true = off.T
    weight = np.mean(error**2) / (np.mean(error**2) + np.mean(true**2))
    values = {"as_tracked": error, "as_exact": -true, "weighed": error - weight * (error + true)}
    return {f"{name}_deg": float(np.degrees(np.sqrt(np.mean(value**2)))) for name, value in values.items()}


def spread(errors: Array) -> dict[str, float]:
    """Median and 95th percentile, cm."""
    return {
        "median_cm": 100.0 * float(np.median(errors)),
        "p95_cm": 100.0 * float(np.percentile(errors, 95)),
    }


def inside(errors: Array, sigmas: Array) -> Mapping[str, float]:
    """The shares of errors within one and two sigma."""
    off = np.abs(errors) / sigmas
    return {"inside_1_sigma": float((off < 1.0).mean()), "inside_2_sigma": float((off < 2.0).mean())}


if __name__ == "__main__":
    main()
