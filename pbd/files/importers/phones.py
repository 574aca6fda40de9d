"""Recordings of the apps Sensor Logger (a phone's, or an Apple Watch's) and phyphox: a zip, a folder, or a CSV file.

They have a file for each sensor. Specific force, +g up, comes from
- TotalAcceleration.csv of Sensor Logger on Android. Accelerometer.csv is without gravity on both systems.
- Accelerometer.csv + Gravity.csv of Sensor Logger on iOS, both with reversed sign; or AccelerometerUncalibrated.csv, in
  g and reversed too. With "Standardise Units & Frames" (`standardisation` in Metadata.csv) all is as on Android.
- gravity + acceleration in WristMotion.csv of Sensor Logger on a watch, both reversed and in g, or standardised.
- "Acceleration x (m/s^2)" of phyphox, "X (m/s^2)" in Accelerometer.csv of an iPhone's simple experiment. "Linear
  Acceleration x (m/s^2)" is without gravity.

Sources: Sensor Logger's documentation (github.com/tszheichoi/awesome-sensor-logger: UNITS.md, COORDINATES.md,
CROSSPLATFORM.md); phyphox' DataExport.java, SimpleExperimentSerializer.swift and documentation
(github.com/phyphox).
"""

import csv
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from pbd.data import GRAVITY, Recording
from pbd.data.paused_clock import ClockEvent, PausedClock
from pbd.data.source_columns import CHANNELS, Column, SourceColumns
from pbd.data.streams import Stream
from pbd.errors import RecordingError, warn
from pbd.files.importers.columns import WHY_UNUSED, why_not_read
from pbd.files.importers.csv_bundle import (
    PHYPHOX_CLOCK,
    Files,
    columns_of,
    files_in_folder,
    files_in_zip,
    joined_recording,
    sheet_of,
    stream_of,
    unread_of,
)
from pbd.files.table import Sheet

LOGGER_FILES = (
    *("TotalAcceleration", "Accelerometer", "AccelerometerUncalibrated", "Gravity"),
    *("Gyroscope", "GyroscopeUncalibrated", "Magnetometer", "MagnetometerUncalibrated"),
)
LOGGER_COLUMNS = ("seconds_elapsed", "x", "y", "z")
METADATA = "Metadata"

PHYPHOX_QUANTITIES = {
    "gyr": r"(?:gyroscope|rotation rate) ([xyz]) \(rad/s\)",
    "acc": r"acceleration ([xyz]) \(m/s(?:\^2|²)\)",
    "mag": r"magnetic field ([xyz]) \([µμ]t\)",
    "linear": r"linear acceleration ([xyz]) \(m/s(?:\^2|²)\)",
}
PHYPHOX_UNITS = {"gyr": "rad/s", "acc": "m/s2", "mag": "uT"}
PHYPHOX_TIME = "Time (s)"
LOGGER = "Sensor Logger"
WRIST = "WristMotion"
"""Sensor Logger's file of a watch."""

WRIST_AXES = tuple(f"{name}{axis}" for name in ("rotationRate", "gravity", "acceleration") for axis in "XYZ")

PHYPHOX_IOS = {
    **{"Accelerometer": "acceleration", "Linear Accelerometer": "linear acceleration"},
    **{"Gyroscope": "gyroscope", "Magnetometer": "magnetic field"},
}
"""Sets of an iPhone's simple experiments, whose columns are only called `X (m/s^2)` -> what Android calls them."""

PHYPHOX_FILES = (*PHYPHOX_IOS, "Acceleration", "Magnetic field")
"""Sets that phyphox' experiments, and ours, export beside one another."""


def read_phone(path: Path) -> Recording | None:
    """Read a recording from a zip, a folder, or a CSV file in such a folder; None: it is from neither app.

    A watch is read where there is no phone.
    """
    files = files_in_zip(path) if path.suffix.lower() == ".zip" else phone_files(path)
    logger = {name: files[name] for name in LOGGER_FILES if name in files}
    sheets = {name: sheet_of(path, name, read) for name, read in logger.items()}
    sheets = {name: sheet for name, sheet in sheets.items() if {*sheet.header} >= {*LOGGER_COLUMNS}}
    if sheets:
        streams, understood = _read_sensor_logger(path, sheets, _metadata(files))
        read = {*sheets, METADATA}
    elif phyphox := _read_phyphox(path, files):
        streams, understood, read = phyphox
    elif watch := _read_watch(path, files):
        streams, understood = watch
        read = {WRIST}
    else:
        return None
    if WRIST in files and WRIST not in read:
        warn(f"{path}: the phone is read, not the watch; for that import {WRIST}.csv alone")
    understood = understood.with_unread({f"{name}.csv": WHY_UNUSED for name in sorted(files.keys() - read)})
    return joined_recording(path, streams, "watch" if WRIST in read else "phone", understood)


def phone_files(path: Path) -> Files:
    """List the CSV files of a folder; or a CSV file of these apps, and those beside it if all have the app's names.

    A CSV file that is not theirs gives none.
    """
    folder = path if path.is_dir() else path.parent
    family: tuple[str, ...] = ()
    if path.is_file():
        with path.open("rb") as file:
            header = file.readline(1000).decode("utf-8", "replace")
        logger = path.stem in LOGGER_FILES and set(header.strip().split(",")) >= {*LOGGER_COLUMNS}
        cells = [cell.strip().strip('"') for cell in re.split(r"[,;\t]", header)]
        if not logger and path.stem != WRIST and not _phyphox_quantities(cells, path.stem):
            return {}
        family = (*LOGGER_FILES, METADATA) if logger else PHYPHOX_FILES
        family = (path.stem, PHYPHOX_CLOCK, *(family if path.stem in family else ()))
    files = files_in_folder(folder)
    return {name: read for name, read in files.items() if not family or name in family}


def _metadata(files: Files) -> Mapping[str, str]:
    """Read Sensor Logger's Metadata.csv, in lower case."""
    if METADATA not in files:
        return {}
    rows = list(csv.DictReader(io.StringIO(files[METADATA]().decode("utf-8", "replace"))))
    return {str(key).strip().lower(): str(value).strip().lower() for key, value in rows[0].items()} if rows else {}


def _read_sensor_logger(
    path: Path, sheets: Mapping[str, Sheet], metadata: Mapping[str, str]
) -> tuple[dict[str, Stream], SourceColumns]:
    def stream(name: str, scale: float = 1.0) -> Stream:
        return stream_of(sheets[name], LOGGER_COLUMNS, scale)

    ios = metadata.get("platform") == "ios"
    reversed_ = ios and metadata.get("standardisation") != "true"
    sign, unit = -1.0 if reversed_ else 1.0, "m/s2"
    if "TotalAcceleration" in sheets:
        acc, source = stream("TotalAcceleration", sign), "TotalAcceleration.csv"
    elif {"Accelerometer", "Gravity"} <= sheets.keys():
        if not metadata:
            what = "Metadata.csv is missing, which says whether the signs are an iPhone's; add it, or export again"
            raise RecordingError.at(path, what)
        linear, gravity = stream("Accelerometer", sign), stream("Gravity", sign)
        acc, source = Stream.of(linear.t, linear.values + gravity.at(linear.t)), "Accelerometer.csv + Gravity.csv"
    elif "AccelerometerUncalibrated" in sheets:
        source, unit = "AccelerometerUncalibrated.csv", "g" if reversed_ else "m/s2"
        acc = stream("AccelerometerUncalibrated", sign * (GRAVITY if reversed_ else 1.0))
        if not metadata and len(acc) and np.median(np.linalg.norm(acc.values, axis=1)) < 0.5 * GRAVITY:
            acc, sign, unit = Stream(acc.t, -GRAVITY * acc.values), -1.0, "g"  # an iPhone's
    else:
        needed = "Gravity.csv beside Accelerometer.csv" if ios else "TotalAcceleration.csv"
        needed += " (an iPhone's Gravity.csv)" * (not metadata)
        switch = "Gravity" if ios else "Total Acceleration" if metadata else "Total Acceleration' or 'Gravity"
        why = "Accelerometer.csv is without gravity" if "Accelerometer" in sheets else "no acceleration is in it"
        what = f"{why}, and {needed} is needed; switch on '{switch}' in Sensor Logger and record again"
        raise RecordingError.at(path, what)
    streams, read = {"acc": acc}, {"acc": (source, sign, unit)}
    for kind, name, unit in (("gyr", "Gyroscope", "rad/s"), ("mag", "Magnetometer", "uT")):
        if found := next((each for each in (name, f"{name}Uncalibrated") if each in sheets), None):
            streams[kind], read[kind] = stream(found), (f"{found}.csv", 1.0, unit)
    columns = [column for kind, its in read.items() for column in columns_of(LOGGER, LOGGER_COLUMNS, kind, *its)]
    used = {name for source, _, _ in read.values() for name in re.findall(r"(\w+)\.csv", source)}
    unread = {f"{name}.csv": "a better file is there" for name in sheets if name not in used}
    if "Accelerometer.csv" in unread:
        unread["Accelerometer.csv"] = "without gravity"
    for name in sorted(used):
        unread |= unread_of(f"{name}.csv", sheets[name].header, LOGGER_COLUMNS)
    return streams, SourceColumns(tuple(columns), unread, f"{LOGGER} (a phone)")


def _read_watch(path: Path, files: Files) -> tuple[dict[str, Stream], SourceColumns] | None:
    time, used = LOGGER_COLUMNS[0], {LOGGER_COLUMNS[0], *WRIST_AXES}
    if WRIST not in files or not {*(sheet := sheet_of(path, WRIST, files[WRIST])).header} >= used:
        return None
    rows = sheet.read((time, *WRIST_AXES)).values
    turn, gravity, linear = np.split(rows[:, 1:], 3, axis=1)
    standard = bool(np.nanmedian(np.linalg.norm(gravity, axis=1)) > 0.5 * GRAVITY)
    sign, unit, scale = (1.0, "m/s2", 1.0) if standard else (-1.0, "g", -GRAVITY)
    streams = {"acc": Stream.of(rows[:, 0], scale * (gravity + linear)), "gyr": Stream.of(rows[:, 0], turn)}
    sums = [" + ".join(both) for both in zip(WRIST_AXES[3:6], WRIST_AXES[6:], strict=True)]
    columns = columns_of(LOGGER, (time, *sums), "acc", f"{WRIST}.csv", sign, unit)
    columns += columns_of(LOGGER, (time, *WRIST_AXES[:3]), "gyr", f"{WRIST}.csv", 1.0, "rad/s")
    unread = unread_of(f"{WRIST}.csv", sheet.header, used)
    return streams, SourceColumns(tuple(dict.fromkeys(columns)), unread, f"{LOGGER} (a watch)")


def _phyphox_quantities(header: Sequence[str], file: str) -> dict[str, list[str]]:
    """Return the three columns of each quantity in a file of phyphox; none if another column looks inertial."""
    found: dict[str, list[str]] = {}
    full = {name: re.sub(r"^(?=[XYZ] )", f"{PHYPHOX_IOS.get(file, '')} ", name).lower() for name in header}
    for kind, pattern in PHYPHOX_QUANTITIES.items():
        axes = {match[1]: name for name in header if (match := re.fullmatch(pattern, full[name]))}
        if set(axes) == set("xyz"):
            found[kind] = [axes[axis] for axis in "xyz"]
    known = {PHYPHOX_TIME, *(name for axes in found.values() for name in axes)}
    have = ["t", *(CHANNELS[kind][0] for kind in found if kind in CHANNELS)]
    foreign = any(not why_not_read(name, have) for name in header if name not in known)
    return found if PHYPHOX_TIME in header and not foreign else {}


def _read_phyphox(path: Path, files: Files) -> tuple[dict[str, Stream], SourceColumns, set[str]] | None:
    """Read phyphox' files, the named one first; return the streams, their columns and the files read, or None."""
    streams: dict[str, Stream] = {}
    columns: list[Column] = []
    unread: dict[str, str] = {}
    files_read = {PHYPHOX_CLOCK}
    clock = _experiment_clock(path, files)
    for name in sorted(files.keys() - {PHYPHOX_CLOCK}, key=lambda name: (name != path.stem, name)):
        try:
            sheet = sheet_of(path, name, files[name])
        except RecordingError:
            continue  # another file of the experiment, which is empty or has few columns
        used: set[str] = set()
        for kind, axes in _phyphox_quantities(sheet.header, name).items():
            used |= {*axes, PHYPHOX_TIME}
            if kind in streams:
                if path.is_file() and path.suffix.lower() == ".csv":
                    continue
                what = f"'{axes[0]}' is in {name}.csv and in another file too; keep one recording in a folder"
                raise RecordingError.at(path, what)
            stream = stream_of(sheet, [PHYPHOX_TIME, *axes])
            streams[kind] = Stream(clock.to_elapsed(stream.t), stream.values)
            if kind == "linear":
                unread |= dict.fromkeys((f"{name}.csv: {axis}" for axis in axes), "without gravity")
            else:
                columns += columns_of("phyphox", [PHYPHOX_TIME, *axes], kind, f"{name}.csv", 1.0, PHYPHOX_UNITS[kind])
        if used:
            files_read.add(name)
            unread |= unread_of(f"{name}.csv", sheet.header, used)
    if not streams:
        return None
    if "acc" not in streams:
        why = "Linear Acceleration is without gravity" if "linear" in streams else "no acceleration is in it"
        raise RecordingError.at(
            path,
            f"{why}, and 'Acceleration x (m/s^2)' is needed; record with the experiment that `pbd sensors phyphox` "
            "gives to the phone",
        )
    return streams, SourceColumns(tuple(dict.fromkeys(columns)), unread, "phyphox (a phone)"), files_read


def _experiment_clock(path: Path, files: Files) -> PausedClock:
    """Read when the measurement was started and paused: experiment time stands still in pauses."""
    clock = PausedClock()
    if PHYPHOX_CLOCK in files:
        sheet = sheet_of(path, PHYPHOX_CLOCK, files[PHYPHOX_CLOCK])
        if {"event", "experiment time", "system time"} <= set(sheet.header):
            at = sheet.read(["experiment time", "system time"]).values.tolist()
            events = sheet.words("event")
            clock.take(tuple(ClockEvent(e == "START", t, s) for e, (t, s) in zip(events, at, strict=True)))
    return clock
