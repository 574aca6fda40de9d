"""pbd replay [DEMO] --robot R: plan the motion, and show it in the browser or as a page."""

import argparse
import math

from pbd.cli.common import plan_demonstration
from pbd.cli.console import print_json, say, working
from pbd.cli.plan_report import moves_json, plan_json, remarks, touching_json, unfollowed
from pbd.errors import UsageError, warn
from pbd.io.atomic import refuse_output
from pbd.replay import replay_scene
from pbd.view.page import write_page
from pbd.view.server import show_replay


def run(args: argparse.Namespace) -> None:
    """Plan the motion, audit it and show it."""
    if args.html is not None:
        refuse_output(args.html, (args.demo, args.robot, args.calibration, args.start))
        if args.html.suffix.lower() not in (".html", ".htm"):
            raise UsageError(f"--html needs a name that ends in .html, got '{args.html}'")
    plan = plan_demonstration(args)
    for what in unfollowed(plan):
        warn(what)
    warned = list(args.warnings)
    used = 100.0 * max(plan.report.velocity, plan.report.acceleration, plan.report.jerk)
    audited = f"{plan.trajectory.duration:.1f} s, audited, at most {used:.0f} % of the limits"
    say(f"'{plan.name}' on {plan.robot.name}: {len(plan.keyframes)} keyframes, {audited}")
    for remark in remarks(plan, args.calibration):
        say(remark)
    if plan.touching is not None:
        later = len(plan.touching.hits) - 1
        more = f" ({later} more, all marked on the page)" if later else ""
        warned.append(f"collision: {plan.touching.error.message}{more}")
        say(f"warning: {warned[-1]}")
    if args.html is not None:
        with working("writing the page"):
            write_page(replay_scene(plan, warned), args.html)
        say(f"wrote {args.html.resolve()} ({args.html.stat().st_size / 1e6:.1f} MB); open it in a browser")
    if args.json:
        report = plan.report
        errors = {name: getattr(report, name) for name in ("max_position_error_m", "max_rotation_error_rad")}
        print_json(
            {
                **plan_json(plan, args.calibration, args.demo),
                "keyframes": len(plan.keyframes),
                "ik": errors,
                "limits": {
                    **{name: getattr(report, name) for name in ("velocity", "acceleration", "jerk")},
                    "torque": report.torque and report.torque.share,
                },
                "moves": moves_json(plan),
                "stretched": [vars(each) for each in plan.stretched],
                "off_deg": [math.degrees(angle) for angle in plan.off_rad.max(axis=0)],
                "collision": touching_json(plan),
                "warnings": warned,
                "html": str(args.html) if args.html else None,
            }
        )
    elif not args.html:
        show_replay(replay_scene(plan, warned), open_browser=args.open)
