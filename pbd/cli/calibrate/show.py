"""pbd calibrate show CALIBRATION [DEMO]: print a calibration, and the tool's uncertainty that follows from it."""

import argparse
import shlex
from pathlib import Path
from typing import Any

import numpy as np

from pbd.calibration.dock import place_in_base
from pbd.calibration.tool_poses import KeyframesInBase
from pbd.calibration.uncertainty import SOURCES, base_sigmas, tool_covariances
from pbd.cli.common import load_demonstration, sigma_json, track_with
from pbd.cli.console import print_json, say, working
from pbd.data import Calibration
from pbd.data.covariance import one_sigma
from pbd.errors import CalibrationError, PbdError, collected_warnings, warn
from pbd.files.calibration import load_calibration
from pbd.io.atomic import atomic_file, refuse_output
from pbd.pose import Array, Pose
from pbd.tracking.keyframes import keyframes_of
from pbd.view.calibration_tables import base_table, calibration_table
from pbd.view.terminal_tables import print_table
from pbd.view.units import Units


def run(args: argparse.Namespace) -> None:
    """Print the calibration, and with --save draw the tool's uncertainty."""
    if args.save is not None:
        refuse_output(args.save)
    calibration = load_calibration(args.name)
    name, placed = _placed(args, calibration) or ("", None)
    if args.save is not None:
        _save(args.save, calibration, name, placed)
    by_part = {} if placed is None else tool_covariances(placed)
    sigmas = base_sigmas(by_part) if by_part else []
    if args.json:
        return print_json(_json(calibration, sigmas))
    print_table(calibration_table(calibration))
    if by_part:
        print(f"\nthe tool's uncertainty at the keyframes of {name}, one sigma, in base (right: by source, rms)")
        print_table(base_table(sigmas, Units()))
        share = {part: float(np.trace(cov[:, :3, :3], axis1=1, axis2=2).mean()) for part, cov in by_part.items()}
        most = max(share, key=lambda part: share[part])
        percent = 100.0 * share[most] / sum(share.values())
        say(f"most of the tool's uncertainty ({percent:.0f} % of its variance) comes from {SOURCES[most]}")
    return None


def _placed(args: argparse.Namespace, calibration: Calibration) -> tuple[str, KeyframesInBase] | None:
    """Return a demonstration's name, and its keyframes in base.

    None if the calibration does not say where the hand starts, or if none was named and the newest can't be tracked.
    """
    if not calibration.knows_start:
        if args.demo is not None:
            say(
                f"'{calibration.name}' does not say where the hand starts, so the tool's uncertainty is unknown; add a "
                f"dock: pbd calibrate dock {shlex.quote(args.name)} --position X Y Z --rpy R P Y"
            )
        return None
    try:
        demo = load_demonstration(args.demo)
        name = demo.recording.info.name
        with collected_warnings() as told:
            path = track_with(args, demo, calibration)
        for message in told:
            warn(f"{name}: {message}")  # else it seems to be about the calibration
        return name, place_in_base(keyframes_of(path), calibration, path=path)
    except PbdError as reason:
        if args.demo is not None:
            raise
        say(
            f"what each part adds to the tool's uncertainty is left out: {reason}; or name another demonstration: "
            f"pbd calibrate show {shlex.quote(args.name)} DEMO"
        )
        return None


def _json(calibration: Calibration, sigmas: list[dict[str, Any]]) -> dict[str, Any]:
    def pose(value: Pose | None, cov: Array | None) -> dict[str, Any] | None:
        sigmas = sigma_json(np.full(6, np.nan) if cov is None else one_sigma(cov))
        return None if value is None else {"position_m": value.p, "wxyz": value.wxyz} | sigmas

    return {
        "calibration": calibration.name,
        "dock": pose(calibration.T_base_dock, calibration.cov_base),
        "nav": pose(calibration.T_base_nav, calibration.cov_base),
        "mount": pose(calibration.T_sensor_tool, calibration.cov_sensor_tool),
        "scale": calibration.scale,
        "table_height_m": calibration.table_height,
        "robots": calibration.robots,
        "sensor": None if calibration.sensor is None else calibration.sensor.sensor,
        "fit": calibration.residuals,
        "keyframes": [{"index": k} | row for k, row in enumerate(sigmas)],
    }


def _save(file: Path, calibration: Calibration, demo: str, placed: KeyframesInBase | None) -> None:
    kind = file.suffix.removeprefix(".")
    if kind not in ("png", "svg", "pdf"):
        raise CalibrationError(f"{file} must end in .png, .svg or .pdf; rename it", path=file)
    if placed is None:
        raise CalibrationError(
            f"a plot shows the tool at a demonstration's keyframes; name one after '{calibration.name}'"
            if calibration.knows_start
            else f"'{calibration.name}' does not say where the hand starts, so there is nothing to plot; add a dock"
        )
    with working("drawing"):
        from pbd.plots.calibration import draw_calibration
        from pbd.plots.style import write

        figure = draw_calibration(demo, placed)
        with atomic_file(file) as unfinished, unfinished.open("wb") as stream:
            write(figure, stream, kind)
    say(f"a plot: {file}")
