"""Options of `pbd calibrate` and of its steps: dock, points, mount, sensor, show."""

import argparse
from argparse import ArgumentParser
from collections.abc import Callable
from pathlib import Path

from pbd.cli.options import JSON, add_accept_gap, add_commands, finite, flag, option, sigma_mm, within

REPLACE_PART = "replace a [dock] by a [nav], or a [nav] by a [dock]"


def calibrate(parser: ArgumentParser) -> None:
    """Where the hand starts in the robot's base, how the sensor is mounted, and its errors.

    Make or update ./calibration/NAME.toml, one part at a time; the other parts stay as they are.
    docs/calibration.md explains each part.

      pbd calibrate dock bench --position 0.45 -0.15 0.25 --rpy 0 0 0 --robot panda
      pbd calibrate show bench
      pbd replay tea --robot panda --calibration bench
    """
    add_commands(parser, "steps", "STEP", (dock, points, mount, sensor, show))


def _add_name(parser: ArgumentParser, demo: str = "") -> None:
    option(parser, "name", "CALIBRATION", "name (./calibration/CALIBRATION.toml), or its file's path")
    flag(parser, "--json", JSON)
    if demo:
        option(parser, "demo", "DEMO", demo)


def _add_placing(parser: ArgumentParser) -> None:
    place = "one sigma of where you put the sensor down, each axis, mm (3)"
    option(parser, "--sigma-mm", "MM", place, type=sigma_mm, default=3.0)
    option(parser, "--sigma-deg", "DEG", "and of how it is turned, degrees (1)", type=within(1e-6, 180.0), default=1.0)


def dock(parser: ArgumentParser) -> None:
    """Where in the robot's base a demonstration starts.

    Say where the sensor lies, in the robot's base, when a demonstration begins: measured by hand, where the
    robot's own tool stands at some joints, or where an earlier demonstration stopped.

      pbd calibrate dock bench --position 0.45 -0.15 0.25 --rpy 0 0 0 --robot panda
      pbd calibrate dock bench --robot panda --joints 0 -45 0 -135 0 90 -45
      pbd calibrate dock shelf --from-keyframe tea 7 --calibration bench
    """
    _add_name(parser)
    where = parser.add_mutually_exclusive_group(required=True)
    option(where, "--position", ("X", "Y", "Z"), "position of the SENSOR in base, m", nargs=3, type=finite)
    joints = "the arm's joints there, degrees (sliding joints: m); needs --robot"
    option(where, "--joints", "Q", joints, nargs="+", type=finite)
    option(where, "--from-keyframe", ("DEMO", "K"), "where demonstration DEMO stopped at its keyframe K", nargs=2)
    rpy = "with --position: roll, pitch, yaw, degrees (as in CALIBRATION's dock, else 0 0 0)"
    option(parser, "--rpy", ("R", "P", "Y"), rpy, nargs=3, type=finite)
    option(parser, "--calibration", "C", "with --from-keyframe: the calibration from whose start DEMO began")
    option(parser, "--robot", "R", "robot of --joints; checks that it reaches the dock")
    _add_placing(parser)
    flag(parser, "--force", REPLACE_PART)
    add_accept_gap(parser)


def points(parser: ArgumentParser) -> None:
    """Where the hand's frame (nav) lies in the robot's base, from known points that the hand touched.

    Find how a demonstration lies in the robot's base from three or more known points that its stops touched.
    FILE is a CSV with the header name,x_m,y_m,z_m (or _cm, _mm; Excel's `x (mm)` too) and one row per point.

      pbd calibrate points bench touches --points corners.csv
      pbd calibrate points bench touches --points corners.csv --any-order
    """
    _add_name(parser, "the demonstration whose stops touched the points")
    option(parser, "--points", "FILE", "the points, in the robot's base", type=Path, required=True)
    option(parser, "--unit", None, "unit of columns named x, y, z", choices=("m", "cm", "mm"))
    order = parser.add_mutually_exclusive_group()
    flag(order, "--any-order", "the points were touched in an unknown order: find it")
    option(order, "--stops", "K,K,...", "the stop that touched each point, in the points' order", type=_stops)
    flag(parser, "--free", "also find the tilt, where the base's z is not vertical")
    flag(parser, "--find-scale", "also find the scale of the hand's path")
    touch = "one sigma between tip and point, each axis, mm (1)"
    option(parser, "--touch-mm", "MM", touch, type=sigma_mm, default=1.0)
    nav = "nav: later demonstrations start at the same point with any heading (needs a magnetometer, and is the default"
    both = f"{nav} with one); dock: they start with the sensor in the same pose"
    option(parser, "--as", None, both, dest="part", choices=("nav", "dock"))
    again = "check how well the heading repeats, in demonstrations that began with the sensor put down the same way"
    option(parser, "--again", "DEMO", again, nargs="+", default=())
    _add_placing(parser)
    flag(parser, "--force", f"{REPLACE_PART}, or a good fit by a poor one")
    add_accept_gap(parser)


def mount(parser: ArgumentParser) -> None:
    """How the sensor is mounted on the tool: its lever and its rotation.

    Find where the tool is relative to the sensor. --pivot: the tip stays on one point while you tilt the tool
    to all sides, with rests between; this gives the lever. --turns: you turn the tool about its own axes,
    one after the other, with rests between; this gives the sensor's rotation. Signs follow the right-hand
    rule; the tool's z is the approach direction, its x the direction in which the jaws open.

      pbd calibrate mount bench pivot --pivot
      pbd calibrate mount bench turns --turns x,-x,y,-y,z,-z
    """
    _add_name(parser, "the recording")
    flag(parser, "--pivot", "the tip stayed on one point at every stop")
    turns = "the tool axis of each turn of 20 degrees or more: x,-x,y,...; --turns=-x,... where the first is negative"
    option(parser, "--turns", "A,A", turns, type=_some_of("x", "y", "z", "-x", "-y", "-z"))
    flag(parser, "--force", "replace a lever that was measured by a poor fit")
    add_accept_gap(parser)


def sensor(parser: ArgumentParser) -> None:
    """The sensor's errors: bias, scale, misalignment, hard and soft iron.

    Find a sensor's errors from one recording in which you put it down in several orientations, two seconds each:
    best twelve (each of the six sides and six of the edges up), turning it in all directions between them.

      pbd record sides --sensor witmotion
      pbd calibrate sensor bench sides --latitude 48
    """
    _add_name(parser, "the recording")
    only = "calibrate only these (gyr, acc, mag), and fail if one of them can't be calibrated"
    option(parser, "--only", "K,K", only, type=_some_of("gyr", "acc", "mag"), default=())
    place = parser.add_mutually_exclusive_group()
    option(place, "--gravity", "G", "gravity at this place, m/s2 (9.80665)", type=within(9.7, 9.9, " m/s2"))
    option(place, "--latitude", "DEG", "latitude to compute gravity from", type=within(-90.0, 90.0))
    option(parser, "--temperature", "C", "room temperature, degrees C, noted in the file", type=finite)


def show(parser: ArgumentParser) -> None:
    """Everything in a calibration, and what each part adds to the tool's uncertainty.

    Print a calibration, and how uncertain the tool's pose in the robot's base is at each keyframe of a
    demonstration: in total, and the parts that come from the start, from the mount and from tracking.

      pbd calibrate show bench tea --save bench.png
    """
    option(parser, "name", "CALIBRATION", "name of the calibration, or its file's path")
    option(parser, "demo", "DEMO", "default: the newest in ./demos, else 'pouring'", nargs="?")
    option(parser, "--save", "FILE", "also draw it into this file (.png, .svg or .pdf)", type=Path)
    add_accept_gap(parser)
    flag(parser, "--json", JSON)


def _stops(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be stops such as 1,2,4, got '{text}'") from None


def _some_of(*known: str) -> Callable[[str], tuple[str, ...]]:
    def parse(text: str) -> tuple[str, ...]:
        words = tuple(text.lower().split(","))
        if not set(words) <= set(known):
            raise argparse.ArgumentTypeError(f"must be some of {', '.join(known)}, got {text}")
        return words

    return parse
