"""pbd keyframes [DEMO]."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Any

import numpy as np

from pbd.calibration.dock import nav_in_base
from pbd.calibration.frames import tool_poses
from pbd.calibration.uncertainty import base_sigmas, tool_covariances
from pbd.cli.console import print_json, say
from pbd.cli.steps import load_arm, load_demonstration, named_calibration, plan_options, track_demonstration
from pbd.data import Calibration, Demonstration, Keyframe, Robot, SensorFound
from pbd.data.sigma import keyframe_sigmas, or_none
from pbd.errors import RecordingError
from pbd.files.keyframes import write_keyframes
from pbd.pose import Array, Pose
from pbd.view.calibration_tables import base_table
from pbd.view.tables import joints_table, keyframes_table, print_csv, print_table

Rows = list[dict[str, Any]]


def run(args: argparse.Namespace) -> None:
    """Track, map where a robot is named, and print."""
    demo = load_demonstration(args.demo)
    if args.save and args.force:
        demo = replace(demo, keyframes=None)
    robot, calibration = load_arm(args) if args.robot else (None, named_calibration(args))
    path, keyframes = track_demonstration(demo, args.method, calibration, args.accept_gap)
    if path.claims:
        fits = (f"{fit.saying} (off by {100.0 * fit.off_m:.1f} cm, {fit.sigmas:.1f} sigma)" for fit in path.claims)
        say(f"using: {'; '.join(fits)}")
    if args.save:
        _save(args, demo, keyframes)
    sigmas = keyframe_sigmas([keyframe.cov for keyframe in keyframes])
    rows = [_row(index, keyframe, sigma) for index, (keyframe, sigma) in enumerate(zip(keyframes, sigmas, strict=True))]
    in_base = bool(args.calibration) and calibration is not None and _add_base(args, rows, keyframes, calibration)
    if robot is not None and calibration is not None:
        _add_joints(args, rows, keyframes, robot, calibration)
    if args.json:
        errors = None if path.sensor is None else _sensor_errors(path.sensor)
        return print_json({"demo": demo.recording.info.name, "keyframes": rows, "sensor_errors": errors})
    table, names = keyframes_table(keyframes, args.units), () if robot is None else robot.joints
    if args.csv:
        return print_csv(table, *([joints_table(names, rows, args.units)] if names else []))
    print_table(table)
    if in_base:
        print("\nuncertainty of the tool in base, one sigma; right columns: by source (rms over axes)")
        print_table(base_table(rows))
    if names:
        prefix = _common_prefix(names)
        print(f"\nthe joints' names begin with {prefix}" if prefix else "")
        print_table(joints_table([name.removeprefix(prefix) for name in names], rows, args.units))
    return None


def _common_prefix(names: Sequence[str]) -> str:
    """With what all names begin, up to a "_": in a table it would only take room."""
    if len(names) < 2:
        return ""
    common = takewhile(lambda words: len(set(words)) == 1, zip(*(name.split("_")[:-1] for name in names), strict=False))
    return "".join(f"{words[0]}_" for words in common)


def _save(args: argparse.Namespace, demo: Demonstration, keyframes: tuple[Keyframe, ...]) -> None:
    """Write keyframes.toml for a person to edit."""
    from pbd.planning.options import PlanOptions, dwells

    source = demo.folder or args.demo
    if demo.bundled:
        what = f"{source} is bundled, so nothing is saved there; copy it under another name, without 'bundled = true'"
        raise RecordingError(what, path=source)
    if demo.folder is None:
        what = f"{source} is no demonstration folder, so nothing is saved there; `pbd import` it first"
        raise RecordingError(what, path=source)
    inner = (keyframes[0], *keyframes, keyframes[-1])  # there is no stay at the ends, but one may be inserted beyond
    stays = dwells(inner, PlanOptions(time=args.time, dwell_s=args.dwell))[1:-1]
    magnetic = demo.recording.mag is not None
    path = write_keyframes(demo.folder, demo.folder.name, keyframes, magnetic, args.force, stays)
    say(f"wrote {path}: edit it; from now on the arm follows this file")


def _add_base(args: argparse.Namespace, rows: Rows, keyframes: tuple[Keyframe, ...], calibration: Calibration) -> bool:
    """Add the tool's position in base and how sure it is; False where the calibration has no dock and no nav."""
    if calibration.T_base_dock is None and calibration.T_base_nav is None:
        return False
    T_base_nav = nav_in_base(calibration, keyframes[0].T_nav_sensor.wxyz)
    parts = tool_covariances(keyframes, T_base_nav, calibration, args.scale)
    poses = tool_poses(keyframes, T_base_nav, calibration, args.scale, args.orientation)
    for row, pose, sigma in zip(rows, poses, base_sigmas(parts), strict=True):
        row |= _pose(pose) | sigma
    return True


def _add_joints(
    args: argparse.Namespace, rows: Rows, keyframes: tuple[Keyframe, ...], robot: Robot, calibration: Calibration
) -> None:
    from pbd.planning import solve_keyframes

    poses, joints, off_rad = solve_keyframes(robot, keyframes, calibration, plan_options(args, robot))
    for row, pose, q, off in zip(rows, poses, joints, off_rad, strict=True):
        row |= _pose(pose) | {"joints": q.tolist()}
        row["off_deg"] = [math.degrees(angle) for angle in off]  # approach axis, about it: arms of five joints


def _pose(pose: Pose) -> dict[str, Any]:
    return {"base_position_m": pose.p.tolist(), "base_wxyz": pose.wxyz.tolist()}


def _sensor_errors(found: SensorFound) -> dict[str, Any]:
    """What the recording shows of its sensor, with its sigma, in the units of the names."""
    named = {
        "gyro_bias_deg_s": (found.gyr_bias, math.degrees(1.0)),
        "gyro_matrix_percent": (found.gyr_matrix, 100.0),
        "acc_bias_m_s2": (found.acc_bias, 1.0),
        "acc_matrix_percent": (found.acc_matrix, 100.0),
        "lag_ms": (found.lag, 1000.0),
    }
    return {
        name: {"value": (unit * one.value).tolist(), "sigma": (unit * one.sigma).tolist()}
        for name, (one, unit) in named.items()
    }


def _row(index: int, keyframe: Keyframe, sigma: Array) -> dict[str, Any]:
    return {
        "index": index,
        "t_s": keyframe.t,
        "dwell_s": keyframe.dwell_s,
        "position_m": keyframe.T_nav_sensor.p.tolist(),
        "wxyz": keyframe.T_nav_sensor.wxyz.tolist(),
        "sigma_m": or_none(sigma[:3]),
        "sigma_deg": or_none(np.degrees(sigma[3:])),
        "weight": keyframe.weight,
        "grip": keyframe.grip,
        "label": keyframe.label,
    }
