"""Real recordings of feet that no parameter was chosen on: python tests/benchmarks/gait.py DIR [--json].

DIR is the folder example_data of gaitmap's source (MIT; MaD-Lab Erlangen): `pip download --no-deps --no-binary gaitmap
gaitmap==2.6.0`, then unpack it.

`steps`: both feet of a walk, against the optics at the heels, as `tracking.py` scores them (the data folder's strides
are the left foot). `stairs`: by how much each foot rises from tread to tread where it takes two steps of the stairs;
they are even, so the spread is the tracker's. `walk`: four minutes on a level floor, 400 Hz, without the magnetometer,
whose field the building disturbs.
"""

import csv
import sys
import warnings
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from pbd.data import Demonstration, HandPath, Recording, Truth
from pbd.errors import PbdWarning
from pbd.pipeline import track
from pbd.pose import Array
from tests.benchmarks.report import arguments, finish
from tests.benchmarks.tracking import inside, spread, stride_errors

RATE_HZ, OPTICS_HZ, WALK_HZ = 204.8, 100.0, 400.0
"""Of the sensors on feet, of the optics, and of the sensor of the long walk."""

TWO_STEPS_M = 0.22
"""m: a foot that rises or sinks by more has passed two steps; one step of a stair is 13 to 20 cm high."""

HEELS = {"left": "L_FCC", "right": "R_FCC"}
"""Foot -> the optics' marker at its heel."""


def main() -> None:
    """Measure and print."""
    parser = arguments(str(__doc__))
    parser.add_argument("data", type=Path, metavar="DIR")
    args = parser.parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    feet, optics = table(args.data / "imu_sample.csv", 2), table(args.data / "mocap_sample.csv", 2)
    steps: dict[str, Any] = {}
    for foot, marker in HEELS.items():
        p = 1e-3 * np.column_stack([optics[marker, axis] for axis in "xyz"])
        t = np.arange(len(p)) / OPTICS_HZ
        truth = Truth(t, p, np.tile((1.0, 0.0, 0.0, 0.0), (len(t), 1)))
        absolute, scaled, heel, _ = stride_errors(Demonstration(of_foot(feet, foot), truth=truth))
        steps[foot] = spread(absolute, "_abs") | {"at_heel": spread(heel, "_abs")} | inside(scaled)
    stairs = {}
    for way in ("up", "down"):
        both = table(args.data / f"imu_sample_healthy_stair_{way}.csv", 2)
        stairs[way] = {foot: rises(track(of_foot(both, foot))) for foot in HEELS}
    finish({"steps": steps, "stairs": stairs, "walk": walk(args.data)}, args.json)


def table(file: Path, names: int) -> dict[tuple[str, ...], Array]:
    """Columns of a table by their names, which fill the first rows."""
    with file.open(newline="") as lines:
        rows = list(csv.reader(lines))
    values = np.array([[float(cell or "nan") for cell in row] for row in rows[names:]])
    return dict(zip(zip(*rows[:names], strict=True), values.T, strict=True))


def of_foot(columns: dict[tuple[str, ...], Array], foot: str) -> Recording:
    """The recording of the sensor on a foot."""
    acc, gyr = (
        np.column_stack([columns[f"{foot}_sensor", f"{name}_{axis}"] for axis in "xyz"]) for name in ("acc", "gyr")
    )
    return Recording(np.arange(len(acc)) / RATE_HZ, acc, np.radians(gyr))


def rises(path: HandPath) -> dict[str, Any]:
    """Mean, standard deviation and number of the changes of height from stop to stop that are two steps of stairs."""
    height = np.array([path.p_nav_sensor[(stop.start + stop.stop) // 2, 2] for stop in path.stops])
    change = np.diff(height)
    two = 100.0 * change[(np.abs(change) > TWO_STEPS_M) & (np.abs(change) < 2.0 * TWO_STEPS_M)]
    return {"mean_cm": float(two.mean()), "std_cm": float(two.std()), "n": len(two)}


def walk(data: Path) -> dict[str, Any]:
    """Of the long walk: stops, the length of the way, and by how much the height of the stops varies."""
    columns = table(data / "aligned_data_with_mag_l_walks.csv", 1)
    acc, gyr = (np.column_stack([columns[(f"{name}_{axis}",)] for axis in "xyz"]) for name in ("acc", "gyr"))
    path = track(Recording(np.arange(len(acc)) / WALK_HZ, acc, np.radians(gyr)))
    p = np.array([path.p_nav_sensor[(stop.start + stop.stop) // 2] for stop in path.stops])
    length = float(np.linalg.norm(np.diff(p, axis=0), axis=1).sum())
    return {"stops": len(p), "path_m": length, "height_range_cm": 100.0 * float(np.ptp(p[:, 2]))}


if __name__ == "__main__":
    main()
