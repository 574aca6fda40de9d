"""pbd robots --suggest FILE: a home and a dock for a robot's TOML that lacks them."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from pbd.arm.collision.allowed_collisions import SAMPLES as CONFIGURATIONS
from pbd.cli.common import load_demonstration, track_demonstration
from pbd.cli.console import print_json, say, working
from pbd.errors import UsageError
from pbd.files.robot import read_robot
from pbd.pose import quat_to_rpy

if TYPE_CHECKING:
    from pbd.planning.suggest import Suggestion

DEMO = "pouring"
"""The demonstration that the suggested home and dock make possible if none is named."""


def suggest_home_and_dock(args: argparse.Namespace) -> None:
    """Search for them, and print them with the reasons for the choice."""
    from pbd.planning.suggest import suggest

    if args.robot or args.csv:
        raise UsageError("--suggest takes the file itself, and prints TOML, or JSON with --json")
    robot = read_robot(args.suggest, draft=True)
    name = args.demo or DEMO
    demo = load_demonstration(name)
    _, keyframes = track_demonstration(demo, "default", None, accept_gap=False)
    with working(f"searching a home and a dock for {robot.name}"):
        found = suggest(robot, keyframes, demo.grasped, say)
    values, reasons = _values(found), _reasons(found, name)
    if args.json:
        print_json({"robot": robot.name, "demo": name, **values, "weighed": reasons})
    else:
        print(_toml(values, reasons))


def _values(found: Suggestion) -> dict[str, Any]:
    """Return the sections [arm] and [dock] of the robot's TOML."""
    dock, at = found.plan.calibration, found.plan.calibration.T_base_dock
    place: dict[str, Any] = {}
    if at is not None:
        yaw_deg = round(float(np.degrees(quat_to_rpy(at.wxyz)[2])), 1) + 0.0
        place = {"position": at.p.round(3).tolist(), "rpy_deg": [0.0, 0.0, yaw_deg]}
    touch = {"may_touch": [list(pair) for pair in found.robot.may_touch]} if found.robot.may_touch else {}
    return {
        "arm": {"joints": list(found.robot.joints), "home": found.robot.home.tolist(), **touch},
        "dock": {**place, "table_height": dock.table_height, "scale": dock.scale},
    }


def _reasons(found: Suggestion, demo: str) -> list[str]:
    """Explain this home and this dock in sentences."""
    joint, room = found.at
    dock, took_s = found.plan.calibration, found.plan.trajectory.duration
    table = "the table's height is the file's own"
    if not found.own_table:
        stands = dock.table_height == 0.0
        table = "the arm is taken to stand on the table" if stands else "the table is put as low as the arm needs it"
        table += " (a table_height in [dock] says better)"
    touching = [
        f"{first} and {second} overlap in {count} of {CONFIGURATIONS} random configurations: taken to do so by design, "
        "so that nothing checks whether they touch; else take them out of may_touch and correct their shapes"
        for (first, second), count in found.touching.items()
    ]
    alone_s = np.abs(np.diff(found.plan.trajectory.keyframe_q, axis=0)).sum(axis=0) / found.robot.limits.velocity
    slowest = found.robot.joints[int(alone_s.argmax())]
    slow = f"{slowest} alone takes {alone_s.max():.1f} s of that at top speed; left out of [arm] joints it stays at 0"
    return [
        *touching,
        f"{found.within_reach} of {found.ranked} docks have all of {demo} within reach at {dock.scale:g} of its size; "
        f"of those farthest from limits and singularities this one is the fastest: {took_s:.1f} s",
        *([slow] if alone_s.max() > 0.5 * took_s else ()),
        f"{table}; nothing touches it or the arm itself, as far as the URDF has shapes",
        f"home is over the dock: {joint} is {room:.2f} from its limit (rad; m where it slides), manipulability is "
        f"{found.dexterity:.1f} times the lower quartile of all configurations",
    ]


def _toml(values: dict[str, Any], reasons: list[str]) -> str:
    """Format the sections as TOML; the reasons follow as comments."""
    lines = ["# In place of [arm] and [dock]."]
    for section, items in values.items():
        lines += [f"[{section}]", *(f"{key} = {json.dumps(value)}" for key, value in items.items()), ""]
    return "\n".join((*lines, *(f"# {sentence}." for sentence in reasons)))
