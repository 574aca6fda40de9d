"""pbd robots [R]: list the robots, or show one; rank them by a demonstration; suggest a home and a dock for one."""

import argparse
from dataclasses import replace
from typing import Any

import numpy as np
from rich.table import Table

from pbd.arm.collision.allowed_collisions import CONFIGURATIONS, link_pairs
from pbd.arm.collision.geometry import link_bodies
from pbd.arm.collision.shape_coverage import doubtful_shapes
from pbd.arm.ik.partial_pose import WARN_RAD
from pbd.arm.ik.starts import reach
from pbd.arm.model import ArmModel, load_model
from pbd.cli.common import load_demonstration, named_calibration, print_result, track_demonstration
from pbd.cli.console import print_json, say, working
from pbd.data import HandPath
from pbd.errors import PbdError, RobotError, UsageError, collected_warnings, one_line, warn
from pbd.files.find_by_name import names, origin
from pbd.files.robot import load_robot, read_robot
from pbd.planning import arm_of, load_robot_and_calibration, plan_path
from pbd.planning.preconditions import warn_of_frames
from pbd.planning.suggest_dock import Suggestion, suggest_home_and_dock
from pbd.pose import quat_to_rpy
from pbd.view.terminal_tables import make_table, print_table, robots_table, words_table
from pbd.view.units import Units


def run(args: argparse.Namespace) -> None:
    """List the robots, or show one; or suggest a home and a dock for one; or rank them by a demonstration."""
    if args.calibration and (args.suggest is not None or args.demo is None):
        raise UsageError("--calibration is for ranking the robots by --for: leave it out")
    if args.suggest is not None:
        _suggest_home_and_dock(args)
    elif args.demo is not None:
        _rank_robots(args)
    else:
        _list_robots(args)


def _list_robots(args: argparse.Namespace) -> None:
    """Print all robots; or one, with its notes and which of its links are checked for collisions."""
    with working("reading the robots"):
        arms = [load_model(load_robot(args.robot))] if args.robot else _readable_arms()
        rows = [_row(arm) for arm in arms]
        if args.robot:
            rows[0]["collision"] = _collision(arms[0])
            warn_of_frames(arms[0])
    files = [row["file"] for row in rows]
    table = robots_table([arm.robot for arm in arms], [row["reach_m"] for row in rows], files, args.units)
    if not print_result(args, {"robots": rows}, table):
        return
    if not args.robot:
        say("`pbd robots NAME` adds what to know about one robot, and which of its links are checked for collisions")
        return
    checked = rows[0]["collision"]
    bare = ", ".join(checked["links_without_shape"]) or "none"
    print(f"\nlinks with a collision shape: {', '.join(checked['links'])}\nlinks without: {bare}")
    for doubt in checked["doubtful_shapes"]:
        print(f"contacts may be missed: {doubt['link']} {doubt['why']}")
    print("\nnot checked against each other:")
    print_table(words_table(("link", "and link", "why"), (each.values() for each in checked["left_out"])))
    for note in rows[0]["notes"]:
        print(f"\n{note}")


def _readable_arms() -> list[ArmModel]:
    """Load all robots; warn of those that can't be read."""
    arms = []
    for name in names("robots"):
        try:
            arms.append(load_model(replace(load_robot(name), name=name)))  # a copied file may still carry the old name
        except RobotError as error:
            warn(str(error))
    return arms


def _row(arm: ArmModel) -> dict[str, Any]:
    """Return a robot's row of the JSON."""
    robot = arm.robot
    return {
        "name": robot.name,
        "description": robot.description,
        "joints": list(robot.joints),
        "reach_m": reach(arm),
        "gripper": robot.gripper is not None,
        "gripper_joints": list(robot.gripper.joints) if robot.gripper else [],
        "limits_source": robot.limits.source,
        "limits_sources": dict(robot.limits.sources),
        "assumed": list(robot.limits.assumed),
        "payload_kg": robot.payload_kg,
        "payload_source": robot.payload_source,
        "notes": list(robot.notes),
        "license": robot.license,
        "file": robot.file and origin("robots", robot.file),
    }


def _collision(arm: ArmModel) -> dict[str, Any]:
    """Return which links have a collision shape, and which pairs of links are not checked against each other."""
    solid = dict.fromkeys(body.name for body in link_bodies(arm))
    _, unchecked = link_pairs(arm)
    return {
        "links": list(solid),
        "links_without_shape": [link for link in arm.links if link not in solid],
        "doubtful_shapes": [{"link": link, "why": why} for link, why in doubtful_shapes(arm).items()],
        "left_out": [vars(each) for each in unchecked],
    }


def _rank_robots(args: argparse.Namespace) -> None:
    """Plan the demonstration for each robot, and print them: first those that hold its poses, the fastest first."""
    demo = load_demonstration(args.demo)
    path, _ = track_demonstration(args, demo, named_calibration(args))
    arms = [args.robot] if args.robot else names("robots")
    rows = []
    for number, name in enumerate(arms, start=1):
        with working(f"planning for {name}, {number} of {len(arms)}"):
            rows.append(_ranked_row(name, args.calibration, path))
    rows.sort(key=lambda row: (row["why"] is not None, not row["holds_poses"], row["duration_s"]))
    print_result(args, {"demo": demo.recording.info.name, "robots": rows}, _ranked_table(rows, args.units))


def _ranked_row(name: str, calibration_name: str | None, path: HandPath) -> dict[str, Any]:
    """Return a robot's row of the JSON: the figures of its motion, or `why` it can't do it."""
    row: dict[str, Any] = {"name": name}
    row |= dict.fromkeys(("reach_m", "farthest_m", "duration_s", "torque", "scale", "holds_poses", "why"))
    with collected_warnings() as row["warnings"]:
        try:
            robot, calibration = load_robot_and_calibration(name, calibration_name)
            row |= {"reach_m": reach(arm_of(robot)), "scale": calibration.scale}
            plan = plan_path(path, calibration, robot)
            row["farthest_m"] = max(float(np.hypot(*pose.p[:2])) for pose in plan.T_base_tool)
            row["duration_s"] = plan.trajectory.duration
            row["holds_poses"] = bool(plan.off_rad.max() <= WARN_RAD)
            row["torque"] = plan.report.torque and plan.report.torque.share
        except PbdError as error:
            row["why"] = error.message
    return row


def _ranked_table(rows: list[dict[str, Any]], units: Units) -> Table:
    m = units.length
    figures = (f"time ({units.time})", f"farthest keyframe ({m})", f"reach ({m})", "torque (%)", "scale")
    remarks = "problems and remarks"
    table = make_table("name", *figures, remarks, left=("name", remarks))
    for row in rows:
        table.add_row(
            row["name"],
            *units.times(row["duration_s"]),
            *units.lengths((row["farthest_m"], row["reach_m"]), finer=-1),
            "" if row["torque"] is None else f"{100.0 * row['torque']:.0f}",
            "" if row["scale"] is None else f"{row['scale']:g}",
            "; ".join(words.partition("; ")[0] for words in ([row["why"]] if row["why"] else row["warnings"])),
        )
    return table


def _suggest_home_and_dock(args: argparse.Namespace) -> None:
    """Search for them, and print them with the reasons for the choice."""
    if args.robot or args.csv or args.units.asked:
        raise UsageError("--suggest takes the file itself, and prints TOML, or JSON with --json")
    robot = read_robot(args.suggest, draft=True)
    name = args.demo or "pouring"
    demo = load_demonstration(name)
    _, keyframes = track_demonstration(args, demo, None)
    warn_of_frames(load_model(robot))
    with working(f"searching a home and a dock for {robot.name}"):
        found = suggest_home_and_dock(robot, keyframes, demo.grasped, say)
    sections, reasons = _sections(found), _reasons(found, name)
    if args.json:
        warned = list(dict.fromkeys(args.warnings))  # the search may repeat what was said before it
        print_json({"robot": robot.name, "demo": name, **sections, "weighed": reasons, "warnings": warned})
    else:
        import tomlkit

        print("# In place of [arm] and [dock].", tomlkit.dumps(sections), sep="\n")
        print(*(f"# {one_line(sentence)}." for sentence in reasons), sep="\n")


def _sections(found: Suggestion) -> dict[str, Any]:
    """Return the sections [arm] and [dock] of the robot's TOML."""
    robot, dock, at = found.plan.robot, found.plan.calibration, found.plan.calibration.T_base_dock
    assert at is not None
    yaw_deg = round(float(np.degrees(quat_to_rpy(at.wxyz)[2])), 1) + 0.0
    place = {"position": at.p.round(3).tolist(), "rpy_deg": [0.0, 0.0, yaw_deg]}
    touch = {"may_touch": [list(pair) for pair in robot.may_touch]} if robot.may_touch else {}
    return {
        "arm": {"joints": list(robot.joints), "home": robot.home.tolist(), **touch},
        "dock": {**place, "table_height": dock.table_height, "scale": dock.scale},
    }


def _reasons(found: Suggestion, demo: str) -> list[str]:
    """Explain this home and this dock in sentences."""
    joint, room = found.near_limit
    robot, dock, took_s = found.plan.robot, found.plan.calibration, found.plan.trajectory.duration
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
    alone_s = np.abs(np.diff(found.plan.trajectory.keyframe_q, axis=0)).sum(axis=0) / robot.limits.velocity
    slowest = robot.joints[int(alone_s.argmax())]
    slow = f"{slowest} alone takes {alone_s.max():.1f} s of that at top speed; left out of [arm] joints it stays at 0"
    near = "home is near a singularity, where a small turn of the tool may turn joints far"
    return [
        *touching,
        f"{found.within_reach} of {found.ranked} docks have all of {demo} within reach at {dock.scale:g} of its size; "
        f"of those farthest from limits and singularities this one is the fastest: {took_s:.1f} s",
        *([slow] if alone_s.max() > 0.5 * took_s else ()),
        f"{table}; nothing that is checked touches it or the arm itself",
        f"home is over the dock: {joint} is {room:.2f} from its limit (rad; m where it slides), manipulability is "
        f"{found.manipulability:.1f} times the lower quartile of all configurations",
        *([near] if found.manipulability < 1.0 else ()),
    ]
