"""The commands that work on several demonstrations at once."""

from __future__ import annotations

import argparse
from pathlib import Path

from pbd.cli.options import Commands, add_accept_gap, add_command, add_force, add_table, add_tracking

FIGURE_FORMATS = ("png", "svg", "pdf")
MOST_JOBS = 256
"""Most processes of `pbd check`: more cores than a workstation has."""


def add_fuse(commands: Commands) -> None:
    """Add `pbd fuse`."""
    parser = add_command(
        commands,
        "fuse",
        "make one demonstration of several takes of a task",
        "Match the keyframes of several takes, estimate all of them together with the sensor's own errors, and store\n"
        "what they make as a demonstration that lists them. Between takes turn the sensor in the hand by a quarter,\n"
        "once about a level axis (`pbd record --take N` says so): then its errors cancel. How the hand scatters from\n"
        "take to take becomes the keyframes' tolerance.",
        "  pbd fuse tea1 tea2 tea3 -o tea\n"
        "  pbd fuse tea tea4 -o tea --force           one more take\n"
        "  pbd fuse tea1 tea2 tea3 -o tea --save-calibration my-sensor --plot plots/tea",
    )
    parser.set_defaults(module="pbd.cli.many.fuse")
    option = parser.add_argument
    option("takes", nargs="+", metavar="TAKE", help="demonstrations of one task, by name or folder; or a fused one")
    option("-o", "--output", required=True, metavar="NAME", help="the new demonstration's name (in ./demos) or folder")
    kept = "write the device's errors, as all takes show them, into the [sensor] of calibration/NAME.toml"
    option("--save-calibration", metavar="NAME", help=kept)
    option("--plot", type=Path, metavar="DIR", help="draw the takes' match and the hand's scatter into this folder")
    add_force(parser)
    add_table(parser, units="m,deg")
    wanted = "name (in ./calibration, or bundled) or file: its [sensor] is taken out of each take first"
    option("--calibration", metavar="C", help=wanted)
    add_accept_gap(parser)


def add_check(commands: Commands) -> None:
    """Add `pbd check`."""
    parser = add_command(
        commands,
        "check",
        "which of many demonstrations need a look",
        "Check demonstrations: whether each can be tracked (and, with --robot, replayed), how sure its keyframes are,\n"
        "what a person should look at, and where it differs from its siblings. What needs a look comes first.\n"
        "The exit code is 1 where one can't be used.",
        "  pbd check demos/*\n  pbd check demos/tea* --robot panda --jobs 4 --csv > tea.csv",
    )
    parser.set_defaults(module="pbd.cli.many.check")
    parser.add_argument("demos", nargs="+", metavar="DEMO", help="names (in ./demos, or bundled), folders, recordings")
    parser.add_argument("--robot", metavar="R", help="also plan for this robot, on its own dock")
    parser.add_argument("--jobs", type=_jobs, default=1, metavar="N", help="how many at once (1); -1: one a core")
    add_table(parser, units="mm,s")


def _jobs(text: str) -> int:
    if not text.removeprefix("-").isdecimal() or not (int(text) == -1 or 1 <= int(text) <= MOST_JOBS):
        raise argparse.ArgumentTypeError(f"must be 1 to {MOST_JOBS}, or -1, got '{text}'")
    return int(text)


def add_plot(commands: Commands) -> None:
    """Add `pbd plot`, of one demonstration or of several."""
    parser = add_command(
        commands,
        "plot",
        "draw a demonstration: the paper's figures and more; or compare several",
        "Draw a demonstration into files: the paper's figures 5 to 10, attitude, specific force, velocity with its\n"
        "residuals, sigma, magnetic field, sampling intervals, and a summary sheet. Several demonstrations of\n"
        "one task are overlaid at their first stop, with the spread at each keyframe, which is also printed as a\n"
        "table.",
        "  pbd plot pouring --save figures --format svg\n  pbd plot paper-test1 paper-test2 --csv > spread.csv",
    )
    parser.add_argument(
        "demos",
        nargs="*",
        metavar="DEMO",
        help="names (in ./demos, or bundled), folders, or recordings (.csv, .npz); two or more are compared; "
        "default: the newest in ./demos, else 'pouring'",
    )
    parser.add_argument("--save", type=Path, metavar="DIR", help="folder for the files (./plots/NAME)")
    parser.add_argument("--format", choices=FIGURE_FORMATS, default="png", help="format of the files (png)")
    add_table(parser, units="cm,deg")
    add_tracking(parser, calibration="none")
