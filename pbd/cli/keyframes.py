"""pbd keyframes [DEMO]."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from itertools import takewhile
from typing import TYPE_CHECKING, Any

from pbd.cli.options import (
    Commands,
    add_command,
    add_demo,
    add_planning,
    add_table,
    add_tracking,
    load_arm,
    load_demonstration,
    named_calibration,
    plan_options,
    print_json,
    say,
    track_demonstration,
)

if TYPE_CHECKING:
    from pbd.data import Calibration, Demonstration, Keyframe, SensorFound
    from pbd.pose import Array


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "keyframes",
        "where the hand stopped, and how certain that is",
        "Print the pose at each stop of a demonstration with its uncertainty; with a robot also the tool's pose\n"
        "in the robot's base and the joints that reach it. --save writes them for you to edit.",
        "  pbd keyframes pouring --robot panda\n  pbd keyframes tea --save",
    )
    add_demo(parser)
    add_table(parser, units="m,deg,s")
    parser.add_argument(
        "--save", action="store_true", help="write keyframes.toml into the demonstration, for you to edit"
    )
    parser.add_argument(
        "--force", action="store_true", help="with --save: find the keyframes again, and replace the file"
    )
    add_tracking(parser, calibration="with --robot its own dock, else 'default'; without, none")
    add_planning(parser, robot_required=False, units=False)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Track, map where a robot is named, and print."""
    from pbd.data.sigma import keyframe_sigmas
    from pbd.view.calibration_tables import base_table
    from pbd.view.tables import joints_table, keyframes_table, print_csv, print_table

    demo = load_demonstration(args)
    if args.save and args.force:
        demo = replace(demo, keyframes=None)
    arm = None if args.robot is None else load_arm(args)
    calibration = named_calibration(args) if arm is None else arm[1]
    path, keyframes = track_demonstration(demo, args.method, calibration, args.accept_gap)
    if path.claims:
        fits = (f"{fit.saying} (off by {100.0 * fit.off_m:.1f} cm, {fit.sigmas:.1f} sigma)" for fit in path.claims)
        say(f"using: {'; '.join(fits)}")
    if args.save:
        _save(args, demo, keyframes)
    sigmas = keyframe_sigmas([keyframe.cov for keyframe in keyframes])
    rows = [_row(index, keyframe, sigma) for index, (keyframe, sigma) in enumerate(zip(keyframes, sigmas, strict=True))]
    in_base = bool(args.calibration) and calibration is not None and _add_base(args, rows, keyframes, calibration)
    joint_names: tuple[str, ...] = ()
    if arm is not None:
        from pbd.planning import solve_keyframes

        robot, calibration = arm
        joint_names = robot.joints
        poses, joints, off_rad = solve_keyframes(robot, keyframes, calibration, plan_options(args, robot))
        for row, pose, q, off in zip(rows, poses, joints, off_rad, strict=True):
            row |= {"base_position_m": pose.p.tolist(), "base_wxyz": pose.wxyz.tolist(), "joints": q.tolist()}
            row["off_deg"] = [math.degrees(angle) for angle in off]  # approach axis, about it: arms of five joints
    if args.json:
        errors = None if path.sensor is None else _sensor_errors(path.sensor)
        print_json({"demo": demo.recording.info.name, "keyframes": rows, "sensor_errors": errors})
        return 0
    table = keyframes_table(keyframes, args.units)
    if args.csv:
        print_csv(table, *([joints_table(joint_names, rows, args.units)] if joint_names else []))
        return 0
    print_table(table)
    if in_base:
        print("\nuncertainty of the tool in base, one sigma; right columns: by source (rms over axes)")
        print_table(base_table(rows))
    if joint_names:
        prefix = _common_prefix(joint_names)
        print(f"\nthe joints' names begin with {prefix}" if prefix else "")
        print_table(joints_table([name.removeprefix(prefix) for name in joint_names], rows, args.units))
    return 0


def _common_prefix(names: tuple[str, ...]) -> str:
    """With what all names begin, up to a "_": in a table it would only take room."""
    if len(names) < 2:
        return ""
    common = takewhile(lambda words: len(set(words)) == 1, zip(*(name.split("_")[:-1] for name in names), strict=False))
    return "".join(f"{words[0]}_" for words in common)


def _save(args: argparse.Namespace, demo: Demonstration, keyframes: tuple[Keyframe, ...]) -> None:
    """Write keyframes.toml for a person to edit."""
    from pbd.errors import RecordingError
    from pbd.files.keyframes import write_keyframes
    from pbd.planning.options import PlanOptions, dwells

    if demo.folder is None or demo.bundled:
        source = demo.folder or args.demo
        raise RecordingError(
            f"{source} is {'bundled' if demo.bundled else 'no demonstration folder'}, so nothing is saved there; "
            + ("copy it under another name, without 'bundled = true'" if demo.bundled else "`pbd import` it first"),
            path=source,
        )
    inner = (keyframes[0], *keyframes, keyframes[-1])  # there is no stay at the ends, but one may be inserted beyond
    stays = dwells(inner, PlanOptions(time=args.time, dwell_s=args.dwell))[1:-1]
    magnetic = demo.recording.mag is not None
    path = write_keyframes(demo.folder, demo.folder.name, keyframes, magnetic, args.force, stays)
    say(f"wrote {path}: edit it; from now on the arm follows this file")


def _add_base(
    args: argparse.Namespace, rows: list[dict[str, Any]], keyframes: tuple[Keyframe, ...], calibration: Calibration
) -> bool:
    """Add the tool's position in base and how sure it is; False where the calibration has no dock and no nav."""
    from pbd.calibration.frames import nav_in_base, tool_poses
    from pbd.calibration.uncertainty import base_sigmas, tool_covariances

    if calibration.T_base_dock is None and calibration.T_base_nav is None:
        return False
    T_base_nav = nav_in_base(calibration, keyframes[0].T_nav_sensor.wxyz)
    parts = tool_covariances(keyframes, T_base_nav, calibration, args.scale)
    poses = tool_poses(keyframes, T_base_nav, calibration, args.scale, args.orientation)
    for row, pose, sigma in zip(rows, poses, base_sigmas(parts), strict=True):
        row |= {"base_position_m": pose.p.tolist(), "base_wxyz": pose.wxyz.tolist()} | sigma
    return True


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
    import numpy as np

    from pbd.data.sigma import or_none

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
