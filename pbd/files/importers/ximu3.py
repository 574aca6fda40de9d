"""The folder of an x-IMU3: x-io's x-IMU3 GUI writes a file for each type of message, all with the device's time.

Inertial.csv, with accelerometer and gyro, is read as a table, and Magnetometer.csv is joined.
"""

from collections.abc import Mapping
from pathlib import Path

from pbd.data.source_columns import CHANNELS, SourceColumns
from pbd.data.streams import Stream
from pbd.files.importers.columns import WHY_UNUSED, scaled, understand
from pbd.files.table import open_sheet

INERTIAL, MAGNETOMETER = "Inertial.csv", "Magnetometer.csv"


def inertial_file(path: Path) -> Path:
    """Return the Inertial.csv of an x-IMU3's folder, or of its Magnetometer.csv; of anything else the path itself."""
    folder = path.parent if path.name == MAGNETOMETER else path
    return folder / INERTIAL if (folder / INERTIAL).is_file() else path


def magnetometer_beside(
    path: Path, found: SourceColumns, units: Mapping[str, str]
) -> tuple[SourceColumns, Stream | None]:
    """Read Magnetometer.csv beside Inertial.csv, unless that has a magnetometer. List the other files as unused."""
    if path.name != INERTIAL:
        return found, None
    stream, beside = None, path.with_name(MAGNETOMETER)
    if beside.is_file() and not found.of("mag"):
        sheet = open_sheet(beside, foreign=True)
        other = understand(sheet, {}, units)
        if other.of("t") and len(other.of("mag")) == len(CHANNELS["mag"]):
            table = sheet.read([column.name for column in other.columns])
            stream = Stream.of(scaled(table, other, "t")[:, 0], scaled(table, other, "mag"))
            found = found.with_file(beside.name, other)
    others = {file.name for file in path.parent.glob("*.csv")} - {path.name, *((beside.name,) if stream else ())}
    return found.with_unread(dict.fromkeys(sorted(others), WHY_UNUSED)), stream
