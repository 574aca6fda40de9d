"""pbd simulate TASK NAME."""

from __future__ import annotations

import argparse

from pbd.cli.options import Commands, add_command, add_json, positive
from pbd.cli.progress import working
from pbd.cli.store import store_demonstration

HIGHEST_HZ = 1e4


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "simulate",
        "make a synthetic demonstration, with its truth",
        "Simulate a hand that does a task with a sensor in it; the truth is stored beside.",
        "  pbd simulate pour tea --sensor-model wt901 --seed 3",
    )
    parser.add_argument("task", metavar="TASK", help="pour, pick-and-place-stops or pick-and-place-direct")
    parser.add_argument("name", metavar="NAME", help="the new demonstration's name (in ./demos) or folder")
    parser.add_argument(
        "--sensor-model", default="modern", metavar="M", help="os5000, os5000-nogyro, wt901, modern or ideal (modern)"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="draws the sensor's errors and its noise (0)")
    parser.add_argument("--rate", type=positive, metavar="HZ", help="instead of the sensor model's own")
    parser.add_argument("--force", action="store_true", help="replace a demonstration of that name")
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Simulate and store."""
    from pbd.errors import SensorError
    from pbd.sensors.simulate import simulate

    if args.rate is not None and args.rate > HIGHEST_HZ:
        raise SensorError(
            f"no sensor gives {args.rate:g} samples a second; give at most {HIGHEST_HZ:g}", value=args.rate
        )
    with working("simulating"):
        demo = simulate(args.task, args.sensor_model, args.seed, rate_hz=args.rate)
    store_demonstration(args, demo, "simulated")
    return 0
