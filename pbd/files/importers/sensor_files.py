"""Recordings with several CSV files, each with sensors that its columns or its name tell: a folder, a zip, or a file.

Sensor Logger's and phyphox' files are known by their columns (phone_sensors.py), any other by its name:
`accelerometer.csv` and `gyroscope.csv` with `timestamp,x,y,z`, MATLAB Mobile's `Acceleration` and `AngularVelocity`,
written with `writetimetable`, and MetaBase's `Hand_2023-11-14T22.13.20.000_C1A2B3D4E5F6_Accelerometer_100.000Hz_
1.7.3.csv` with `epoc (ms),timestamp (+0100),elapsed (s),x-axis (g),y-axis (g),z-axis (g)`.

Files that are known by their names must share a clock. A column that begins at 0 in each file, as MetaBase's `elapsed`,
may count from the first sample of each sensor (State.swift of
github.com/mbientlab/MetaWear-MetaBase-iOS-macOS-App), so any other is preferred.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pbd.data import Demonstration, Recording, RecordingInfo
from pbd.data.paused_clock import ClockEvent, PausedClock
from pbd.data.recording import DEVICE_CLOCK
from pbd.data.source_columns import CHANNELS, DATES, Column, SourceColumns
from pbd.data.streams import Stream, joined
from pbd.errors import RecordingError, listed, printable, warn
from pbd.files.importers.clock_columns import refuse_backwards, unwrapped
from pbd.files.importers.columns import remapped, understand, unused
from pbd.files.importers.csv_bundle import PHYPHOX_CLOCK, Files, files_of, may_be_removed, sheet_of
from pbd.files.importers.header_names import is_time, our_name, plain
from pbd.files.importers.phone_sensors import (
    LINEAR,
    METADATA,
    PHYPHOX,
    PROGRAMS,
    WATCH,
    WRIST,
    Part,
    Program,
    parts_of_force,
    read_metadata,
    sensors_in,
)
from pbd.files.importers.request import Request
from pbd.files.importers.ximu3 import INERTIAL
from pbd.files.table import Sheet
from pbd.io.numbers import is_stamp


def read_sensor_files(request: Request) -> Demonstration | None:
    """Read a recording from a folder, a zip, or one of its files with those beside it; None: it is no such recording.

    A phone's CSV file for which units are given is an ordinary table.

    Raises:
        RecordingError: there are several recordings, no accelerometer, or no clock in common; or a file can't be read.
    """
    path, is_csv = request.path, request.is_csv
    if not (path.is_dir() or request.suffix == ".zip" or (is_csv and (request.beside or not request.columns))):
        return None
    programs: Sequence[Program] = PROGRAMS
    if is_csv:
        with path.open("rb") as file:
            first = file.read(1000)
        encoding = "utf-16" if first[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
        first_line = re.split("[\r\n]", first.decode(encoding, "replace").lstrip())[0]
        header = [cell.strip().strip('"') for cell in re.split(r"[,;\t]", first_line)]
        programs = [program for program in PROGRAMS if sensors_in(program, path.stem, header)]
        if (programs and request.units and not request.beside) or not (programs or _sensor(path.stem)[1]):
            return None
    files = files_of(path)
    if Path(INERTIAL).stem in files and not is_csv:
        return None  # a zip of an x-IMU3's, which is read as a table
    for program in programs:
        beside = {path.stem, METADATA, PHYPHOX_CLOCK, *(program.files if path.stem in program.files else ())}
        of_program = {name: read for name, read in files.items() if not is_csv or name in beside}
        if demo := _read_documented(request, program, of_program):
            return demo
    return _read_named(request, files)


def _find_sensors(request: Request, program: Program, files: Files) -> dict[str, Part]:
    """Find a program's sensors, which the columns of its files tell, in the named file first.

    phyphox writes files without rows too, as for a magnetometer that the phone lacks.
    """
    path, found, broken = request.path, dict[str, Part](), dict[str, RecordingError]()
    is_phyphox = program is PHYPHOX
    may_hold = files if is_phyphox else files.keys() & {*program.files}
    for name in sorted(may_hold, key=lambda name: (name != path.stem, name)):
        try:
            sheet = sheet_of(path, name, files[name])
        except RecordingError as error:
            if not is_phyphox and name not in PHYPHOX.files:
                raise
            broken[name] = error
            continue
        for sensor, columns in sensors_in(program, name, sheet.header).items():
            if sensor in found and is_phyphox and not request.is_csv:
                what = f"'{list(columns.values())[1]}' is in {name}.csv and in another file too"
                raise RecordingError.at(path, f"{what}; keep one recording in a folder")
            found.setdefault(sensor, (sheet, columns))
    for name in sorted(broken.keys() & {*program.files}) if found else ():
        if not (is_phyphox and {"acc", "gyr"} <= found.keys()):
            raise broken[name]
        warn(f"{broken[name].message.partition('; ')[0]}; the recording is read without this file")
    return found


def _read_documented(request: Request, program: Program, files: Files) -> Demonstration | None:
    """Read a recording whose program documents its sensors; None: there are none."""
    path, found = request.path, _find_sensors(request, program, files)
    if not found:
        return None
    force, unit = parts_of_force(path, program, found, read_metadata(path, files))
    request.refuse_rate("an app's file has times")
    if WRIST in files and program is not WATCH:
        warn(f"{path}: the phone is read, not the watch; for that import {WRIST}.csv alone")
    made_of: dict[str, Sequence[str]] = {"acc": force, "gyr": ["gyr"], "mag": ["mag"]}
    read = {channel: [found[each] for each in its] for channel, its in made_of.items() if found.keys() >= {*its}}
    streams, source = _read(read, {"acc": unit}, f"{program.name}'s documentation")
    clock = _experiment_clock(path, files)
    streams = {channel: Stream(clock.to_elapsed(stream.t), stream.values) for channel, stream in streams.items()}
    of_read = {sheet.path for parts in read.values() for sheet, _ in parts}
    for sensor, (sheet, _) in found.items():
        if sheet.path not in of_read:
            why = "without gravity" if sensor == LINEAR else "a better file is there"
            source = source.with_unread({sheet.path.name: why})
    others = files.keys() - {METADATA, PHYPHOX_CLOCK, *(sheet.path.stem for sheet, _ in found.values())}
    source = replace(source, program=f"{program.name} (a {program.sensor})").with_unread(unused(others))
    recording = _joined(path, streams, program.sensor, source)
    return Demonstration(remapped(path, recording, request.columns, request.units))


def _experiment_clock(path: Path, files: Files) -> PausedClock:
    """Read when phyphox' measurement was started and paused: experiment time stands still in pauses."""
    clock = PausedClock()
    if PHYPHOX_CLOCK in files:
        sheet = sheet_of(path, PHYPHOX_CLOCK, files[PHYPHOX_CLOCK])
        if {"event", "experiment time", "system time"} <= set(sheet.header):
            at = sheet.read(["experiment time", "system time"]).values.tolist()
            events = sheet.words("event")
            clock.take(tuple(ClockEvent(e == "START", t, s) for e, (t, s) in zip(events, at, strict=True)))
    return clock


def _read_named(request: Request, files: Files) -> Demonstration | None:
    path, is_csv = request.path, request.is_csv
    recordings: dict[str, dict[str, Part]] = {}
    for name in files:
        device, channel = _sensor(name)
        if not channel or (is_csv and device != _sensor(path.stem)[0]):
            continue
        sheet = sheet_of(path, name, files[name])
        with may_be_removed(name):
            axes = _axes(sheet, channel)
        if not axes:
            continue
        first, _ = recordings.setdefault(device, {}).setdefault(channel, (sheet, axes))
        if first is not sheet:
            both = f"{first.path.name} and {sheet.path.name} are of the same sensor"
            raise RecordingError.at(path, f"{both}; keep one recording in a folder")
    if is_csv and all(sheet.path != path for of in recordings.values() for sheet, _ in of.values()):
        return None
    if len(recordings) > 1:
        recordings.pop("linear_", None)  # a phone's acceleration without gravity, beside its accelerometer
    if len(recordings) > 1:
        raise RecordingError.at(path, f"it holds {len(recordings)} recordings; name a file of one of them")
    if not recordings:
        return None
    (found,) = recordings.values()
    if is_csv and list(found) == ["acc"] and all(map(our_name, found["acc"][1].values())):
        return None
    request.refuse_rate("an app's file has times")
    if "acc" not in found:
        what = f"no file of the accelerometer is beside it; put it there (an x-IMU3's is {INERTIAL})"
        raise RecordingError.at(path, f"{what}, or export all sensors of the recording")
    clock = _clock(path, [sheet for sheet, _ in found.values()])
    read = {channel: [(sheet, {"t": clock, **axes})] for channel, (sheet, axes) in found.items()}
    streams, source = _read(read, request.units)
    is_metabase = found["acc"][0].header[0].startswith(("epoc (ms)", "epoch (ms)"))  # in its versions
    others = files.keys() - {sheet.path.stem for sheet, _ in found.values()}
    source = replace(source, program="MetaBase (MbientLab)" * is_metabase).with_unread(unused(others))
    recording = _joined(path, streams, "metawear" if is_metabase else "unknown", source)
    return Demonstration(remapped(path, recording, request.columns))


def _sensor(name: str) -> tuple[str, str]:
    """Return the device and the channel that a file's name tells: `Hand_Accelerometer` -> `hand_`, acc; "": none."""
    name = re.sub(r"_[\d.]+Hz_[\d.]+$", "", name)  # MetaBase's rate and firmware
    given = our_name(f"{name} x")
    channel = {"ax": "acc", "gx": "gyr", "mx": "mag"}.get(given[0], "") if given else ""
    return (given[2] if given else "", channel)


def _axes(sheet: Sheet, channel: str) -> dict[str, str]:
    """Return our names of the axes and the file's; none if it has none, or another sensor's.

    Raises:
        RecordingError: an axis or the time is missing.
    """
    axes: dict[str, str] = {}
    for name in sheet.header:
        bare, given = re.fullmatch("[xyz]", plain(name)), our_name(name)
        ours = f"{channel[0]}{bare[0]}" if bare else given[0] if given else "t"
        if ours in CHANNELS[channel]:
            axes.setdefault(ours, name)
        elif ours != "t":
            return {}
    if len(axes) == len(CHANNELS[channel]) and any(map(is_time, sheet.header)):
        return axes
    if all(map(our_name, axes.values())):  # read as a table, its columns can be named
        return {}
    missing = next((ours[-1] for ours in CHANNELS[channel] if ours not in axes), "t")
    what = f"no column for '{missing}', though there is '{next(iter(axes.values()))}'"
    raise RecordingError.at(sheet.path, f"{what}; the columns are {listed(sheet.header)}: name one '{missing}'")


def _clock(path: Path, sheets: Sequence[Sheet]) -> str:
    """Return the column of times that all files have, with the most distinct times; preferably none that counts from 0.

    Raises:
        RecordingError: there is none.
    """
    shared = [name for name in sheets[0].header if is_time(name) and all(name in sheet.header for sheet in sheets)]
    if not shared:
        times = listed(f"{sheet.path.name}: {listed(filter(is_time, sheet.header))}" for sheet in sheets)
        raise RecordingError.at(path, f"its files have no column of times in common ({times}); name it alike in all")
    apart = [name for name in shared if any("".join(sheet.words(name)[:1]).strip("0.,") for sheet in sheets)]
    if len(sheets) > 1 and not apart:
        each = f"the times in the column '{printable(shared[0])}' begin at 0 in each file"
        warn(f"{path}: {each}; if the sensors did not start together, the result is wrong")
    return max(apart or shared, key=lambda name: len(set(sheets[0].words(name))))


def _read(
    sensors: Mapping[str, Sequence[Part]], units: Mapping[str, str], documented_by: str = ""
) -> tuple[dict[str, Stream], SourceColumns]:
    """Read each channel: the sum of its parts, at the times of the first.

    Args:
        units: channel -> unit; -UNIT reverses the sign.
        documented_by: who says which columns are read, and their units; "": the names of the files and columns.
    """
    streams, columns, unread = dict[str, Stream](), list[Column](), dict[str, str]()
    for channel, parts in sensors.items():
        read = []
        for sheet, its in parts:
            with may_be_removed(sheet.path.stem):
                found = understand(sheet, its, units)
                if not documented_by and is_stamp(sheet.cell(its["t"], 0)[1]):
                    found = found.with_column(its["t"], unit="s", unit_by=DATES)
                read.append(_stream(sheet, channel, found, in_order=not documented_by))
            unread |= {f"{sheet.path.name}: {name}": why for name, why in found.unread.items()}
        first, *others = read
        streams[channel] = Stream(first.t, sum((other.at(first.t) for other in others), first.values))
        file, *names = (
            " + ".join(dict.fromkeys(words))
            for words in zip(*((sheet.path.name, *its.values()) for sheet, its in parts), strict=True)
        )
        for ours, name in zip(its, names, strict=True):
            named_by = documented_by or ("a time that all files have" if ours == "t" else "the file's name")
            (column,) = (column for column in found.columns if column.ours == ours)
            unit_by = documented_by or column.unit_by
            columns.append(replace(column, name=f"{file}: {name}", named_by=named_by, unit_by=unit_by))
    used = {f"{sheet.path.name}: {name}" for parts in sensors.values() for sheet, its in parts for name in its.values()}
    unread = {name: why for name, why in unread.items() if name not in used}
    return streams, SourceColumns(tuple(dict.fromkeys(columns)), unread)


@np.errstate(invalid="ignore")  # of infinite values, which are left out later
def _stream(sheet: Sheet, channel: str, found: SourceColumns, in_order: bool) -> Stream:
    """Read a sensor's samples, sorted; `in_order`: times that a counter wraps, and no others, may run backwards."""
    clock, axes = found.of("t")[0], found.of(channel)
    values = sheet.read([clock.name, *(column.name for column in axes)], times=[clock.name] * in_order).values
    t = clock.factor * values[:, 0]
    if in_order:
        t = unwrapped(t, found, sheet)
        refuse_backwards(sheet, clock.name, t)
    return Stream.of(t, values[:, 1:] * [column.factor for column in axes])


def _joined(path: Path, streams: Mapping[str, Stream], sensor: str, source: SourceColumns) -> Recording:
    """Join acc, gyr and mag to a recording; RecordingError: they have no time in common."""
    given = {name: stream for name, stream in streams.items() if name == "acc" or stream}
    t, values = joined(given)
    if len(t) < 2:
        known = (given[name].t for name in ("acc", "gyr") if given.get(name))
        spans = listed(f"{each[0]:.1f} to {each[-1]:.1f} s" for each in known)
        raise RecordingError.at(path, f"its sensors have no time in common ({spans}); record them together")
    info = RecordingInfo(sensor=sensor, clock=DEVICE_CLOCK, source=source)
    return Recording(t - t[0], values["acc"], values.get("gyr"), values.get("mag"), info=info)
