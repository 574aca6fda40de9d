"""What every benchmark prints: on which machine, with which versions, and its figures as a table or as JSON."""

import argparse
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pbd.cli.console import print_json
from pbd.tracking.noise import Noise

PACKAGES = ("numpy", "scipy", "pin", "ruckig", "meshcat")


def arguments(description: str) -> argparse.ArgumentParser:
    """The options that every benchmark takes."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--quick", action="store_true", help="a small run")
    return parser


def add_data(parser: argparse.ArgumentParser) -> None:
    """Add where the real recordings are."""
    default = os.environ.get("PBD_DATA", str(Path(__file__).parents[3] / "shared" / "data"))
    parser.add_argument("--data", type=Path, default=Path(default), help="the folder with broad/, walks/ and strides/")


def add_sway(parser: argparse.ArgumentParser) -> None:
    """Add how fast a simulated hand wanders: by default as fast as the tracker takes one to that stands still."""
    mm_s = 1e3 * Noise.still_speed
    parser.add_argument("--sway", type=float, default=mm_s, metavar="MM/S", help="how fast the hand wanders, rms")


def print_machine() -> None:
    """Print machine and versions."""
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    print(", ".join(f"{package} {version(package)}" for package in PACKAGES))


def print_figures(figures: Mapping[str, Any], name: str = "") -> None:
    """Print nested figures, a line each."""
    for key, value in figures.items():
        full = f"{name}.{key}" if name else key
        if isinstance(value, Mapping):
            print_figures(value, full)
        else:
            print(f"{full:<40} {value:>12.4g}" if isinstance(value, float) else f"{full:<40} {value!s:>12}")


def finish(figures: Mapping[str, Any], as_json: bool) -> None:
    """Print the figures as asked."""
    if as_json:
        print_json(figures)
    else:
        print_machine()
        print_figures(figures)


def median_ms(call: Callable[[], object], runs: int) -> float:
    """Median time of a call over so many runs, after one that isn't counted."""
    call()
    times: Sequence[float] = [_timed(call) for _ in range(runs)]
    return 1e3 * sorted(times)[len(times) // 2]


def _timed(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start
