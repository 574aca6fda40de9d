"""pbd robots --for DEMO: which robots can do a demonstration, and what stops the others."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from rich.table import Table

from pbd.arm.reach import reach
from pbd.cli.common import load_demonstration, print_result, track_demonstration
from pbd.cli.console import working
from pbd.data import HandPath
from pbd.errors import PbdError, collected_warnings
from pbd.files.find_by_name import names
from pbd.view.terminal_tables import make_table
from pbd.view.units import Units


def rank_robots(args: argparse.Namespace) -> None:
    """Plan the demonstration for each robot, and print them: first those that hold its poses, the fastest first."""
    demo = load_demonstration(args.demo)
    path, _ = track_demonstration(demo, "default", None, accept_gap=False)
    arms = [args.robot] if args.robot else names("robots", ".toml")
    rows = []
    for number, name in enumerate(arms, start=1):
        with working(f"planning for {name}, {number} of {len(arms)}"):
            rows.append(_row(name, args.calibration, path))
    rows.sort(key=lambda row: (row["why"] is not None, not row["holds_poses"], row["duration_s"]))
    print_result(args, {"demo": demo.recording.info.name, "robots": rows}, _table(rows, args.units))


def _row(name: str, calibration_name: str | None, path: HandPath) -> dict[str, Any]:
    """Return a robot's row of the JSON: the figures of its motion, or `why` it can't do it."""
    from pbd.arm.ik.partial_pose import WARN_RAD
    from pbd.planning import arm_of, load_arm, plan_path

    row: dict[str, Any] = {"name": name}
    row |= dict.fromkeys(("reach_m", "farthest_m", "duration_s", "torque", "scale", "holds_poses", "why"))
    with collected_warnings() as row["warnings"]:
        try:
            robot, calibration = load_arm(name, calibration_name)
            row |= {"reach_m": reach(arm_of(robot)), "scale": calibration.scale}
            plan = plan_path(path, calibration, robot)
            row["farthest_m"] = max(float(np.hypot(*pose.p[:2])) for pose in plan.T_base_tool)
            row["duration_s"] = plan.trajectory.duration
            row["holds_poses"] = bool(plan.off_rad.max() <= WARN_RAD)
            row["torque"] = plan.report.torque and plan.report.torque.share
        except PbdError as error:
            row["why"] = error.message
    return row


def _table(rows: list[dict[str, Any]], units: Units) -> Table:
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
