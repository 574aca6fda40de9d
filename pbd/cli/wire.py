"""What a command has to be told of the bytes of a sensor: which decoder, and what the numbers of a line are."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pbd.sensors.decoding import Decoder


def add_lines(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the options of a device that prints numbers, but for --unit."""
    group = parser.add_argument_group("a device that prints numbers (--sensor lines)")
    group.add_argument(
        "--columns", metavar="LIST", help="names of the numbers in a line, such as t,ax,ay,az,gx,gy,gz; or a .toml file"
    )
    group.add_argument(
        "--separator", default=",", metavar="CHAR", help="separator between numbers: a character, space or tab (,)"
    )
    group.add_argument("--prefix", default="", metavar="TEXT", help="text that each line begins with")
    group.add_argument(
        "--wrap", type=float, metavar="T", help="value at which the device's clock restarts from 0, in its unit"
    )
    return group


def decoder_maker(
    args: argparse.Namespace, sensor: str, units: Iterable[str], also: Iterable[str] = ()
) -> Callable[[], Decoder]:
    """What makes the sensor's decoder; `units` as in `acc=g`, for lines and the Razor; what a command takes `also`.

    Raises:
        SensorError: the sensor is unknown, or its lines are not described, or wrongly.
    """
    from pbd.sensors.protocols import protocol

    if sensor not in ("lines", "razor"):
        return protocol(sensor, also).decoder
    from pbd.doors.opening import read_text
    from pbd.errors import SensorError
    from pbd.sensors.line_layout import layout_from_options, layout_from_toml, units_from_options
    from pbd.sensors.lines import LineDecoder
    from pbd.sensors.razor import razor_layout

    if sensor == "razor":
        layout = razor_layout(units_from_options(units))
    elif not args.columns:
        raise SensorError('name the numbers of a line: --columns "t,ax,ay,az,gx,gy,gz", or a .toml file')
    elif args.columns.endswith(".toml"):
        text = read_text(Path(args.columns), SensorError, "give a TOML file")
        layout = layout_from_toml(text, args.columns)
    else:
        layout = layout_from_options(args.columns, units, args.separator, args.prefix, args.wrap)
    return lambda: LineDecoder(layout)
