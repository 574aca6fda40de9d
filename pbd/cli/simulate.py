"""pbd simulate TASK NAME: make a synthetic demonstration, with its ground truth."""

import argparse
import shlex

from pbd.cli.common import store_demonstration
from pbd.cli.console import say, working
from pbd.errors import UsageError
from pbd.files.demo import demo_folder
from pbd.files.points import points_csv
from pbd.simulation.calibration_tasks import TOUCHED
from pbd.simulation.simulate import EARTH, simulate
from pbd.tracking.repair.clock import FASTEST_HZ, SLOWEST_HZ

POINTS_FILE = "points.csv"
"""Name of the file, in a demonstration's folder, with the points that the hand touched."""

NEXT_COMMAND = {
    "touch": "pbd calibrate points trial {demo} --points {points}",
    "pivot": "pbd calibrate mount trial-tip {demo} --pivot",
    "sides": "pbd calibrate sensor trial {demo} --gravity {gravity}",
}
"""The command that uses a calibration task's recording. In "touch" the sensor itself touches the points, so the mount
goes into another calibration."""


def run(args: argparse.Namespace) -> None:
    """Simulate the task, store it, and say which step of `pbd calibrate` uses it."""
    if args.rate is not None and not SLOWEST_HZ <= args.rate <= FASTEST_HZ:  # the rates that tracking accepts
        what = f"--rate must be from {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz, got {args.rate:g}"
        raise UsageError(what, value=args.rate)
    with working("simulating"):
        demo = simulate(args.task, args.sensor_model, args.seed, rate_hz=args.rate)
    points, more, beside = str(demo_folder(args.name) / POINTS_FILE), {}, {}
    if args.task == "touch":
        more["points"] = points
        beside[POINTS_FILE] = points_csv(TOUCHED, "simulated: touched with the sensor itself, in the robot's base")
    store_demonstration(args, demo, "simulated", more, beside)
    if args.task in NEXT_COMMAND:
        words = {"demo": shlex.quote(args.name), "points": shlex.quote(points), "gravity": EARTH.gravity}
        say(f"try it: {NEXT_COMMAND[args.task].format(**words)}")
