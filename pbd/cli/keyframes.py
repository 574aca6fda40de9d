"""pbd keyframes [DEMO]: where the hand stopped, and with a robot the tool's poses and the joints there."""

import argparse
import math
from collections.abc import Sequence
from dataclasses import replace
from os.path import commonprefix
from typing import Any

import numpy as np
from rich.table import Table

from pbd.calibration.dock import place_in_base
from pbd.calibration.success_probability import Success, success_of
from pbd.calibration.tool_poses import KeyframesInBase
from pbd.calibration.touch_up import touched_covariances, touched_poses
from pbd.calibration.uncertainty import base_sigmas
from pbd.cli.common import (
    load_demonstration,
    named_calibration,
    plan_options,
    print_result,
    save_keyframes,
    sigma_json,
    track_demonstration,
)
from pbd.cli.console import say
from pbd.data import Calibration, Demonstration, HandPath, Keyframe, Robot, SensorEstimate
from pbd.data.covariance import keyframe_sigmas
from pbd.data.keyframe import thing_carriers
from pbd.errors import RecordingError, UsageError, listed, warn
from pbd.files.keyframes import KEYFRAMES_FILE, read_touch_ups
from pbd.files.keyframes_edit import set_frames
from pbd.io.numbers import LARGEST_NUDGE_M
from pbd.io.toml import SMALLEST_POSITIVE
from pbd.planning import arm_of, load_robot_and_calibration, solve_keyframes
from pbd.planning.object_frames import keyframes_of_things, refuse_unknown_things
from pbd.planning.result import place_remark, robot_remark, size_remark
from pbd.pose import Array, Pose
from pbd.view.calibration_tables import base_table
from pbd.view.terminal_tables import joints_table, keyframes_table


def run(args: argparse.Namespace) -> None:
    """Track, map to the robot's base if there is a calibration or a robot, and print."""
    if args.force and not args.save:
        raise UsageError("--force is for --save, which writes keyframes.toml: give both, or neither")
    demo = _load_recorded(args) if args.force else load_demonstration(args.demo)
    robot, calibration = (
        load_robot_and_calibration(args.robot, args.calibration) if args.robot else (None, named_calibration(args))
    )
    path, found, keyframes = _track(args, demo, calibration)
    rows = list(map(_row, range(len(keyframes)), keyframes, keyframe_sigmas([each.cov for each in keyframes])))
    placed, below = None, list[str | Table]()  # what is printed below the keyframes
    if calibration is not None and (calibration.knows_start or args.tolerance is not None):
        placed = place_in_base(keyframes, calibration, args.scale, path, args.orientation)
        if args.calibration:
            below += _add_base(args, rows, placed)
    inside = _success(args, placed)
    if inside is not None:
        for row, probability in zip(rows, inside.of_each, strict=True):
            row["probability"] = probability
        which = "the tolerance" if args.tolerance else f"their own tolerances ({_tolerances(keyframes)})"
        below.append(f"\nprobability that all keyframes are within {which}: {inside.band}")
    if robot is not None and calibration is not None:
        solved = solve_keyframes(robot, keyframes, calibration, plan_options(args, robot), path)
        below += _add_joints(args, rows, robot, *solved)
        placing = place_remark(robot, calibration, args.calibration), size_remark(robot, calibration, args.scale)
        for remark in filter(None, (robot_remark(robot), *placing)):
            say(remark)
    if args.save or args.frame:
        _save(args, demo, found, keyframes)
    result = {
        "demo": demo.recording.info.name,
        "keyframes": rows,
        "sensor_errors": path.sensor and _sensor_errors(path.sensor),
        "success": inside and {"probability": inside.of_all, "band": inside.band},
        "frames": [  # each with the tool's position at its first keyframe
            {"name": name, "keyframes": list(members), "base_position_m": rows[members[0]].get("base_position_m")}
            for name, members in keyframes_of_things(keyframes).items()
        ],
    }
    print_result(args, result, keyframes_table(keyframes, args.units, inside and inside.of_each), *below)


def _track(
    args: argparse.Namespace, demo: Demonstration, calibration: Calibration | None
) -> tuple[HandPath, tuple[Keyframe, ...], tuple[Keyframe, ...]]:
    """Track as --method says; return the keyframes as found, and as they are printed: assigned to things by --frame."""
    path, found = track_demonstration(args, demo, calibration)
    if path.claims and demo.keyframes is None:
        fits = (f"{fit.saying} (off by {100.0 * fit.off_m:.1f} cm, {fit.sigmas:.1f} sigma)" for fit in path.claims)
        say(f"using: {'; '.join(fits)}")
    keyframes = _assign_frames(args, found)
    if args.method == "paper" and demo.keyframes is None:
        if args.tolerance is not None:
            raise UsageError("--tolerance needs an uncertainty, which the paper's method has not; use --method default")
        say("the paper's method gives no uncertainty, so there is no σ")
        keyframes = tuple(replace(keyframe, cov=np.zeros((6, 6))) for keyframe in keyframes)
    return path, found, keyframes


def _load_recorded(args: argparse.Namespace) -> Demonstration:
    """Load the demonstration without the keyframes of keyframes.toml, but with its touch-ups if they can be read."""
    demo = load_demonstration(args.demo, edited=False)
    if demo.folder is None or not (file := demo.folder / KEYFRAMES_FILE).exists():
        return demo
    try:
        return replace(demo, touch_ups=read_touch_ups(file))
    except RecordingError as error:
        warn(f"{error.message}; its touch-ups, if there are any, are not used")
        return demo


def _add_base(args: argparse.Namespace, rows: list[dict[str, Any]], placed: KeyframesInBase) -> list[str | Table]:
    """Add the tool's poses in base and their uncertainty to the rows; return what to print of them."""
    base = touched_poses(placed), base_sigmas(touched_covariances(placed))
    for row, pose, sigma_base in zip(rows, *base, strict=True):
        row |= _pose(pose) | sigma_base
    what = "uncertainty of the tool in base, one sigma; right columns: by source (rms over axes)"
    return [f"\n{what}", base_table(rows, args.units)]


def _add_joints(
    args: argparse.Namespace, rows: list[dict[str, Any]], robot: Robot, poses: Sequence[Pose], q: Array, off: Array
) -> list[str | Table]:
    """Add the tool's poses, the joints (n, k) and the missed rotations (n, 2), rad, to the rows, as `_add_base`."""
    for row, pose, joints, missed in zip(rows, poses, q, off, strict=True):
        row |= _pose(pose) | {"joints": joints}
        row["off_deg"] = [math.degrees(angle) for angle in missed]  # approach axis, then about it: arms of 5 joints
    common = commonprefix(robot.joints)  # noqa: RUF071  # a prefix of letters, not of path components
    prefix = "" if args.csv else "".join(common.rpartition("_")[:2])
    names = [name.removeprefix(prefix) for name in robot.joints]
    table = joints_table(names, rows, args.units, (arm_of(robot).turns == 0.0).tolist())
    return [f"\nthe joints' names begin with {prefix}" if prefix else "", table]


def _success(args: argparse.Namespace, placed: KeyframesInBase | None) -> Success | None:
    """Compute how likely the tool is within --tolerance, or else the keyframes' tolerances; None without any."""
    if placed is None:
        if args.tolerance is None:
            return None
        raise UsageError("--tolerance is about the robot's tool: name the robot (--robot), or a calibration")
    if args.tolerance is None:
        return success_of(placed) if any(each.tolerance_m is not None for each in placed.keyframes) else None
    within_m, *within_deg = args.tolerance
    if min(args.tolerance) < SMALLEST_POSITIVE or within_m > LARGEST_NUDGE_M or len(within_deg) > 1:
        raise UsageError(f"--tolerance takes METRES (up to {LARGEST_NUDGE_M}), or METRES DEGREES, above zero")
    return success_of(placed, within_m, math.radians(within_deg[0]) if within_deg else math.inf)


def _tolerances(keyframes: Sequence[Keyframe]) -> str:
    """Say how large the keyframes' own tolerances are, and how to ask for another."""
    mm = 1e3 * np.concatenate([each.tolerance_m for each in keyframes if each.tolerance_m is not None])
    return f"{mm.min():.1f} to {mm.max():.1f} mm; --tolerance METRES asks for another"


def _pose(pose: Pose) -> dict[str, Any]:
    return {"base_position_m": pose.p, "base_wxyz": pose.wxyz}


def _sensor_errors(found: SensorEstimate) -> dict[str, Any]:
    """Return the sensor's errors as estimated from the recording, with sigmas; the names say the units."""
    named = {
        "gyro_bias_deg_s": (found.gyr_bias, math.degrees(1.0)),
        "gyro_matrix_percent": (found.gyr_matrix, 100.0),
        "acc_bias_m_s2": (found.acc_bias, 1.0),
        "acc_matrix_percent": (found.acc_matrix, 100.0),
        "lag_ms": (found.lag, 1000.0),
    }
    return {name: {"value": (unit * one.value), "sigma": (unit * one.sigma)} for name, (one, unit) in named.items()}


def _row(index: int, keyframe: Keyframe, sigma: Array) -> dict[str, Any]:
    return {
        "index": index,
        "t_s": keyframe.t,
        "dwell_s": keyframe.dwell_s,
        "position_m": keyframe.T_nav_sensor.p,
        "wxyz": keyframe.T_nav_sensor.wxyz,
        **sigma_json(sigma),
        "weight": keyframe.weight,
        "grip": keyframe.grip,
        "label": keyframe.label,
    }


def _assign_frames(args: argparse.Namespace, keyframes: tuple[Keyframe, ...]) -> tuple[Keyframe, ...]:
    """Assign keyframes to things as --frame says.

    Raises:
        RecordingError: there is no keyframe of that number.
        UsageError: the thing is unknown, or a keyframe would belong to two things that do not carry each other.
    """
    known = sorted({names[0] for names, *_ in args.frame}.union(keyframes_of_things(keyframes)))
    refuse_unknown_things((name for names, *_ in args.frame for name in names), known)
    frames: dict[int, tuple[str, ...]] = {}
    for names, first, last in args.frame:
        if last >= len(keyframes):
            what = f"there is no keyframe {last} for '{names[0]}'; they are 0 to {len(keyframes) - 1}"
            raise RecordingError(what, value=last)
        for number in range(first, last + 1):
            inner, outer = sorted((names, frames.get(number, ())), key=len, reverse=True)
            if outer and inner[-len(outer) :] != outer:
                what = f"keyframe {number} can't belong to '{outer[0]}' and to '{inner[0]}'"
                raise UsageError(f"{what}; where one carries the other, say so: --frame lid=6..7@cup")
            frames[number] = inner
    marked = tuple(replace(each, frames=frames.get(k, each.frames)) for k, each in enumerate(keyframes))
    thing_carriers(marked)
    return marked


def _save(
    args: argparse.Namespace, demo: Demonstration, found: tuple[Keyframe, ...], marked: tuple[Keyframe, ...]
) -> None:
    """Write keyframes.toml with --save or if it is missing; write into it which keyframes --frame assigned to things.

    Raises:
        RecordingError: nothing can be saved there.
    """
    if args.save or demo.keyframes is None:
        save_keyframes(args, demo, found)
    if args.frame and demo.folder is not None:
        file = demo.folder / KEYFRAMES_FILE
        assigned = {k: marked[k].frames for _, first, last in args.frame for k in range(first, last + 1)}
        set_frames(file, assigned)
        say(f"{file} says which keyframes belong to {listed(dict.fromkeys(names[0] for names, *_ in args.frame))}")
        for number, names in assigned.items():
            for before in set(found[number].frames) - set(names):
                say(f"keyframe {number} belonged to {before} and no longer does")
