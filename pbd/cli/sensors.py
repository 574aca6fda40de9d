"""pbd sensors: what is plugged in and what is supported; pbd sensors phyphox: the experiment for a phone."""

import argparse
import io
import shutil
import struct
import sys
import zlib
from pathlib import Path
from typing import Any

from pbd.cli.console import print_json, say
from pbd.cli.recording.device import probe_port
from pbd.errors import SensorError, UsageError
from pbd.io.atomic import atomic_file, refuse_output
from pbd.io.made_by_pbd import PICTURE_MADE_BY
from pbd.sensors import port as serial_port
from pbd.sensors.phyphox.experiment import EXPERIMENT_FILE, MAX_QR_CODES, experiment, qr_payloads
from pbd.sensors.probe import ProbeResult, quote_line
from pbd.sensors.protocols import PROTOCOLS
from pbd.view.terminal import for_rich
from pbd.view.terminal_tables import ports_table, print_csv, print_table, words_table


def run(args: argparse.Namespace) -> None:
    """List the ports and the supported sensors, with --probe listen to the ports; or prepare a phone."""
    if args.phone:
        return _prepare_phone(args)
    if args.output is not None:
        raise UsageError("-o is for a phone: pbd sensors phyphox -o FILE")
    if args.port and not args.probe:
        raise UsageError("--port is the port to listen to: add --probe")
    ports = (serial_port.PortInfo(args.port, "", ""),) if args.port else serial_port.list_ports()
    rows: list[dict[str, str | int | None]] = []
    for port in ports:
        row: dict[str, str | int | None] = {"port": port.device, "title": port.title, "usb": port.usb}
        if args.probe:
            try:
                found = probe_port(port.device)
            except SensorError as error:
                if args.port:
                    raise
                row |= {"sensor": None, "baud": None, "note": error.message}
            else:
                row |= {"sensor": found.sensor, "baud": found.baud or None, "note": _note(found)}
        rows.append(row)
    kinds = [{"sensor": name, "title": one.title, "gives": one.gives} for name, one in PROTOCOLS.items()]
    if args.json:
        return print_json({"ports": rows, "sensors": kinds})
    show = print_csv if args.csv else print_table
    if rows or args.csv:
        show(ports_table(rows))
    else:
        print("no serial port has anything plugged in; try one without hardware: pbd record tea --sensor sim")
    print()
    return show(words_table(("--sensor", "device", "gives"), (kind.values() for kind in kinds)))


def _note(found: ProbeResult) -> str:
    """Say what was heard on a port if no sensor was recognised; "" if one was."""
    if found.sensor is not None:
        return ""
    if found.line is not None:
        return f'lines such as {quote_line(found.line)}: pbd record --sensor lines --columns "..."'
    return "bytes in no known protocol" if found.bytes_seen else "silent"


def _prepare_phone(args: argparse.Namespace) -> None:
    """Write the experiment, or a picture of its QR code; at a terminal also show the codes."""
    if args.probe or args.port or args.csv:
        raise UsageError("--probe, --port and --csv are for sensors on a cable: pbd sensors")
    file: Path = args.output or Path(EXPERIMENT_FILE)
    kind = file.suffix.lower().lstrip(".")
    if kind not in ("phyphox", "png", "svg"):
        raise SensorError(f"{file} can't be written as '{kind}'; give a .phyphox, .png or .svg", path=file)
    refuse_output(file)
    with atomic_file(file) as there:
        if kind == "phyphox":
            there.write_text(experiment(), encoding="utf-8")
        else:
            (data,) = qr_payloads(1)
            _draw_code(_qr_code(data), kind, there)
    if args.json:
        return print_json({"file": str(file)})
    shown = sys.stdout.isatty() and kind == "phyphox"
    if shown:
        _show_codes()
    if kind != "phyphox":
        message = f"{file} is written: show it on a screen or on paper for the phone to scan"
    elif shown:
        message = f"{file} is written, for a phone that can't scan: send it there, and open it with phyphox"
    else:
        message = f"{file} is written; a terminal shows the code to scan, -o code.png makes a picture of it"
    scanned = shown or kind != "phyphox"
    scan = 'in phyphox: + (below right), "add experiment from QR code", and scan the code'
    print(f"1. {scan if scanned else f'send {file} to the phone, and open it there with phyphox'}")
    print('2. open the experiment "pbd"; in its menu (three dots) switch "allow remote access" on; it shows an address')
    print("3. pbd record tea --sensor phyphox --port http://ADDRESS")
    return say(message)


def _qr_code(data: bytes) -> Any:
    import segno

    return segno.make_qr(data, mode="byte", error="l", boost_error=False)


def _draw_code(code: Any, kind: str, file: Path) -> None:
    """Write a picture of a code, which says that pbd made it, as `refuse_others_file` wants."""
    made_by = f"{PICTURE_MADE_BY}segno"
    if kind == "svg":
        code.save(str(file), kind=kind, scale=6, title=made_by)
        return
    drawn, text = io.BytesIO(), b"tEXtSoftware\0" + made_by.encode()
    code.save(drawn, kind=kind, scale=6)
    png, chunk = drawn.getvalue(), struct.pack(f">I{len(text)}sI", len(text) - 4, text, zlib.crc32(text))
    file.write_bytes(png[:33] + chunk + png[33:])  # after the signature and the header


def _show_codes() -> None:
    """Show the experiment as QR codes, one at a time: as few as fit the terminal's size."""
    columns, lines = shutil.get_terminal_size()
    border = 2  # light modules; the standard says four, but the app reads two, and a terminal is small
    for count in range(1, MAX_QR_CODES + 1):
        codes = [_qr_code(part) for part in qr_payloads(count)]
        width = max(code.symbol_size(border=border)[0] for code in codes)
        if width <= columns and (width + 1) // 2 + 2 <= lines:
            break
    else:
        raise SensorError(
            f"a terminal of {columns} x {lines} is too small for a code; make it larger, or give -o pbd.png"
        )
    for k, code in enumerate(codes):
        drawn = io.StringIO()
        code.terminal(drawn, border=border, compact=True)
        # White on black, as the characters are the light modules, and a terminal's own colours may be reversed.
        rows = (f"\033[97;40m{line}\033[0m" for line in drawn.getvalue().splitlines())
        print("\n".join(rows), file=for_rich(sys.stdout))
        if count > 1:
            print(f"code {k + 1} of {count}: scan it, then press Enter", flush=True)
            sys.stdin.readline()
