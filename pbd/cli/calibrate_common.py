"""What the steps of `pbd calibrate` share."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from pbd.cli.options import add_json
from pbd.cli.progress import working

if TYPE_CHECKING:
    from pbd.data import Calibration, Robot
    from pbd.pose import Pose


def add_name(parser: argparse.ArgumentParser) -> None:
    """Add the calibration that is made or updated, and --json."""
    parser.add_argument("name", metavar="CALIBRATION", help="name (./calibration/CALIBRATION.toml), or its file's path")
    add_json(parser)


def add_force(parser: argparse.ArgumentParser) -> None:
    """Add --force."""
    parser.add_argument("--force", action="store_true", help="replace a [dock] by a [nav], or a [nav] by a [dock]")


def existing(path: Path) -> Calibration | None:
    """What the calibration says so far (a new one begins as the bundled one of its name), or None."""
    from pbd.files.calibration import read_calibration
    from pbd.files.library import bundled

    for file in (path, bundled("calibration") / path.name):
        if file.is_file():
            return read_calibration(file)
    return None


def instead_of(path: Path, calibration: Calibration | None, part: str, force: bool) -> dict[str, str]:
    """Which of [dock] and [nav] gives way to the other, by its name; empty where there is none.

    Raises:
        CalibrationError: one would, and `force` was not given.
    """
    from pbd.errors import CalibrationError

    other = "nav" if part == "dock" else "dock"
    if calibration is None or (calibration.T_base_nav if other == "nav" else calibration.T_base_dock) is None:
        return {}
    if not force:
        raise CalibrationError(
            f"{path} has a [{other}], and a calibration can't have [{part}] too; replace it with --force, or give "
            "another name",
            path=path,
        )
    return {other: part}


def refuse_out_of_reach(robot: Robot, T_base_tool: Pose, what: str) -> None:
    """Refuse a tool's pose that the robot can't take.

    Raises:
        PlanError: with how near it comes.
    """
    import numpy as np

    from pbd.arm.joint_path import solve_path
    from pbd.arm.model import load_model
    from pbd.errors import PlanError

    try:
        with working(f"checking whether {robot.name} reaches it"):
            solve_path(load_model(robot), [T_base_tool], robot.home)
    except PlanError as reason:
        x, y, z = T_base_tool.p
        away, turned = (float(str(reason.fields[name])) for name in ("value", "rotation"))
        raise PlanError(
            f"{what} puts the tool at ({x:.3f}, {y:.3f}, {z:.3f}) m, out of {robot.name}'s reach: it gets no nearer "
            f"than {100.0 * away:.1f} cm and {np.degrees(turned):.0f} degrees; choose a place nearer to the base, or "
            "another orientation",
            **reason.fields,
        ) from None
