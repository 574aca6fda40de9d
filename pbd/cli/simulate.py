"""pbd simulate TASK NAME."""

from __future__ import annotations

import argparse
import shlex

from pbd.cli.options import Commands, add_command, add_json, positive, say
from pbd.cli.progress import working
from pbd.cli.store import POINTS, store_demonstration

HIGHEST_HZ = 1e4

NEXT = {
    "touch": "pbd calibrate points trial {demo} --points {points}",
    "pivot": "pbd calibrate mount trial-tip {demo} --pivot",
    "sides": "pbd calibrate sensor trial {demo} --gravity {gravity}",
}
"""What a calibration task is for. The points are touched with the sensor itself, so the mount goes elsewhere."""


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "simulate",
        "make a synthetic demonstration with ground truth",
        "Simulate a hand that holds a sensor and does a task; the ground truth is stored too.",
        "  pbd simulate pour tea --sensor-model wt901 --seed 3\n"
        "  pbd simulate touch trial-touch   to try `pbd calibrate points` with",
    )
    parser.add_argument(
        "task",
        metavar="TASK",
        help="pour, pick-and-place-stops or pick-and-place-direct; to calibrate from: touch, pivot or sides",
    )
    parser.add_argument("name", metavar="NAME", help="the new demonstration's name (in ./demos) or folder")
    parser.add_argument(
        "--sensor-model", default="modern", metavar="M", help="os5000, os5000-nogyro, wt901, modern or ideal (modern)"
    )
    parser.add_argument(
        "--seed", type=int, default=0, metavar="N", help="random seed of the sensor's errors and noise (0)"
    )
    parser.add_argument("--rate", type=positive, metavar="HZ", help="sample rate (the sensor model's own)")
    parser.add_argument("--force", action="store_true", help="replace a demonstration of that name")
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Simulate, store, and say which step of `pbd calibrate` takes it."""
    import numpy as np

    from pbd.errors import SensorError
    from pbd.files.demo import demo_folder
    from pbd.files.points import Points
    from pbd.simulation.calibration_tasks import TOUCHED
    from pbd.simulation.simulate import EARTH, simulate

    if args.rate is not None and args.rate > HIGHEST_HZ:
        raise SensorError(f"--rate must be at most {HIGHEST_HZ:g} Hz, got {args.rate:g}", value=args.rate)
    with working("simulating"):
        demo = simulate(args.task, args.sensor_model, args.seed, rate_hz=args.rate)
    touched = Points(tuple(TOUCHED), np.array(list(TOUCHED.values()))) if args.task == "touch" else None
    store_demonstration(args, demo, "simulated", touched)
    if args.task in NEXT:
        points = demo_folder(args.name) / POINTS
        words = {"demo": shlex.quote(args.name), "points": shlex.quote(str(points)), "gravity": EARTH.gravity}
        say(f"try it: {NEXT[args.task].format(**words)}")
    return 0
