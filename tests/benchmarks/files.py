"""How fast recordings of other programs are imported: python tests/benchmarks/files.py [--json] [--quick].

An hour of nine axes at 400 Hz (--quick: a minute) is written as x-io's CSV, as a bag of ROS 2 (MCAP) and as Movella's
DOT CSV, and each is imported by `pbd import` in a process of its own: reading, checking, tracking and storing. Of each:

- `rate`: samples a second of processor time;
- `seconds` of processor time (aim: 10 for an hour);
- `peak_mb`: the largest memory of the process (aim: 1000).

`pandas` is the same of pandas.read_csv alone on x-io's file, which neither checks nor stores anything.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from pbd.data import GRAVITY, Recording
from pbd.pose import Array
from pbd.simulation.simulate import simulate
from tests.benchmarks.report import arguments, finish
from tests.files.test_import_bag import write_bag

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
    recording = long_recording(round(RATE_HZ * (60 if args.quick else 3600)))
    figures: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        files = written(Path(folder), recording)
        for name, file in files.items():
            figures[name] = measured(["-m", "pbd", "import", str(file), f"demo-{name}"], folder, len(recording))
        reading = f"import pandas; pandas.read_csv({str(files['xio'])!r})"
        figures["pandas"] = measured(["-c", reading], folder, len(recording))
    finish(figures, args.json)


def long_recording(samples: int) -> Recording:
    """A simulated demonstration, again and again, there and back in time so that it never leaps."""
    once = simulate("pour", "modern", 0, rate_hz=RATE_HZ).recording
    assert once.gyr is not None
    assert once.mag is not None
    there = np.arange(len(once))
    rows = np.resize(np.concatenate((there, there[::-1])), samples)
    back = np.resize(np.repeat((1.0, -1.0), len(once)), samples)
    noise = np.random.default_rng(0).normal(0.0, 1e-3, (3, samples, 3))  # without it a block would come twice
    # Backwards in time a hand turns the other way, with the same specific force.
    gyr = once.gyr[rows] * back[:, None]
    return Recording(np.arange(samples) / RATE_HZ, once.acc[rows] + noise[0], gyr + noise[1], once.mag[rows] + noise[2])


def written(folder: Path, recording: Recording) -> dict[str, Path]:
    """The files, by format."""
    assert recording.gyr is not None
    assert recording.mag is not None
    us, counter = 1e6 * recording.t[:, None], np.arange(len(recording), dtype=np.float64)[:, None]
    dps, mag = np.degrees(recording.gyr), recording.mag
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
