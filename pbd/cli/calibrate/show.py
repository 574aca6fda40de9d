"""pbd calibrate show CALIBRATION [DEMO]."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from pbd.calibration.dock import nav_in_base
from pbd.calibration.tool_poses import tool_poses
from pbd.calibration.uncertainty import base_sigmas, tool_covariances
from pbd.cli.console import print_json, say, working
from pbd.cli.steps import load_demonstration
from pbd.data import Calibration, Keyframe
from pbd.errors import CalibrationError, PbdError
from pbd.files.calibration import load_calibration
from pbd.io.atomic import atomic_file
from pbd.pipeline import track
from pbd.pose import Array
from pbd.tracking.keyframes import keyframes_of
from pbd.view.calibration_tables import base_table, calibration_table
from pbd.view.terminal_tables import print_table

Found = tuple[str, tuple[Keyframe, ...], dict[str, Array]]
"""A demonstration's name, its keyframes, and the tool's covariances by source."""

SOURCES = {"start": "where the hand starts", "mount": "the mount", "tracking": "tracking"}


def run(args: argparse.Namespace) -> None:
    """Print, and plot."""
    calibration = load_calibration(args.name)
    found = _contributions(args, calibration)
    if args.save is not None:
        _save(args.save, calibration, found)
    if args.json:
        return print_json(_json(calibration, found))
    print_table(calibration_table(calibration))
    if found is not None:
        name, _, parts = found
        print(f"\nthe tool's uncertainty at the keyframes of {name}, one sigma, in base (right: by source, rms)")
        print_table(base_table(base_sigmas(parts)))
        share = {part: float(np.trace(cov[:, :3, :3], axis1=1, axis2=2).mean()) for part, cov in parts.items()}
        most = max(share, key=lambda part: share[part])
        percent = 100.0 * share[most] / sum(share.values())
        say(f"most of the tool's uncertainty ({percent:.0f} % of its variance) comes from {SOURCES[most]}")
    return None


def _contributions(args: argparse.Namespace, calibration: Calibration) -> Found | None:
    """A demonstration's name, its keyframes, and the tool's covariances.

    None where it is not known where it starts, or where nobody named a demonstration and the newest is of no use.
    """
    if not calibration.knows_start:
        if args.demo is not None:
            say(
                f"'{calibration.name}' does not say where the hand starts, so the tool's uncertainty is unknown; add a "
                f"dock: pbd calibrate dock {args.name} --position X Y Z --rpy R P Y"
            )
        return None
    try:
        return _of_demonstration(args, calibration)
    except PbdError as reason:
        if args.demo is not None:
            raise
        say(
            f"what each part adds to the tool's uncertainty is left out: {reason}; or name another demonstration: "
            f"pbd calibrate show {args.name} DEMO"
        )
        return None


def _of_demonstration(args: argparse.Namespace, calibration: Calibration) -> Found:
    demo = load_demonstration(args.demo)
    with working("tracking"):
        keyframes = keyframes_of(track(demo, calibration=calibration, accept_gap=args.accept_gap))
    T_base_nav = nav_in_base(calibration, keyframes[0].T_nav_sensor.wxyz)
    return demo.recording.info.name, keyframes, tool_covariances(keyframes, T_base_nav, calibration)


def _json(calibration: Calibration, found: Found | None) -> dict[str, Any]:
    def pose(value: Any) -> dict[str, Any] | None:
        return None if value is None else {"position_m": value.p, "wxyz": value.wxyz}

    result: dict[str, Any] = {
        "calibration": calibration.name,
        "dock": pose(calibration.T_base_dock),
        "nav": pose(calibration.T_base_nav),
        "mount": pose(calibration.T_sensor_tool),
        "scale": calibration.scale,
        "sensor": None if calibration.sensor is None else calibration.sensor.sensor,
        "fit": dict(calibration.residuals),
        "keyframes": [],
    }
    if found is not None:
        result["keyframes"] = [{"index": k} | row for k, row in enumerate(base_sigmas(found[2]))]
    return result


def _save(file: Path, calibration: Calibration, found: Found | None) -> None:
    kind = file.suffix.removeprefix(".")
    if kind not in ("png", "svg", "pdf"):
        raise CalibrationError(f"{file} must end in .png, .svg or .pdf; rename it", path=file)
    if found is None:
        raise CalibrationError(
            f"a plot shows the tool at a demonstration's keyframes; name one after '{calibration.name}'"
            if calibration.knows_start
            else f"'{calibration.name}' does not say where the hand starts, so there is nothing to plot; add a dock"
        )
    name, keyframes, parts = found
    T_base_nav = nav_in_base(calibration, keyframes[0].T_nav_sensor.wxyz)
    with working("drawing"):
        from pbd.plots.calibration import draw_calibration
        from pbd.plots.style import write

        figure = draw_calibration(calibration, name, T_base_nav, tool_poses(keyframes, T_base_nav, calibration), parts)
        with atomic_file(file) as unfinished, unfinished.open("wb") as stream:
            write(figure, stream, kind)
    say(f"a plot: {file}")
