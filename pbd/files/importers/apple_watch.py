"""Recordings of an Apple Watch by Sensor Logger: WristMotion.csv in a zip, a folder, or alone.

Specific force, +g up, is gravity + acceleration, both with reversed sign and in g. With "Standardise Units & Frames"
they have Android's sign and are in m/s2.

Source: Sensor Logger's documentation (github.com/tszheichoi/awesome-sensor-logger: UNITS.md, COORDINATES.md).
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from pbd.data import GRAVITY, Recording
from pbd.data.source_columns import SourceColumns
from pbd.data.streams import Stream
from pbd.errors import RecordingError
from pbd.files.importers.app_files import columns_of, files_in_zip, joined_recording, sheet_of, unread_of
from pbd.files.importers.columns import UNUSED
from pbd.files.importers.phones import LOGGER, WRIST
from pbd.io.read_file import read_bytes

TIME = "seconds_elapsed"
AXES = tuple(f"{quantity}{axis}" for quantity in ("rotationRate", "gravity", "acceleration") for axis in "XYZ")


def read_watch(path: Path) -> Recording | None:
    """Read a watch's recording from a zip, a folder or its CSV file; None: there is none."""
    file = path if path.is_file() else path / f"{WRIST}.csv"
    if path.suffix.lower() == ".zip":
        files = files_in_zip(path)
    else:
        files = {file.stem: partial(read_bytes, file, RecordingError, "give another")} if file.is_file() else {}
    if WRIST not in files or not {*(sheet := sheet_of(path, WRIST, files[WRIST])).header} >= {TIME, *AXES}:
        return None
    rows = sheet.read((TIME, *AXES)).values
    turn, gravity, linear = np.split(rows[:, 1:], 3, axis=1)
    standard = bool(np.nanmedian(np.linalg.norm(gravity, axis=1)) > 0.5 * GRAVITY)
    sign, unit, scale = (1.0, "m/s2", 1.0) if standard else (-1.0, "g", -GRAVITY)
    streams = {"acc": Stream.of(rows[:, 0], scale * (gravity + linear)), "gyr": Stream.of(rows[:, 0], turn)}
    sums = [f"{its_gravity} + {its_rest}" for its_gravity, its_rest in zip(AXES[3:6], AXES[6:], strict=True)]
    columns = [
        *columns_of(LOGGER, (TIME, *sums), "acc", f"{WRIST}.csv", sign, unit),
        *columns_of(LOGGER, (TIME, *AXES[:3]), "gyr", f"{WRIST}.csv", 1.0, "rad/s"),
    ]
    unread = unread_of(f"{WRIST}.csv", sheet.header, (TIME, *AXES))
    unread |= {f"{name}.csv": UNUSED for name in sorted(files.keys() - {WRIST})}
    understood = SourceColumns(tuple(dict.fromkeys(columns)), unread, f"{LOGGER} (a watch)")
    return joined_recording(path, streams, "watch", understood)
