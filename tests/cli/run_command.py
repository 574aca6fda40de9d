"""Runs commands in this process, for tests of the command line."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pbd.cli import main

Capture = pytest.CaptureFixture[str]
HEADER = "t,gx,gy,gz,ax,ay,az\n"


def run(capsys: Capture, *args: str | Path) -> tuple[int, str, str]:
    """Run a command; return its exit code and what it printed on stdout and stderr."""
    capsys.readouterr()
    code = main([str(arg) for arg in args])
    out, err = capsys.readouterr()
    return code, out, err


def run_json(capsys: Capture, *args: str | Path) -> dict[str, Any]:
    """Run a command with --json; check that it succeeds and prints one JSON object alone on stdout, and return it."""
    code, out, _ = run(capsys, *args, "--json")
    assert code == 0
    result = json.loads(out)
    assert isinstance(result, dict)
    assert out.count("\n") == 1
    return result


def refused(capsys: Capture, exit_code: int, *args: str | Path) -> str:
    """Run a command that fails; return its one line on stderr."""
    code, out, err = run(capsys, *args)
    assert code == exit_code
    assert out == ""
    notes = ("pbd: warning:", "pbd: no demonstration named:")
    lines = [line for line in err.splitlines() if not line.startswith(notes)]
    assert len(lines) == 1, err
    return lines[0]


def write_recording(path: Path, rows: int = 400, norm: float = 9.81) -> Path:
    """Write a recording of a still sensor as a CSV; the last digit of each number varies, as a sensor's does."""
    flicker = 1e-4 * np.random.default_rng(0).integers(-1, 2, (rows, 6)) + (0.0, 0.0, 0.0, 0.0, 0.0, norm)
    rows_text = (f"{i / 100},{','.join(f'{x:.4f}' for x in row)}\n" for i, row in enumerate(flicker))
    path.write_text(HEADER + "".join(rows_text))
    return path
