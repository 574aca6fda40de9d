"""Make the pictures of docs/plots.md: python docs/plot_pictures.py."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
ONE = ("summary", "path", "motion", "velocity", "sigma")
"""Of the bundled demonstration."""
SEVERAL = ("views", "spread")
"""Of four simulated ones of the same task."""


def main() -> None:
    """Write plot-*.png beside this file."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        _pbd(work, "plot", "pouring", "--save", "one")
        names = [f"tea{seed}" for seed in range(4)]
        for seed, name in enumerate(names):
            _pbd(work, "simulate", "pour", name, "--sensor-model", "wt901", "--seed", str(seed))
        _pbd(work, "plot", *names, "--save", "several")
        for kind, pictures in (("one", ONE), ("several", SEVERAL)):
            for picture in pictures:
                (HERE / f"plot-{picture}.png").write_bytes((work / kind / f"{picture}.png").read_bytes())


def _pbd(folder: Path, *args: str) -> None:
    subprocess.run([sys.executable, "-m", "pbd", *args], cwd=folder, check=True)


if __name__ == "__main__":
    main()
