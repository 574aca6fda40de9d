"""pbd run [DEMO] --robot R --port P."""

from __future__ import annotations

import argparse
from pathlib import Path

from pbd.cli.options import (
    Commands,
    UsageError,
    add_command,
    add_demo,
    add_json,
    add_planning,
    add_tracking,
    positive,
)

DRIVEN = ("so100", "so101")

DRIVERS = {
    "panda": ("npz", "franky"),
    **dict.fromkeys(("ur3", "ur5", "ur10"), ("npz", "ur_rtde")),
    "xarm7": ("npz", "xArm-Python-SDK"),
}
"""Of the arms that pbd doesn't drive: the export, and the program that runs it; of others ROS 2's controller."""


def add_run(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "run",
        "run a demonstration on a so100 or so101 arm",
        "Plan from where the arm stands, show what will happen, ask, and move the arm over its servos' bus; watch its\n"
        "error, load, temperature and voltage. Any key stops it at once. It ends at home, and holds there: its servos\n"
        "let go only with --release. docs/running.md says how to begin. Other arms run what `pbd export` writes.",
        "  pbd run --calibrate --robot so101            once: where the servos' zeros and ends are\n"
        "  pbd run pouring --robot so101 --dry-run      all but the motion\n"
        "  pbd run pouring --robot so101 --speed 0.3",
    )
    add_demo(parser)
    add_json(parser)
    option = parser.add_argument
    option("--port", metavar="P", help="the arm's serial port; default: the only one with something plugged in")
    servos = "the servos' calibration, LeRobot's JSON; default: ./calibration/R-servos.json, else LeRobot's own"
    option("--servos", type=Path, metavar="FILE", help=servos)
    option("--yes", action="store_true", help="do not ask before the arm moves or sinks")
    tolerance = "a joint farther off its goal stops the arm (10)"
    option("--tolerance", type=positive, default=10.0, metavar="DEG", help=tolerance)
    option("--rate", type=_run_rate, default=50.0, metavar="HZ", help="goals a second, from 40 to 100 (50)")
    instead = parser.add_mutually_exclusive_group()
    instead.add_argument("--dry-run", action="store_true", help="do all but move: read the servos, give them no goals")
    instead.add_argument("--calibrate", action="store_true", help="find the servos' middles and ends; write --servos")
    instead.add_argument("--release", action="store_true", help="switch the servos' torque off: hold the arm, it sinks")
    add_tracking(parser)
    add_planning(parser, measured=True)


def _run_rate(text: str) -> float:
    rate = positive(text)
    if not 40.0 <= rate <= 100.0:  # slower, and a stop would take longer than 50 ms; faster than the servos answer
        raise argparse.ArgumentTypeError(f"must be 40 to 100 Hz, got {text}")
    return rate


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
    if args.release:
        release_servos(args, robot)
        return 0
    return drive(args, robot)
