"""What recording costs and what it loses: python tests/benchmarks/record.py [--json] [--quick].

Decoders' speed; ten minutes at 400 Hz through a pseudo-terminal (--quick: ten seconds) and the share of a core that it
takes with the tracker running, also at 1 kHz; and what is on disk after a `kill -9` at random moments.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from pbd.data import Recording
from pbd.files.demo import read_demo
from pbd.record import RecordOptions, record
from pbd.sensors.emulator import Emulator
from pbd.sensors.port import open_port
from pbd.sensors.protocols import protocol
from pbd.sensors.simulate import simulate
from tests.benchmarks.decoders import speed
from tests.benchmarks.report import arguments, finish
from tests.benchmarks.wires import FASTEST

FOLDER_SEEN_S = 0.3
"""When the folder appears it holds this much already (pbd/record/session.py, LOOK_S)."""


def main() -> None:
    """Measure and print."""
    args = arguments(str(__doc__)).parse_args()
    figures: dict[str, Any] = {"decoders": {}}
    for name, wire in FASTEST.items():
        found = speed(wire, 0.2)
        slower = min(found["samples_per_s_64"], found["samples_per_s_4096"])
        figures["decoders"][name] = {"samples_per_s": slower, "times_fastest": found["times_fastest"]}
    long_run = recording_run(400.0, 10.0 if args.quick else 600.0)
    figures["lost_in_ten_minutes"] = long_run["lost"]
    figures["seconds"] = long_run["seconds"]
    figures["cpu_share"] = {"400": long_run["cpu_share"], "1000": recording_run(1000.0, 10.0)["cpu_share"]}
    figures["kill9"] = kills(5 if args.quick else 100)
    finish(figures, args.json)


def recording_run(rate_hz: float, seconds: float) -> dict[str, float]:
    """Record for so long; the emulator's own work is in the share too, as it runs in this process."""
    recording: Recording = simulate("pour", "modern", 1, rate_hz=rate_hz).recording
    with tempfile.TemporaryDirectory() as folder, Emulator(recording) as sensor:
        options = RecordOptions(Path(folder) / "demo", "ximu3", "2026-01-01T00:00:00Z", duration_s=seconds)
        begun, cpu = time.monotonic(), time.process_time()
        outcome = record(
            lambda: open_port(sensor.device, 115200),
            protocol("ximu3").decoder(),
            options,
            lambda: None,
            lambda status: None,
        )
        share = (time.process_time() - cpu) / (time.monotonic() - begun)
        t = read_demo(Path(folder) / "demo").recording.t
    sent = round(float(t[-1]) * rate_hz) + 1
    return {"lost": sent - len(t), "seconds": outcome.duration_s, "cpu_share": share}


def kills(cases: int) -> dict[str, float]:
    """Kill `pbd record` at random moments; the worst that was not on disk, s."""
    dice, worst = random.Random(1), 0.0
    for _ in range(cases):
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "pbd", "record", "demo", "--sensor", "sim"]
            process = subprocess.Popen(
                command,
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
            )
            demo = Path(folder) / "demos" / "demo"
            while not (demo / "imu.csv").exists():
                time.sleep(0.002)
            begun = time.monotonic()
            time.sleep(dice.uniform(0.1, 2.0))
            elapsed = time.monotonic() - begun
            process.kill()
            process.wait()
            worst = max(worst, elapsed + FOLDER_SEEN_S - float(read_demo(demo).recording.t[-1]))
    return {"cases": cases, "max_lost_s": worst}


if __name__ == "__main__":
    main()
