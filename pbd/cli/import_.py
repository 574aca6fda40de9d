"""pbd import FILE NAME."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from pbd.cli.options import Commands, add_command, add_json, print_json, say


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "import",
        "bring a recording of another program in",
        "Read a recording (a CSV with a header, x-io's CSV, an npz) and store it as a demonstration. Names and\n"
        "units are taken from the header where it tells them; elsewhere say which is which.",
        "  pbd import run7.csv tea --column ax=AccX --column ay=AccY --column az=AccZ --unit acc=g --unit t=ms",
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="the recording")
    parser.add_argument("name", metavar="NAME", help="the new demonstration's name (in ./demos) or folder")
    parser.add_argument(
        "--column",
        type=_pair,
        action="append",
        default=[],
        metavar="OURS=THEIRS",
        help="t, gx, gy, gz, ax, ay, az, mx, my, mz, heading, pitch or roll, and the file's name for it",
    )
    parser.add_argument(
        "--unit", type=_pair, action="append", default=[], metavar="WHAT=UNIT", help="of t, gyr, acc, mag or angle"
    )
    parser.add_argument("--sensor", metavar="S", help="what recorded it")
    parser.add_argument("--force", action="store_true", help="replace a demonstration of that name")
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Import and store."""
    from pbd.errors import RecordingError
    from pbd.files.demo import demo_folder, utc_now, write_demo
    from pbd.files.importers import import_file
    from pbd.tracking.conditioning import condition

    if not args.file.is_file():
        raise RecordingError(f"no file {args.file}; give the path of a recording", path=args.file)
    demo = import_file(args.file, dict(args.column), dict(args.unit))
    info = replace(demo.recording.info, created=utc_now(), sensor=args.sensor or demo.recording.info.sensor)
    recording = replace(demo.recording, info=info)
    condition(recording)  # what can't be tracked is refused here, before it takes a name
    folder = demo_folder(args.name)
    write_demo(replace(demo, recording=recording), folder, force=args.force)
    say(f"imported {len(recording)} samples, {recording.t[-1]:.1f} s at {recording.rate_hz:.0f} Hz, into {folder}")
    if args.json:
        print_json(
            {
                "demo": folder.name,
                "folder": str(folder),
                "samples": len(recording),
                "duration_s": float(recording.t[-1]),
                "rate_hz": recording.rate_hz,
            }
        )
    return 0


def _pair(text: str) -> tuple[str, str]:
    ours, equals, theirs = text.partition("=")
    if not (ours and equals and theirs):
        raise argparse.ArgumentTypeError(f"must be two words with = between them, got '{text}'")
    return ours, theirs
