"""How true the tracker's own sigma is, simulated: python tests/benchmarks/sigma.py [--json] [--quick].

Sensors x tasks x 50 seeds: the normalised squared error of the keyframes' positions and rotations, relative to the
first stop's place and heading. 1 is a true covariance, less is too wide, more too narrow. `band` is where its mean over
the seeds lies in 95 % of cases, if all keyframes of a recording err together. `inside`: share of errors within one
and two sigma, axis by axis (.68 and .95). Odd seeds have no magnetometer. The hand wanders as fast as the tracker takes
a hand to that stands still; with --sway 0 it stands perfectly still.
"""

import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.errors import PbdWarning, TrackingError
from pbd.pose import Array
from tests.benchmarks.report import add_sway, arguments, finish
from tests.tracking.nees import band, demonstration, errors_of, nees

SENSORS = ("modern", "os5000", "wt901", "wandering")
TASKS = ("pour", "pick-and-place-stops", "pick-and-place-direct", "random", "tipping", "dawdling", "creeping")


def main() -> None:
    """Simulate, track, print."""
    parser = arguments(str(__doc__))
    add_sway(parser)
    args = parser.parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    seeds = range(10 if args.quick else 50)
    figures: dict[str, Any] = {"seeds": len(seeds), "band": list(np.round(band(len(seeds)), 2))}
    for sensor in SENSORS:
        figures[sensor] = {task: group(task, sensor, seeds, 1e-3 * args.sway) for task in TASKS}
    finish(figures, args.json)


def group(task: str, sensor: str, seeds: Sequence[int], sway_speed: float) -> dict[str, Any]:
    """Position and rotation of one task with one sensor."""
    found = []
    for seed in seeds:
        with suppress(TrackingError):  # of a slow hand the sensor may rest better than at its first stop
            found.append(errors_of(demonstration(task, sensor, seed, sway_speed)))
    off = np.abs(np.concatenate([e.in_sigmas for e in found]))
    return {
        "refused": len(seeds) - len(found),
        "position": of_part([e.position for e in found], off[:, :3]),
        "rotation": of_part([e.rotation for e in found], off[:, 3:]),
    }


def of_part(white: list[Array], off: Array) -> dict[str, Any]:
    """Normalised square, whether it is in its band, shares inside."""
    value, (low, high) = nees(white), band(len(white))
    return {
        "nees": value,
        "in_band": low < value < high,
        "inside_1_sigma": float((off < 1.0).mean()),
        "inside_2_sigma": float((off < 2.0).mean()),
    }


if __name__ == "__main__":
    main()
