"""The parser with errors of one line, the types of options, and the options that several commands share."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Container, Iterable
from contextlib import suppress
from dataclasses import replace
from inspect import cleandoc
from typing import TYPE_CHECKING, Any

from pbd.io import numbers

if TYPE_CHECKING:
    from pbd.view.units import Units

DRIVEN = ("so100", "so101")
"""The robots that `pbd run` drives."""

UNITS = ("m, cm or mm", "deg or rad", "s or ms")
"""The units to choose from, as the help lists them."""

JSON = "print one JSON object on stdout"
CALIBRATION = "name (in ./calibration, or bundled) or file"
REPLACE_DEMO = "replace a demonstration of that name; a recording, or one with a person's edits, stays in NAME.before"


class HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """Wraps descriptions to the terminal's width; examples keep their lines."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        kind = argparse.RawDescriptionHelpFormatter if "\n  " in text else argparse.HelpFormatter
        return kind._fill_text(self, text, width, indent)


class AppendOnce(argparse.Action):
    """Appends a pair of a name and a value, and refuses a name that was given before."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, name: str | None = None) -> None:
        """Append the pair."""
        given = getattr(namespace, self.dest)
        if values[0] in dict(given):
            raise argparse.ArgumentError(self, f"'{values[0]}' is given twice; give it once")
        setattr(namespace, self.dest, [*given, values])


def option(
    to: argparse._ActionsContainer, names: str, metavar: str | tuple[str, ...] | None, text: str, **more: Any
) -> None:
    """Add an option or an argument; `names` are separated by spaces, and `more` goes to argparse."""
    to.add_argument(*names.split(), metavar=metavar, help=text, **more)


def flag(to: argparse._ActionsContainer, name: str, text: str) -> None:
    """Add an option without a value; --no-WORD sets `word`, which is else true, to false."""
    word = name.removeprefix("--no-")
    dest, action = (None, "store_true") if word == name else (word, "store_false")
    to.add_argument(name, action=action, dest=dest, help=text)


def add_commands(
    parser: argparse.ArgumentParser,
    title: str,
    metavar: str,
    commands: Iterable[Callable[[argparse.ArgumentParser], None]],
) -> None:
    """Add commands, each from a function that adds its options. `run` in the module of the same name executes it.

    The function's docstring is the help: a summary, a description, and indented examples.
    """
    below = parser.add_subparsers(title=title, metavar=metavar, required=True)
    for add in commands:
        summary, _, more = cleandoc(add.__doc__ or "").partition("\n\n")
        description, _, example = more.partition("\n\n  ")
        command = below.add_parser(
            add.__name__.rstrip("_"),  # import_, as `import` is a keyword
            help=summary[:1].lower() + summary[1:].rstrip("."),
            description=description,
            epilog=f"example:\n  {example}",
            formatter_class=HelpFormatter,
        )
        module = ".".join(["pbd.cli", *parser.prog.split()[1:], add.__name__])  # pbd.cli.calibrate.dock
        command.set_defaults(parser=command, module=module)
        add(command)


def add_demo(parser: argparse.ArgumentParser) -> None:
    """Add the demonstration that a command works on."""
    what = "a demonstration's name (in ./demos, or bundled), its folder, or a recording (.csv, .txt, .npz)"
    newest = "default: the newest in ./demos, else 'pouring'"
    option(parser, "demo", "DEMO", f"{what}; {newest}", nargs="?")


def add_table(parser: argparse.ArgumentParser, units: str | None = None) -> None:
    """Add --json, --csv and, with the default `units`, --units: the options of every command that prints a table."""
    form = parser.add_mutually_exclusive_group()
    flag(form, "--json", JSON)
    flag(form, "--csv", "print the table as CSV")
    if units is not None:
        choices = (each for each in UNITS if set(re.findall(r"\w+", each)) & set(units.split(",")))
        _add_units(parser, units, f"units of the table: {'; '.join(choices)}")


def add_tracking(parser: argparse.ArgumentParser, calibration: str = "the robot's own dock, else 'default'") -> None:
    """Add the options of every command that tracks; the help names the default `calibration`."""
    how = "how to track: with pbd's own method, or with the paper's (default)"
    option(parser, "--method", None, how, choices=("default", "paper"), default="default")
    option(parser, "--calibration", "C", f"{CALIBRATION}; default: {calibration}")
    add_accept_gap(parser)


def add_accept_gap(parser: argparse.ArgumentParser) -> None:
    """Add --accept-gap, for commands that track."""
    flag(parser, "--accept-gap", "accept missing data in a rest: the hand stood still there")
    parser.set_defaults(method="default")


def add_placing(group: argparse._ArgumentGroup) -> None:
    """Add the options that say where the motion's keyframes are in base."""
    size = "factor on the motion's size; it multiplies the scale of the dock or the calibration (1)"
    option(group, "--scale", "S", size, type=positive, default=1.0)
    fixed = "'demo': as the hand turned; 'fixed': straight down, with the heading of the first keyframe (demo)"
    option(group, "--orientation", None, fixed, choices=("demo", "fixed"), default="demo")


def add_planning(
    parser: argparse.ArgumentParser, robot_required: bool = True, units: bool = True, measured: bool = False
) -> None:
    """Add the options of every command that plans; `units` adds --units, which `add_table` adds elsewhere.

    `measured` leaves out the options that do not suit a real arm, whose start is measured: --from, --no-approach and
    --allow-collision.
    """
    group = parser.add_argument_group("motion")
    option(group, "--robot", "R", "name or file; see `pbd robots`", required=robot_required)
    add_placing(group)
    way = "between keyframes: straight in joint space, the tool on a straight line, or as the hand went (keyframes)"
    option(group, "--path", None, way, choices=("keyframes", "line", "demo"), default="keyframes")
    tolerance = "with --path keyframes: moves that stray farther from a straight line are made straight"
    metres = within(1e-6, numbers.LARGEST_NUDGE_M, " m")
    option(group, "--path-tolerance", "METRES", tolerance, type=metres, dest="tolerance_m")
    pace = "as fast as the limits allow, or at the hand's own pace where they allow it (limits)"
    option(group, "--time", None, pace, choices=("limits", "demo"), default="limits")
    option(group, "--speed", "F", "share of the joints' limits, up to 1 (1)", type=within(0.01, 1.0), default=1.0)
    margin = "share of those limits that is left for the controller: 0, or 1 to 50 (5)"
    option(group, "--margin", "PERCENT", margin, type=percent, default=5.0)
    dwell = "longest stay at a keyframe, s (0.5; the hand's own with --time demo; what an edited keyframes.toml says)"
    option(group, "--dwell", "S", dwell, type=not_negative, dest="dwell_s")
    if measured:
        parser.set_defaults(start=None, approach=True, allow_collision=False)
    else:
        start = group.add_mutually_exclusive_group()
        joints = "the arm's present joints: a list, an object by name, a /joint_states message, or a file"
        option(start, "--from", "JSON", f"{joints}; default: home", dest="start")
        flag(start, "--no-approach", "start at the first keyframe, not at home")
        if units:
            _add_units(group, "m,rad", f"units of --from, except in a message: {'; '.join(UNITS[:2])}")
    flag(group, "--no-retreat", "end at the last keyframe, do not go back home")
    flag(group, "--no-detour", "refuse a move for which only a planner finds a way around obstacles")
    carried = "mass that the tool always carries, and its centre of mass in the tool frame, m (0 0 0)"
    option(group, "--payload", ("KG", "X Y Z"), carried, type=finite, nargs="+", default=[0.0])
    stands = (
        "move a thing: the tool's place at the thing's first keyframe, m in base, and a turn about the vertical, deg"
    )
    option(group, "--at", "THING=X,Y,Z[,DEG]", stands, type=thing_place, action="append", default=[])
    if not measured:
        flag(group, "--allow-collision", "show a motion that touches something, marked red (never exported)")


def add_line_options(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the options of a device that prints numbers, except --unit."""
    group = parser.add_argument_group("a device that prints numbers (--sensor lines)")
    option(group, "--columns", "LIST", "names of the numbers in a line, such as t,ax,ay,az,gx,gy,gz; or a .toml file")
    option(group, "--separator", "CHAR", "separator between numbers: a character, space or tab (,)", default=",")
    option(group, "--prefix", "TEXT", "text that each line begins with", default="")
    option(group, "--wrap", "T", "value at which the device's clock restarts from 0, in its unit", type=float)
    return group


def _add_units(parser: argparse._ActionsContainer, usual: str, help_text: str) -> None:
    def parsed(text: str) -> Units:
        from pbd.view.units import parse_units

        standard = parse_units(usual)
        try:
            units = parse_units(text, standard) if text else replace(standard, asked=frozenset())
        except ValueError as reason:
            raise argparse.ArgumentTypeError(str(reason)) from None
        if other := sorted(units.asked - standard.asked):
            raise argparse.ArgumentTypeError(f"nothing here has a unit of {other[0]}: leave it out")
        return units

    option(parser, "--units", "U", f"{help_text} ({usual})", type=parsed, default="")


def number(wanted: str, holds: Callable[[float], bool]) -> Callable[[str], float]:
    """Make the parser of a finite number for which `holds` is true; the error says what is `wanted`."""

    def parse(text: str) -> float:
        with suppress(ValueError):
            if holds(value := numbers.finite(text)):
                return value
        comma = "; write a decimal point" if re.fullmatch(r"-?\d+,\d+", text) else ""
        raise argparse.ArgumentTypeError(f"must be {wanted}, got '{text}'{comma}")

    return parse


def within(least: float, most: float, unit: str = "") -> Callable[[str], float]:
    """Make the parser of a number from `least` to `most`."""
    return number(f"from {least:g} to {most:g}{unit}", lambda value: least <= value <= most)


def integer(wanted: str, valid: Container[int]) -> Callable[[str], int]:
    """Make the parser of a whole number in `valid`; the error says what is `wanted`."""

    def parse(text: str) -> int:
        if not (text.isascii() and text.removeprefix("-").isdigit() and int(text) in valid):
            raise argparse.ArgumentTypeError(f"must be {wanted}, got '{text}'")
        return int(text)

    return parse


finite = number("a number", lambda _: True)
positive = number("a number above zero", lambda value: value > 0.0)
sigma_mm = within(0.01, 1e4, " mm")  # a smaller one was probably meant in metres
not_negative = number("zero or a number above", lambda value: value >= 0.0)
# A value below 1 may be meant as a share: 0.05 for 5 %.
percent = number("0, or from 1 to 50 percent", lambda value: value == 0.0 or 1.0 <= value <= 50.0)


def thing_keyframes(text: str) -> tuple[tuple[str, ...], int, int]:
    """Parse THING=I, THING=I..J or THING=I..J@CARRIER: the names, innermost first, the first and the last keyframe."""
    thing, words = pair(text)
    span, *carriers = words.split("@")
    first, _, last = span.partition("..")
    if not (first.isdecimal() and (last or first).isdecimal() and int(first) <= int(last or first) and all(carriers)):
        raise argparse.ArgumentTypeError(f"must be like cup=3..5, or lid=6..7@cup, got '{text}'")
    return (thing, *carriers), int(first), int(last or first)


def thing_place(text: str) -> tuple[str, tuple[float, ...]]:
    """Parse THING=X,Y,Z or THING=X,Y,Z,DEG."""
    with suppress(ValueError, argparse.ArgumentTypeError):
        thing, words = pair(text)
        values = tuple(map(numbers.finite, words.split(",")))
        if len(values) in (3, 4):
            return thing, values
    raise argparse.ArgumentTypeError(f"must be like cup=0.5,0.2,0.1 or cup=0.5,0.2,0.1,30, got '{text}'")


def pair(text: str) -> tuple[str, str]:
    """Parse two words with = between them."""
    ours, equals, theirs = text.partition("=")
    if not (ours and equals and theirs):
        raise argparse.ArgumentTypeError(f"must be two words with = between them, got '{text}'")
    return ours, theirs
