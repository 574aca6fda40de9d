"""pbd export [DEMO] --robot R --format F -o FILE."""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from pbd.cli.console import print_json, say, working
from pbd.cli.options import UsageError
from pbd.cli.plan_report import moves_json, say_moves, say_torque
from pbd.cli.steps import plan_demonstration
from pbd.doors.atomic import refuse_output
from pbd.errors import PbdError
from pbd.files.exporters import ALSO, FOR_SOME, FORMATS, SUFFIXES, Export, check_format, export
from pbd.view.terminal import is_closed

if TYPE_CHECKING:
    from pbd.data import JointTrajectory, Robot
    from pbd.files.exporters.order import Source

STDOUT = Path("-")


def run(args: argparse.Namespace) -> None:
    """Plan, audit, write."""
    from pbd.files.robot import load_robot
    from pbd.planning import source_of

    format_name = _format(args)
    check_format(format_name, args.rate, args.dense, load_robot(args.robot) if format_name in FOR_SOME else None)
    if args.output != STDOUT:
        refuse_output(args.output, (args.demo, args.robot, args.calibration, args.start))
    demo, path, robot, options, plan = plan_demonstration(args)
    if plan.touching is not None:
        raise plan.touching.error
    say_torque(demo, robot, plan, options)
    say_moves(demo, path, robot, plan, options)
    source = source_of(plan, path, robot, demo.recording.info.name)
    done = _write(args, plan.trajectory, robot, format_name, source)
    name = "to standard output" if args.output == STDOUT else args.output
    count = len(done.samples.t)
    say(f"wrote {name}: {count} {done.counted}, {plan.trajectory.duration:.1f} s, {len(robot.joints)} joints")
    if args.json:
        receiver = {rule: {share.limit: share.value for share in shares} for rule, shares in done.receiver.items()}
        print_json(
            {
                "demo": demo.recording.info.name,
                "robot": robot.name,
                "format": format_name,
                "output": str(args.output),
                "samples": count,
                "duration_s": plan.trajectory.duration,
                "receiver": receiver,
                "moves": moves_json(plan),
                "warnings": args.warnings,
            }
        )


def _format(args: argparse.Namespace) -> str:
    """The format that was named, or that the file's name says."""
    said = SUFFIXES.get(args.output.suffix.lower())
    if args.output == STDOUT:
        if args.json:
            raise UsageError("-o - and --json would both go to standard output; name a file, or leave --json out")
        if is_closed(sys.stdout):
            raise PbdError("standard output is closed: name a file")
        if args.format in ("npz", "mcap") and sys.stdout.isatty():
            raise UsageError(f"{args.format} is binary, so it is not printed to a terminal; name a file, or pipe it")
    name: str | None = args.format or said
    if name is None:
        raise UsageError(f"name the --format ({', '.join(FORMATS)}), or a file that ends in {', '.join(SUFFIXES)}")
    if said not in (name, None) and args.output.suffix.lower() not in ALSO.get(name, ()):
        raise UsageError(f"{args.output} looks like {said}, but --format is {name}; name another file, or no --format")
    return name


def _write(
    args: argparse.Namespace, trajectory: JointTrajectory, robot: Robot, format_name: str, source: Source
) -> Export:
    """Write the file, or to standard output what the file would hold."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "motion" if args.output == STDOUT else args.output
        with working("writing the motion"):
            done = export(trajectory, robot, format_name, file, args.rate, dense=args.dense, source=source)
        if args.output == STDOUT:
            with file.open("rb") as written:
                shutil.copyfileobj(written, sys.stdout.buffer)
    return done
