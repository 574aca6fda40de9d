"""pbd export [DEMO] --robot R --format F -o FILE."""

from __future__ import annotations

import argparse
from pathlib import Path

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
from pbd.cli.ways import tell_ways, ways_json
from pbd.files.exporters import FORMATS, HIGHEST_HZ, LOWEST_HZ


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "export",
        "write the joint trajectory for other tools",
        "Plan and audit as `pbd replay` does, and write the joint trajectory.",
        "  pbd export pouring --robot panda --format ros2-json -o pouring.json --rate 100",
    )
    add_demo(parser)
    add_json(parser)
    parser.add_argument("--format", required=True, choices=FORMATS, help="csv, npz or ros2-json")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="FILE", help="the file to write")
    parser.add_argument(
        "--rate", type=_rate, default=1000.0, metavar="HZ", help="samples a second, from 10 to 100000 (1000)"
    )
    add_tracking(parser)
    add_planning(parser)
    parser.set_defaults(run=run)


def _rate(text: str) -> float:
    rate = positive(text)
    if not LOWEST_HZ <= rate <= HIGHEST_HZ:
        raise argparse.ArgumentTypeError(f"must be from {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz, got {text}")
    return rate


def run(args: argparse.Namespace) -> int:
    """Plan, audit, write."""
    from pbd.files.exporters import export

    demo, _, robot, plan = plan_demonstration(args)
    if plan.touching is not None:
        raise plan.touching.error
    tell_ways(plan)
    samples = export(plan.trajectory, args.format, args.output, args.rate)
    say(f"wrote {args.output}: {len(samples.t)} samples, {plan.trajectory.duration:.1f} s, {len(robot.joints)} joints")
    if args.json:
        print_json(
            {
                "demo": demo.recording.info.name,
                "robot": robot.name,
                "format": args.format,
                "output": str(args.output),
                "samples": len(samples.t),
                "duration_s": plan.trajectory.duration,
                "moves": ways_json(plan),
                "warnings": args.warnings,
            }
        )
    return 0
