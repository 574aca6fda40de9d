"""Functions that the steps of `pbd calibrate` share."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from pbd.cli.console import working
from pbd.data import Calibration, HandPath, Recording, Robot
from pbd.data.covariance import one_sigma
from pbd.errors import CalibrationError, PlanError
from pbd.files.demo import load_demo
from pbd.pipeline import track
from pbd.pose import Array, Pose


def tracked(args: argparse.Namespace, calibration: Calibration) -> tuple[Recording, HandPath]:
    """A demonstration's recording, and the hand's path by that alone: what is known of its stops doesn't count."""
    recording = load_demo(args.demo).recording
    with working("tracking"):
        return recording, track(recording, calibration=calibration, accept_gap=args.accept_gap)


def instead_of(path: Path, calibration: Calibration, part: str, force: bool) -> dict[str, str]:
    """Which of [dock] and [nav] gives way to the other, by its name; empty where there is none.

    CalibrationError: one would, and `force` was not given.
    """
    other = "nav" if part == "dock" else "dock"
    if (calibration.T_base_nav if other == "nav" else calibration.T_base_dock) is None:
        return {}
    if not force:
        raise CalibrationError(
            f"{path} has a [{other}], and a calibration can't have [{part}] too; replace it with --force, or give "
            "another name",
            path=path,
        )
    return {other: part}


def sigma_json(cov: Array) -> dict[str, Any]:
    """One sigma of a pose's covariance (6, 6); NaN (null in JSON) where it is unknown."""
    sigma = one_sigma(cov)
    return {"sigma_m": sigma[:3], "sigma_deg": np.degrees(sigma[3:])}


def refuse_out_of_reach(robot: Robot, T_base_tool: Pose) -> None:
    """Refuse a dock that the robot can't reach; PlanError: with how near it comes."""
    from pbd.arm.joint_path import solve_path
    from pbd.arm.model import load_model

    try:
        with working(f"checking whether {robot.name} reaches it"):
            solve_path(load_model(robot), [T_base_tool], robot.home)
    except PlanError as reason:
        x, y, z = T_base_tool.p
        away, turned = (float(str(reason.fields[name])) for name in ("value", "rotation"))
        raise PlanError(
            f"the dock puts the tool at ({x:.3f}, {y:.3f}, {z:.3f}) m, out of {robot.name}'s reach: it gets no nearer "
            f"than {100.0 * away:.1f} cm and {np.degrees(turned):.0f} degrees; choose a place nearer to the base, or "
            "another orientation",
            **reason.fields,
        ) from None
