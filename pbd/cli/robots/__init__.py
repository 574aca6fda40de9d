"""pbd robots [R]: list the robots, or show one; --for and --suggest are in files of their own."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

from pbd.arm.collision.allowed_collisions import link_pairs
from pbd.arm.collision.geometry import link_bodies
from pbd.arm.collision.shape_coverage import doubtful_shapes
from pbd.arm.model import ArmModel, load_model
from pbd.arm.reach import reach
from pbd.cli.common import print_result
from pbd.cli.console import say, working
from pbd.cli.robots.rank import rank_robots
from pbd.cli.robots.suggest import suggest_home_and_dock
from pbd.data import Robot
from pbd.errors import RobotError, UsageError, warn
from pbd.files.find_by_name import names
from pbd.files.robot import load_robot
from pbd.view.terminal_tables import print_table, robots_table, words_table


def run(args: argparse.Namespace) -> None:
    """List the robots; or suggest a home and a dock for one; or rank them by a demonstration."""
    if args.calibration and (args.suggest is not None or args.demo is None):
        raise UsageError("--calibration is for --for, which ranks the robots: leave it out")
    if args.suggest is not None:
        return suggest_home_and_dock(args)
    if args.demo is not None:
        return rank_robots(args)
    with working("reading the robots"):
        arms = [load_model(load_robot(args.robot))] if args.robot else _readable_arms()
        robots, reach_m = [arm.robot for arm in arms], [reach(arm) for arm in arms]
        collision = [_collision(arm) for arm in arms] if args.robot else []
    rows = [_row(robot, reach) for robot, reach in zip(robots, reach_m, strict=True)]
    for row, checked in zip(rows, collision, strict=False):
        row["collision"] = checked
    if not print_result(args, {"robots": rows}, robots_table(robots, reach_m, args.units)):
        return None
    for checked in collision:
        bare = ", ".join(checked["links_without_shape"]) or "none"
        print(f"\nlinks with a collision shape: {', '.join(checked['links'])}\nlinks without: {bare}")
        for doubt in checked["doubtful_shapes"]:
            print(f"contacts may be missed: {doubt['link']} {doubt['why']}")
        print("\nnot checked against each other:")
        print_table(words_table(("link", "and link", "why"), (each.values() for each in checked["left_out"])))
    if args.robot:
        print("".join(f"\n{note}\n" for note in robots[0].notes), end="")
    else:
        say("`pbd robots NAME` adds what to know about one robot, and which of its links are checked for collisions")
    return None


def _readable_arms() -> list[ArmModel]:
    """Load all robots; warn of those that can't be read."""
    arms = []
    for name in names("robots", ".toml"):
        try:
            arms.append(load_model(replace(load_robot(name), name=name)))  # a copied file may still carry the old name
        except RobotError as error:
            warn(str(error))
    return arms


def _row(robot: Robot, reach_m: float) -> dict[str, Any]:
    """Return a robot's row of the JSON."""
    return {
        "name": robot.name,
        "description": robot.description,
        "joints": list(robot.joints),
        "reach_m": reach_m,
        "gripper": robot.gripper is not None,
        "gripper_joints": list(robot.gripper.joints) if robot.gripper else [],
        "limits_source": robot.limits.source,
        "limits_sources": dict(robot.limits.sources),
        "assumed": list(robot.limits.assumed),
        "notes": list(robot.notes),
        "license": robot.license,
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
