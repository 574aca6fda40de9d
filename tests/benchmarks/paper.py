"""The paper's two tests, simulated: python tests/benchmarks/paper.py [--json] [--quick].

Test 1 (with stops) and Test 2 (direct) with the os5000 preset over 200 seeds: the error of the target, the last
keyframe's position, in x, y and z, by the paper's method and by ours. The paper reports 1, 2 and under 1 cm for Test 1
and 2, 2 and under 1 cm for Test 2 on recordings that are not public. `in_cup` is its own criterion: the bottle's mouth,
0.12 m from the sensor along the tool, is over a cup of 3.5 cm radius. `target` is the same error before the hand turns
to pour (Test 1 only): the device's own attitude lags behind a fast turn, which the paper's chain takes for motion.
"""

import sys
import warnings
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.data import TOOL_DOWN, Keyframe, Truth
from pbd.errors import PbdWarning
from pbd.pipeline import track
from pbd.pose import Array, Pose
from pbd.simulation.simulate import simulate
from pbd.track_recording import METHODS
from pbd.tracking.keyframes import find_keyframes
from tests.benchmarks.report import arguments, finish

TESTS = {"test1": "pick-and-place-stops", "test2": "pick-and-place-direct"}
MOUTH = np.array([0.0, 0.0, 0.12])
CUP_RADIUS_M = 0.035
BEFORE_THE_TURN_S = 170 / 40.0


def main() -> None:
    """Simulate, track, print."""
    args = arguments(str(__doc__)).parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    seeds = range(20 if args.quick else 200)
    figures: dict[str, Any] = {"seeds": len(seeds)}
    for name, task in TESTS.items():
        demos = [simulate(task, "os5000", seed) for seed in seeds]
        figures[name] = {}
        for method in METHODS:
            errors, before, hits = [], [], 0
            for demo in demos:
                if demo.truth is None:
                    raise RuntimeError("a simulated demonstration has its truth")
                keyframes = find_keyframes(track(demo.recording, method))
                estimated, true = keyframes[-1].T_nav_sensor, true_pose(demo.truth, demo.truth.t[-1])
                errors.append(estimated.p - true.p)
                before.append(target_error(keyframes, demo.truth))
                off = (estimated @ TOOL_DOWN).act(MOUTH) - (true @ TOOL_DOWN).act(MOUTH)
                hits += bool(np.hypot(off[0], off[1]) < CUP_RADIUS_M)
            figures[name][method] = summary(errors) | {"in_cup": hits}
            if name == "test1":
                figures[name][method]["target"] = summary(before)
    finish(figures, args.json)


def true_pose(truth: Truth, t: float) -> Pose:
    """The true pose of the sample nearest to an instant."""
    i = int(np.argmin(np.abs(truth.t - t)))
    return Pose(truth.p_nav_sensor[i], truth.wxyz_nav_sensor[i])


def target_error(keyframes: tuple[Keyframe, ...], truth: Truth) -> Array:
    """Error (3,) m of the keyframe at which the hand is about to turn."""
    keyframe = min(keyframes, key=lambda k: abs(k.t - BEFORE_THE_TURN_S))
    return keyframe.T_nav_sensor.p - true_pose(truth, keyframe.t).p


def summary(errors: list[Array]) -> dict[str, Any]:
    """Median and 95th percentile in x, y and z, and the median distance, cm."""
    cm = 100.0 * np.abs(np.array(errors))
    return {
        "median_cm": [round(float(x), 2) for x in np.median(cm, axis=0)],
        "p95_cm": [round(float(x), 2) for x in np.percentile(cm, 95, axis=0)],
        "median_norm_cm": float(np.median(np.linalg.norm(cm, axis=1))),
    }


if __name__ == "__main__":
    main()
