"""pbd check DEMO...: which of many demonstrations need a look."""

import argparse
import math
import sys
from collections.abc import Sequence
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn
from rich.table import Table

from pbd.check_demos import DemoCheck, check_all
from pbd.cli.common import print_result, without_aside
from pbd.cli.console import say
from pbd.errors import RecordingError, listed
from pbd.files.robot import load_robot
from pbd.planning.result import robot_remark
from pbd.view.safe_console import SafeConsole
from pbd.view.terminal_tables import make_table
from pbd.view.units import Units

MOST_REMARKS = 2
"""Largest number of remarks on one demonstration in the table; --json lists all."""


def run(args: argparse.Namespace) -> None:
    """Check the demonstrations, print those that need a look first, and fail if one is unusable."""
    demos = without_aside(args.demos)
    if args.robot and (remark := robot_remark(load_robot(args.robot))):
        say(remark)
    columns = ("checking", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=SafeConsole(sys.stderr), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("", total=len(demos))
        checks = check_all(
            *(demos, args.robot, args.jobs, lambda number: bar.update(task, completed=number)),
            accept_gap=args.accept_gap,
        )
    checks = tuple(sorted(checks, key=_worst_first))
    print_result(args, {"demos": [_row(check) for check in checks]}, _table(checks, args.robot, args.units))
    if unusable := [check.name for check in checks if not check.usable]:
        what = f"{len(unusable)} of {len(checks)} can't be used: {listed(unusable)}"
        raise RecordingError(f"{what}; leave them out, or put right what is said of each", value=len(unusable))


def _worst_first(check: DemoCheck) -> tuple[bool, int, int, float]:
    sigma = check.sigma_m if math.isfinite(check.sigma_m) else math.inf
    return check.usable, -len(check.differs), -len(check.findings), -sigma


def _row(check: DemoCheck) -> dict[str, Any]:
    return {
        "name": check.name,
        "usable": check.usable,
        "why": check.why or check.refused or None,
        "duration_s": check.duration_s,
        "keyframes": None if check.p_dock_sensor is None else len(check.p_dock_sensor),
        "sigma_m": check.sigma_m,
        "motion_s": check.motion_s,
        "differs": list(check.differs),
        "findings": list(check.findings),
    }


def _table(checks: Sequence[DemoCheck], robot: str | None, units: Units) -> Table:
    s = units.time
    motion = () if robot is None else (f"{robot} ({s})",)
    columns = ("demonstration", f"length ({s})", "keyframes", f"largest σ ({units.length})", *motion, "look at")
    table = make_table(*columns, left=(columns[0], columns[-1]))
    for check in checks:
        remarks = check.remarks
        more = f" (and {len(remarks) - MOST_REMARKS} more)" if len(remarks) > MOST_REMARKS else ""
        table.add_row(
            check.name,
            *units.times(check.duration_s),
            "" if check.p_dock_sensor is None else str(len(check.p_dock_sensor)),
            *units.lengths(check.sigma_m, finer=1),
            *(() if robot is None else units.times(check.motion_s)),
            "; ".join(remarks[:MOST_REMARKS]) + more,
        )
    return table
