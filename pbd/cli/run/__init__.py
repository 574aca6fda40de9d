"""pbd run [DEMO] --robot R --port P."""

from __future__ import annotations

import argparse
import sys

from pbd.errors import UsageError

DRIVEN = ("so100", "so101")

DRIVERS = {
    "panda": ("npz", "franky"),
    **dict.fromkeys(("ur3", "ur5", "ur10"), ("npz", "ur_rtde")),
    "xarm7": ("npz", "xArm-Python-SDK"),
}
"""Of the arms that pbd doesn't drive: the export, and the program that runs it; of others ROS 2's controller."""


def run(args: argparse.Namespace) -> int:
    """Drive the arm, calibrate its servos, or let go of it."""
    from pbd.cli.run.drive import drive
    from pbd.cli.run.servos import calibrate_servos, release_servos
    from pbd.files.robot import load_robot

    robot = load_robot(args.robot)
    if robot.servos is None:
        name, program = DRIVERS.get(robot.name, ("ros2-json", "ros2_control"))
        file = f"motion.{'json' if name == 'ros2-json' else name}"
        raise UsageError(
            f"pbd run drives {' and '.join(DRIVEN)} alone; for {robot.name}: `pbd export --robot {args.robot} --format "
            f"{name} -o {file}`, and {program} as in docs/exports.md, 'Programs that drive the arms'"
        )
    if args.calibrate:
        calibrate_servos(args, robot)
        return 0
    if not (args.yes or args.dry_run or sys.stdin.isatty()):
        raise UsageError("pbd run asks before the arm moves: start it at a terminal, or with --yes")
    if args.release:
        release_servos(args, robot)
        return 0
    return drive(args, robot)
