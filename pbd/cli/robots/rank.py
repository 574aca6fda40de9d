"""pbd robots --for DEMO: which arms can replay it, and what stops the others."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from rich.table import Table

from pbd.arm.reach import farthest
from pbd.cli.common import load_demonstration, print_result, track_demonstration
from pbd.cli.console import working
from pbd.data import Demonstration, HandPath
from pbd.errors import PbdError, collected_warnings
from pbd.files.find_by_name import names
from pbd.planning import arm_of, load_arm, plan_path
from pbd.view.terminal_tables import make_table
from pbd.view.units import Units


def rank(args: argparse.Namespace) -> None:
    """Plan it on each, and print the fastest first."""
    demo = load_demonstration(args.demo)
    path, _ = track_demonstration(demo, "default", None, accept_gap=False)
    arms = [args.robot] if args.robot else names("robots", ".toml")
    rows = []
    for number, name in enumerate(arms, start=1):
        with working(f"planning for {name}, {number} of {len(arms)}"):
            rows.append(_row(name, demo, path))
    rows.sort(key=lambda row: (row["why"] is not None, row["duration_s"] or 0.0))
    print_result(args, {"demo": demo.recording.info.name, "robots": rows}, _table(rows, args.units))


def _row(name: str, demo: Demonstration, path: HandPath) -> dict[str, Any]:
    row: dict[str, Any] = {"name": name}
    row |= dict.fromkeys(("reach_m", "farthest_m", "duration_s", "torque", "scale", "why"))
    with collected_warnings() as row["warnings"]:
        try:
            robot, calibration = load_arm(name)
            row |= {"reach_m": farthest(arm_of(robot)), "scale": calibration.scale}
            plan = plan_path(path, calibration, robot)
            row["farthest_m"] = max(float(np.hypot(*pose.p[:2])) for pose in plan.T_base_tool)
            row["duration_s"] = plan.trajectory.duration
            row["torque"] = plan.report.torque and plan.report.torque.share
        except PbdError as error:
            row["why"] = error.message
    return row


def _table(rows: list[dict[str, Any]], units: Units) -> Table:
    m = units.length
    goes = (f"time ({units.time})", f"goes to ({m})", f"reaches ({m})")
    columns = ("name", *goes, "torque (%)", "scale", "what stops it, or is told")
    table = make_table(*columns, left=(columns[0], columns[-1]))
    for row in rows:
        told = row["why"] or "; ".join(row["warnings"])
        table.add_row(
            row["name"],
            *("" if row["duration_s"] is None else text for text in units.times(row["duration_s"] or 0.0)),
            *("" if row[key] is None else units.lengths(row[key], finer=-1)[0] for key in ("farthest_m", "reach_m")),
            "" if row["torque"] is None else f"{100.0 * row['torque']:.0f}",
            "" if row["scale"] is None else f"{row['scale']:g}",
            told.partition("; ")[0],
        )
    return table
