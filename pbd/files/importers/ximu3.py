"""The folder of an x-IMU3: x-io's x-IMU3 GUI writes a file for each type of message, all with the device's time.

Inertial.csv, with accelerometer and gyro, is read as a table, and Magnetometer.csv is joined.
"""

from collections.abc import Mapping
from pathlib import Path

from pbd.data.source_columns import CHANNELS, SourceColumns
from pbd.data.streams import Stream
from pbd.files.importers.columns import scaled, understand, unused
from pbd.files.importers.csv_bundle import Files, files_of, sheet_of

INERTIAL, MAGNETOMETER = "Inertial.csv", "Magnetometer.csv"


def inertial_file(path: Path) -> Path:
    """Return the Inertial.csv of an x-IMU3's folder, or of its Magnetometer.csv; of anything else the path itself."""
    folder = path.parent if path.name == MAGNETOMETER else path
    return folder / INERTIAL if (folder / INERTIAL).is_file() else path


def files_of_ximu3(path: Path) -> Files:
    """List the files of an x-IMU3's zip, or those beside its Inertial.csv; none for any other path."""
    files = files_of(path) if path.name == INERTIAL or path.suffix.lower() == ".zip" else {}
    return files if Path(INERTIAL).stem in files else {}


def magnetometer_beside(
    path: Path, files: Files, found: SourceColumns, units: Mapping[str, str]
) -> tuple[SourceColumns, Stream | None]:
    """Read Magnetometer.csv beside Inertial.csv, unless that has a magnetometer. List the other files as unused."""
    stream, others, name = None, files.keys() - {path.stem}, Path(MAGNETOMETER).stem
    if name in files and not found.of("mag"):
        sheet = sheet_of(path, name, files[name])
        other = understand(sheet, {}, units)
        if other.of("t") and len(other.of("mag")) == len(CHANNELS["mag"]):
            table = sheet.read([column.name for column in other.columns])
            stream = Stream.of(scaled(table, other, "t")[:, 0], scaled(table, other, "mag"))
            found = found.with_file(sheet.path.name, other)
            others -= {name}
    return found.with_unread(unused(others)), stream
