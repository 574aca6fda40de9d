"""pbd calibrate dock CALIBRATION: where in the robot's base a demonstration starts."""

import argparse
import shlex

import numpy as np

from pbd.calibration.dock import dock_at, lever_figure, placing_covariance
from pbd.cli.calibrate.replacing import keep_other_start
from pbd.cli.common import track_with
from pbd.cli.console import print_json, say, working
from pbd.data import Calibration, Robot
from pbd.data.world import IN_METRES, REACH_M, beyond_reach
from pbd.errors import CalibrationError, PlanError, UsageError, amount, in_degrees, warn
from pbd.files.calibration import load_calibration
from pbd.files.calibration_edit import calibration_to_update, pose_values, update_calibration
from pbd.files.demo import load_demo
from pbd.files.robot import load_robot
from pbd.planning.result import robot_remark
from pbd.pose import Array, Pose, quat_to_rpy
from pbd.tracking.keyframes import keyframes_of

LIMIT_TOLERANCE = 1e-6
"""Largest excess of a given joint over its limit, rad or m. Limits are printed in rounded degrees."""


def run(args: argparse.Namespace) -> None:
    """Find the dock's pose, check that the robot reaches it, and write it."""
    path, calibration = calibration_to_update(args.name)
    if not args.force:
        keep_other_start(path, calibration, "dock")
    robot = load_robot(args.robot) if args.robot else None
    if robot is not None and (remark := robot_remark(robot)):
        say(remark)
    T_base_dock, of_pose, source = _pose(args, robot, calibration)
    tool = T_base_dock @ calibration.T_sensor_tool
    if robot is not None:
        _refuse_out_of_reach(robot, tool)
    cov = of_pose + placing_covariance(args.sigma_mm, args.sigma_deg)
    figures = {} if args.joints is None else lever_figure(calibration)
    if calibration.scale_sigma:  # the scale is kept
        figures["scale_sigma"] = calibration.scale_sigma
    values = pose_values(T_base_dock, "in base", cov) | {"fit": (figures or None, "")}
    update_calibration(path, {"dock": values}, robots=(robot.name,) if robot else ())
    rpy_deg = np.degrees(quat_to_rpy(T_base_dock.wxyz))
    x, y, z = T_base_dock.p
    say(
        f"{path}: the sensor's dock is at ({x:.3f}, {y:.3f}, {z:.3f}) m, roll, pitch, yaw "
        f"({', '.join(f'{angle + 0.0:.1f}' for angle in np.round(rpy_deg, 1))}) degrees, {source}; "
        + (f"{robot.name} reaches it" if robot else "give --robot to check that it is in reach")
    )
    if robot is not None and args.position is not None:
        for note in robot.notes:
            if note.startswith("base is "):  # where it points
                say(note)
    if robot is not None and robot.dock is not None and robot.dock.scale != calibration.scale:
        both = f"{path} has scale = {calibration.scale:g}, {robot.name}'s own dock {robot.dock.scale:g}"
        say(f"{both}: edit it if keyframes are out of reach")
    if args.json:
        print_json(
            {
                "calibration": str(path),
                "dock": {"position_m": T_base_dock.p, "rpy_deg": rpy_deg},
                "tool": {"position_m": tool.p, "wxyz": tool.wxyz},
                "reached": robot is not None,
            }
        )


def _pose(args: argparse.Namespace, robot: Robot | None, calibration: Calibration) -> tuple[Pose, Array, str]:
    """Return T_base_dock, its covariance (6, 6) without that of putting the sensor down, and its source in words."""
    if args.rpy is not None and args.position is None:
        raise UsageError("--rpy goes with --position; leave it out")
    if args.calibration is not None and args.from_keyframe is None:
        raise UsageError("--calibration goes with --from-keyframe; leave it out")
    if args.position is not None:
        before = calibration.T_base_dock
        kept = np.zeros(3) if before is None else np.degrees(quat_to_rpy(before.wxyz))
        rpy_deg = kept if args.rpy is None else args.rpy
        if far := beyond_reach(args.position):
            raise UsageError(f"--position has {far}; {IN_METRES}", value=args.position, bound=REACH_M)
        if args.rpy is not None:
            _doubt_degrees("angle", "--rpy", np.array(args.rpy))
        turned = "" if args.rpy is not None or not kept.any() else ", with its former rotation (--rpy changes it)"
        return Pose.from_rpy(args.position, np.radians(rpy_deg)), np.zeros((6, 6)), f"as given{turned}"
    if args.joints is not None:
        pose = tool_at_joints(args.joints, robot) @ calibration.T_sensor_tool.inverse()
        return pose, np.zeros((6, 6)), "where the robot's tool stands at those joints"
    name, index = args.from_keyframe
    if args.calibration in (None, args.name):  # else each run would move the dock on
        what = f"'{args.name}' is to be written, so it can't say where the hand started in {name}"
        raise CalibrationError(f"{what}; name the calibration that does with --calibration")
    through = load_calibration(args.calibration)
    path = track_with(args, load_demo(name), through)
    keyframes = keyframes_of(path)
    if not (index.isdigit() and int(index) < len(keyframes)):
        last = len(keyframes) - 1
        what = f"{name} has the keyframes 0 to {last}, not '{index}'; `pbd keyframes {shlex.quote(name)}` lists them"
        raise CalibrationError(what, value=index, bound=last)
    return *dock_at(keyframes, int(index), through, path), f"where {name} stopped at keyframe {index}"


def tool_at_joints(joints: list[float], robot: Robot | None) -> Pose:
    """Return T_base_tool by forward kinematics; joints in degrees, sliding joints in m."""
    from pbd.arm.model import load_model

    if robot is None:
        raise UsageError("--joints needs a robot; give --robot too")
    if len(joints) != len(robot.joints):
        raise UsageError(
            f"{robot.name} has {len(robot.joints)} joints ({', '.join(robot.joints)}), but {len(joints)} numbers "
            "were given; give one for each joint, in degrees (sliding joints: m)",
            value=len(joints),
            bound=len(robot.joints),
        )
    model = load_model(robot)
    per_si = np.where(model.turns, 180.0 / np.pi, 1.0)
    q, limits = np.array(joints) / per_si, robot.limits
    inside = (q >= limits.lower - LIMIT_TOLERANCE) & (q <= limits.upper + LIMIT_TOLERANCE)
    for k in np.flatnonzero(~inside):
        lower, upper = limits.lower[k] * per_si[k], limits.upper[k] * per_si[k]
        raise PlanError(
            f"joint {robot.joints[k]} can't be at {joints[k]:g}: its limits are {lower:.4g} to {upper:.4g}; "
            f"give {'degrees' if model.turns[k] else 'm'} within them",
            joint=robot.joints[k],
            value=float(q[k]),
        )
    _doubt_degrees("joint", "--joints", np.where(model.turns, joints, 0.0))
    return model.forward(q)


def _doubt_degrees(what: str, option: str, angles: Array) -> None:
    """Warn if angles (n,), degrees, may be rad: up to a turn, and with a second decimal, as 1.57."""
    largest = np.abs(angles).max()
    if largest <= 2.0 * np.pi and (np.round(angles, 1) != angles).any():
        beyond = amount(largest, "degree", ".3g")
        warn(f"no {what} is beyond {beyond}; {option} takes degrees, so if they are rad, convert them")


def _refuse_out_of_reach(robot: Robot, T_base_tool: Pose) -> None:
    """Raise PlanError if the robot does not reach the pose."""
    from pbd.arm.ik.branches import find_branches
    from pbd.arm.ik.unreachable import out_of_reach
    from pbd.arm.ladder_building import STARTS
    from pbd.arm.model import load_model

    with working(f"checking whether {robot.name} reaches it"):
        arm = load_model(robot)
        if len(find_branches(arm, T_base_tool, robot.home[None], STARTS)):
            return
        fields = out_of_reach(arm, 0, T_base_tool, robot.home).fields
    x, y, z = T_base_tool.p
    away, turned = (float(str(fields[name])) for name in ("value", "rotation"))
    raise PlanError(
        f"the dock puts the tool at ({x:.3f}, {y:.3f}, {z:.3f}) m, out of {robot.name}'s reach: it gets no nearer "
        f"than {100.0 * away:.1f} cm and {in_degrees(turned)}; choose a place nearer to the base, or "
        "another orientation",
        **fields,
    )
