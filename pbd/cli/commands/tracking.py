"""Options of the commands that need no robot: segments, keyframes, touch, plot, fuse, check."""

import sys
from argparse import ArgumentParser
from pathlib import Path

from pbd.cli.options import (
    CALIBRATION,
    add_accept_gap,
    add_demo,
    add_placing,
    add_planning,
    add_table,
    add_tracking,
    finite,
    flag,
    integer,
    option,
    thing_keyframes,
)

MOST_JOBS = 256
"""Largest number of processes of `pbd check`: more than the cores of a workstation."""


def segments(parser: ArgumentParser) -> None:
    """When the hand moved, when it rested, and what kind of motion it was.

    Print the paper's Table I for a demonstration: the intervals of samples, what happens in each, and how long.

      pbd segments paper-test1
    """
    add_demo(parser)
    add_table(parser, units="ms")
    add_tracking(parser, calibration="none")


def keyframes(parser: ArgumentParser) -> None:
    """Where the hand stopped, and how certain that is.

    Print the pose at each stop of a demonstration with its uncertainty; with a robot also the tool's pose
    in the robot's base and joints that reach it, if nothing is in the way. Times are the hand's, whatever
    --speed and --time say (the motion's own: pbd export --format keyframes). --save writes them for you to edit.

      pbd keyframes pouring --robot panda
      pbd keyframes tea --save
    """
    add_demo(parser)
    add_table(parser, units="m,deg,s")
    flag(parser, "--save", "write keyframes.toml into the demonstration, for you to edit")
    flag(parser, "--force", "with --save: find the keyframes again; an edited file stays in keyframes.toml.before")
    things = (
        "keyframes that belong to a thing, which `pbd replay --at` moves: cup=3..5; lid=6..7@cup if the cup carries it"
    )
    option(parser, "--frame", "THING=I..J", things, type=thing_keyframes, action="append", default=[])
    within = "print how likely the tool is within this distance and angle of its pose (the keyframes' own tolerances)"
    option(parser, "--tolerance", ("METRES", "DEGREES"), within, type=finite, nargs="+")
    add_tracking(parser, calibration="with --robot: its own dock, else 'default'; without: none")
    add_planning(parser, robot_required=False, units=False)


def touch(parser: ArgumentParser) -> None:
    """Correct a keyframe where the real arm was off.

    The tool is off at a keyframe: say by how much, or where it belongs. That is a measurement, so the other
    keyframes move with it as far as their errors are correlated with its error. It is kept in keyframes.toml.

      pbd touch tea 3 --robot panda --by 0 -0.004 0
      pbd touch tea --robot panda --undo
    """
    option(parser, "demo", "DEMO", "a demonstration's name (in ./demos), or its folder")
    count = integer("a whole number", range(sys.maxsize))
    option(parser, "keyframe", "KEYFRAME", "its number, as `pbd keyframes` has it", nargs="?", type=count)
    option(parser, "--robot", "R", "the arm that was tried", required=True)
    option(parser, "--by", ("X", "Y", "Z"), "how far the tool must move, m, in base axes", type=finite, nargs=3)
    flag(parser, "--tool", "with --by: in the tool's own axes")
    option(parser, "--at", ("X", "Y", "Z"), "where the tool belongs in base, m", type=finite, nargs=3)
    flag(parser, "--only", "the other keyframes stay where they are")
    add_placing(parser.add_argument_group("as the motion was tried"))
    flag(parser, "--undo", "undo the last touch-up; an edited file keeps it, marked as undone")
    option(parser, "--calibration", "C", f"{CALIBRATION}; default: the robot's own dock, else 'default'")
    add_accept_gap(parser)
    add_table(parser, units="m")
    parser.set_defaults(time="limits", dwell_s=None, force=False)


def plot(parser: ArgumentParser) -> None:
    """Draw a demonstration: the paper's figures and more; or compare several.

    Draw a demonstration into files: the paper's figures 5 to 10, attitude, specific force, velocity with its
    residuals, sigma, magnetic field, sampling intervals, and a summary sheet. Several demonstrations of
    one task are overlaid at their first stop, with the spread at each keyframe, which is also printed as a
    table.

      pbd plot pouring --save figures --format svg
      pbd plot paper-test1 paper-test2 --csv > spread.csv
    """
    several = "names (in ./demos, or bundled), folders, or recordings (.csv, .txt, .npz); two or more are compared"
    option(parser, "demos", "DEMO", f"{several}; default: the newest in ./demos, else 'pouring'", nargs="*")
    option(parser, "--save", "DIR", "folder for the files (./plots/NAME); older figures are replaced", type=Path)
    option(parser, "--format", None, "format of the files (png)", choices=("png", "svg", "pdf"), default="png")
    add_table(parser, units="cm,deg")
    add_tracking(parser, calibration="none")


def fuse(parser: ArgumentParser) -> None:
    """Make one demonstration of several takes of a task.

    Match the keyframes of several takes, estimate all of them together with the sensor's own errors, and store
    the result as a demonstration that lists its takes. Between takes turn the sensor in the hand by a quarter,
    once about a level axis (`pbd record --take N` says how): its errors then cancel. The hand's scatter from
    take to take becomes the keyframes' tolerance.

      pbd fuse tea1 tea2 tea3 -o tea
      pbd fuse tea tea4 -o tea --force           one more take
      pbd fuse tea1 tea2 tea3 -o tea --save-calibration my-sensor --plot plots/tea
    """
    option(
        parser, "takes", "TAKE", "demonstrations of one task, by name or folder; a fused one adds its takes", nargs="+"
    )
    option(parser, "-o --output", "NAME", "the new demonstration's name (in ./demos) or folder", required=True)
    kept = "write the device's errors, as all takes show them, into the [sensor] of calibration/NAME.toml"
    option(parser, "--save-calibration", "NAME", kept)
    drawn = "draw the takes' match and the hand's scatter into this folder; older figures are replaced"
    option(parser, "--plot", "DIR", drawn, type=Path)
    replaced = "replace a fused demonstration of that name; one with a person's edits stays in NAME.before"
    flag(parser, "--force", replaced)
    add_table(parser, units="m,deg")
    option(parser, "--calibration", "C", f"{CALIBRATION}: its [sensor] is taken out of each take first")
    add_accept_gap(parser)


def check(parser: ArgumentParser) -> None:
    """Which of many demonstrations need a look.

    Check demonstrations: whether each can be tracked (and, with --robot, replayed), how sure its keyframes are,
    what a person should look at, and where it differs from the others of its task. The worst come first.
    The exit code is 1 where one can't be used.

      pbd check demos/*
      pbd check demos/tea* --robot panda --jobs 4 --csv > tea.csv
    """
    option(parser, "demos", "DEMO", "names (in ./demos, or bundled), folders, recordings", nargs="+")
    option(parser, "--robot", "R", "also plan for this robot, on its own dock")
    jobs = integer(f"1 to {MOST_JOBS}, or -1", (-1, *range(1, MOST_JOBS + 1)))
    option(parser, "--jobs", "N", "number of processes (1); -1: one per core", type=jobs, default=1)
    add_accept_gap(parser)
    add_table(parser, units="mm,s")
