"""pbd demos: the demonstrations in ./demos and the bundled ones."""

import argparse
from pathlib import Path
from typing import Any

from pbd.cli.common import print_result
from pbd.data import Demonstration
from pbd.errors import RecordingError, warn
from pbd.files.demo import UNDATED, load_demo, newest_demo
from pbd.files.find_by_name import names
from pbd.files.set_aside_demos import is_set_aside
from pbd.io.toml import instant_of
from pbd.view.terminal_tables import make_table


def run(args: argparse.Namespace) -> None:
    """List the demonstrations, the newest first; warn of those that can't be read."""
    found: list[Demonstration] = []
    for name in names("demos"):
        try:
            found.append(load_demo(name))
        except RecordingError as error:
            warn(str(error))
    default = newest_demo()
    rows = [_row(demo, demo.folder, default) for demo in found if demo.folder is not None]
    rows.sort(key=lambda row: (not row["bundled"], instant_of(row["created"] or UNDATED)), reverse=True)
    columns = ("name", "created", "sensor", f"lasts ({args.units.time})", "keyframes", "remarks")
    table = make_table(*columns, left=("name", "sensor", "keyframes", "remarks"))
    for row in rows:
        words = {"bundled": row["bundled"], "fused": row["takes"], "the default": row["default"]}
        words |= {"failed": row["failed"], "set aside": row["aside"]}
        edited = "edited" if row["edited"] else "automatic"
        lasts = args.units.times(row["duration_s"])
        table.add_row(
            row["name"],
            (row["created"] or "") if args.csv else (row["created"] or "")[:16].replace("T", " "),
            row["sensor"],
            *lasts,
            edited,
            ", ".join(word for word, holds in words.items() if holds),
        )
    print_result(args, {"demos": rows}, table)


def _row(demo: Demonstration, folder: Path, default: str) -> dict[str, Any]:
    """Return a demonstration's row of the JSON; `default`: the demonstration that commands use if none is named."""
    recording, info = demo.recording, demo.recording.info
    return {
        "name": folder.name,
        "folder": str(folder),
        "created": info.created,
        "sensor": info.sensor,
        "rate_hz": info.rate_hz or recording.rate_hz,
        "duration_s": float(recording.t[-1] - recording.t[0]),
        "edited": demo.keyframes is not None,
        "takes": len(demo.takes),
        "bundled": demo.bundled,
        "default": folder.name == default,
        "failed": demo.failed,
        "aside": is_set_aside(folder),
        "notes": demo.notes,
    }
