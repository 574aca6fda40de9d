"""How fast recordings of other programs are imported: python tests/benchmarks/files.py [--json] [--quick].

An hour of nine axes at 400 Hz (--quick: a minute), pouring again and again, is written as x-io's CSV, as a bag of
ROS 2 (MCAP) and as Movella's DOT CSV, and each is imported by `pbd import` in a process of its own: reading, checking,
tracking and storing. Of each:

- `rate`: samples a second of processor time;
- `seconds` of processor time (aim: 10 for an hour);
- `peak_mb`: the largest memory of the process (aim: 1000).

`pandas` is the same of pandas.read_csv alone on x-io's file, which neither checks nor stores anything.
"""

import os
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from pbd.data import GRAVITY
from pbd.pose import Array
from tests.benchmarks.memory import repeated, simulated
from tests.benchmarks.report import arguments, finish
from tests.files.write_bag import write_bag
from tests.not_none import not_none

RATE_HZ = 400.0
XIO = "Timestamp (us)," + ",".join(
    f"{what} {axis} ({unit})"
    for what, unit in (("Gyroscope", "deg/s"), ("Accelerometer", "g"), ("Magnetometer", "uT"))
    for axis in "XYZ"
)
DOT = "DeviceTag:,D422,,,,,,,,,,\nPacketCounter,SampleTimeFine," + ",".join(
    f"{what}_{axis}" for what in ("Gyr", "Acc", "Mag") for axis in "XYZ"
)


def main() -> None:
    """Write, import, print."""
    args = arguments(str(__doc__)).parse_args()
    samples = round(RATE_HZ * (60 if args.quick else 3600))
    figures: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        with ProcessPoolExecutor(1) as elsewhere:  # a child's peak counts what its parent holds
            files = elsewhere.submit(written, Path(folder), samples).result()
        for name, file in files.items():
            figures[name] = measured(["-m", "pbd", "import", str(file), f"demo-{name}"], folder, samples)
        reading = f"import pandas; pandas.read_csv({str(files['xio'])!r})"
        figures["pandas"] = measured(["-c", reading], folder, samples)
    finish(figures, args.json)


def written(folder: Path, samples: int) -> dict[str, Path]:
    """The files, by format."""
    recording = repeated(simulated("moves", RATE_HZ).recording, samples, RATE_HZ)
    us, counter = 1e6 * recording.t[:, None], np.arange(len(recording), dtype=np.float64)[:, None]
    dps, mag = np.degrees(not_none(recording.gyr)), not_none(recording.mag)
    tables: dict[str, tuple[str, tuple[Array, ...]]] = {
        "xio": (XIO, (us, dps, recording.acc / GRAVITY, mag)),
        "dot": (DOT, (counter, us, dps, recording.acc, mag)),
    }
    files = {}
    for name, (header, columns) in tables.items():
        files[name] = folder / f"{name}.csv"
        np.savetxt(files[name], np.hstack(columns), fmt="%.9g", delimiter=",", header=header, comments="")
    files["mcap"] = write_bag(folder / "bag", recording)
    return files


def measured(command: list[str], folder: str, samples: int) -> dict[str, float]:
    """Run Python; say how long it computed, and its peak."""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    child = subprocess.Popen([sys.executable, *command], cwd=folder, env=environment, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    if status:
        sys.exit(f"{command} failed")
    seconds = used.ru_utime + used.ru_stime
    return {"rate": samples / seconds, "seconds": seconds, "peak_mb": used.ru_maxrss / 1e3}


if __name__ == "__main__":
    main()
