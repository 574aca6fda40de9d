"""Recordings of the phone apps Sensor Logger and phyphox: a zip, a folder, or one CSV file of it.

They have a file for each sensor. Specific force, +g up, comes from
- TotalAcceleration.csv of Sensor Logger on Android. Accelerometer.csv is without gravity on both systems.
- Accelerometer.csv + Gravity.csv of Sensor Logger on iOS, both with reversed sign; or AccelerometerUncalibrated.csv, in
  g and reversed too. With "Standardise Units & Frames" (`standardisation` in Metadata.csv) all is as on Android.
- "Acceleration x (m/s^2)" of phyphox, "X (m/s^2)" in Accelerometer.csv of an iPhone's simple experiment. "Linear
  Acceleration x (m/s^2)" is without gravity.

Sources: Sensor Logger's documentation (github.com/tszheichoi/awesome-sensor-logger: UNITS.md, COORDINATES.md,
CROSSPLATFORM.md); phyphox' DataExport.java, SimpleExperimentSerializer.swift and documentation
(github.com/phyphox).
"""

from __future__ import annotations

import csv
import io
import re
import zipfile
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from pathlib import Path, PurePosixPath

import numpy as np

from pbd.data import GRAVITY, Recording, RecordingInfo
from pbd.data.paused_clock import ClockEvent, PausedClock
from pbd.data.source_columns import CHANNEL_OF, CHANNELS, Column, SourceColumns
from pbd.data.streams import Stream, joined
from pbd.errors import RecordingError, in_words, listed, warn
from pbd.files.importers.columns import UNUSED, why_not_read
from pbd.files.table import Sheet, foreign_text, open_sheet
from pbd.io.read_file import LARGE, read_bytes

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
"""Sensor Logger's file of a watch (watch.py)."""

PHYPHOX_IOS = {
    **{"Accelerometer": "acceleration", "Linear Accelerometer": "linear acceleration"},
    **{"Gyroscope": "gyroscope", "Magnetometer": "magnetic field"},
}
"""Sets of an iPhone's simple experiments, whose columns are only called `X (m/s^2)` -> what Android calls them."""

PHYPHOX_FILES = (*PHYPHOX_IOS, "Acceleration", "Magnetic field")
"""Sets that phyphox' experiments, and ours, export beside one another."""

LARGEST_FILE = LARGE // 4
"""Largest file in a zip, bytes, so that a small zip can't fill the memory. An hour at 400 Hz has 120 MB."""

PHYPHOX_CLOCK = "meta/time"
"""phyphox' table of starts and pauses. The other files in its folder `meta` describe the phone."""

Files = dict[str, Callable[[], bytes]]
"""Name of a CSV file, without suffix -> a function that reads it."""


def read_phone(path: Path) -> Recording | None:
    """Read a phone's recording from a zip, a folder, or a CSV file in such a folder; None: it is from neither app."""
    files = files_in_zip(path) if path.suffix.lower() == ".zip" else _files_in_folder(path)
    logger = {name: files[name] for name in LOGGER_FILES if name in files}
    sheets = {name: sheet_of(path, name, read) for name, read in logger.items()}
    sheets = {name: sheet for name, sheet in sheets.items() if {*sheet.header} >= {*LOGGER_COLUMNS}}
    if sheets:
        streams, understood = _read_sensor_logger(path, sheets, _metadata(files))
        read = {*sheets, METADATA}
    elif phyphox := _read_phyphox(path, files):
        streams, understood, read = phyphox
    else:
        return None
    if WRIST in files:
        warn(f"{path}: the phone is read, not the watch; for that import {WRIST}.csv alone")
    understood = understood.with_unread({f"{name}.csv": UNUSED for name in sorted(files.keys() - read)})
    return joined_recording(path, streams, "phone", understood)


def files_in_zip(path: Path) -> Files:
    """List the CSV files of a zip, in any folder; RecordingError: it is not a zip, or has several recordings."""
    data = read_bytes(path, RecordingError, "export it again")
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
    except (zipfile.BadZipFile, OSError, ValueError) as reason:
        what = f"{path}: the zip is damaged or cut off ({in_words(reason)}); copy or export it again"
        raise RecordingError(what, path=path) from None
    files: Files = {}
    for member in archive.infolist():
        place = PurePosixPath(member.filename)
        if place.suffix.lower() != ".csv" or "__MACOSX" in place.parts:
            continue
        name = PHYPHOX_CLOCK if place.parts[-2:] == ("meta", "time.csv") else place.stem
        if place.parts[-2:-1] == ("meta",) and name != PHYPHOX_CLOCK:
            continue
        if name in files:
            raise RecordingError.at(path, f"it holds several recordings ({name}.csv twice); export one")
        files[name] = partial(_member, path, archive, member)
    return files


def _member(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    if member.file_size > LARGEST_FILE:
        most = f"{LARGEST_FILE / 1e6:.0f} MB"
        what = f"'{member.filename}' in it has {member.file_size / 1e6:.3g} MB, more than the {most} that are read"
        raise RecordingError.at(path, f"{what}; export a shorter recording", value=member.file_size)
    try:
        return archive.read(member)
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError, NotImplementedError, ValueError) as reason:
        what = f"'{member.filename}' in the zip can't be read ({in_words(reason)}); export it again"
        raise RecordingError.at(path, what) from None


def _files_in_folder(path: Path) -> Files:
    """List the CSV files of a folder; or a CSV file of these apps, and those beside it if all have the app's names."""
    folder = path if path.is_dir() else path.parent
    family: tuple[str, ...] = ()
    if path.is_file():
        with path.open("rb") as file:
            header = file.readline(1000).decode("utf-8", "replace")
        logger = path.stem in LOGGER_FILES and set(header.strip().split(",")) >= {*LOGGER_COLUMNS}
        cells = [cell.strip().strip('"') for cell in re.split(r"[,;\t]", header)]
        if not logger and not _phyphox_quantities(cells, path.stem):
            return {}
        family = (*LOGGER_FILES, METADATA) if logger else PHYPHOX_FILES
        family = (path.stem, PHYPHOX_CLOCK, *(family if path.stem in family else ()))
    names = sorted(each for each in (*folder.glob("*.csv"), folder / f"{PHYPHOX_CLOCK}.csv") if each.is_file())
    files = {
        str(file.relative_to(folder).with_suffix("")): partial(read_bytes, file, RecordingError, "give another")
        for file in names
    }
    return {name: read for name, read in files.items() if not family or name in family}


def sheet_of(path: Path, name: str, read: Callable[[], bytes]) -> Sheet:
    """Read the header of a CSV file, `name` without suffix, of the recording at `path`."""
    folder = path.parent if path.suffix.lower() == ".csv" else path
    file = folder / f"{name}.csv"
    return open_sheet(file, foreign=True, text=foreign_text(file, read()))


def stream_of(sheet: Sheet, columns: Sequence[str], scale: float = 1.0) -> Stream:
    """Read a sensor's samples from columns of time, x, y, z: sorted, without repeated times and rows with NaN."""
    rows = sheet.read(columns).values
    return Stream.of(rows[:, 0], scale * rows[:, 1:])


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


def columns_of(program: str, names: Sequence[str], kind: str, file: str, sign: float, unit: str) -> list[Column]:
    """Describe columns of time, x, y, z, as the program documents them."""
    by = f"{program}'s documentation"
    ours = ("t", 1.0, "s"), *((f"{kind[0]}{axis}", sign, unit) for axis in "xyz")
    return [Column(f"{file}: {name}", *its, by, by) for name, its in zip(names, ours, strict=True)]


def unread_of(file: str, header: Sequence[str], used: Collection[str]) -> dict[str, str]:
    """Return the columns of a file that were not read, and why."""
    return {f"{file}: {name}": why_not_read(name, CHANNEL_OF) for name in header if name not in used}


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


def joined_recording(path: Path, streams: Mapping[str, Stream], sensor: str, source: SourceColumns) -> Recording:
    """Join the streams to a recording; RecordingError: they have no time in common."""
    given = {name: streams[name] for name in ("acc", "gyr", "mag") if name == "acc" or streams.get(name)}
    t, values = joined(given)
    if len(t) < 2:
        known = (given[name].t for name in ("acc", "gyr") if given.get(name))
        spans = listed(f"{each[0]:.1f} to {each[-1]:.1f} s" for each in known)
        raise RecordingError.at(path, f"its sensors have no time in common ({spans}); record them together")
    info = RecordingInfo(sensor=sensor, clock="device", source=source)
    return Recording(t - t[0], values["acc"], values.get("gyr"), values.get("mag"), info=info)
