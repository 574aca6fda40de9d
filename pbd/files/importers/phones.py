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

from pbd.data import GRAVITY, Demonstration
from pbd.data.paused_clock import ClockEvent, PausedClock
from pbd.data.source_columns import CHANNELS, Column, SourceColumns
from pbd.data.streams import Stream
from pbd.errors import RecordingError, warn
from pbd.files.importers.columns import WHY_UNUSED, remapped, why_not_read
from pbd.files.importers.csv_bundle import (
    PHYPHOX_CLOCK,
    Files,
    files_of,
    joined_recording,
    read_sensor,
    sheet_of,
    unread_of,
)
from pbd.files.importers.request import Request
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


def read_phone(request: Request) -> Demonstration | None:
    """Read a recording from a zip, a folder, or a CSV file in such a folder; None: it is from neither app.

    A watch is read where there is no phone. A CSV file for which columns or units are given is an ordinary table.
    """
    path = request.path
    if not request.may_be_several_files or (request.is_csv and request.units and not request.beside):
        return None
    files = phone_files(path)
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
    request.refuse_rate("an app's file has times")
    if WRIST in files and WRIST not in read:
        warn(f"{path}: the phone is read, not the watch; for that import {WRIST}.csv alone")
    understood = understood.with_unread({f"{name}.csv": WHY_UNUSED for name in sorted(files.keys() - read)})
    recording = joined_recording(path, streams, "watch" if WRIST in read else "phone", understood)
    return Demonstration(remapped(path, recording, request.columns, request.units))


def phone_files(path: Path) -> Files:
    """List the CSV files of a folder or a zip; or a CSV file of these apps, and those beside it with the app's names.

    A CSV file that is not theirs gives none.
    """
    family: tuple[str, ...] = ()
    if path.suffix.lower() == ".csv" and path.is_file():
        with path.open("rb") as file:
            header = file.readline(1000).decode("utf-8", "replace")
        logger = path.stem in LOGGER_FILES and set(header.strip().split(",")) >= {*LOGGER_COLUMNS}
        cells = [cell.strip().strip('"') for cell in re.split(r"[,;\t]", header)]
        if not logger and path.stem != WRIST and not _phyphox_quantities(cells, path.stem):
            return {}
        family = (*LOGGER_FILES, METADATA) if logger else PHYPHOX_FILES
        family = (path.stem, PHYPHOX_CLOCK, *(family if path.stem in family else ()))
    return {name: read for name, read in files_of(path).items() if not family or name in family}


def _metadata(files: Files) -> Mapping[str, str]:
    """Read Sensor Logger's Metadata.csv, in lower case."""
    if METADATA not in files:
        return {}
    rows = list(csv.DictReader(io.StringIO(files[METADATA]().decode("utf-8", "replace"))))
    return {str(key).strip().lower(): str(value).strip().lower() for key, value in rows[0].items()} if rows else {}


def _read_sensor_logger(
    path: Path, sheets: Mapping[str, Sheet], metadata: Mapping[str, str]
) -> tuple[dict[str, Stream], SourceColumns]:
    ios = metadata.get("platform") == "ios"
    reversed_ = ios and metadata.get("standardisation") != "true"
    sign, unit = -1.0 if reversed_ else 1.0, "m/s2"
    if "TotalAcceleration" in sheets:
        acc = ["TotalAcceleration"]
    elif {"Accelerometer", "Gravity"} <= sheets.keys():
        if not metadata:
            what = "Metadata.csv is missing, which says whether the signs are an iPhone's; add it, or export again"
            raise RecordingError.at(path, what)
        acc = ["Accelerometer", "Gravity"]
    elif "AccelerometerUncalibrated" in sheets:
        acc = ["AccelerometerUncalibrated"]
        if not metadata:
            values = sheets[acc[0]].read(LOGGER_COLUMNS[1:]).values
            reversed_ = bool(np.nanmedian(np.linalg.norm(values, axis=1)) < 0.5 * GRAVITY)
        sign, unit = (-1.0, "g") if reversed_ else (1.0, "m/s2")
    else:
        needed = "Gravity.csv beside Accelerometer.csv" if ios else "TotalAcceleration.csv"
        needed += " (an iPhone's Gravity.csv)" * (not metadata)
        switch = "Gravity" if ios else "Total Acceleration" if metadata else "Total Acceleration' or 'Gravity"
        why = "Accelerometer.csv is without gravity" if "Accelerometer" in sheets else "no acceleration is in it"
        what = f"{why}, and {needed} is needed; switch on '{switch}' in Sensor Logger and record again"
        raise RecordingError.at(path, what)
    read: dict[str, tuple[list[str], float, str]] = {"acc": (acc, sign, unit)}
    for channel, name in (("gyr", "Gyroscope"), ("mag", "Magnetometer")):
        if found := next((each for each in (name, f"{name}Uncalibrated") if each in sheets), None):
            read[channel] = [found], 1.0, ""
    streams, columns, used = dict[str, Stream](), list[Column](), set[str]()
    for channel, (names, sign, unit) in read.items():
        parts = [(sheets[name], LOGGER_COLUMNS) for name in names]
        streams[channel], described = read_sensor(LOGGER, parts, channel, sign, unit)
        columns += described
        used |= {*names}
    unread = {f"{name}.csv": "a better file is there" for name in sheets if name not in used}
    if "Accelerometer.csv" in unread:
        unread["Accelerometer.csv"] = "without gravity"
    for name in sorted(used):
        unread |= unread_of(sheets[name], LOGGER_COLUMNS)
    return streams, SourceColumns(tuple(columns), unread, f"{LOGGER} (a phone)")


def _read_watch(path: Path, files: Files) -> tuple[dict[str, Stream], SourceColumns] | None:
    time, used = LOGGER_COLUMNS[0], {LOGGER_COLUMNS[0], *WRIST_AXES}
    if WRIST not in files or not {*(sheet := sheet_of(path, WRIST, files[WRIST])).header} >= used:
        return None
    turn, gravity, linear = ((sheet, (time, *WRIST_AXES[k : k + 3])) for k in (0, 3, 6))
    norm = np.linalg.norm(sheet.read(gravity[1][1:]).values, axis=1)
    standard = bool(np.nanmedian(norm) > 0.5 * GRAVITY)
    acc, of_acc = read_sensor(LOGGER, (gravity, linear), "acc", *((1.0, "m/s2") if standard else (-1.0, "g")))
    gyr, of_gyr = read_sensor(LOGGER, (turn,), "gyr")
    source = SourceColumns(tuple(dict.fromkeys(of_acc + of_gyr)), unread_of(sheet, used), f"{LOGGER} (a watch)")
    return {"acc": acc, "gyr": gyr}, source


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
            channel = "acc" if kind == "linear" else kind
            stream, described = read_sensor("phyphox", [(sheet, [PHYPHOX_TIME, *axes])], channel)
            streams[kind] = Stream(clock.to_elapsed(stream.t), stream.values)
            if kind == "linear":
                unread |= dict.fromkeys((f"{name}.csv: {axis}" for axis in axes), "without gravity")
            else:
                columns += described
        if used:
            files_read.add(name)
            unread |= unread_of(sheet, used)
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
