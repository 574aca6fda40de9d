"""pbd run [DEMO] --robot R --port P: drive the arm, calibrate its servos, or let go of it."""

import argparse
import shlex
import sys
import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from typing import Any

from rich.table import Table

from pbd.cli.console import print_json, say
from pbd.cli.options import DRIVEN
from pbd.cli.recording.device import only_port
from pbd.cli.recording.keys import POLL_S, Keys
from pbd.cli.run.drive import UNCHANGED_NOTE, drive_arm
from pbd.data import Robot
from pbd.driving.bus import Bus
from pbd.driving.calibrating import FULL_TURN_JOINT, Calibrating, calibrating
from pbd.driving.encoders import Encoders, servo_names
from pbd.driving.servo_arm import identify, release
from pbd.errors import SensorError, UsageError, listed, noting
from pbd.files.robot import load_robot
from pbd.files.servo_calibration import COUNTS, own_servo_calibration, write_servo_calibration
from pbd.io.atomic import is_folder, refuse_folder, refuse_output
from pbd.view.safe_console import SafeConsole
from pbd.view.terminal_tables import make_table, print_table

EXPORTS_FOR_OTHER_ARMS = {
    "panda": ("npz", "franky"),
    **dict.fromkeys(("ur3", "ur5", "ur10"), ("npz", "ur_rtde")),
    "xarm7": ("npz", "xArm-Python-SDK"),
}
"""Export format and program for arms that pbd does not drive. For arms not listed it is ROS 2's controller."""

SINKS_QUESTION = "Hold the arm: its servos will let go, and it sinks. Enter lets go; any other key cancels."


def run(args: argparse.Namespace) -> int:
    """Drive the arm, calibrate its servos, or let go of it."""
    robot = load_robot(args.robot)
    if robot.servos is None:
        name, program = EXPORTS_FOR_OTHER_ARMS.get(robot.name, ("ros2-json", "ros2_control"))
        file = f"motion.{'json' if name == 'ros2-json' else name}"
        options = f"--robot {shlex.quote(args.robot)} --format {name} -o {file}"
        raise UsageError(
            f"pbd run drives {' and '.join(DRIVEN)} alone; for {robot.name}: `pbd export DEMO {options}`, and "
            f"{program} as in docs/exports.md, 'Programs that drive the arms'"
        )
    if args.calibrate:
        _calibrate_servos(args, robot)
        return 0
    if not (args.yes or args.dry_run or sys.stdin.isatty()):
        raise UsageError("pbd run asks before the arm moves: start it at a terminal, or with --yes")
    if args.release:
        _release_servos(args, robot)
        return 0
    if args.yes and not args.dry_run and args.demo is None:
        raise UsageError("with --yes the arm moves unasked: name the demonstration, so that it is not just the newest")
    return drive_arm(args, robot)


def _calibrate_servos(args: argparse.Namespace, robot: Robot) -> None:
    """Guide a person through the calibration; write it to the file and to the servos."""
    if not sys.stdin.isatty():
        raise UsageError("pbd run --calibrate needs a person at a terminal, who moves the arm by hand")
    file = args.servos or own_servo_calibration(robot.name)
    if is_folder(file.parent):
        refuse_output(file)
    else:
        refuse_folder(file.parent)  # it is made at the end
    device, ids = args.port or only_port("arm", ""), _ids(robot)
    with Keys() as keys, Bus.open(device) as bus:
        identify(bus, ids)
        with noting(UNCHANGED_NOTE):
            keys.ask(SINKS_QUESTION)
        with calibrating(bus, ids) as session:
            keys.ask("Move every joint to the middle of its range, the gripper half open. Enter when it stands there.")
            session.set_middles()
            others = f"every joint but {FULL_TURN_JOINT}" if FULL_TURN_JOINT in ids else "every joint"
            say(f"move {others} slowly from stop to stop, one after the other; Enter when all are done")
            _show_ranges(keys, session, ids)
            servos = session.result()
            Encoders(robot, servos)  # raises for ranges that are too short
            session.store(servos)
            write_servo_calibration(servos, file)
    print_table(_ranges(ids, [(s.range_min, s.range_max) for s in servos.values()]), sys.stderr)
    say(f"wrote {file}, and the servos; the arm is loose")
    if args.json:
        written = {name: asdict(servo) for name, servo in servos.items()}
        print_json({"robot": robot.name, "port": device, "written": str(file), "servos": written})


def _release_servos(args: argparse.Namespace, robot: Robot) -> None:
    """Switch the servos' torque off, after a question; of those that answer, if some do not."""
    device, ids, silent = args.port or only_port("arm", ""), _ids(robot), None
    with Keys() as keys, Bus.open(device) as bus:
        try:
            identify(bus, ids)
        except SensorError as error:
            if not isinstance(dumb := error.fields.get("silent"), tuple):
                raise
            silent, ids = error, {name: id_ for name, id_ in ids.items() if id_ not in dumb}
            identify(bus, ids)
        if not args.yes:
            with noting(UNCHANGED_NOTE):
                keys.ask(SINKS_QUESTION)
        release(bus, tuple(ids.values()))
    if silent:
        raise SensorError(f"{silent.message}; {listed(ids)} have let go")
    say("the servos have let go")
    if args.json:
        print_json({"robot": robot.name, "port": device, "released": True})


def _ids(robot: Robot) -> dict[str, int]:
    """Return joint -> its servo's bus number, as LeRobot's setup assigns it."""
    return {name: number for number, name in enumerate(servo_names(robot), start=1)}


def _show_ranges(keys: Keys, session: Calibrating, ids: dict[str, int]) -> None:
    """Show the ranges while the person moves the joints, until Enter; any other key cancels (PbdError)."""
    live: AbstractContextManager[Any] = nullcontext()
    if sys.stderr.isatty():
        from rich.live import Live

        live = Live(console=SafeConsole(sys.stderr), transient=True, auto_refresh=False)
    with live as shown:
        while not (key := keys.next()):
            lowest, highest = session.follow()
            if shown is not None:
                ends = list(zip(lowest.tolist(), highest.tolist(), strict=True))
                shown.update(_ranges(ids, ends), refresh=True)
            time.sleep(POLL_S)
    keys.require_enter(key)


def _ranges(ids: dict[str, int], ends: list[tuple[int, int]]) -> Table:
    table = make_table("joint", "servo", "lowest", "highest", "range", left=("joint",))
    for (name, id_), (low, high) in zip(ids.items(), ends, strict=True):
        table.add_row(name, str(id_), str(low), str(high), f"{360 * (high - low) / COUNTS:.0f}°")
    return table
