"""Is the probability of success true? Of simulated takes that are said to succeed with p, how many do?

Each take is tracked and docked; the dock is off by its sigma, the sensor by its errors, and the hand goes through the
task, wandering as fast as the tracker takes a hand to that stands still (--sway). A take succeeds where the tool, as it
would be commanded, is within the tolerance of where it belongs at all keyframes. Several tolerances are asked of each.
"""

import sys
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.calibration.dock import place_in_base
from pbd.calibration.success_probability import success_of
from pbd.calibration.tool_poses import tool_poses
from pbd.data import Calibration, HandPath, Truth
from pbd.errors import PbdError
from pbd.pipeline import track
from pbd.pose import Pose, quat_exp, quat_multiply
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import random_task
from pbd.tracking.keyframes import find_keyframes
from tests.benchmarks.report import add_sway, arguments, finish
from tests.scenarios import truth_at
from tests.simulation.sway import with_sway

TOLERANCES_M = (0.003, 0.005, 0.0075, 0.01, 0.015, 0.02)
SENSORS = ("os5000", "wt901", "modern")
EDGES = (0, 25, 50, 75, 90, 101)
"""Of bands, %."""


def one(seed: int, sensor: str, sway_speed: float) -> list[tuple[float, bool]]:
    """What is said of a take and what happens, for each tolerance."""
    demo = simulate(with_sway(random_task(seed), sway_speed, seed), sensor, seed)
    assert demo.truth is not None
    path = track(replace(demo, truth=None))
    truth = [_true_pose(demo.truth, keyframe.t) for keyframe in find_keyframes(path)]
    return said_and_happened(path, truth, np.random.default_rng(seed))


def said_and_happened(
    path: HandPath, truth: Sequence[Pose], rng: np.random.Generator, docks: int = 1
) -> list[tuple[float, bool]]:
    """The same of any path, given its keyframes' true poses; `rng` draws by what each of some docks is off."""
    keyframes = find_keyframes(path)
    said = Pose(np.array([0.45, -0.1, 0.2]), truth[0].wxyz)
    calibration = Calibration("simulated", T_base_dock=said)
    placed = place_in_base(keyframes, calibration, path=path)
    commanded = tool_poses(placed)
    found = [success_of(placed, within).of_all for within in TOLERANCES_M]
    cases = []
    for error in np.sqrt(np.diagonal(calibration.cov_start)) * rng.standard_normal((docks, 6)):
        real = Pose(said.p + error[:3], quat_multiply(quat_exp(np.array([0.0, 0.0, error[5]])), said.wxyz))
        T_real = real @ truth[0].inverse()
        belongs = [T_real @ pose @ calibration.T_sensor_tool for pose in truth]
        off = max(a.distance(b)[0] for a, b in zip(commanded, belongs, strict=True))
        cases += [(each, bool(off <= within)) for each, within in zip(found, TOLERANCES_M, strict=True)]
    return cases


def reliability(cases: Sequence[tuple[float, bool]]) -> dict[str, dict[str, float]]:
    """By band of what is said (%): how many cases, the mean of what is said, and the share that happened, %."""
    said, happened = 100.0 * np.array(cases).T
    bands = {}
    for low, high in pairwise(EDGES):
        inside = (said >= low) & (said < high)
        if inside.any():
            figures = {"cases": int(inside.sum()), "said": said[inside].mean(), "happened": happened[inside].mean()}
            bands[f"{low}-{min(high, 100)}"] = {key: float(value) for key, value in figures.items()}
    return bands


def _true_pose(truth: Truth, t: float) -> Pose:
    return Pose(truth_at(truth, t), truth.wxyz_nav_sensor[np.searchsorted(truth.t, t)])


def draw(bands: Mapping[str, Mapping[str, Mapping[str, float]]], file: Path) -> None:
    """The reliability diagram, with two binomial sigmas as if every case were a take of its own."""
    from matplotlib.figure import Figure

    axes = (figure := Figure(figsize=(4.5, 4.5), layout="constrained")).add_subplot()
    axes.plot((0, 100), (0, 100), color="0.6", linewidth=1.0)
    for (sensor, each), colour in zip(bands.items(), ("#d55e00", "#009e73", "#0072b2"), strict=True):
        said, happened, cases = np.array([(b["said"], b["happened"], b["cases"]) for b in each.values()]).T
        spread = 2.0 * np.sqrt(happened * (100.0 - happened) / cases)
        axes.errorbar(said, happened, spread, color=colour, marker="o", capsize=2, label=sensor)
    axes.set(xlabel="said to succeed (%)", ylabel="succeeded (%)", xlim=(0, 101), ylim=(0, 101), aspect="equal")
    axes.legend(loc="lower right")
    figure.savefig(file, dpi=100)


def main() -> None:
    """Print the reliability table."""
    parser = arguments(__doc__ or "")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="write the reliability diagram")
    add_sway(parser)
    args = parser.parse_args()
    takes = 60 if args.quick else 2000
    figures: dict[str, Any] = {"takes": takes, "refused": 0}
    for sensor in SENSORS:
        cases: list[tuple[float, bool]] = []
        for seed in range(takes // len(SENSORS)):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                try:
                    cases += one(seed, sensor, 1e-3 * args.sway)
                except PbdError:
                    figures["refused"] += 1
        figures[sensor] = reliability(cases)
    if args.plot:
        draw({sensor: figures[sensor] for sensor in SENSORS}, args.plot)
    finish(figures, args.json)


if __name__ == "__main__":
    main()
