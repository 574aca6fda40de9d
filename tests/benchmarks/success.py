"""Is the probability of success true? Of simulated takes that are said to succeed with p, how many do?

Each take is tracked and docked; the dock is off by its sigma, the sensor by its errors, and the hand goes through the
task exactly. A take succeeds where the tool, as it would be commanded, is within the tolerance of where it belongs at
all keyframes. Several tolerances are asked of each take.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from itertools import pairwise

import numpy as np

from pbd.calibration.dock import nav_in_base
from pbd.calibration.frames import tool_poses
from pbd.calibration.success import success_of
from pbd.data import Calibration, Truth
from pbd.errors import PbdError
from pbd.pipeline import track
from pbd.pose import Pose, quat_exp, quat_multiply
from pbd.simulation.simulate import simulate
from pbd.simulation.tasks import random_task
from pbd.tracking.keyframes import find_keyframes
from tests.benchmarks.report import arguments, print_machine
from tests.scenarios import truth_at

TOLERANCES_M = (0.003, 0.005, 0.0075, 0.01, 0.015, 0.02)
SENSORS = ("os5000", "wt901", "modern")
EDGES = (0.0, 0.25, 0.5, 0.75, 0.9, 1.000001)


def one(seed: int, sensor: str) -> list[tuple[float, bool]]:
    """What is said and what happens, for each tolerance."""
    rng = np.random.default_rng(seed)
    demo = simulate(random_task(seed), sensor, seed)
    assert demo.truth is not None
    path = track(replace(demo, truth=None))
    keyframes = find_keyframes(path)
    truth = [_true_pose(demo.truth, keyframe.t) for keyframe in keyframes]
    said = Pose(np.array([0.45, -0.1, 0.2]), truth[0].wxyz)
    calibration = Calibration("simulated", T_base_dock=said)
    error = np.sqrt(np.diagonal(calibration.cov_start)) * rng.standard_normal(6)
    real = Pose(said.p + error[:3], quat_multiply(quat_exp(np.array([0.0, 0.0, error[5]])), said.wxyz))
    T_base_nav = nav_in_base(calibration, keyframes[0].T_nav_sensor.wxyz)
    commanded = tool_poses(keyframes, T_base_nav, calibration)
    T_real = real @ truth[0].inverse()
    belongs = [T_real @ pose @ calibration.T_sensor_tool for pose in truth]
    off = np.array([a.distance(b)[0] for a, b in zip(commanded, belongs, strict=True)])
    found = (success_of(path, keyframes, T_base_nav, calibration, within_m=within) for within in TOLERANCES_M)
    return [(each.of_all, bool((off <= within).all())) for each, within in zip(found, TOLERANCES_M, strict=True)]


def _true_pose(truth: Truth, t: float) -> Pose:
    return Pose(truth_at(truth, t), truth.wxyz_nav_sensor[np.searchsorted(truth.t, t)])


def main() -> None:
    """Print the reliability table."""
    takes = 60 if arguments(__doc__ or "").parse_args().quick else 2000
    print_machine()
    print(f"\n{takes} simulated takes: what is said on average, and the share that is inside\n")
    print(f"{'sensor':8}{'band (%)':>12}{'cases':>8}{'said (%)':>10}{'happened (%)':>14}")
    for sensor in SENSORS:
        cases: list[tuple[float, bool]] = []
        refused = 0
        for seed in range(takes // len(SENSORS)):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                try:
                    cases += one(seed, sensor)
                except PbdError:
                    refused += 1
        said, happened = np.array(cases).T
        for low, high in pairwise(EDGES):
            inside = (said >= low) & (said < high)
            if inside.any():
                figures = (100.0 * said[inside].mean(), 100.0 * happened[inside].mean())
                band = f"{100 * low:.0f} to {min(100 * high, 100):.0f}"
                print(f"{sensor:8}{band:>12}{inside.sum():>8}{figures[0]:>10.0f}{figures[1]:>14.0f}")
        print(f"{sensor:8}{'refused':>12}{refused:>8}")


if __name__ == "__main__":
    main()
