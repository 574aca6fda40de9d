"""pbd robots [R]."""

from __future__ import annotations

import argparse
import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from pbd.cli.options import Commands, add_command, add_table, print_json
from pbd.cli.progress import working

if TYPE_CHECKING:
    from pbd.arm.model import ArmModel
    from pbd.data import Robot


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "robots",
        "list the robots that pbd knows",
        "List the robots in ./robots and the bundled ones, with their reach (tool from the base's axis) and what pbd\n"
        "assumes about them; or show one, with the links that are not checked for collisions. To add your own, put a\n"
        "file into ./robots (docs/robots.md).",
        "  pbd robots --json\n  pbd robots panda",
    )
    parser.add_argument("robot", nargs="?", metavar="R", help="a robot's name or file; default: all")
    add_table(parser, units="m")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """List them."""
    from pbd.arm.reach import farthest
    from pbd.view.tables import left_out_table, print_csv, print_table, robots_table

    with working("reading the robots"):
        arms = [_arm(args.robot)] if args.robot else _all()
        robots, reach_m = [arm.robot for arm in arms], [farthest(arm) for arm in arms]
        collision = [_collision(arm) for arm in arms] if args.robot else []
    if args.json:
        rows = [_row(robot, reach) for robot, reach in zip(robots, reach_m, strict=True)]
        for row, checked in zip(rows, collision, strict=False):
            row["collision"] = checked
        print_json({"robots": rows})
        return 0
    if args.csv:
        print_csv(robots_table(robots, reach_m, args.units))
        return 0
    print_table(robots_table(robots, reach_m, args.units))
    for checked in collision:
        bare = ", ".join(checked["links_without_shape"]) or "none"
        print(f"\nlinks with a collision shape: {', '.join(checked['links'])}\nlinks without: {bare}")
        for doubt in checked["doubtful_shapes"]:
            print(f"contacts may be missed: {doubt['link']} {doubt['why']}")
        print("\nnot checked against each other:")
        print_table(left_out_table([(each["first"], each["second"], each["why"]) for each in checked["left_out"]]))
    of: dict[str, list[str]] = {}
    for robot in robots:
        for note in robot.notes:
            of.setdefault(note, []).append(robot.name)
    for note, those in of.items():
        print(f"\n{', '.join(those)}: {note}")
    return 0


def _arm(name: str) -> ArmModel:
    from pbd.arm.model import load_model
    from pbd.files.robot import load_robot

    return load_model(load_robot(name))


def _all() -> list[ArmModel]:
    """All that can be read; the others are warned of."""
    from pbd.arm.model import load_model
    from pbd.errors import PbdWarning, RobotError
    from pbd.files.library import names
    from pbd.files.robot import load_robot

    arms = []
    for name in names("robots", ".toml"):
        try:
            arms.append(load_model(replace(load_robot(name), name=name)))  # a copied file may still carry the old name
        except RobotError as error:
            warnings.warn(str(error), PbdWarning, stacklevel=2)
    return arms


def _row(robot: Robot, reach: float) -> dict[str, Any]:
    return {
        "name": robot.name,
        "description": robot.description,
        "joints": list(robot.joints),
        "reach_m": reach,
        "gripper": robot.gripper is not None,
        "gripper_joints": list(robot.gripper.joints) if robot.gripper else [],
        "limits_source": robot.limits.source,
        "limits_sources": dict(robot.limits.sources),
        "assumed": list(robot.limits.assumed),
        "notes": list(robot.notes),
        "license": robot.license,
    }


def _collision(arm: ArmModel) -> dict[str, Any]:
    """What is checked for collisions, and what isn't."""
    from pbd.arm.allowed_collisions import link_pairs
    from pbd.arm.coverage import doubts
    from pbd.arm.geometry import link_bodies

    solid = dict.fromkeys(body.name for body in link_bodies(arm))
    _, unchecked = link_pairs(arm)
    return {
        "links": list(solid),
        "links_without_shape": [link for link in arm.links if link not in solid],
        "doubtful_shapes": [vars(doubt) for doubt in doubts(arm)],
        "left_out": [vars(each) for each in unchecked],
    }
