"""`pbd run` on emulated servos in real time: how steady it is, how far behind the arm, how soon each fault stops it.

The servos are emulated (tests/driving/emulator.py): their first-order motion is an assumption, the times on the wire
are a pseudo-terminal's. What is measured is pbd and this machine.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pbd.driving.motion_monitor import LAG_S
from pbd.driving.stream import Clock
from pbd.files.servo_calibration import write_servo_calibration
from tests.benchmarks.report import arguments, finish
from tests.driving.emulator import LEFT, Emulator, calibration_of, resting

RATE_HZ, TOLERANCE_DEG = 50.0, 10.0
FAULT_AT = 60
"""Goals before the fault: the arm is on its way to the first keyframe."""

Fault = Callable[[Emulator], object]
FAULTS: dict[str, Fault] = {
    "hot": lambda arm: arm.servos[2].put(63, bytes([66])),
    "low_voltage": lambda arm: arm.servos[2].put(62, bytes([50])),
    "complains": lambda arm: setattr(arm.servos[3], "flags", 32),
    "silent": lambda arm: setattr(arm.servos[4], "silent", True),
    "cable": lambda arm: setattr(arm, "drop", 0.5),
    "blocked": lambda arm: setattr(arm.servos[2], "blocked", True),
    "signal": lambda arm: None,
}


def run(emulator: Emulator, robot: str, folder: Path) -> subprocess.Popen[str]:
    """Start `pbd run` on it."""
    file = folder / "servos.json"
    write_servo_calibration(calibration_of(robot), file)
    words = ["run", "pouring", "--robot", robot, "--port", emulator.device, "--servos", str(file), "--yes", "--json"]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    pipe = subprocess.PIPE
    command = [sys.executable, "-m", "pbd", *words]
    return subprocess.Popen(command, env=environment, cwd=folder, stdout=pipe, stderr=pipe, text=True)


def whole(robot: str, folder: Path) -> dict[str, Any]:
    """Run the whole demonstration."""
    with Emulator(calibration_of(robot), resting(robot), Clock()) as emulator:
        process = run(emulator, robot, folder)
        out, _ = process.communicate()
        result = json.loads(out)
        goals = np.array([list(goal.values()) for _, goal in emulator.goals])
        places = np.array([list(place.values()) for place in emulator.places])
    return {
        "exit_code": process.returncode,
        "goals": result["goals"],
        "seconds": result["t_s"],
        "period_ms": result["period_ms"],
        "behind_deg": float(np.abs(goals - places)[:, :5].max() * 360 / 4096),
        "asked_again": result["asked_again"],
    }


def stop(name: str, folder: Path) -> dict[str, Any]:
    """Let something go wrong; say how long (ms) until the servos had the goal that holds them, if one reached them."""
    with Emulator(calibration_of("so101"), resting("so101", LEFT), Clock()) as emulator:
        process = run(emulator, "so101", folder)
        emulator.fault = lambda: process.terminate() if name == "signal" else FAULTS[name](emulator)
        emulator.at_goal = FAULT_AT
        _, err = process.communicate()
        assert emulator.goals, err
        began = crossed(emulator) if name == "blocked" else emulator.fault_t
        last = emulator.goals[-1][1]
        after = [t for t, goal in emulator.goals if t > began and goal == last]
    ms = 1e3 * (after[0] - began) if after else None
    return {"exit_code": process.returncode, "ms": ms, "says": err.splitlines()[-1]}


def crossed(emulator: Emulator) -> float:
    """When (real s) a servo was last seen within the tolerance of its goals of the last LAG_S."""
    goals = np.array([list(goal.values())[:5] for _, goal in emulator.goals])
    places = np.array([list(place.values())[:5] for place in emulator.places])
    window = round(LAG_S * RATE_HZ)
    for i in range(FAULT_AT, len(goals)):
        recent = goals[max(0, i - window) : i]
        off = np.maximum(recent.min(axis=0) - places[i], places[i] - recent.max(axis=0)).max()
        if off * 360 / 4096 > TOLERANCE_DEG:
            return emulator.goals[i - 1][0]
    return time.monotonic()


def main() -> None:
    """Run it."""
    args = arguments(__doc__ or "").parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        robots = ("so101",) if args.quick else ("so101", "so100")
        figures: dict[str, Any] = {robot: whole(robot, folder) for robot in robots}
        figures["stop"] = {fault: stop(fault, folder) for fault in (("hot", "silent") if args.quick else FAULTS)}
    finish(figures, args.json)


if __name__ == "__main__":
    main()
