"""Options of the commands that plan for a robot: replay, export, run; and of robots."""

from argparse import ArgumentParser
from pathlib import Path

from pbd.cli.options import (
    JSON,
    add_accept_gap,
    add_demo,
    add_planning,
    add_table,
    add_tracking,
    flag,
    option,
    positive,
    within,
)
from pbd.files.exporters import FORMATS, HIGHEST_HZ, LOWEST_HZ, SUFFIXES


def replay(parser: ArgumentParser) -> None:
    """Plan the robot's motion, audit it and show it.

    Plan the motion of a robot through a demonstration's keyframes, audit it against all limits, and show it:
    in the browser, served on this machine only, or as one HTML file that plays anywhere without a network.

      pbd replay pouring --robot panda --html pouring.html
    """
    add_demo(parser)
    flag(parser, "--json", JSON)
    option(parser, "--html", "FILE", "write the page to FILE, or over an older page, instead of serving it", type=Path)
    flag(parser, "--no-open", "do not open a browser; print the address")
    add_tracking(parser)
    add_planning(parser)


def export(parser: ArgumentParser) -> None:
    """Write the joint trajectory for other tools.

    Plan and audit as `pbd replay` does, and write the joint trajectory.

      pbd export pouring --robot panda -o pouring.json
      pbd export pouring --robot panda --format csv -o - | head -3
      pbd export pouring --format tum-hand -o hand.tum      the hand's path alone
      pbd export tea1 tea2 --robot so101 --format lerobot --task 'pour the tea' -o tea
    """
    demos = "names (in ./demos, or bundled), folders, or recordings; default: the newest in ./demos, else 'pouring'; "
    option(parser, "demos", "DEMO", f"{demos}lerobot alone takes several", nargs="*")
    flag(parser, "--json", JSON)
    form = f"{', '.join(FORMATS)}; default: from FILE's ending ({', '.join(SUFFIXES)})"
    option(parser, "--format", None, form, choices=tuple(FORMATS))
    output = "the file to write (lerobot: the folder); - is standard output"
    option(parser, "-o --output", "FILE", output, required=True, type=Path)
    rate = "samples a second, from 10 to 100000 (1000; tum, mcap: 100; glb: 50; ros2-json: only the motion's own knots)"
    option(parser, "--rate", "HZ", rate, type=within(LOWEST_HZ, HIGHEST_HZ, " Hz"))
    dense = "urscript: servoj at the controller's period (--rate 125, or 500 for e-Series)"
    flag(parser, "--dense", f"{dense}, not a movej for each keyframe")
    option(parser, "--task", "WORDS", "lerobot: what the arm does, in words; default: DEMO's name", default="")
    add_tracking(parser)
    add_planning(parser, robot_required=False)


def run(parser: ArgumentParser) -> None:
    """Run a demonstration on a so100 or so101 arm.

    Plan from where the arm stands, show what will happen, ask, and move the arm over its servos' bus; watch its
    error, load, temperature and voltage. Any key stops it at once. It ends at home, and holds there: its servos
    let go only with --release. docs/running.md says how to begin. Other arms run what `pbd export` writes.

      pbd run --calibrate --robot so101            once: where the servos' zeros and ends are
      pbd run pouring --robot so101 --dry-run      everything but the motion
      pbd run pouring --robot so101 --speed 0.3
    """
    add_demo(parser)
    flag(parser, "--json", JSON)
    option(parser, "--port", "P", "the arm's serial port; default: the only one with something plugged in")
    servos = "the servos' calibration, LeRobot's JSON; default: ./calibration/R-servos.json, else LeRobot's own"
    option(parser, "--servos", "FILE", servos, type=Path)
    flag(parser, "--yes", "do not ask before the arm moves or sinks")
    off = "stop the arm if a joint is farther than this from its goal (10)"
    option(parser, "--tolerance", "DEG", off, type=positive, default=10.0)
    pace = within(40.0, 100.0, " Hz")  # slower, and a stop would take longer than 50 ms; no servo answers faster
    option(parser, "--rate", "HZ", "goals a second, from 40 to 100 (50)", type=pace, default=50.0)
    instead = parser.add_mutually_exclusive_group()
    flag(instead, "--dry-run", "do everything but move: read the servos, send them no goals")
    flag(instead, "--calibrate", "find the servos' middles and ends; write --servos")
    flag(instead, "--release", "switch the servos' torque off: hold the arm, it sinks")
    add_tracking(parser)
    add_planning(parser, measured=True)


def robots(parser: ArgumentParser) -> None:
    """List the robots that pbd knows.

    List the robots in ./robots and the bundled ones, with their reach (tool from the base's axis) and what pbd
    assumes about them; or show one, with the links that are not checked for collisions. To add your own, put a
    file into ./robots (docs/robots.md).

      pbd robots panda
      pbd robots --for pouring
      pbd robots --suggest robots/mine.toml
    """
    option(parser, "robot", "R", "a robot's name or file; default: all", nargs="?")
    able = "which robots can replay this demonstration, those that hold its poses first, the fastest first; what stops"
    option(parser, "--for", "DEMO", f"{able} the others", dest="demo")
    option(parser, "--calibration", "C", "with --for: name or file; default: each robot's own dock")
    missing = "find a home and a dock for a robot's TOML that lacks them, with which it replays --for (pouring)"
    option(parser, "--suggest", "FILE", missing, type=Path)
    add_accept_gap(parser)
    add_table(parser, units="m")
