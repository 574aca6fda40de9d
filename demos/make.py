"""Write the bundled demonstrations again: python demos/make.py. They are simulated, and their notes say so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pbd.data import Demonstration
from pbd.files.demo import write_demo
from pbd.simulation.simulate import simulate

BUNDLED = {
    "pouring": ("pour", "modern"),
    "paper-test1": ("pick-and-place-stops", "os5000"),
    "paper-test2": ("pick-and-place-direct", "os5000"),
}
"""Name -> task, sensor model; all with seed 0."""


def make(name: str) -> Demonstration:
    """Simulate a bundled demonstration."""
    demo = simulate(*BUNDLED[name], seed=0)
    info = replace(demo.recording.info, name=name, created="2026-11-21T00:00:00Z")
    return replace(demo, recording=replace(demo.recording, info=info), bundled=True)


if __name__ == "__main__":
    for name in BUNDLED:
        write_demo(make(name), Path(__file__).parent / name, force=True)
