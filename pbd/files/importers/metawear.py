"""Recordings of MbientLab's MetaWear and MetaMotion sensors: a file for each sensor, as the app MetaBase exports them.

All have the columns `epoc (ms),timestamp (+0100),elapsed (s),x-axis (g),y-axis (g),z-axis (g)`; only the file's name,
`Hand_2023-11-14T22.13.20.000_C1A2B3D4E5F6_Accelerometer_100.000Hz_1.7.3.csv`, says which sensor it is.

Source: files and readers that users of MetaBase published; no such sensor was at hand.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from pbd.data import Recording
from pbd.data.source_columns import CHANNELS, SourceColumns
from pbd.data.streams import Stream
from pbd.errors import RecordingError
from pbd.files.importers.app_files import joined_recording, stream_of
from pbd.files.importers.columns import UNUSED, understand
from pbd.files.importers.header_names import split_unit
from pbd.files.table import open_sheet

SENSORS = {"Accelerometer": "acc", "Gyroscope": "gyr", "Magnetometer": "mag"}
TIME, AXES = "elapsed (s)", ("x-axis", "y-axis", "z-axis")
TITLE = "MetaBase (MbientLab)"


def read_metawear(path: Path) -> Recording | None:
    """Read a recording from one of its files, with those beside it, or from a folder; None: MetaBase did not write it.

    Raises:
        RecordingError: the folder has several recordings, or a file can't be read.
    """
    folder = path if path.is_dir() else path.parent
    recordings: dict[str, dict[str, Path]] = {}
    for file in sorted(folder.glob("*.csv")):
        if match := re.fullmatch(rf"(.*)_({'|'.join(SENSORS)})(?:_.*)?", file.stem):
            recordings.setdefault(match[1], {})[match[2]] = file
    if path.is_file():
        recordings = {name: files for name, files in recordings.items() if path in files.values()}
    recordings = {name: files for name, files in recordings.items() if all(map(_is_of_metabase, files.values()))}
    if not recordings:
        return None
    if len(recordings) > 1:
        raise RecordingError.at(path, f"it holds {len(recordings)} recordings; name a file of one of them")
    ((_, files),) = recordings.items()
    if "Accelerometer" not in files:
        raise RecordingError.at(path, "no file of the accelerometer is beside it; export all sensors of the recording")
    streams, understood = dict[str, Stream](), SourceColumns(program=TITLE)
    for sensor, file in files.items():
        channel, sheet = SENSORS[sensor], open_sheet(file, foreign=True)
        axes = [next((name for name in sheet.header if split_unit(name)[0] == axis), axis) for axis in AXES]
        ours = dict(zip(("t", *CHANNELS[channel]), (TIME, *axes), strict=True))
        its = understand(sheet, ours, {})
        streams[channel] = stream_of(sheet, list(ours.values()), its.of(channel)[0].factor)
        columns = tuple(replace(column, named_by=TITLE) for column in its.columns)
        understood = understood.with_file(file.name, replace(its, columns=columns))
    others = (file.name for file in sorted(folder.glob("*.csv")) if file not in files.values())
    return joined_recording(path, streams, "metawear", understood.with_unread(dict.fromkeys(others, UNUSED)))


def _is_of_metabase(file: Path) -> bool:
    with file.open("rb") as stream:
        header = stream.readline(1000).decode("utf-8", "replace")
    return re.match(r"\ufeff?epoch? \(ms\),", header) is not None and TIME in header
