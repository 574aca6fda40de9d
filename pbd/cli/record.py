"""pbd record [NAME]."""

from __future__ import annotations

import argparse
import errno
import os
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from datetime import datetime
from typing import TYPE_CHECKING

from pbd.cli.options import Commands, add_command, add_json, positive, print_json
from pbd.cli.progress import listening
from pbd.cli.wire import add_lines, decoder_maker

if TYPE_CHECKING:
    from pathlib import Path

    from pbd.cli.recording_screen import PanelScreen, PlainScreen
    from pbd.cli.recording_simulated import Poll, Show, SimulatedHand
    from pbd.data import SensorErrors
    from pbd.record import Outcome
    from pbd.sensors.decoding import Decoder
    from pbd.sensors.port import Port
    from pbd.view.live_view import LiveView

SIMULATED = "sim"


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "record",
        "record a demonstration from a sensor",
        "Record to ./demos/NAME, sample by sample. Hold still for two seconds, then move, stop, move, stop.\n"
        "At a terminal: Enter ends the recording, space marks that the grip closes or opens, q discards it\n"
        "(after a question), Ctrl-C ends and keeps it as Enter does.\n"
        "`--sensor sim` simulates a hand that does a TASK (pour) and grips by itself.",
        "  pbd record tea --sensor witmotion\n"
        "  pbd record tea --sensor sim:pour           without hardware: a simulated hand that pours\n"
        "  pbd record tea --live                      and see the hand, its path and its stops in the browser\n"
        '  pbd record tea --sensor lines --columns "t,ax,ay,az,gx,gy,gz" --unit t=ms --unit acc=g --unit gyr=deg/s',
    )
    parser.add_argument("name", nargs="?", metavar="NAME", help="name in ./demos; default: the date and the time")
    parser.add_argument(
        "--sensor", metavar="SENSOR", help="protocol (`pbd sensors` lists them), or sim[:TASK]; default: detect it"
    )
    parser.add_argument("--port", metavar="P", help="the serial port; default: the only one with something plugged in")
    parser.add_argument("--baud", type=int, metavar="B", help="default: try the sensor's usual rates")
    parser.add_argument("--rate", type=positive, metavar="HZ", help="first set the device's rate, where it can be set")
    parser.add_argument("--duration", type=positive, metavar="S", help="end after this many seconds")
    parser.add_argument(
        "--tolerance", type=positive, default=1.0, metavar="CM", help="uncertainty of a move that calls 'pause now' (1)"
    )
    parser.add_argument("--closed", action="store_true", help="the hand will end where it began; tracking uses that")
    parser.add_argument("--raw", action="store_true", help="also keep the sensor's raw bytes (raw.bin)")
    parser.add_argument("--reconnect", action="store_true", help="wait for a sensor that was unplugged")
    parser.add_argument(
        "--calibration", metavar="C", help="of this sensor: used to track, and compared with the sensor at rest"
    )
    parser.add_argument(
        "--force",
        action="store_true",
        help="replace a demonstration of that name: the old one is in NAME.before until the new one has ended well, "
        "with two stops or more",
    )
    parser.add_argument("--live", action="store_true", help="show the hand in the browser, served on this machine only")
    parser.add_argument("--no-open", action="store_true", help="with --live: open no browser; print the address")
    add_lines(parser).add_argument(
        "--unit", action="append", default=[], metavar="Q=U", help="unit of acc, gyr, mag, angle or t, such as acc=g"
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Record, and say how it went."""
    from pbd.cli.keys import Keys, Person
    from pbd.cli.recording_screen import PanelScreen, PlainScreen
    from pbd.files.demo import demo_folder, may_be_written, utc_now
    from pbd.record import RecordOptions, record
    from pbd.record.loop import SHOWN_S

    name = args.name or datetime.now().strftime("demo-%m%d-%H%M%S")
    folder = demo_folder(name)
    if args.sensor is not None and args.sensor.partition(":")[0] != SIMULATED:
        decoder_maker(args, args.sensor, args.unit, also=(SIMULATED,))  # what is misspelt is told before what is taken
    may_be_written(folder, args.force)
    with ExitStack() as stack:
        view = stack.enter_context(_live_view()) if args.live else None
        hand = _simulated(args, stack)
        sensor, opened, decoder = _sensor(args) if hand is None else (hand.name, hand.open, hand.decoder())
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
            errors=_errors(args.calibration, sensor),
        )
        keys = stack.enter_context(Keys())
        title = f"recording {folder} from {sensor}"
        screen: PanelScreen | PlainScreen
        if keys.terminal and sys.stderr.isatty():
            screen = PanelScreen(title, options.tolerance_m)
        else:
            screen = PlainScreen(title)
        poll: Poll = Person(keys, screen)
        show: Show = screen.show
        every_s, live = SHOWN_S, None
        if view is not None:
            from pbd.cli.recording_live import SHOWN_S as LIVE_SHOWN_S
            from pbd.cli.recording_live import LiveScreen

            view.open(name, sensor, not args.no_open)
            live = LiveScreen(view, screen.show, options.tolerance_m)
            show, every_s = live.show, LIVE_SHOWN_S
        if hand is not None:
            poll, show = hand.beside(poll, show, keys.terminal, args.duration)
        with screen:
            outcome = record(opened, decoder, options, poll, show, every_s)
        if hand is not None:
            outcome = hand.outcome(outcome)
        if live is not None:
            live.end(outcome)
    try:
        _report(args, outcome)
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as reason:  # the terminal was hung up; what counts is done
        if reason.errno != errno.EIO:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _errors(name: str | None, sensor: str) -> SensorErrors | None:
    """The errors of this sensor by a calibration."""
    import warnings

    from pbd.calibration.sensor import refuse_other_sensor
    from pbd.errors import PbdWarning
    from pbd.files.calibration import load_calibration

    if name is None:
        return None
    errors = load_calibration(name).sensor
    if errors is None:
        warnings.warn(
            f"the calibration '{name}' has no [sensor] to compare with; pbd calibrate sensor {name} DEMO makes one",
            PbdWarning,
            stacklevel=2,
        )
        return None
    refuse_other_sensor("this recording", sensor, errors)
    return errors


def _live_view() -> LiveView:
    from pbd.view.live_view import LiveView

    return LiveView()


def _simulated(args: argparse.Namespace, stack: ExitStack) -> SimulatedHand | None:
    """The hand of --sensor sim[:TASK]."""
    from pbd.errors import SensorError

    kind, _, task = (args.sensor or "").partition(":")
    if kind != SIMULATED:
        return None
    if args.port or args.baud or args.rate:
        raise SensorError("a simulated sensor has no port, baud or rate to choose; leave out --port, --baud, --rate")
    from pbd.cli.recording_simulated import simulated_hand

    return simulated_hand(task, stack)


def _sensor(args: argparse.Namespace) -> tuple[str, Callable[[], Port], Decoder]:
    """The sensor's name, what opens its port, and its decoder."""
    from pbd.sensors.port import open_port
    from pbd.sensors.probe import BOOT_S, LISTEN_S, find_baud
    from pbd.sensors.protocols import PROTOCOLS

    wanted: str | None = args.sensor
    make = None if wanted is None else decoder_maker(args, wanted, args.unit)  # before anything is opened
    device, baud = args.port or _only_port(), args.baud
    if wanted is None:
        wanted, heard_at = _listened(device)
        baud = baud or heard_at
    make = make or decoder_maker(args, wanted, args.unit)
    if baud is None:
        bauds = PROTOCOLS[wanted].bauds
        longest_s = BOOT_S + 2.0 * LISTEN_S * len(bauds)
        with open_port(device, bauds[0]) as port, listening(device, "looking for the baud rate of", longest_s):
            baud = find_baud(port, make, wanted)
    if args.rate is not None:
        _set_rate(device, baud, wanted, args.rate)
    return wanted, lambda: open_port(device, baud), make()


def _listened(device: str) -> tuple[str, int]:
    """Which sensor speaks on a port, and at which baud rate."""
    from pbd.errors import SensorError
    from pbd.sensors.port import open_port
    from pbd.sensors.probe import FIRST_BAUD, LONGEST_S, probe

    with open_port(device, FIRST_BAUD) as port, listening(device, "listening to", LONGEST_S):
        found = probe(port)
    if found.sensor is not None:
        return found.sensor, found.baud
    if not found.bytes_seen:
        why = "it is silent at every baud rate; check that the sensor is on and sends by itself"
    elif found.line is not None:
        why = f'it prints lines such as {found.line!r}; give --sensor lines --columns "..." --baud {found.baud}'
    else:
        why = f"{found.bytes_seen} bytes came in no known protocol; give --sensor and --baud"
    raise SensorError(f"the protocol of {device} is not recognised: {why}", path=device)


def _only_port() -> str:
    from pbd.errors import SensorError
    from pbd.sensors.port import list_ports

    ports = [port for port in list_ports() if port.usb]  # a board's own ttyS0 is always there
    if len(ports) == 1:
        return ports[0].device
    if not ports:
        raise SensorError(
            "no USB serial port has anything plugged in; plug the sensor in, name its --port, or try --sensor sim"
        )
    raise SensorError(f"several ports have something plugged in ({', '.join(p.device for p in ports)}); name a --port")


def _set_rate(device: str, baud: int, sensor: str, rate_hz: float) -> None:
    from pbd.sensors.port import open_port
    from pbd.sensors.protocols import COMMAND_PAUSE_S, protocol

    commands = protocol(sensor).commands_for(rate_hz)
    with open_port(device, baud) as port:
        for command in commands:
            port.write(command)
            time.sleep(COMMAND_PAUSE_S)


def _report(args: argparse.Namespace, outcome: Outcome) -> None:
    from pbd.record.told import FEWEST_STOPS

    folder = None if outcome.folder is None else str(outcome.folder)
    if outcome.before:
        with suppress(OSError):  # nobody reads it any more
            print(outcome.before, file=sys.stderr)
    if args.json:
        print_json(
            {
                "demo": folder,
                "samples": outcome.samples,
                "duration_s": outcome.duration_s,
                "lost": outcome.lost,
                "bad_packets": outcome.bad_packets,
                "stops": outcome.stops,
                "ended_by": outcome.ended_by,
            }
        )
    elif outcome.folder is None:
        print("discarded", file=sys.stderr)
    else:
        bad = f", {outcome.bad_packets} bad packets" if outcome.bad_packets else ""
        print(
            f"{folder}: {outcome.duration_s:.1f} s, {outcome.samples} samples, {outcome.lost} lost{bad}, "
            f"stops after the first rest: {max(outcome.stops - 1, 0)}; ended: {outcome.ended_by}"
        )
        if outcome.stops < FEWEST_STOPS:
            print("fewer than two stops: nothing to replay; hold still for two seconds, then move, stop, move, stop")
        else:
            print(f"next: pbd keyframes {_word(outcome.folder)}")


def _word(folder: Path) -> str:
    """A demonstration as a shell takes it: by its name in ./demos, else by its path."""
    import shlex
    from pathlib import Path

    word = folder.name if folder.parent == Path("demos") else str(folder)
    return shlex.quote(f"./{folder}" if word[0] in "-~" else word)
