"""pbd import FILE NAME."""

from __future__ import annotations

import argparse
from contextlib import suppress
from dataclasses import replace

from pbd.cli.console import say, working
from pbd.cli.steps import decoder_maker, store_demonstration
from pbd.data import Demonstration
from pbd.doors.atomic import is_file, is_folder
from pbd.errors import RecordingError, SensorError, TrackingError, listed
from pbd.files.demo import demo_folder
from pbd.files.importers import import_file
from pbd.record.redecode import decode_raw
from pbd.tracking.repair.conditioning import condition
from pbd.tracking.repair.gyro_consistency import warn_upside_down
from pbd.tracking.rest import find_rest


def run(args: argparse.Namespace) -> None:
    """Import and store."""
    if not is_file(args.file) and not is_folder(args.file):
        raise RecordingError(f"no file {args.file}; give the path of a recording", path=args.file)
    folder = demo_folder(args.name)
    if folder.resolve() in (args.file.resolve(), *args.file.resolve().parents):
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
    if args.grip:
        from pbd.tracking.taps import grip_by_taps

        taps = grip_by_taps(demo.recording)
        say(f"{len(taps)} pairs of taps found: {listed(f'{event.t:.1f} s' for event in taps)}")
        demo = replace(demo, recording=replace(demo.recording, grip=taps))
    if args.sensor:
        info = replace(demo.recording.info, sensor=args.sensor)
        demo = replace(demo, recording=replace(demo.recording, info=info))
    store_demonstration(args, replace(demo, closed=demo.closed or args.closed), "imported")


def _decode(args: argparse.Namespace) -> Demonstration:
    """Decode bytes that `pbd record --raw` kept."""
    if not args.sensor:
        raise SensorError(f"{args.file} holds a sensor's raw bytes; name the sensor with --sensor", path=args.file)
    make = decoder_maker(args, args.sensor, [f"{quantity}={unit}" for quantity, unit in args.unit])
    with working(f"decoding {args.file}"):
        return decode_raw(args.file, make(), args.sensor, args.rate)
