"""pbd keyframes [DEMO]."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from pbd.cli.options import (
    Commands,
    add_command,
    add_demo,
    add_json,
    add_planning,
    add_tracking,
    load_arm,
    load_demonstration,
    plan_options,
    print_json,
    say,
    track_demonstration,
)

if TYPE_CHECKING:
    from pbd.data import Keyframe


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "keyframes",
        "where the hand stopped, and how sure we are",
        "Print the pose at each stop of a demonstration with its uncertainty; with a robot also the tool's pose\n"
        "in the robot's base and the joints that reach it.",
        "  pbd keyframes pouring --robot panda",
    )
    add_demo(parser)
    add_json(parser)
    add_tracking(parser)
    add_planning(parser, robot_required=False)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Track, map where a robot is named, and print."""
    from pbd.view.tables import joints_table, keyframes_table, print_table

    demo = load_demonstration(args)
    path, keyframes = track_demonstration(args, demo)
    if path.claims:
        fits = (f"{fit.saying} ({100.0 * fit.off_m:.1f} cm, {fit.sigmas:.1f} sigma off)" for fit in path.claims)
        say(f"known, and used: {'; '.join(fits)}")
    rows = [_row(index, keyframe) for index, keyframe in enumerate(keyframes)]
    joint_names: tuple[str, ...] = ()
    if args.robot is not None:
        from pbd.arm.model import load_model
        from pbd.pipeline import solve_keyframes

        robot, calibration = load_arm(args)
        joint_names = robot.joints
        _, poses, joints = solve_keyframes(load_model(robot), keyframes, calibration, plan_options(args))
        for row, pose, q in zip(rows, poses, joints, strict=True):
            row |= {"base_position_m": pose.p.tolist(), "base_wxyz": pose.wxyz.tolist(), "joints": q.tolist()}
    if args.json:
        print_json({"demo": demo.recording.info.name, "keyframes": rows})
        return 0
    print_table(keyframes_table(keyframes))
    if joint_names:
        print_table(joints_table(joint_names, rows))
    return 0


def _row(index: int, keyframe: Keyframe) -> dict[str, Any]:
    from pbd.tracking.uncertainty import sigmas

    sigma_m, sigma_deg = sigmas(keyframe.cov)
    return {
        "index": index,
        "t_s": keyframe.t,
        "dwell_s": keyframe.dwell_s,
        "position_m": keyframe.T_nav_sensor.p.tolist(),
        "wxyz": keyframe.T_nav_sensor.wxyz.tolist(),
        "sigma_m": sigma_m.tolist(),
        "sigma_deg": sigma_deg.tolist(),
        "grip": keyframe.grip,
        "label": keyframe.label,
    }
