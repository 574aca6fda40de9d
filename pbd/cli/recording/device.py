"""Finds the sensor for `pbd record`: its port, baud rate and decoder."""

import argparse
import time
from collections.abc import Callable

from pbd.cli.common import decoder_maker
from pbd.cli.console import working
from pbd.errors import SensorError, UsageError, amount
from pbd.sensors import port as serial_port
from pbd.sensors.decoding import Decoder
from pbd.sensors.port import open_port
from pbd.sensors.probe import BOOT_S, FIRST_BAUD, LISTEN_S, LONGEST_PROBE_S, ProbeResult, find_baud, probe, quote_line
from pbd.sensors.protocols import COMMAND_PAUSE_S, PROTOCOLS, protocol
from pbd.sensors.reader import ByteSource

PHONE, GAMEPAD = "phyphox", "gamepad"


def find_sensor(args: argparse.Namespace) -> tuple[str, Callable[[], ByteSource], Decoder]:
    """Return the sensor's name, a function that opens its port, and its decoder.

    Raises:
        SensorError: no sensor or several are plugged in, or the protocol is not recognised.
    """
    wanted: str | None = args.sensor
    if wanted == PHONE or "://" in (args.port or ""):
        return _phone(args)
    if wanted == GAMEPAD:
        if args.baud or args.rate:
            raise UsageError("a gamepad has no baud or rate to choose; leave out --baud, --rate")
        from pbd.sensors.gamepad_port import open_gamepad

        return wanted, lambda: open_gamepad(args.port), protocol(GAMEPAD).decoder()
    device, baud = args.port or only_port(), args.baud
    if wanted is None:
        wanted, heard_at = _detect(device)
        baud = baud or heard_at
    make = decoder_maker(args, wanted)
    if baud is None:
        bauds = PROTOCOLS[wanted].bauds
        longest_s = BOOT_S + 2.0 * LISTEN_S * len(bauds)
        with open_port(device, bauds[0]) as port, working(f"looking for the baud rate of {device}", longest_s):
            baud = find_baud(port, make, wanted)
    if args.rate is not None:
        commands = protocol(wanted).commands_for(args.rate)
        with open_port(device, baud) as port:
            for command in commands:
                port.write(command)
                time.sleep(COMMAND_PAUSE_S)
    # A sensor that is plugged in again may have another name.
    return wanted, lambda: open_port(args.port or only_port(), baud), make()


def _phone(args: argparse.Namespace) -> tuple[str, Callable[[], ByteSource], Decoder]:
    """Find a phone, as `find_sensor` does. Its model is in the name, by which a calibration knows it."""
    decoder = decoder_maker(args, PHONE)
    if args.sensor not in (PHONE, None):
        raise UsageError(f"{args.sensor} has a serial port; for a phone give --sensor {PHONE}", value=args.sensor)
    if args.port is None:
        raise UsageError(
            f"where is the phone? give --port http://ADDRESS:8080 as {PHONE} shows it, once remote access is allowed"
        )
    if args.baud or args.rate:
        raise UsageError("a phone has no baud or rate to choose; leave out --baud and --rate")
    from pbd.sensors.phyphox.phone import PhonePort

    phone = PhonePort(args.port)
    return (f"{PHONE} ({phone.model})" if phone.model else PHONE), phone.connect, decoder()


def probe_port(device: str) -> ProbeResult:
    """Listen on a port to detect its sensor and baud rate."""
    with open_port(device, FIRST_BAUD) as port, working(f"listening to {device}", LONGEST_PROBE_S):
        return probe(port)


def _detect(device: str) -> tuple[str, int]:
    """Detect the sensor on a port and its baud rate; SensorError if the protocol is not recognised."""
    found = probe_port(device)
    if found.sensor is not None:
        return found.sensor, found.baud
    if not found.bytes_seen:
        why = "it is silent at every baud rate; check that the sensor is on and sends by itself"
    elif found.line is not None:
        lines = f"it prints lines such as {quote_line(found.line)}"
        why = f'{lines}; give --sensor lines --columns "..." --baud {found.baud}'
    else:
        why = f"{amount(found.bytes_seen, 'byte')} came in no known protocol; give --sensor and --baud"
    raise SensorError(f"the protocol of {device} is not recognised: {why}", path=device)


def only_port(what: str = "sensor", instead: str = ", or try --sensor sim") -> str:
    """Return the only USB serial port; SensorError if there is none or several; it names the device `what`."""
    ports = [port for port in serial_port.list_ports() if port.usb]  # the built-in ttyS0 is always there
    if len(ports) == 1:
        return ports[0].device
    if not ports:
        port = f"name its --port{instead}" if instead else "or name its --port"
        raise SensorError(f"no USB serial port has anything plugged in; plug the {what} in, {port}")
    raise SensorError(f"several ports have something plugged in ({', '.join(p.device for p in ports)}); name a --port")
