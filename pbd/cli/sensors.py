"""pbd sensors."""

from __future__ import annotations

import argparse

from pbd.cli.console import print_json
from pbd.cli.recording.device import probed
from pbd.errors import SensorError
from pbd.sensors import port as serial_port
from pbd.sensors.probe import Found
from pbd.sensors.protocols import PROTOCOLS
from pbd.view.terminal_tables import ports_table, print_csv, print_table, words_table


def run(args: argparse.Namespace) -> None:
    """List, and listen; or prepare a phone."""
    if args.phone:
        from pbd.cli.recording.phone import prepare

        prepare(args)
        return None
    ports = (serial_port.PortInfo(args.port, "", ""),) if args.port else serial_port.list_ports()
    rows: list[dict[str, str | int | None]] = []
    for port in ports:
        row: dict[str, str | int | None] = {"port": port.device, "title": port.title, "usb": port.usb}
        if args.probe:
            try:
                found = probed(port.device)
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


def _note(found: Found) -> str:
    if found.sensor is not None:
        return ""
    if found.line is not None:
        return f"lines such as {found.line[:40]!r}: record --sensor lines --columns ..."
    return "bytes in no known protocol" if found.bytes_seen else "silent"
