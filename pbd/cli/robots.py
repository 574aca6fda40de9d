"""pbd robots."""

from __future__ import annotations

import argparse
import warnings
from dataclasses import replace

from pbd.cli.options import Commands, add_command, add_json, print_json


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "robots",
        "which robots are known",
        "List the robots in ./robots and the bundled ones. A file of your own in ./robots adds one.",
        "  pbd robots --json",
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """List them."""
    from pbd.errors import PbdWarning, RobotError
    from pbd.files.library import names
    from pbd.files.robot import load_robot
    from pbd.view.tables import print_table, robots_table

    robots = []
    for name in names("robots", ".toml"):
        try:
            robots.append(replace(load_robot(name), name=name))  # a copied file may still carry the old name
        except RobotError as error:
            warnings.warn(str(error), PbdWarning, stacklevel=2)
    if args.json:
        rows = [
            {
                "name": robot.name,
                "description": robot.description,
                "joints": list(robot.joints),
                "gripper": robot.gripper is not None,
                "limits_source": robot.limits.source,
                "notes": list(robot.notes),
            }
            for robot in robots
        ]
        print_json({"robots": rows})
    else:
        print_table(robots_table(robots))
    return 0
