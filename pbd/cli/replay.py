"""pbd replay [DEMO] --robot R."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from pbd.cli.options import (
    Commands,
    add_command,
    add_demo,
    add_json,
    add_planning,
    add_tracking,
    plan_demonstration,
    print_json,
    say,
)
from pbd.cli.parser import UsageError
from pbd.cli.place import refuse_place
from pbd.cli.progress import working
from pbd.cli.ways import tell_ways, touching_json, ways_json

SUFFIXES = (".html", ".htm")


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "replay",
        "plan the robot's motion, audit it and show it",
        "Plan the motion of a robot through a demonstration's keyframes, audit it against all limits, and show it:\n"
        "in the browser, served on this machine only, or as one HTML file that plays anywhere without a network.",
        "  pbd replay pouring --robot panda --html pouring.html",
    )
    add_demo(parser)
    add_json(parser)
    parser.add_argument("--html", type=Path, metavar="FILE", help="write the page to FILE instead of serving it")
    parser.add_argument("--no-open", action="store_true", help="do not open a browser; print the address")
    add_tracking(parser)
    add_planning(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Plan, audit, show."""
    from pbd.replay import replay_scene

    if args.html is not None:
        refuse_place(args.html, (args.demo, args.robot, args.calibration, args.start))
        if args.html.suffix.lower() not in SUFFIXES:
            raise UsageError(f"--html needs a name that ends in .html, got '{args.html}'")
    demo, path, robot, options, plan = plan_demonstration(args)
    duration = plan.trajectory.duration
    say(f"'{demo.recording.info.name}' on {robot.name}: {len(plan.keyframes)} keyframes, {duration:.1f} s, audited")
    tell_ways(demo, path, robot, plan, options)
    if plan.touching is not None:
        later = len(plan.touching.hits) - 1
        more = f" ({later} more, all marked on the page)" if later else ""
        args.warnings.append(f"collision: {plan.touching.error.message}{more}")
        say(f"warning: {args.warnings[-1]}")
    if args.html is not None:
        from pbd.files.whole import written_whole
        from pbd.view.page import write_page

        with working("writing the page"), written_whole(args.html) as unfinished:
            write_page(replay_scene(demo, path, plan, robot, options, args.warnings), unfinished)
        say(f"wrote {args.html.resolve()} ({args.html.stat().st_size / 1e6:.1f} MB); open it in a browser")
    if args.json:
        report = plan.report
        print_json(
            {
                "demo": demo.recording.info.name,
                "robot": robot.name,
                "keyframes": len(plan.keyframes),
                "duration_s": duration,
                "ik": {
                    "max_position_error_m": report.max_position_error_m,
                    "max_rotation_error_rad": report.max_rotation_error_rad,
                },
                "limits": {"velocity": report.velocity, "acceleration": report.acceleration, "jerk": report.jerk},
                "moves": ways_json(plan),
                "stretched": [vars(each) for each in plan.stretched],
                "off_deg": [math.degrees(angle) for angle in plan.off_rad.max(axis=0)],
                "collision": touching_json(plan),
                "warnings": args.warnings,
                "html": str(args.html) if args.html else None,
            }
        )
    elif not args.html:
        from pbd.view.server import show_replay

        show_replay(replay_scene(demo, path, plan, robot, options, args.warnings), open_browser=not args.no_open)
    return 0
