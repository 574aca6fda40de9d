"""Recordings with a CSV file for each sensor, which the file's name tells: a folder, a zip, or one of the files.

Examples are `accelerometer.csv` and `gyroscope.csv` with `timestamp,x,y,z`, MATLAB Mobile's `Acceleration` and
`AngularVelocity`, written with `writetimetable`, and MetaBase's `Hand_2023-11-14T22.13.20.000_C1A2B3D4E5F6_
Accelerometer_100.000Hz_1.7.3.csv` with `epoc (ms),timestamp (+0100),elapsed (s),x-axis (g),y-axis (g),z-axis (g)`.

The files must share a clock. A column that begins at 0 in each file, as MetaBase's `elapsed`, may count from the first
sample of each sensor (State.swift of github.com/mbientlab/MetaWear-MetaBase-iOS-macOS-App), so any other is preferred.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pbd.data import Demonstration
from pbd.data.source_columns import CHANNELS, DATES, SourceColumns
from pbd.data.streams import Stream
from pbd.errors import RecordingError, listed, printable, warn
from pbd.files.importers.clock_columns import refuse_backwards, unwrapped
from pbd.files.importers.columns import WHY_UNUSED, remapped, understand
from pbd.files.importers.csv_bundle import files_of, joined_recording, may_be_removed, sheet_of
from pbd.files.importers.header_names import is_time, our_name, plain
from pbd.files.importers.phones import phone_files
from pbd.files.importers.request import Request
from pbd.files.importers.ximu3 import INERTIAL
from pbd.files.table import Sheet
from pbd.io.numbers import is_stamp

RATE = r"_[\d.]+Hz_[\d.]+$"
"""What MetaBase writes after the sensor's name: its rate, and the firmware."""

METABASE = ("epoc (ms)", "epoch (ms)")
"""The first column of MetaBase's files, in its versions."""


def read_sensor_files(request: Request) -> Demonstration | None:
    """Read a recording from a folder, a zip, or one of its files with those beside it; None: it is no such recording.

    Raises:
        RecordingError: there are several recordings, no accelerometer, or no clock in common; or a file can't be read.
    """
    path, is_csv = request.path, request.is_csv
    its_device, its_channel = _sensor(path.stem) if is_csv else ("", "")
    if not request.may_be_several_files or (is_csv and (not its_channel or phone_files(path))):
        return None
    recordings: dict[str, dict[str, Sheet]] = {}
    files = files_of(path)
    for name, read in files.items():
        device, channel = _sensor(name)
        if not channel or (is_csv and device != its_device):
            continue
        if not _axes(sheet := sheet_of(path, name, read), channel):
            continue
        if (first := recordings.setdefault(device, {}).setdefault(channel, sheet)) is not sheet:
            both = f"{first.path.name} and {sheet.path.name} are of the same sensor"
            raise RecordingError.at(path, f"{both}; keep one recording in a folder")
    if is_csv and all(sheet.path != path for of in recordings.values() for sheet in of.values()):
        return None
    if len(recordings) > 1:
        recordings.pop("linear_", None)  # a phone's acceleration without gravity, beside its accelerometer
    if len(recordings) > 1:
        raise RecordingError.at(path, f"it holds {len(recordings)} recordings; name a file of one of them")
    if not recordings:
        return None
    (sheets,) = recordings.values()
    if is_csv and list(sheets) == ["acc"] and all(map(our_name, _axes(sheets["acc"], "acc").values())):
        return None
    request.refuse_rate("an app's file has times")
    if "acc" not in sheets:
        what = f"no file of the accelerometer is beside it; put it there (an x-IMU3's is {INERTIAL})"
        raise RecordingError.at(path, f"{what}, or export all sensors of the recording")
    clock = _clock(path, list(sheets.values()))
    streams, understood = dict[str, Stream](), SourceColumns()
    for channel, sheet in sheets.items():
        with may_be_removed(sheet.path.stem):
            streams[channel], its = _stream(sheet, clock, channel, request.units)
        understood = understood.with_file(sheet.path.name, its)
    if sheets["acc"].header[0].startswith(METABASE):
        understood = replace(understood, program="MetaBase (MbientLab)")
    used = [sheet.path.stem for sheet in sheets.values()]
    understood = understood.with_unread({f"{name}.csv": WHY_UNUSED for name in files if name not in used})
    recording = joined_recording(path, streams, "metawear" if understood.program else "unknown", understood)
    return Demonstration(remapped(path, recording, request.columns))


def _sensor(name: str) -> tuple[str, str]:
    """Return the device and the channel that a file's name tells: `Hand_Accelerometer` -> `hand_`, acc; "": none."""
    given = our_name(f"{re.sub(RATE, '', name)} x")
    channel = {"ax": "acc", "gx": "gyr", "mx": "mag"}.get(given[0], "") if given else ""
    return (given[2] if given else "", channel)


def _axes(sheet: Sheet, channel: str) -> dict[str, str]:
    """Return our names of the axes and the file's; none if one or the time is missing, or another sensor is there."""
    axes: dict[str, str] = {}
    for name in sheet.header:
        bare, given = re.fullmatch(r"([xyz])(?:_axis)?", plain(name)), our_name(name)
        ours = f"{channel[0]}{bare[1]}" if bare else given[0] if given else "t"
        if ours in CHANNELS[channel]:
            axes.setdefault(ours, name)
        elif ours != "t":
            return {}
    return axes if len(axes) == len(CHANNELS[channel]) and any(map(is_time, sheet.header)) else {}


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


@np.errstate(invalid="ignore")  # of infinite values, which are left out later
def _stream(sheet: Sheet, clock: str, channel: str, units: Mapping[str, str]) -> tuple[Stream, SourceColumns]:
    axes = _axes(sheet, channel)
    found = understand(sheet, {"t": clock, **axes}, units)
    named_by = {"t": "a time that all files have"}
    columns = tuple(replace(each, named_by=named_by.get(each.ours, "the file's name")) for each in found.columns)
    found = replace(found, columns=columns)
    values = sheet.read([clock, *(axes[ours] for ours in CHANNELS[channel])], times=[clock]).values
    if is_stamp(sheet.cell(clock, 0)[1]):
        found = found.with_column(clock, unit="s", unit_by=DATES)
    t = unwrapped(found.of("t")[0].factor * values[:, 0], found, sheet)
    refuse_backwards(sheet, clock, t)
    return Stream.of(t, values[:, 1:] * [column.factor for column in found.of(channel)]), found
