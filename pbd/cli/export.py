"""pbd export [DEMO] --robot R --format F -o FILE."""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from pbd.cli.options import (
    Commands,
    add_command,
    add_demo,
    add_json,
    add_planning,
    add_tracking,
    plan_demonstration,
    positive,
    print_json,
    say,
)
from pbd.cli.parser import UsageError
from pbd.cli.place import refuse_place
from pbd.cli.progress import working
from pbd.cli.ways import tell_ways, ways_json
from pbd.errors import PbdError
from pbd.files.exporters import FORMATS, HIGHEST_HZ, LOWEST_HZ, SUFFIXES
from pbd.view.terminal import is_closed

if TYPE_CHECKING:
    from pbd.data import JointTrajectory, Robot
    from pbd.files.exporters import Export

STDOUT = Path("-")


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "export",
        "write the joint trajectory for other tools",
        "Plan and audit as `pbd replay` does, and write the joint trajectory.",
        "  pbd export pouring --robot panda -o pouring.json\n"
        "  pbd export pouring --robot panda --format csv -o - | head -3",
    )
    add_demo(parser)
    add_json(parser)
    parser.add_argument(
        "--format", choices=FORMATS, help="csv, npz or ros2-json; default: from FILE's ending (.csv, .npz, .json)"
    )
    parser.add_argument(
        "-o", "--output", required=True, type=Path, metavar="FILE", help="the file to write; - is standard output"
    )
    parser.add_argument(
        "--rate",
        type=_rate,
        metavar="HZ",
        help="samples a second, from 10 to 100000 (1000; ros2-json: none but the motion's own knots)",
    )
    add_tracking(parser)
    add_planning(parser)
    parser.set_defaults(run=run)


def _rate(text: str) -> float:
    rate = positive(text)
    if not LOWEST_HZ <= rate <= HIGHEST_HZ:
        raise argparse.ArgumentTypeError(f"must be {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz, got {text}")
    return rate


def run(args: argparse.Namespace) -> int:
    """Plan, audit, write."""
    format_name = _format(args)
    if args.output != STDOUT:
        refuse_place(args.output, (args.demo, args.robot, args.calibration, args.start))
    demo, path, robot, options, plan = plan_demonstration(args)
    if plan.touching is not None:
        raise plan.touching.error
    tell_ways(demo, path, robot, plan, options)
    done = _write(args, plan.trajectory, robot, format_name)
    name = "to standard output" if args.output == STDOUT else args.output
    count, what = len(done.samples.t), "points" if done.receiver else "samples"
    say(f"wrote {name}: {count} {what}, {plan.trajectory.duration:.1f} s, {len(robot.joints)} joints")
    if args.json:
        print_json(
            {
                "demo": demo.recording.info.name,
                "robot": robot.name,
                "format": format_name,
                "output": str(args.output),
                "samples": count,
                "duration_s": plan.trajectory.duration,
                "receiver": {
                    rule: {share.limit: share.value for share in shares} for rule, shares in done.receiver.items()
                },
                "moves": ways_json(plan),
                "warnings": args.warnings,
            }
        )
    return 0


def _format(args: argparse.Namespace) -> str:
    """The format that was named, or that the file's name says."""
    said = SUFFIXES.get(args.output.suffix.lower())
    if args.output == STDOUT:
        if args.json:
            raise UsageError("-o - and --json would both go to standard output; name a file, or leave --json out")
        if is_closed(sys.stdout):
            raise PbdError("standard output is closed: name a file")
        if args.format == "npz" and sys.stdout.isatty():
            raise UsageError("an npz is binary, so it is not printed to a terminal; name a file, or pipe it")
    name: str | None = args.format or said
    if name is None:
        raise UsageError(f"name the --format ({', '.join(FORMATS)}), or a file that ends in {', '.join(SUFFIXES)}")
    if said not in (name, None):
        raise UsageError(f"{args.output} looks like {said}, but --format is {name}; name another file, or no --format")
    return name


def _write(args: argparse.Namespace, trajectory: JointTrajectory, robot: Robot, format_name: str) -> Export:
    """Write the file, or to standard output what the file would hold."""
    from pbd.files.exporters import export

    with TemporaryDirectory() as folder:
        file = Path(folder) / "motion" if args.output == STDOUT else args.output
        with working("writing the motion"):
            done = export(trajectory, robot, format_name, file, args.rate)
        if args.output != STDOUT:
            return done
        with file.open("rb") as written:
            shutil.copyfileobj(written, sys.stdout.buffer)
    return done
