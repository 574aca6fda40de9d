"""pbd record [NAME]: record a demonstration from a sensor, or from a simulated hand."""

import argparse
import errno
import shlex
import sys
from contextlib import ExitStack, closing, nullcontext, suppress
from datetime import datetime
from pathlib import Path

from pbd.calibration.sensor import refuse_other_sensor
from pbd.cli.common import decoder_maker, refuse_columns, say_if_hiding_bundled
from pbd.cli.console import print_json, say
from pbd.cli.recording.device import find_sensor
from pbd.cli.recording.keys import KeyboardCommands, Keys
from pbd.cli.recording.screen import PanelScreen, PlainScreen
from pbd.cli.recording.simulated import Show, simulated_hand
from pbd.data import SensorErrors
from pbd.data.streams import RATE_TOLERANCE
from pbd.errors import RecordingError, UsageError, amount, warn
from pbd.files.calibration import load_calibration
from pbd.files.demo import demo_folder, read_demo_toml, refuse_demo_folder, shell_word
from pbd.io.toml import utc_now
from pbd.record import Outcome, RecordOptions, record
from pbd.record.loop import SCREEN_EVERY_S, Poll
from pbd.record.session_types import TOO_FEW_STOPS
from pbd.tracking.repair.clock import FASTEST_HZ
from pbd.view.terminal import discard_rest

SIMULATED = "sim"

KEPT = (
    *("sensor", "port", "baud", "rate", "columns", "separator", "prefix", "wrap", "calibration"),
    *("duration", "tolerance", "grip", "closed", "raw", "reconnect", "live"),
)
"""Options, besides --unit, that the advised command of the next take repeats."""

HOLDS = (
    "hold the sensor as you like, and remember how",
    "turn the sensor by a quarter about the vertical, as it lies at the dock",
    "turn the sensor by a quarter about a level axis, so that another side of it is up at the dock",
    "turn the sensor by another quarter about the vertical",
)
"""How to hold the sensor in takes 1, 2, 3 and 4. Later takes repeat 2, 3 and 4."""


def run(args: argparse.Namespace) -> None:
    """Record, and report the result."""
    name = args.name or datetime.now().strftime("demo-%m%d-%H%M%S")
    if args.take is not None:
        if args.name is None:
            raise UsageError("--take needs the task's NAME: pbd record tea --take 2")
        name = f"{name}{args.take}"
    folder = demo_folder(name)
    kind, _, task = (args.sensor or "").partition(":")
    if kind == SIMULATED:
        if args.port or args.baud or args.rate or args.unit:
            what = "a simulated sensor has no port, baud, rate or unit to choose"
            raise UsageError(f"{what}; leave out --port, --baud, --rate, --unit")
        refuse_columns(args, kind)
    elif kind:
        decoder_maker(args, args.sensor, also=(SIMULATED,))  # an unknown sensor is reported before anything else
    refuse_demo_folder(folder, args.force)
    say_if_hiding_bundled(folder)
    if args.take is not None:
        say(how_to_hold(args.take))
    with ExitStack() as stack:
        view = None
        if args.live:
            from pbd.view.live_view import LiveView

            view = stack.enter_context(closing(LiveView()))
        hand = simulated_hand(task, stack) if kind == SIMULATED else None
        sensor, opened, decoder = find_sensor(args) if hand is None else (hand.name, hand.open, hand.decoder())
        options = RecordOptions(
            folder=folder,
            sensor=sensor,
            created=utc_now(),
            duration_s=args.duration,
            tolerance_m=args.tolerance / 100.0,
            closed=args.closed,
            raw=args.raw,
            reconnect=args.reconnect,
            force=args.force,
            taps=args.grip == "tap",
            errors=_errors(args.calibration, sensor),
        )
        keys = stack.enter_context(Keys())
        title = f"recording {folder} from {sensor}"
        panel = PanelScreen(title, options.tolerance_m) if keys.terminal and sys.stderr.isatty() else None
        screen = panel or PlainScreen(title)
        poll: Poll = KeyboardCommands(keys, screen.ask)
        show: Show = screen.show
        every_s, live = SCREEN_EVERY_S, None
        if view is not None:
            from pbd.cli.recording.live import LiveScreen

            view.open(name, sensor, args.open)
            live = LiveScreen(view, screen.show, options.tolerance_m)
            show, every_s = live.show, 0.05
        if hand is not None:
            poll, show = hand.combine(poll, show, keys.terminal, args.duration)
        with panel or nullcontext():
            outcome = record(opened, decoder, options, poll, show, every_s)
        if live is not None:
            live.end(outcome)
    try:
        _report(args, outcome)
        sys.stdout.flush()
    except OSError as reason:  # the terminal was closed; the recording is on disk
        if reason.errno != errno.EIO:
            raise
        discard_rest(sys.stdout)


def _errors(name: str | None, sensor: str) -> SensorErrors | None:
    """Load the sensor's errors from the calibration of this name; refuse those of another sensor."""
    errors = None if name is None else load_calibration(name).sensor
    if errors is not None:
        refuse_other_sensor("this recording", sensor, errors)
    elif name is not None:
        make = f"pbd calibrate sensor {shlex.quote(name)} DEMO makes one"
        warn(f"the calibration '{name}' has no [sensor] to compare with; {make}")
    return errors


def _report(args: argparse.Namespace, outcome: Outcome) -> None:
    """Print the result, as JSON or in words with the next command."""
    if outcome.backup_note:
        with suppress(OSError):  # the terminal is closed
            print(outcome.backup_note, file=sys.stderr)
    sent_hz = (outcome.samples + outcome.lost) / max(outcome.duration_s, 1.0 / FASTEST_HZ)
    if args.rate is not None and abs(sent_hz / args.rate - 1.0) > RATE_TOLERANCE:
        warn(
            f"the sensor sends {sent_hz:.3g} samples a second, not the {args.rate:g} of --rate: it does not take that "
            "command, or its baud rate is too low for them"
        )
    folder = None if outcome.folder is None else str(outcome.folder)
    if args.json:
        figures = ("samples", "duration_s", "lost", "bad_packets", "stops", "ended_by")
        counts = {name: getattr(outcome, name) for name in figures}
        print_json({"demo": folder, **counts, "failed": bool(outcome.why_failed), "why": outcome.why_failed or None})
    elif outcome.folder is None:
        print("discarded", file=sys.stderr)
    else:
        bad = f", {outcome.bad_packets} bad packets" if outcome.bad_packets else ""
        bad += f" (the last: {outcome.why_bad.partition(';')[0]})" if outcome.why_bad else ""
        print(
            f"{folder}: {outcome.duration_s:.1f} s, {amount(outcome.samples, 'sample')}, {outcome.lost} lost{bad}, "
            f"stops after the first rest: {max(outcome.stops - 1, 0)}; ended: {outcome.ended_by}"
        )
        if outcome.why_failed == TOO_FEW_STOPS:
            print(TOO_FEW_STOPS)
        elif outcome.why_failed:
            warn(f"{outcome.folder / 'imu.csv'}: {outcome.why_failed}")
        else:
            print(f"next: {_next_command(args, outcome.folder)}")


def how_to_hold(take: int) -> str:
    """Say how to hold the sensor in take 1, 2, ..., and why."""
    how = HOLDS[(take - 1) % len(HOLDS)] if take <= len(HOLDS) else HOLDS[1 + (take - 2) % (len(HOLDS) - 1)]
    why = ": its own errors then point elsewhere in each take, and fusing tells them from the motion"
    return f"take {take}: {how}{'' if take == 1 else why}; the hand starts and moves as before"


def _next_command(args: argparse.Namespace, folder: Path) -> str:
    """Return the command that follows a recording; after a take, the next take, or `pbd fuse`."""
    if args.take is None:
        return f"pbd keyframes {shell_word(folder)}"
    given = [(name, getattr(args, name)) for name in KEPT if getattr(args, name) != args.parser.get_default(name)]
    given += [("unit", f"{kind}={unit}") for kind, unit in args.unit]
    again = "".join(f" --{name}" if value is True else f" --{name} {shlex.quote(str(value))}" for name, value in given)
    more = f"pbd record {shlex.quote(args.name)} --take {args.take + 1}{again}"
    folders = (folder.with_name(f"{Path(args.name).name}{take}") for take in range(1, args.take + 1))
    takes = [shell_word(take) for take in folders if _can_be_fused(take)]
    return more if len(takes) < 2 else f"{more}; or pbd fuse {' '.join(takes)} -o {shlex.quote(args.name)}"


def _can_be_fused(folder: Path) -> bool:
    """Say whether there is a recording that did not fail."""
    with suppress(RecordingError):
        return not read_demo_toml(folder)[2]["failed"]
    return False
