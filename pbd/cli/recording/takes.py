"""Advice for several takes of a task: how to hold the sensor, and which command comes next."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from pbd.files.demo import shell_word

HOLDS = (
    "hold the sensor as you like, and remember how",
    "turn the sensor by a quarter about the vertical, as it lies at the dock",
    "turn the sensor by a quarter about a level axis, so that another side of it is up at the dock",
    "turn the sensor by another quarter about the vertical",
)
"""How to hold the sensor in takes 1, 2, 3 and 4. Later takes repeat 2, 3 and 4."""

WHY = "its own errors then point elsewhere in each take, and fusing tells them from the motion"


def how_to_hold(take: int) -> str:
    """Say how to hold the sensor in take 1, 2, ..., and why."""
    how = HOLDS[(take - 1) % len(HOLDS)] if take <= len(HOLDS) else HOLDS[1 + (take - 2) % (len(HOLDS) - 1)]
    return f"take {take}: {how}{'' if take == 1 else f': {WHY}'}; the hand starts and moves as before"


def next_command(args: argparse.Namespace, folder: Path) -> str:
    """Return the command that follows a recording; after a take, the next take, or `pbd fuse`."""
    if args.take is None:
        return f"pbd keyframes {shell_word(folder)}"
    sensor = f" --sensor {args.sensor}" if args.sensor else ""
    more = f"pbd record {shlex.quote(args.name)} --take {args.take + 1}{sensor}"
    if args.take < 2:
        return more
    takes = (folder.with_name(f"{Path(args.name).name}{take}") for take in range(1, args.take + 1))
    words = " ".join(map(shell_word, takes))
    return f"{more}; or pbd fuse {words} -o {shlex.quote(args.name)}"
