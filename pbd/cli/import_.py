"""pbd import FILE NAME: store another program's recording as a demonstration."""

import argparse
from contextlib import suppress
from dataclasses import replace
from itertools import islice

from pbd.cli.common import decoder_maker, refuse_columns, store_demonstration
from pbd.cli.console import say, working
from pbd.data import Demonstration, Recording
from pbd.data.source_columns import SourceColumns
from pbd.errors import PbdError, RecordingError, SensorError, TrackingError, UsageError, amount, listed, warn
from pbd.files.demo import demo_folder, shell_word
from pbd.files.importers import import_file
from pbd.files.importers.columns import WHY_UNUSED
from pbd.io.atomic import exists
from pbd.pipeline import track
from pbd.record.redecode import decode_raw
from pbd.record.session_types import FEWEST_STOPS
from pbd.tracking.first_rest import find_rest
from pbd.tracking.repair.repair_recording import repair_recording
from pbd.tracking.taps import grip_by_taps

MOST_PRINTED = 200
"""Largest number of columns that aren't read that are printed: a few screens."""


def run(args: argparse.Namespace) -> None:
    """Import the file, store it as a demonstration, and print how its columns were understood."""
    folder = demo_folder(args.name)
    if not exists(args.file):
        raise RecordingError(f"no file {args.file}; give the path of a recording", path=args.file)
    if folder.resolve() in (args.file.resolve(), *args.file.resolve().parents):
        raise RecordingError(f"{args.file} is in {folder}, which it would replace; give another name", path=args.file)
    demo = _read(args)
    recording, source = demo.recording, demo.recording.info.source
    if recording.gyr is None:
        warn(
            "no gyro was found: attitude is then the device's own, which lags, or there is none; keyframes of a hand "
            "that turns are centimetres off. If the file has one, name it with --column gx=NAME --column gy=NAME "
            "--column gz=NAME"
        )
    try:
        with working("checking it"):
            recording = _checked(recording)
    except RecordingError:
        _print_columns(args, source)  # how they were read may be the cause
        raise
    if args.grip:
        taps = grip_by_taps(recording)
        none = "the grip stays open; `pbd keyframes --save` writes a file in which to say where it closes"
        at = listed(f"{event.t:.1f} s" for event in taps) if taps else none
        say(f"{amount(len(taps), 'pair')} of taps found: {at}")
        recording = replace(recording, grip=taps)
    if args.sensor:
        recording = replace(recording, info=replace(recording.info, sensor=args.sensor))
    demo = replace(demo, recording=recording, closed=demo.closed or args.closed)
    try:
        with working("tracking it"):
            stops = len(track(demo).stops)
        failure = "" if stops >= FEWEST_STOPS else "it has fewer than two stops, and a motion needs two"
    except PbdError as error:
        failure = error.message
    columns = [column.row() for column in source.columns]
    more = {"columns": columns, "unread": dict(source.unread)} if columns else {}
    store_demonstration(args, replace(demo, failed=bool(failure)), "imported", more)
    if failure:
        warn(f"stored, but not as a default demonstration: {failure}")
    _print_columns(args, source)
    if not failure and not args.json:
        print(f"stops after the first rest: {stops - 1}\nnext: pbd keyframes {shell_word(folder)}")


def _read(args: argparse.Namespace) -> Demonstration:
    """Read the file. Raw bytes, and lines without a header, are decoded as `pbd record` does."""
    if args.columns and not args.sensor:
        raise UsageError("--columns names the numbers of --sensor lines: add --sensor lines")
    if args.file.suffix.lower() != ".bin" and not args.columns:
        refuse_columns(args, "a file with a header")
        with working(f"reading {args.file}"):
            return import_file(args.file, dict(args.column), dict(args.unit), args.rate, args.topic)
    if args.column or args.topic is not None:
        instead = "turn or swap names in --columns itself, as ax,ay,-az" if args.columns else "leave them out"
        raise UsageError(f"--column is for a file with a header, and --topic for a bag; {instead}")
    if not args.sensor:
        raise SensorError(f"{args.file} holds a sensor's raw bytes; name the sensor with --sensor", path=args.file)
    make = decoder_maker(args, args.sensor)
    with working(f"decoding {args.file}"):
        return decode_raw(args.file, make(), args.sensor, args.rate)


def _checked(recording: Recording) -> Recording:
    """Refuse wrong units or a wrong clock before anything is stored. A TrackingError is left to the tracking command.

    Return the recording with its rate, which is that of evenly spaced times, where the file's come in batches.
    """
    with suppress(TrackingError):
        repaired, _ = repair_recording(recording)
        if recording.info.rate_hz is None:
            recording = replace(recording, info=replace(recording.info, rate_hz=repaired.rate_hz))
        find_rest(repaired)
    return recording


def _print_columns(args: argparse.Namespace, source: SourceColumns) -> None:
    if source.columns and not args.json:
        from pbd.view.terminal_tables import columns_table, print_table

        if source.program:
            print(f"written by {source.program}")
        unread = dict(source.unread)
        files = [name for name, why in unread.items() if why == WHY_UNUSED]
        if len(files) > 1:
            unread = {name: why for name, why in unread.items() if why != WHY_UNUSED}
            unread[f"{len(files)} files"] = "not used; --json names them"
        if len(unread) > MOST_PRINTED:
            more = f"{len(unread) - MOST_PRINTED} more"
            unread = {**dict(islice(unread.items(), MOST_PRINTED)), more: "not read; --json names them"}
        print_table(columns_table([column.row() for column in source.columns], unread))
