"""pbd calibrate dock CALIBRATION."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from pbd.cli.calibrate_common import add_force, add_name, existing, instead_of, refuse_out_of_reach
from pbd.cli.options import Commands, add_accept_gap, add_command, positive, print_json, say
from pbd.cli.progress import working

if TYPE_CHECKING:
    from pbd.data import Calibration
    from pbd.pose import Array, Pose


def add(commands: Commands) -> None:
    """Add the step."""
    parser = add_command(
        commands,
        "dock",
        "where in the robot's base a demonstration starts",
        "Say where the sensor lies, in the robot's base, when a demonstration begins: measured by hand, where the\n"
        "robot's own tool stands at some joints, or where an earlier demonstration stopped.",
        "  pbd calibrate dock bench --position 0.45 -0.15 0.25 --rpy 0 0 0 --robot panda\n"
        "  pbd calibrate dock bench --robot panda --joints 0 -45 0 -135 0 90 -45\n"
        "  pbd calibrate dock shelf --from-keyframe tea 7 --calibration bench",
    )
    add_name(parser)
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument(
        "--position", nargs=3, type=float, metavar=("X", "Y", "Z"), help="position of the SENSOR in base, m"
    )
    where.add_argument(
        "--joints",
        nargs="+",
        type=float,
        metavar="Q",
        help="the arm's joints there, degrees (sliding joints: m); needs --robot",
    )
    where.add_argument(
        "--from-keyframe", nargs=2, metavar=("DEMO", "K"), help="where demonstration DEMO stopped at its keyframe K"
    )
    parser.add_argument(
        "--rpy",
        nargs=3,
        type=float,
        metavar=("R", "P", "Y"),
        help="with --position: roll, pitch, yaw, degrees (as in NAME's dock, else 0 0 0)",
    )
    parser.add_argument("--calibration", metavar="C", help="calibration to track --from-keyframe with (NAME itself)")
    parser.add_argument("--robot", metavar="R", help="robot of --joints; checks that it reaches the dock")
    parser.add_argument(
        "--sigma-mm", type=positive, default=3.0, metavar="MM", help="one sigma of the position, each axis, mm (3)"
    )
    parser.add_argument(
        "--sigma-deg",
        type=positive,
        default=1.0,
        metavar="DEG",
        help="one sigma of the rotation, each axis, degrees (1)",
    )
    add_force(parser)
    add_accept_gap(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Find the pose, make sure that it can be reached, write it."""
    import numpy as np

    from pbd.files.calibration_edit import calibration_file, covariance_values, pose_values, update_calibration
    from pbd.files.robot import load_robot
    from pbd.pose import quat_to_rpy

    path = calibration_file(args.name)
    calibration = existing(path)
    instead = instead_of(path, calibration, "dock", args.force)
    robot = load_robot(args.robot) if args.robot else None
    T_sensor_tool = _mount(calibration)
    T_base_dock, of_pose, source = _pose(args, calibration, T_sensor_tool)
    if robot is not None:
        refuse_out_of_reach(robot, T_base_dock @ T_sensor_tool, "the dock")
    cov = of_pose + np.diag(np.square([*[1e-3 * args.sigma_mm] * 3, 0.0, 0.0, np.radians(args.sigma_deg)]))
    sigma = np.sqrt(np.diagonal(cov))
    resized = _sigma_changes(calibration, cov)
    update_calibration(
        path,
        {"dock": pose_values(T_base_dock, "in base") | covariance_values(cov)},
        instead=instead,
        robots=(robot.name,) if robot else (),
    )
    rpy_deg = np.degrees(quat_to_rpy(T_base_dock.wxyz))
    x, y, z = T_base_dock.p
    say(
        f"{path}: the sensor's dock is at ({x:.3f}, {y:.3f}, {z:.3f}) m, roll, pitch, yaw "
        f"({', '.join(f'{angle + 0.0:.1f}' for angle in np.round(rpy_deg, 1))}) degrees, {source}"
        + (f", sigma now {1e3 * sigma[:3].max():.3g} mm and {np.degrees(sigma[5]):.3g} degrees" if resized else "")
        + (f"; {robot.name} reaches it" if robot else "; give --robot to check that it is in reach")
    )
    if args.json:
        tool: Pose = T_base_dock @ T_sensor_tool
        print_json(
            {
                "calibration": str(path),
                "dock": {"position_m": T_base_dock.p.tolist(), "rpy_deg": rpy_deg.tolist()},
                "tool": {"position_m": tool.p.tolist(), "wxyz": tool.wxyz.tolist()},
                "reached": robot is not None,
            }
        )
    return 0


def _sigma_changes(calibration: Calibration | None, cov: Array) -> bool:
    """Tell whether the dock that was there was known better or worse."""
    import numpy as np

    if calibration is None or calibration.T_base_dock is None or calibration.cov_base is None:
        return False
    return not np.allclose(calibration.cov_base, cov, rtol=1e-3, atol=0.0)


def _mount(calibration: Calibration | None) -> Pose:
    from pbd.data import TOOL_DOWN

    return TOOL_DOWN if calibration is None else calibration.T_sensor_tool


def _pose(args: argparse.Namespace, calibration: Calibration | None, T_sensor_tool: Pose) -> tuple[Pose, Array, str]:
    """T_base_dock, its covariance (6, 6) but for how the sensor is put down, and where it comes from in words."""
    import numpy as np

    from pbd.errors import CalibrationError
    from pbd.files.points import FARTHEST_M
    from pbd.pose import Pose, quat_to_rpy

    if args.rpy is not None and args.position is None:
        raise CalibrationError("--rpy goes with --position; leave it out")
    if args.position is not None:
        before = None if calibration is None else calibration.T_base_dock
        kept = np.zeros(3) if before is None else np.degrees(quat_to_rpy(before.wxyz))
        rpy_deg = kept if args.rpy is None else args.rpy
        if not np.isfinite([*args.position, *rpy_deg]).all():
            raise CalibrationError("--position and --rpy must be finite numbers; correct them")
        if max(map(abs, args.position)) > FARTHEST_M:
            raise CalibrationError(
                f"a dock {max(map(abs, args.position)):g} m from the robot's base is beyond every robot's reach; give "
                "metres",
                value=max(map(abs, args.position)),
                bound=FARTHEST_M,
            )
        turned = "" if args.rpy is not None or not kept.any() else ", and turned as before (--rpy turns it)"
        return Pose.from_rpy(args.position, np.radians(rpy_deg)), np.zeros((6, 6)), f"as given{turned}"
    if args.joints is not None:
        pose = _where_the_robot_stands(args) @ T_sensor_tool.inverse()
        return pose, np.zeros((6, 6)), "where the robot's tool stands at those joints"
    name, index = args.from_keyframe
    return *_where_it_stopped(args, calibration), f"where {name} stopped at keyframe {index}"


def _where_the_robot_stands(args: argparse.Namespace) -> Pose:
    """T_base_tool by forward kinematics."""
    import numpy as np

    from pbd.arm.model import load_model
    from pbd.errors import CalibrationError, PlanError
    from pbd.files.robot import load_robot

    if args.robot is None:
        raise CalibrationError("--joints needs a robot; give --robot too")
    robot = load_robot(args.robot)
    if len(args.joints) != len(robot.joints):
        raise CalibrationError(
            f"{robot.name} has {len(robot.joints)} joints ({', '.join(robot.joints)}), but {len(args.joints)} numbers "
            "were given; give one for each joint, in degrees",
            value=len(args.joints),
            bound=len(robot.joints),
        )
    model = load_model(robot)
    slides = [joint.shortname().startswith("JointModelP") for joint in list(model.model.joints)[1:]]
    q = np.array(args.joints) * np.where(slides, 1.0, np.pi / 180.0)
    beyond = np.flatnonzero(~((q >= robot.limits.lower - 1e-6) & (q <= robot.limits.upper + 1e-6)))
    if len(beyond):
        k = int(beyond[0])
        lower, upper = np.array((robot.limits.lower[k], robot.limits.upper[k])) * (1.0 if slides[k] else 180.0 / np.pi)
        raise PlanError(
            f"joint {robot.joints[k]} can't be at {args.joints[k]:g}: its limits are {lower:.1f} to {upper:.1f}; "
            "give degrees within them",
            joint=robot.joints[k],
            value=float(q[k]),
        )
    return model.forward(q)


def _where_it_stopped(args: argparse.Namespace, calibration: Calibration | None) -> tuple[Pose, Array]:
    """T_base_sensor at a keyframe, and the covariance (6, 6) of its position and heading: a dock has no other."""
    import numpy as np

    from pbd.calibration.frames import nav_in_base, tool_poses
    from pbd.calibration.uncertainty import tool_covariances
    from pbd.errors import CalibrationError
    from pbd.files.calibration import load_calibration
    from pbd.files.demo import load_demo
    from pbd.pipeline import track
    from pbd.pose import Pose
    from pbd.tracking.keyframes import keyframes_of

    name, index = args.from_keyframe
    through = load_calibration(args.calibration) if args.calibration else calibration
    if through is None:
        raise CalibrationError(
            f"there is no calibration '{args.name}' yet, so it is unknown where {name} started; name another one with "
            "--calibration"
        )
    demo = load_demo(name)
    with working("tracking"):
        keyframes = keyframes_of(track(demo, calibration=through, accept_gap=args.accept_gap))
    if not (index.isdigit() and int(index) < len(keyframes)):
        raise CalibrationError(
            f"{name} has the keyframes 0 to {len(keyframes) - 1}, not '{index}'; `pbd keyframes {name}` lists them",
            value=index,
            bound=len(keyframes) - 1,
        )
    T_base_nav = nav_in_base(through, keyframes[0].T_nav_sensor.wxyz)
    bare = replace(through, T_sensor_tool=Pose.identity(), cov_sensor_tool=None)
    stopped = [keyframes[int(index)]]
    cov = sum(tool_covariances(stopped, T_base_nav, bare).values(), np.zeros((1, 6, 6)))[0]
    cov[3:5] = cov[:, 3:5] = 0.0
    return tool_poses(stopped, T_base_nav, bare)[0], cov
