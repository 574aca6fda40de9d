"""Options and small steps that several commands share."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

from pbd.cli.progress import working

if TYPE_CHECKING:
    from pbd.data import Calibration, Demonstration, HandPath, Keyframe, Robot
    from pbd.planning import Plan, PlanOptions
    from pbd.view.units import Units


_LENGTHS, _ANGLES, _TIMES = "m, cm or mm", "deg or rad", "s or ms"
CHOICES = {"m": _LENGTHS, "cm": _LENGTHS, "mm": _LENGTHS, "deg": _ANGLES, "rad": _ANGLES, "s": _TIMES, "ms": _TIMES}
"""What the help says to choose from, by the unit that is usual."""


class Commands(Protocol):
    """What argparse's `add_subparsers` returns."""

    def add_parser(self, name: str, **kwargs: Any) -> argparse.ArgumentParser:
        """Add a command."""


def add_command(
    commands: Commands, name: str, help_text: str, description: str, example: str
) -> argparse.ArgumentParser:
    """Add a command with an example at the end of its help."""
    parser = commands.add_parser(
        name,
        help=help_text,
        description=description,
        epilog=f"example:\n{example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(parser=parser)
    return parser


def add_demo(parser: argparse.ArgumentParser) -> None:
    """Add the demonstration that a command works on."""
    parser.add_argument(
        "demo",
        nargs="?",
        metavar="DEMO",
        help="a demonstration's name (in ./demos, or bundled), its folder, or a recording (.csv, .txt, .npz); "
        "default: the newest in ./demos, else 'pouring'",
    )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add --json."""
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")


def add_table(parser: argparse.ArgumentParser, units: str | None = None) -> None:
    """Add what every command that prints a table takes: --json, --csv, and --units, with those that are usual there."""
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    form.add_argument("--csv", action="store_true", help="print the table as CSV")
    if units is not None:
        parser.add_argument(
            "--units",
            type=lambda text: _units(text, units),
            default="",
            metavar="U",
            help=f"units of the table: {'; '.join(CHOICES[unit] for unit in units.split(','))} ({units})",
        )


def add_tracking(parser: argparse.ArgumentParser, calibration: str = "the robot's own dock, else 'default'") -> None:
    """Add what every command that tracks takes; which `calibration` is used where none is named."""
    parser.add_argument(
        "--method",
        choices=("default", "paper"),
        default="default",
        help="how to track: with pbd's own method, or with the paper's (default)",
    )
    parser.add_argument(
        "--calibration",
        metavar="C",
        help=f"name (in ./calibration, or bundled) or file; default: {calibration}",
    )
    add_accept_gap(parser)


def add_accept_gap(parser: argparse.ArgumentParser) -> None:
    """Add --accept-gap: every command that tracks takes it."""
    parser.add_argument(
        "--accept-gap", action="store_true", help="the hand stood still where data are missing in a rest"
    )


def add_planning(parser: argparse.ArgumentParser, robot_required: bool = True, units: bool = True) -> None:
    """Add what every command that plans takes; --units too, where `add_table` doesn't."""
    group = parser.add_argument_group("motion")
    group.add_argument("--robot", metavar="R", required=robot_required, help="name or file; see `pbd robots`")
    group.add_argument("--scale", type=positive, default=1.0, metavar="S", help="multiply the hand's motion (1)")
    group.add_argument(
        "--orientation",
        choices=("demo", "fixed"),
        default="demo",
        help="'fixed' keeps the tool straight down with its heading at the first keyframe (demo)",
    )
    group.add_argument(
        "--path",
        choices=("keyframes", "line", "demo"),
        default="keyframes",
        help="between keyframes: straight in joint space, the tool on a straight line, or as the hand went (keyframes)",
    )
    group.add_argument(
        "--path-tolerance",
        type=positive,
        metavar="METRES",
        help="with --path keyframes: moves that stray farther from a straight line are made straight",
    )
    group.add_argument(
        "--time",
        choices=("limits", "demo"),
        default="limits",
        help="as fast as the limits allow, or at the hand's own pace where they allow it (limits)",
    )
    group.add_argument("--speed", type=share, default=1.0, metavar="F", help="share of the joints' limits, up to 1 (1)")
    group.add_argument(
        "--dwell",
        type=not_negative,
        metavar="S",
        help="longest stay at a keyframe, s (0.5; the hand's own with --time demo; what an edited keyframes.toml says)",
    )
    start = group.add_mutually_exclusive_group()
    start.add_argument(
        "--from",
        dest="start",
        metavar="JSON",
        help="the arm's present joints: a list, an object by name, a /joint_states message, or a file; default: home",
    )
    start.add_argument("--no-approach", action="store_true", help="start at the first keyframe, not at home")
    if units:
        group.add_argument(
            "--units",
            type=lambda text: _units(text, "m,rad"),
            default="",
            metavar="U",
            help=f"units of --from, but for a message: {_LENGTHS}; {_ANGLES} (m,rad)",
        )
    group.add_argument("--no-retreat", action="store_true", help="end at the last keyframe, do not go back home")
    group.add_argument(
        "--allow-collision",
        action="store_true",
        help="show a motion that touches something, marked red (never exported)",
    )


def _units(text: str, usual: str) -> Units:
    from pbd.view.units import parse_units

    standard = replace(parse_units(usual), asked=frozenset())
    try:
        return parse_units(text, standard) if text else standard
    except ValueError as reason:
        raise argparse.ArgumentTypeError(str(reason)) from None


def positive(text: str) -> float:
    """Parse a finite number above zero."""
    value = _number(text)
    if not value > 0.0:
        raise argparse.ArgumentTypeError(f"must be a number above zero, got '{text}'")
    return value


def not_negative(text: str) -> float:
    """Parse a finite number, zero or above."""
    value = _number(text)
    if not value >= 0.0:
        raise argparse.ArgumentTypeError(f"must be zero or a number above, got '{text}'")
    return value


def _number(text: str) -> float:
    """NaN where it is no finite number."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def share(text: str) -> float:
    """Parse a number from 0.01 to 1."""
    value = positive(text)
    if not 0.01 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"must be from 0.01 to 1, got {text}")
    return value


def load_demonstration(args: argparse.Namespace) -> Demonstration:
    """Load the demonstration that was named, or the newest, and then say which."""
    from pbd.files.demo import load_demo, newest_demo

    name = args.demo
    if name is None:
        name = newest_demo()
        say(f"no demonstration named: using '{name}'")
    with working(f"reading {name}"):
        return load_demo(name)


def track_demonstration(
    demo: Demonstration, method: str, calibration: Calibration | None, accept_gap: bool
) -> tuple[HandPath, tuple[Keyframe, ...]]:
    """Track it; return the hand's path and the keyframes that count."""
    from pbd.pipeline import track
    from pbd.tracking.agreement import up_in_sensor, warn_upside_down
    from pbd.tracking.keyframes import keyframes_of

    with working("tracking"):
        path = track(demo, method, calibration=calibration, accept_gap=accept_gap)
    keyframes = keyframes_of(path)
    if calibration is None:  # one that is there tells how far the dock is tilted
        up_sensor = up_in_sensor(keyframes[0].T_nav_sensor.wxyz)
        warn_upside_down(demo.recording, up_sensor, path.stops[0].start, path.stops[0].stop)
    if demo.keyframes is not None:
        say(f"keyframes as edited in {demo.folder}/keyframes.toml")
    return path, keyframes


def named_calibration(args: argparse.Namespace) -> Calibration | None:
    """Load the calibration that was named, if one was: what a command without a robot tracks with."""
    from pbd.files.calibration import load_calibration

    return load_calibration(args.calibration) if args.calibration else None


def load_arm(args: argparse.Namespace) -> tuple[Robot, Calibration]:
    """Load the robot, and the calibration that was named, the robot's own, or the default."""
    from pbd.calibration.frames import with_table
    from pbd.files.calibration import load_calibration
    from pbd.files.robot import load_robot

    robot = load_robot(args.robot)
    if args.calibration is None and robot.dock is not None:
        return robot, robot.dock
    return robot, with_table(load_calibration(args.calibration or "default"), robot)


def plan_options(args: argparse.Namespace, robot: Robot) -> PlanOptions:
    """Collect what `add_planning` added."""
    from pbd.cli.start import start_joints
    from pbd.planning import PlanOptions

    return PlanOptions(
        path=args.path,
        tolerance_m=args.path_tolerance,
        time=args.time,
        scale=args.scale,
        orientation=args.orientation,
        speed=args.speed,
        dwell_s=args.dwell,
        approach=not args.no_approach,
        start=None if args.start is None else start_joints(args.start, robot, args.units),
        retreat=not args.no_retreat,
        allow_collision=args.allow_collision,
    )


def plan_demonstration(args: argparse.Namespace) -> tuple[Demonstration, HandPath, Robot, PlanOptions, Plan]:
    """Load, track, and plan an audited motion."""
    from pbd.planning import plan_path

    demo = load_demonstration(args)
    robot, calibration = load_arm(args)
    path, _ = track_demonstration(demo, args.method, calibration, args.accept_gap)
    options = plan_options(args, robot)
    with working(f"planning for {robot.name}"):
        plan = plan_path(path, calibration, robot, options)
    return demo, path, robot, options, plan


def say(message: str) -> None:
    """Tell the user something that is not the result, in one line."""
    print(f"pbd: {' '.join(message.split())}", file=sys.stderr)


def print_json(result: dict[str, Any]) -> None:
    """Print the result as one JSON object; what is not a finite number is null."""
    print(json.dumps(_without_nan(result), allow_nan=False))


def _without_nan(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_nan(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
