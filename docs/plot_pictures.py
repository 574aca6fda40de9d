"""Make the pictures of docs/plots.md: python docs/plot_pictures.py."""

import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from pbd.files.demo import write_demo
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import TASKS, simulate

HERE = Path(__file__).parent
ONE = ("summary", "path", "motion", "velocity", "sigma")
"""Of the bundled demonstration."""
SEVERAL = ("views", "spread")
"""Of four simulated ones of the same task."""
TREMBLES, SWING_M, SWING_S, SWINGS, HURRIES, HURRIES_S = 5, 0.008, 0.1, 12, 3, 0.1
"""The hand trembles at one keyframe, up and down in so many seconds, and stands still at another for so many."""


def main() -> None:
    """Write plot-*.png beside this file."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        _pbd(work, "plot", "pouring", "--save", "one")
        names = [f"tea{seed}" for seed in range(4)]
        for seed, name in enumerate(names):
            _pbd(work, "simulate", "pour", name, "--sensor-model", "wt901", "--seed", str(seed))
        _pbd(work, "plot", *names, "--save", "several")
        _write_trouble(work / "trouble")
        _pbd(work, "plot", "trouble", "--save", "flawed")
        (HERE / "plot-trouble.png").write_bytes((work / "flawed" / "summary.png").read_bytes())
        for kind, pictures in (("one", ONE), ("several", SEVERAL)):
            for picture in pictures:
                (HERE / f"plot-{picture}.png").write_bytes((work / kind / f"{picture}.png").read_bytes())


def _write_trouble(folder: Path) -> None:
    """Pouring as somebody in a hurry does it, who trembles while it pours."""
    waypoints = list(TASKS["pour"].waypoints)
    waypoints[HURRIES] = replace(waypoints[HURRIES], rest_s=HURRIES_S)
    held = waypoints[TREMBLES]
    x, y, z = held.p
    swings = [Waypoint((x, y, z + k % 2 * SWING_M), move_s=SWING_S) for k in range(1, SWINGS + 1)]
    waypoints[TREMBLES : TREMBLES + 1] = [replace(held, rest_s=0.0), *swings]
    demo = simulate(replace(TASKS["pour"], waypoints=tuple(waypoints)), "modern")
    info = replace(demo.recording.info, name="trouble")
    write_demo(replace(demo, recording=replace(demo.recording, info=info), truth=None), folder)


def _pbd(folder: Path, *args: str) -> None:
    subprocess.run([sys.executable, "-m", "pbd", *args], cwd=folder, check=True)


if __name__ == "__main__":
    main()
