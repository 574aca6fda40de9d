"""All commands with their options. A command's module is imported when it runs, so that `pbd --help` is instant."""

import argparse
from collections.abc import Sequence
from functools import cache

from pbd import __version__
from pbd.cli.commands import demonstrations, robots, tracking
from pbd.cli.commands.calibrate import calibrate
from pbd.cli.commands.completion import SHELLS, PrintCompletion
from pbd.cli.commands.one_line_errors import Parser
from pbd.cli.options import HelpFormatter, add_commands

EPILOG = """\
a first look:
  pbd replay --robot panda              a panda replays the bundled demonstration
  pbd keyframes                         where the hand stopped, and how certain that is
  pbd export --robot panda --format csv -o pouring.csv

exit codes: 0 done; 1 the input, the output or the device is at fault; 2 wrong usage; 3 the robot can't do it
"""


@cache
def parser() -> Parser:
    """Build the parser of all commands."""
    top = Parser(
        prog="pbd",
        description="Show a robot arm a task with a small inertial sensor in your hand; the arm replays it.",
        epilog=EPILOG,
        formatter_class=HelpFormatter,
    )
    top.add_argument("--version", action="version", version=f"pbd {__version__}")
    completion = "print the script that completes commands, options and names in that shell"
    top.add_argument("--print-completion", action=PrintCompletion, choices=SHELLS, help=completion)
    add_commands(
        top,
        "commands",
        "COMMAND",
        (
            *(demonstrations.record, demonstrations.simulate, demonstrations.import_, tracking.segments),
            *(tracking.keyframes, tracking.touch, tracking.plot, tracking.fuse, tracking.check, calibrate),
            *(robots.replay, robots.export, robots.run, robots.robots, demonstrations.sensors, demonstrations.demos),
        ),
    )
    return top


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse a command line. Unknown arguments are reported by the command's own parser, with its help."""
    top = parser()
    args: argparse.Namespace
    args, unknown = top.parse_known_args(argv)
    command: Parser = getattr(args, "parser", top)
    if unknown and not any(word.startswith("-") for word in unknown):  # an option is between two names
        args, unknown = command.parse_known_intermixed_args(command.words)
    if unknown:
        command.error(f"unexpected argument '{unknown[0]}'")
    return args
