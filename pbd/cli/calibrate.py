"""pbd calibrate dock / points / mount / sensor / show: makes calibration/NAME.toml, step by step."""

from __future__ import annotations

from pbd.cli.calibrate_dock import add as add_dock
from pbd.cli.calibrate_mount import add as add_mount
from pbd.cli.calibrate_points import add as add_points
from pbd.cli.calibrate_sensor import add as add_sensor
from pbd.cli.calibrate_show import add as add_show
from pbd.cli.options import Commands, add_command

STEPS = (add_dock, add_points, add_mount, add_sensor, add_show)


def add(commands: Commands) -> None:
    """Add the command and its steps."""
    parser = add_command(
        commands,
        "calibrate",
        "where the hand starts in the robot's base, how the sensor is mounted, and its errors",
        "Make or update ./calibration/NAME.toml, one part at a time; the other parts stay as they are.\n"
        "docs/calibration.md explains each part.",
        "  pbd calibrate dock bench --position 0.45 -0.15 0.25 --rpy 0 0 0 --robot panda\n"
        "  pbd calibrate show bench\n"
        "  pbd replay tea --robot panda --calibration bench",
    )
    steps = parser.add_subparsers(title="steps", metavar="STEP", required=True)
    for add_step in STEPS:
        add_step(steps)
