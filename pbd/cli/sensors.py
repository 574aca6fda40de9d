"""pbd sensors."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from pbd.cli.options import Commands, add_command, add_table, print_json
from pbd.cli.progress import listening

if TYPE_CHECKING:
    from pbd.sensors.probe import Found


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "sensors",
        "which sensors are plugged in, and which are supported",
        "List the serial ports with something plugged in, and the sensors that pbd supports. As CSV these are\n"
        "two tables, with an empty line between.",
        "  pbd sensors --probe",
    )
    parser.add_argument("--probe", action="store_true", help="listen to each port and detect its sensor")
    parser.add_argument("--port", metavar="P", help="this port only")
    add_table(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """List, and listen."""
    from pbd.errors import SensorError
    from pbd.sensors.port import PortInfo, list_ports, open_port
    from pbd.sensors.probe import FIRST_BAUD, LONGEST_S, probe
    from pbd.sensors.protocols import PROTOCOLS
    from pbd.view.tables import ports_table, print_csv, print_table, sensors_table

    ports = (PortInfo(args.port, "", ""),) if args.port else list_ports()
    rows: list[dict[str, str | int | None]] = []
    for port in ports:
        row: dict[str, str | int | None] = {"port": port.device, "title": port.title, "usb": port.usb}
        if args.probe:
            try:
                with open_port(port.device, FIRST_BAUD) as opened, listening(port.device, "listening to", LONGEST_S):
                    found = probe(opened)
            except SensorError as error:
                if args.port:
                    raise
                row |= {"sensor": None, "baud": None, "note": error.message}
            else:
                row |= {"sensor": found.sensor, "baud": found.baud or None, "note": _note(found)}
        rows.append(row)
    kinds = [{"sensor": name, "title": one.title, "gives": one.gives} for name, one in PROTOCOLS.items()]
    if args.json:
        print_json({"ports": rows, "sensors": kinds})
        return 0
    if args.csv:
        print_csv(ports_table(rows))
        print()
        print_csv(sensors_table(kinds))
        return 0
    if rows:
        print_table(ports_table(rows))
    else:
        print("no serial port has anything plugged in; try one without hardware: pbd record tea --sensor sim")
    print()
    print_table(sensors_table(kinds))
    return 0


def _note(found: Found) -> str:
    if found.sensor is not None:
        return ""
    if found.line is not None:
        return f"lines such as {found.line[:40]!r}: record --sensor lines --columns ..."
    return "bytes in no known protocol" if found.bytes_seen else "silent"
