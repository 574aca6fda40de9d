"""pbd robots."""

from __future__ import annotations

import argparse
import warnings
from dataclasses import replace

from pbd.cli.options import Commands, add_command, add_table, print_json
from pbd.cli.progress import working


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "robots",
        "list the robots that pbd knows",
        "List the robots in ./robots and the bundled ones, with their reach (tool from the base's axis) and what pbd\n"
        "assumes about them. To add your own, put a file into ./robots (docs/robots.md).",
        "  pbd robots --json",
    )
    add_table(parser, units="m")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """List them."""
    from pbd.arm.model import load_model
    from pbd.arm.reach import farthest
    from pbd.errors import PbdWarning, RobotError
    from pbd.files.library import names
    from pbd.files.robot import load_robot
    from pbd.view.tables import print_csv, print_table, robots_table

    robots, reach_m = [], []
    with working("reading the robots"):
        for name in names("robots", ".toml"):
            try:
                robot = replace(load_robot(name), name=name)  # a copied file may still carry the old name
                reach_m.append(farthest(load_model(robot)))
                robots.append(robot)
            except RobotError as error:
                warnings.warn(str(error), PbdWarning, stacklevel=2)
    if args.json:
        rows = [
            {
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
            }
            for robot, reach in zip(robots, reach_m, strict=True)
        ]
        print_json({"robots": rows})
    elif args.csv:
        print_csv(robots_table(robots, reach_m, args.units))
    else:
        print_table(robots_table(robots, reach_m, args.units))
        of: dict[str, list[str]] = {}
        for robot in robots:
            for note in robot.notes:
                of.setdefault(note, []).append(robot.name)
        for note, those in of.items():
            print(f"\n{', '.join(those)}: {note}")
    return 0
