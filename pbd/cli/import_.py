"""pbd import FILE NAME."""

from __future__ import annotations

import argparse
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pbd.cli.options import Commands, add_command, add_json, positive
from pbd.cli.progress import working
from pbd.cli.store import store_demonstration
from pbd.cli.wire import add_lines, decoder_maker

if TYPE_CHECKING:
    from pbd.data import Demonstration


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "import",
        "import a recording of another program",
        "Read a recording (a CSV with a header, x-io's CSV, WitMotion's .txt or .csv log, an npz, a raw.bin of\n"
        "`pbd record --raw`) and store it as a demonstration. Names and units come from the header where it\n"
        "gives them; otherwise use --column and --unit. A level sensor must read +1 g on z: where it reads -1 g, turn\n"
        "the signs with --unit acc=-g.",
        "  pbd import run7.csv tea --column ax=AccX --column ay=AccY --column az=AccZ --unit acc=g --unit t=ms\n"
        "  pbd import log.txt tea2                    as WitMotion's program wrote it\n"
        "  pbd import demos/tea/raw.bin again --sensor witmotion",
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="the recording")
    parser.add_argument("name", metavar="NAME", help="the new demonstration's name (in ./demos) or folder")
    parser.add_argument(
        "--column",
        type=_pair,
        action="append",
        default=[],
        metavar="OURS=THEIRS",
        help="t, gx, gy, gz, ax, ay, az, mx, my, mz, heading, pitch or roll, and the file's name for it; "
        "-NAME turns its sign",
    )
    parser.add_argument(
        "--unit",
        type=_pair,
        action="append",
        default=[],
        metavar="WHAT=UNIT",
        help="of t, gyr, acc, mag or angle, such as t=ms, gyr=deg/s, acc=g; -UNIT turns the signs",
    )
    parser.add_argument("--sensor", metavar="SENSOR", help="the sensor that recorded it; needed for a raw.bin")
    parser.add_argument(
        "--rate", type=positive, metavar="HZ", help="sample rate of a raw.bin, or of a table without times"
    )
    parser.add_argument("--closed", action="store_true", help="the hand ended where it began")
    parser.add_argument("--force", action="store_true", help="replace a demonstration of that name")
    add_lines(parser)
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Import and store."""
    from pbd.errors import RecordingError, TrackingError
    from pbd.files.demo import demo_folder
    from pbd.files.importers import import_file
    from pbd.paths import is_file, is_folder
    from pbd.tracking.agreement import warn_upside_down
    from pbd.tracking.conditioning import condition
    from pbd.tracking.rest import find_rest

    if is_folder(args.file):
        raise RecordingError(f"{args.file} is a folder: give a file", path=args.file)
    if not is_file(args.file):
        raise RecordingError(f"no file {args.file}; give the path of a recording", path=args.file)
    folder = demo_folder(args.name)
    if folder.resolve() in args.file.resolve().parents:
        raise RecordingError(f"{args.file} is in {folder}, which it would replace; give another name", path=args.file)
    if args.file.suffix.lower() == ".bin":
        demo = _decode(args)
    else:
        with working(f"reading {args.file}"):
            demo = import_file(args.file, dict(args.column), dict(args.unit), args.rate)
    # What can't be a recording (units, clock) is refused before it takes a name; where the hand stops is seen later.
    with suppress(TrackingError), working("checking it"):
        recording, _ = condition(demo.recording)
        rest = find_rest(recording)
        warn_upside_down(recording, rest.up_sensor, rest.start, rest.stop)
    if args.sensor:
        info = replace(demo.recording.info, sensor=args.sensor)
        demo = replace(demo, recording=replace(demo.recording, info=info))
    store_demonstration(args, replace(demo, closed=demo.closed or args.closed), "imported")
    return 0


def _decode(args: argparse.Namespace) -> Demonstration:
    """Decode bytes that `pbd record --raw` kept."""
    from pbd.errors import SensorError
    from pbd.record.redecode import decode_raw

    if not args.sensor:
        raise SensorError(f"{args.file} holds a sensor's raw bytes; name the sensor with --sensor", path=args.file)
    make = decoder_maker(args, args.sensor, [f"{quantity}={unit}" for quantity, unit in args.unit])
    with working(f"decoding {args.file}"):
        return decode_raw(args.file, make(), args.sensor, args.rate)


def _pair(text: str) -> tuple[str, str]:
    ours, equals, theirs = text.partition("=")
    if not (ours and equals and theirs):
        raise argparse.ArgumentTypeError(f"must be two words with = between them, got '{text}'")
    return ours, theirs
