"""What recording costs and what it loses: python tests/benchmarks/record.py [--json] [--quick].

Decoders' speed; samples lost in ten minutes at 400 Hz through a pseudo-terminal (--quick: ten seconds); the share of a
core that `pbd record` takes with its tracker and screen while a hand moves, at 400 Hz and 1 kHz; and what is on disk
after a `kill -9` at random moments.
"""

import os
import pty
import random
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

from pbd.data import Recording
from pbd.files.demo import read_demo
from pbd.sensors.protocols import protocol
from pbd.simulation.emulator import Emulator
from pbd.simulation.simulate import simulate
from tests.benchmarks.decoders import speed
from tests.benchmarks.report import arguments, finish
from tests.benchmarks.wires import FASTEST

ROOT = str(Path(__file__).parents[2])

WARM_S = 3.0
"""What is loaded at the start, and the first rest, are no part of the share of a core."""

MOVING_S = 20.0
"""So long the simulated hand moves and stops; then it rests."""


def main() -> None:
    """Measure and print."""
    args = arguments(str(__doc__)).parse_args()
    figures: dict[str, Any] = {"decoders": {}}
    for name, wire in FASTEST.items():
        found = speed(wire, 0.2)
        slower = min(found["samples_per_s_64"], found["samples_per_s_4096"])
        figures["decoders"][name] = {"samples_per_s": slower, "times_fastest": found["times_fastest"]}
    long_run = recording_run(400.0, 10.0 if args.quick else 600.0)
    figures["lost_in_ten_minutes"], figures["seconds"] = long_run["lost"], long_run["seconds"]
    for key, hz in (("cpu_share", 400.0), ("cpu_share_1000_hz", 1000.0)):
        figures[key] = recording_run(hz, MOVING_S)["cpu_share"]
    figures["kill9"] = kills(5 if args.quick else 100)
    finish(figures, args.json)


def recording_run(rate_hz: float, seconds: float) -> dict[str, float]:
    """Let `pbd record` run for so long at a terminal, with its screen; its share of a core begins after WARM_S."""
    recording: Recording = simulate("pour", "modern", 1, rate_hz=rate_hz).recording
    with tempfile.TemporaryDirectory() as folder, Emulator(recording) as sensor:
        words = ["--sensor", "ximu3", "--port", sensor.device, "--baud", "115200", "--duration", f"{seconds}"]
        child, terminal = pty.fork()
        if child == 0:
            os.chdir(folder)
            os.environ |= {"PYTHONPATH": ROOT, "TERM": "xterm", "COLUMNS": "80", "LINES": "24"}
            os.execv(sys.executable, [sys.executable, "-m", "pbd", "record", "demo", *words])
        imu = Path(folder) / "demos" / "demo" / "imu.csv"
        begun: tuple[float, float] | None = None
        latest, since = (0.0, 0.0), 0.0
        while drained(terminal):
            now = (time.monotonic(), cpu_s(child))
            if not since and imu.exists():
                since = now[0]
            if since and begun is None and now[0] - since > WARM_S:
                begun = now
            latest = now if now[0] - since < seconds - 1.0 else latest
        os.close(terminal)
        if os.waitpid(child, 0)[1] != 0 or begun is None:
            sys.exit(f"the recording at {rate_hz:g} Hz failed")
        t = read_demo(imu.parent).recording.t
    sent = round(float(t[-1]) * rate_hz) + 1
    share = (latest[1] - begun[1]) / (latest[0] - begun[0])
    return {"lost": sent - len(t), "seconds": float(t[-1]), "cpu_share": share}


def drained(terminal: int) -> bool:
    """Read what is drawn; False once nobody draws any more."""
    try:
        return bool(os.read(terminal, 65536))
    except OSError:
        return False


def cpu_s(process: int) -> float:
    """Processor time of a process so far, s."""
    fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def kills(cases: int) -> dict[str, float]:
    """Kill `pbd record` at random moments: what the sensor had sent and is not on disk, s."""
    dice, lost = random.Random(1), []
    recording = simulate("pour", "modern", 1).recording
    for _ in range(cases):
        with tempfile.TemporaryDirectory() as folder, Emulator(recording) as sensor:
            words = ["--sensor", "ximu3", "--port", sensor.device, "--baud", "115200", "--raw"]
            process = subprocess.Popen(
                [sys.executable, "-m", "pbd", "record", "demo", *words],
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": ROOT},
            )
            demo = Path(folder) / "demos" / "demo"
            while not (demo / "imu.csv").exists():
                time.sleep(0.002)
            time.sleep(dice.uniform(0.02, 3.0))
            sent = sensor.sent
            process.kill()
            process.wait()
            # the times on disk begin with the first sample that was read: raw.bin tells which of those sent that was
            (first, *_) = protocol("ximu3").decoder().feed((demo / "raw.bin").read_bytes())
            on_disk = float(first.t_device or 0.0) + float(read_demo(demo).recording.t[-1])
            lost.append((sent - 1) / recording.rate_hz - on_disk)
    return {"cases": cases, "median_lost_s": statistics.median(lost), "max_lost_s": max(lost)}


if __name__ == "__main__":
    main()
