"""How well `pbd calibrate` finds what it looks for, simulated: python tests/benchmarks/calibration.py [--json].

100 seeds with the wt901 preset, which has 20 mg of accelerometer bias, 1 % of scale and so on (one sigma over devices).

- `points`: the hand goes to four points about 30 cm apart. The error of nav's origin in base, and of the heading in
  which the sensor lies at its first rest. (Nav's own heading, `nav_yaw_deg`, is magnetic and off by what the
  accelerometer's bias tilts it, the same for every demonstration that starts alike.) `inside`: the share of the errors
  of x, y, z and that heading within one and two of the fit's own sigmas, and `interval_2_sigma`, in which that share
  lies by 95 % (binomial, by Clopper and Pearson, as though the four of a trial were independent); of this and of other
  tasks, 3 to 8 points, 15 to 60 cm apart, by better sensors, with a hand that is yawed, or that sways and misses as
  the model says it does. `nees`: the mean normalised squared error of x, y, z and heading; 1 if the covariance is true.
  `lost`: the tracker refused, or found other stops; `refused`: the points seemed to contradict each other.
- `outlier`: one of six points is wrong by 10 cm in a direction drawn at random; the share in which that one and no
  other is named, and in which a right one is, where none is wrong.
- `gyro`: the bias after five seconds of rest, largest over the axes.
- `acc`, `mag`, `gyro.matrix`: a worse device (one sigma: bias 50 mg, scale 2 %, misalignment 1 degree; hard iron 20 uT,
  soft iron 10 %) is put down in 12 orientations. Largest over the axes. A rotation of all axes together is no error of
  an accelerometer alone: its matrix is compared with the symmetric one. The heading is that of 50 attitudes tilted by
  up to a radian, rms.
- `move`: the error of the displacement over one move of a second by 30 cm that turns by up to 60 degrees, by that
  device, as it is and calibrated.
- `mount`: a lever of 10 cm by nine tilts of 25 to 45 degrees, of a wt901 as it is, and of the worse one calibrated.
"""

import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from scipy.stats import binomtest

from pbd.calibration.gyro import fit_gyro
from pbd.calibration.mount import fit_pivot
from pbd.calibration.points import PointFit, fit_points
from pbd.calibration.registration import observe_points
from pbd.calibration.rests import find_rests
from pbd.calibration.sensor import SensorFit, calibrate_sensor
from pbd.data import GRAVITY, Calibration, Keyframe, SensorErrors
from pbd.errors import CalibrationError, PbdWarning, RecordingError, TrackingError
from pbd.pipeline import track
from pbd.pose import Array, quat_from_rpy, quat_inverse, quat_multiply, quat_rotate, yaw_toward
from pbd.simulation.calibration_tasks import pivoting, sides
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import EARTH, simulate
from pbd.simulation.tasks import Task
from pbd.tracking.keyframes import find_keyframes
from tests.benchmarks.report import arguments, finish
from tests.calibration.device_errors import BAD, WT901, device, symmetric
from tests.calibration.touched_points import Touching, touching
from tests.not_none import not_none

TIP = (0.03, -0.02, 0.0933)
"""m: 10 cm long."""


TASKS: dict[str, Any] = {
    "wt901_4": (4, "wt901", 0.3),
    "wt901_3": (3, "wt901", 0.3),
    "wt901_5": (5, "wt901", 0.3),
    "wt901_8": (8, "wt901", 0.3),
    "wt901_4_15cm": (4, "wt901", 0.15),
    "wt901_4_60cm": (4, "wt901", 0.6),
    "os5000_4": (4, "os5000", 0.3),
    "os5000_8": (8, "os5000", 0.3),
    "modern_4": (4, "modern", 0.3),
    "modern_8": (8, "modern", 0.3),
    "wt901_5_yawed": (5, "wt901", 0.3, 90.0),
    "wt901_3_sways": (3, "wt901", 0.3, 0.0, 1e-3, 1e-3),
    "wt901_8_sways": (8, "wt901", 0.3, 0.0, 1e-3, 1e-3),
    "modern_8_sways": (8, "modern", 0.3, 0.0, 1e-3, 1e-3),
}
"""How many points, the sensor, how far they lie apart (m), by how much the hand is yawed on each way (degrees), how
fast it sways (m/s), and by how much its tip misses (m); the first is the one asked for."""


def main() -> None:
    """Simulate, calibrate, compare, print."""
    args = arguments(str(__doc__)).parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    seeds = range(10 if args.quick else 100)
    coverage = {name: points_figures(seeds, *task) for name, task in TASKS.items()}
    points = next(iter(coverage.values()))
    sensor = sensor_figures(seeds)
    figures: dict[str, Any] = {"seeds": len(seeds), "points": points, "outlier": outlier_figures(seeds)}
    figures["inside"] = {name: each.pop("inside") for name, each in coverage.items()}
    figures["tasks"] = coverage
    figures["gyro"] = gyro_figures(seeds) | {"matrix": sensor.pop("gyro")}
    figures |= sensor | {"mount": mount_figures(seeds), "inside_2_sigma": figures["inside"]["wt901_4"]["2_sigma"]}
    finish(figures, args.json)


def spread(values: Sequence[float], name: str) -> dict[str, float]:
    """Median and 95th percentile."""
    return {f"{name}_median": float(np.median(values)), f"{name}_p95": float(np.percentile(values, 95))}


def points_figures(seeds: Sequence[int], count: int, sensor: str, spacing_m: float, *hand: float) -> dict[str, Any]:
    """Of one of TASKS."""
    metres, yaws, nav_yaws, sigmas, squared, refused = [], [], [], [], [], 0
    for seed in seeds:
        touched = touching(seed, count, sensor, spacing_m, *hand)
        try:
            found = registered(touched, touched.points)
        except CalibrationError:
            refused += 1
            continue
        if found is None:
            continue
        first, fit = found
        off = fit.T_base_nav.p - touched.T_base_nav.p
        true = quat_multiply(touched.T_base_nav.wxyz, not_none(touched.demo.truth).wxyz_nav_sensor[0])
        yaw = yaw_toward(quat_multiply(fit.T_base_nav.wxyz, first.T_nav_sensor.wxyz), true)
        metres.append(1e3 * float(np.linalg.norm(off)))
        yaws.append(abs(np.degrees(yaw)))
        nav_yaws.append(abs(np.degrees(yaw_toward(fit.T_base_nav.wxyz, touched.T_base_nav.wxyz))))
        error, cov = np.array([*off, -yaw]), fit.cov[np.ix_([0, 1, 2, 5], [0, 1, 2, 5])]
        sigmas.append(np.abs(error) / np.sqrt(np.diagonal(cov)))
        squared.append(error @ np.linalg.solve(cov, error) / 4.0)
    figures = spread(metres, "position_mm") | spread(yaws, "yaw_deg") | spread(nav_yaws, "nav_yaw_deg")
    return figures | {
        "nees": float(np.mean(squared)),
        "inside": inside(np.array(sigmas)) | {"lost": len(seeds) - len(sigmas) - refused, "refused": refused},
    }


def inside(sigmas: Array) -> dict[str, Any]:
    """What share of errors, in their sigmas, (trials, 4), lies within one and two."""
    within = int((sigmas < 2.0).sum())
    low, high = binomtest(within, sigmas.size).proportion_ci(0.95)
    return {
        "1_sigma": float((sigmas < 1.0).mean()),
        "2_sigma": within / sigmas.size,
        "interval_2_sigma": [float(low), float(high)],
        "of": sigmas.size,
    }


def registered(touched: Touching, points: Array) -> tuple[Keyframe, PointFit] | None:
    """The first keyframe, and nav by the stops after it; None where the tracker found other stops."""
    try:
        hand = track(touched.demo.recording)
    except (RecordingError, TrackingError):
        return None
    keyframes = find_keyframes(hand)
    if len(keyframes) != len(points) + 1:
        return None
    return keyframes[0], fit_points(
        observe_points(keyframes, hand.covariance, np.zeros(3)).only(range(1, len(keyframes))), points
    )


def wrapped(angle: float) -> float:
    """Within half a turn."""
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


def outlier_figures(seeds: Sequence[int]) -> dict[str, float]:
    """Six points, one of them wrong, or none."""
    named, blamed, undecided, lost = 0, 0, 0, 0
    for seed in seeds:
        touched = touching(seed, 6)
        rng = np.random.default_rng(seed)
        wrong, way = int(rng.integers(6)), rng.normal(size=3)
        points = touched.points.copy()
        points[wrong] += 0.1 * way / np.linalg.norm(way)
        try:
            right = registered(touched, touched.points)
            if right is None:
                lost += 1
                continue
            blamed += not all(right[1].used)
            found = registered(touched, points)
            named += found is not None and [k for k, used in enumerate(found[1].used) if not used] == [wrong]
        except CalibrationError:
            undecided += 1
    shares = {"named": named, "undecided": undecided, "blamed_where_none_is_wrong": blamed, "lost": lost}
    return {name: count / len(seeds) for name, count in shares.items()}


def gyro_figures(seeds: Sequence[int]) -> dict[str, float]:
    """Five seconds of rest."""
    off = []
    for seed in seeds:
        still = simulate(Task("still", (Waypoint(rest_s=5.0),)), WT901, seed).recording
        bias = fit_gyro(still, find_rests(still)).bias - device(WT901, seed)["gyr"][1]
        off.append(float(np.degrees(np.abs(bias).max())))
    return spread(off, "bias_deg_s")


def sensor_figures(seeds: Sequence[int]) -> dict[str, Any]:
    """Twelve orientations of the worse device, and a move by it."""
    kept: dict[str, list[float]] = {}

    def keep(name: str, value: float) -> None:
        kept.setdefault(name, []).append(float(value))

    stops_lost = {"as_it_is": 0, "calibrated": 0}
    for seed in seeds:
        true = device(BAD, seed)
        fit = calibrate_sensor(simulate(sides(seed), BAD, seed).recording, gravity=EARTH.gravity)
        errors = fit.errors
        assert errors.acc is not None
        wanted = symmetric(true["acc"][0])
        turned = wanted @ true["acc"][0]
        off = errors.acc.matrix - wanted
        keep("acc.bias_mg", 1e3 / GRAVITY * np.abs(errors.acc.bias - true["acc"][1]).max())
        keep("acc.scale_pct", 100.0 * np.abs(np.diagonal(off)).max())
        keep("acc.misalignment_deg", np.degrees(np.abs(off - np.diag(np.diagonal(off))).max()))
        keep("gyro.left_pct", 100.0 * np.abs(not_none(errors.gyr).matrix @ true["gyr"][0] - turned).max())
        keep("gyro.before_pct", 100.0 * np.abs(true["gyr"][0] - turned).max())
        keep("mag.heading_deg", heading_error(fit, true, turned))
        for name, used in (("as_it_is", None), ("calibrated", errors)):
            moved = move_error(seed, turned, used)
            if moved is None:
                stops_lost[name] += 1
            else:
                keep(f"move.{name}_cm", 100.0 * moved)
    figures: dict[str, Any] = {"acc": {}, "mag": {}, "gyro": {}, "move": {}}
    for name, values in kept.items():
        part, _, figure = name.partition(".")
        figures[part] |= spread(values, figure)
    figures["move"] |= {f"{name}_lost": count for name, count in stops_lost.items()}
    return figures


def heading_error(fit: SensorFit, true: dict[str, tuple[Array, Array]], turned: Array) -> float:
    """Of the corrected field and vertical against the true ones, rms over attitudes, degrees."""
    gain, bias = true["mag"]
    rng = np.random.default_rng(0)
    off = []
    for _ in range(50):
        wxyz = quat_inverse(quat_from_rpy(rng.uniform((-1.0, -1.0, -np.pi), (1.0, 1.0, np.pi))))
        field, up = quat_rotate(wxyz, EARTH.field), quat_rotate(wxyz, (0.0, 0.0, 1.0))
        found = heading(not_none(fit.errors.mag).correct(gain @ field + bias), turned @ up, turned[:, 0])
        off.append(wrapped(found - heading(field, up, np.array((1.0, 0.0, 0.0)))))
    return float(np.degrees(np.sqrt(np.mean(np.square(off)))))


def heading(field: Array, up: Array, axis: Array) -> float:
    """Of an axis, from magnetic east."""
    east = np.cross(field, up)
    return float(np.arctan2(axis @ np.cross(up, east), axis @ east))


def move_error(seed: int, turned: Array, errors: SensorErrors | None) -> float | None:
    """Of the displacement over one move of a second, m, in the accelerometer's axes before it; None where it failed."""
    rng = np.random.default_rng(seed)
    way, axis = rng.normal(size=(2, 3))
    way *= 0.3 / np.linalg.norm(way)
    axis *= np.radians(rng.uniform(0.0, 60.0)) / np.linalg.norm(axis)
    waypoints = (Waypoint(rest_s=2.0), Waypoint(triple(way), triple(axis), 1.0, 1.0))
    demo = simulate(Task("move", waypoints, start_rpy=(0.0, 0.0, rng.uniform(-np.pi, np.pi))), BAD, seed)
    try:
        keyframes = find_keyframes(track(demo.recording, calibration=Calibration("bad", sensor=errors)))
    except (RecordingError, TrackingError):
        return None
    if len(keyframes) != 2:
        return None
    assert demo.truth is not None
    first, last = keyframes[0].T_nav_sensor, keyframes[1].T_nav_sensor
    found = quat_rotate(quat_inverse(first.wxyz), last.p - first.p)
    wxyz, p = demo.truth.wxyz_nav_sensor, demo.truth.p_nav_sensor
    return float(np.linalg.norm(found - turned @ quat_rotate(quat_inverse(wxyz[0]), p[-1] - p[0])))


def triple(values: Array) -> tuple[float, float, float]:
    """As waypoints take it."""
    x, y, z = values.tolist()
    return x, y, z


def mount_figures(seeds: Sequence[int]) -> dict[str, Any]:
    """A lever of 10 cm."""
    figures: dict[str, Any] = {}
    for name, model in (("wt901", WT901), ("calibrated", BAD)):
        off, inside = [], []
        for seed in seeds:
            calibration = None
            if name == "calibrated":
                errors = calibrate_sensor(simulate(sides(seed), model, seed).recording, gravity=EARTH.gravity).errors
                calibration = Calibration("bad", sensor=errors)
            recording = simulate(pivoting(seed, TIP), model, seed).recording
            hand = track(recording, calibration=calibration)
            fit = fit_pivot(find_keyframes(hand), hand.covariance)
            wrong = fit.p_sensor_tip - TIP
            if calibration is not None:  # in the accelerometer's own axes
                gain = device(model, seed)["acc"][0]
                wrong = fit.p_sensor_tip - symmetric(gain) @ gain @ TIP
            off.append(1e3 * float(np.linalg.norm(wrong)))
            inside.append(np.abs(wrong) < 2.0 * np.sqrt(np.diagonal(fit.cov)))
        figures[name] = spread(off, "lever_mm") | {"inside_2_sigma": float(np.mean(inside))}
    return figures


if __name__ == "__main__":
    main()
