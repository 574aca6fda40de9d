"""Tables with a header: our imu.csv, those of x-io, WitMotion, Movella and Shimmer, or any with recognisable names.

`columns.py` finds what the columns mean. Without a unit, SI is assumed; tracking refuses a specific force whose norm at
rest is not gravity.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pbd.data import Recording, RecordingInfo
from pbd.data.imu_columns import ACC, device_rpy
from pbd.data.one_line_repr import counted
from pbd.data.source_columns import CHANNELS, DATES, Column, SourceColumns
from pbd.data.streams import RATE_TOLERANCE, Stream, joined
from pbd.data.units import unit_factor
from pbd.errors import RecordingError, listed, warn
from pbd.files.header_line import without_thousands
from pbd.files.importers import XIO_FILE, check_rate
from pbd.files.importers.clock_columns import (
    choose_clock,
    dated_column,
    numbers_of_samples,
    refuse_backwards,
    unwrapped,
)
from pbd.files.importers.columns import PROGRAMS, WHY_UNUSED, understand
from pbd.files.importers.grip_column import read_grip
from pbd.files.importers.header_names import is_counter, is_time, is_time_step, own_times_of, plain, time_unit
from pbd.files.importers.printed_lines import is_printed, printed_sheet
from pbd.files.importers.refuse_several_devices import refuse_alternating_devices, refuse_several_devices
from pbd.files.table import Sheet, Table, foreign_text, open_sheet
from pbd.io.numbers import is_stamp
from pbd.pose import Array

OTHERS_ROWS = 0.05
"""Smallest share of rows without accelerometer and gyro that are taken for another sensor's rows, not for losses."""

TOP = 5000
"""Number of characters of the first rows, whose number of cells is compared with the header's."""


def read_csv(
    path: Path, columns: Mapping[str, str], units: Mapping[str, str], rate_hz: float | None = None
) -> Recording:
    """Read a recording from a table with a header.

    Args:
        path: the file. If it has no magnetometer, x-io's Magnetometer.csv beside it is joined by its time.
        columns: our name -> the file's column, if the header doesn't tell; -NAME reverses the sign. `dt` is the time
            since the row before, in place of t.
        units: channel (t, gyr, acc, mag, angle) -> unit, if the header doesn't tell; -UNIT reverses the sign.
        rate_hz: row k is at k / rate_hz s; for a table without times, or with wrong ones.

    Raises:
        RecordingError: a column or unit is missing or unknown, or the file is not a table.
    """
    text = foreign_text(path)
    sheet = printed_sheet(path, text) if is_printed(text) else open_sheet(path, foreign=True, text=text)
    del text  # as large as the file
    of_remarks = re.search(r"(?im)^\W*update rate\s*:\s*([\d.]+)\s*hz", sheet.preamble)  # MT Manager's
    if rate_hz is None and of_remarks and not any(map(is_time, sheet.header)) and not {"t", "dt"} & {*columns}:
        rate_hz = float(of_remarks[1])
    if rate_hz is not None:
        check_rate(path, rate_hz, "the rate is")
        units = {"t": "s", **units}  # of times that are not read
    if any((unit_factor("t", units.get("t") or time_unit(name)) or 1.0) < 1.0 for name in sheet.header):
        sheet = replace(sheet, body=without_thousands(sheet.body, sheet.delimiter))  # `100.010` may be ms, not s
    if (top := sheet.body[:TOP].rpartition("\n")[0]) and '"' not in top:
        replace(sheet, body=top).read(())  # refuses rows that are wider than the header before names are asked for
    refuse_several_devices(sheet)
    in_steps = "dt" in columns
    given = columns
    columns = {"t" if ours == "dt" else ours: name for ours, name in columns.items() if ours != "grip"}
    found = understand(sheet, columns, units)
    if not found.of("t") and rate_hz is None and (dates := dated_column(sheet)):
        # A column of dates is recognised by its contents: it may have any name.
        columns = {**columns, "t": dates}
        found = understand(sheet, columns, units).with_column(dates, named_by=DATES)
    elif not found.of("t") and rate_hz is None and (steps := next(filter(is_time_step, sheet.header), "")):
        in_steps, columns = True, {**columns, "t": steps}
        found = understand(sheet, columns, units).with_column(steps, named_by="its name: steps of time")
    if rate_hz is not None and (wrong := found.of("t")):
        name = wrong[0].name
        other = _other_rate(sheet, name, rate_hz)
        warn(f"{path}: --rate {rate_hz:g} is used instead of the times in the column '{name}'{other}")
        others = tuple(column for column in found.columns if column not in wrong)
        found = replace(found, columns=others).with_unread({name: "--rate is used instead"})
    timed = bool(found.of("t"))
    known = f"the columns are {listed(sheet.header)}"
    say = "import it with --column for each, for example --column ax=NAME"
    if not timed and rate_hz is None:
        what = f"no column for t (time); {known}: {say.replace('ax=', 't=')}, or with its --rate HZ"
        raise RecordingError.at(path, what)
    if not found.of("acc"):
        without = [name for name, why in found.unread.items() if "gravity" in why and "gravity" not in plain(name)]
        why = f"; {listed(without)} are without gravity, which is needed" if without else ""
        raise RecordingError.at(path, f"no column for {', '.join(ACC)} (specific force){why}; {known}: {say}")
    for channel, wanted in CHANNELS.items():
        present = [column.ours for column in found.of(channel)]
        if missing := [name for name in wanted if present and name not in present]:
            what = f"no column for '{missing[0]}', though there is '{present[0]}'"
            raise RecordingError.at(path, f"{what}; {known}: name it with --column {missing[0]}=NAME", value=missing[0])
    clocks = [column.name for column in found.of("t")]
    if timed and "t" not in columns:
        clocks = [name for name in sheet.header if is_time(name)]
    own = {channel: name for channel in ("gyr", "mag") for name in sheet.header if own_times_of(name) == channel[0]}
    own = {channel: name for channel, name in own.items() if timed and found.of(channel)}
    stamped = [*clocks, *own.values()]
    refuse_alternating_devices(sheet, found)
    counter = [name for name in sheet.header if is_counter(name)][:1] if rate_hz is not None else []
    table = sheet.read([*(column.name for column in found.columns), *stamped, *counter], times=stamped)
    if timed:
        read = {"", *(column.name for column in found.columns if column.ours != "t")}
        unread = () if in_steps else [name for name in sheet.header if name not in read]
        table, best, part = choose_clock(sheet, table, clocks, unread, units)
        if best != found.of("t")[0].name:
            found = understand(sheet, {**columns, "t": best}, units)
            found = found.with_column(best, named_by="the best of several times")
        if is_stamp(sheet.cell(best, 0)[1]):
            if "t" in units:
                what = f"the column '{best}' has dates or times of day, whose unit is known; leave --unit t out"
                raise RecordingError.at(path, what)
            found = found.with_column(best, unit="s", unit_by=DATES)  # whatever its name says
        if part:
            found = found.with_unread({part: f"read with {best}"})
        if own_times_of(best) != "a":
            own = {}  # those of the rows may be of another clock
        found = found.with_unread(dict.fromkeys(own.values(), "its sensor's times"))

    understood, beside = _magnetometer_beside(path, found, units)
    with np.errstate(all="ignore"):  # infinite values are repaired later, like other invalid samples
        channels = {channel: _values(table, found.of(channel)) for channel in CHANNELS if found.of(channel)}
        for channel in {"angle", "rpy"} & channels.keys():  # WitMotion leaves an output that is off empty
            if not np.isfinite(channels[channel]).any():
                empty = dict.fromkeys((column.name for column in understood.of(channel)), "no number in any row")
                kept = tuple(column for column in understood.columns if column.name not in empty)
                understood = replace(understood, columns=kept).with_unread(empty)
                del channels[channel]
        if in_steps:
            channels["t"] = np.cumsum(channels["t"], axis=0)
        clock = channels.get("t")
        numbers = numbers_of_samples(counter[0], table.columns(*counter)[:, 0]) if counter else None
        if numbers is not None:
            understood = understood.with_unread(
                {counter[0]: "the rate is used, and this shows which samples are missing"}
            )
        if clock is None:
            t = (np.arange(len(table.values)) if numbers is None else numbers) / (rate_hz or 1.0)
        else:
            t = unwrapped(clock[:, 0], found, sheet)
        grip_name, grip = read_grip(sheet, given, t - t[np.isfinite(t)][0])
        if grip_name:
            does = (f"{'closes' if event.closed else 'opens'} at {event.t:.1f} s" for event in grip)
            understood = understood.with_unread({grip_name: f"read as the grip: {listed(does) or 'always open'}"})
        if clock is not None:
            refuse_backwards(sheet, found.of("t")[0].name, t)
            filled = ~np.isnan(table.values).all(axis=1)  # spreadsheets write rows of empty cells
            t, channels = t[filled], {channel: values[filled] for channel, values in channels.items()}
            times = {}
            for channel, name in own.items():
                its = unwrapped(found.of("t")[0].factor * table.columns(name)[:, 0], found, sheet)
                refuse_backwards(sheet, name, its)
                if not np.array_equal(its[filled], t, equal_nan=True):
                    times[channel] = its[filled]
            if (apart := _joined(t, channels, times)) is not None:
                t, channels = apart
        mag, compass = channels.get("mag"), channels.get("angle")
        sensor = next((program.sensor for program in PROGRAMS if program.title == understood.program), "unknown")
        recording = Recording(
            t=t - t[0],
            acc=channels["acc"],
            gyr=channels.get("gyr"),
            mag=beside.at(t) if mag is None and beside is not None else mag,
            device_rpy=channels.get("rpy") if compass is None else device_rpy(compass),
            grip=grip,
            info=RecordingInfo(sensor=sensor, rate_hz=rate_hz, source=understood),
        )
    return _without_repeats(path, recording) if timed else recording


def _joined(
    t: Array, channels: Mapping[str, Array], times: Mapping[str, Array]
) -> tuple[Array, dict[str, Array]] | None:
    """Join accelerometer, gyro and magnetometer if they have rows or `times` of their own; None: they share both."""
    known = {name: np.isfinite(channels[name]).all(axis=1) for name in ("acc", "gyr", "mag") if name in channels}
    acc, gyr = known["acc"], known.get("gyr", known["acc"])
    alone = 2 * (acc & gyr).sum() < min(acc.sum(), gyr.sum())
    apart = alone or (acc | gyr).mean() <= 1.0 - OTHERS_ROWS
    if not times and not (apart and (np.diff(t[gyr]) > 0.0).all()):
        return None
    at, values = joined({name: Stream.of(times.get(name, t), channels[name]) for name in known})
    return (at, values) if len(at) > 1 else None  # else there are holes in every row


def _without_repeats(path: Path, recording: Recording) -> Recording:
    """Leave out rows that repeat the row before with its time, if most do, and samples don't share coarse times."""
    channels: dict[str, Any] = {"t": recording.t, **recording.channels}
    rows = np.column_stack(list(channels.values()))
    kept = np.concatenate(([True], ~((rows[1:] == rows[:-1]) | np.isnan(rows[1:]) & np.isnan(rows[:-1])).all(axis=1)))
    steps, left = np.diff(recording.t), np.diff(recording.t[kept])
    if not len(left) or np.median(steps) > 0.0 or not np.median(left) > 0.0:
        return recording
    warn(f"{path}: {counted(int((~kept).sum()), 'row')} that repeat the row before are left out")
    return replace(recording, **{name: values[kept] for name, values in channels.items()})


def _values(table: Table, columns: list[Column]) -> Array:
    return table.columns(*(column.name for column in columns)) * [column.factor for column in columns]


def _other_rate(sheet: Sheet, name: str, rate_hz: float) -> str:
    """What the times of a column say against the given rate; "" if they agree, or their unit is unknown."""
    try:
        t = (unit_factor("t", time_unit(name)) or np.nan) * sheet.read([name]).columns(name)[:, 0]
    except RecordingError:  # dates, or no numbers
        return ""
    lasts = float(t[-1] - t[0])
    own_hz = (len(t) - 1) / lasts if lasts > 0.0 else rate_hz
    if abs(own_hz / rate_hz - 1.0) <= RATE_TOLERANCE:
        return ""
    return (
        f", by which the samples come at {own_hz:.4g} Hz: if they are right, every distance comes out "
        f"{(own_hz / rate_hz) ** 2:.2f} times its true value"
    )


def _magnetometer_beside(
    path: Path, found: SourceColumns, units: Mapping[str, str]
) -> tuple[SourceColumns, Stream | None]:
    """Read x-io's Magnetometer.csv beside its Inertial.csv; both have the device's time. List the other files."""
    if path.name != XIO_FILE:
        return found, None
    stream, beside = None, path.with_name("Magnetometer.csv")
    if beside.is_file() and not found.of("mag"):
        sheet = open_sheet(beside, foreign=True)
        other = understand(sheet, {}, units)
        if other.of("t") and len(other.of("mag")) == len(CHANNELS["mag"]):
            table = sheet.read([column.name for column in other.columns])
            stream = Stream.of(_values(table, other.of("t"))[:, 0], _values(table, other.of("mag")))
            found = found.with_file(beside.name, other)
    others = {file.name for file in path.parent.glob("*.csv")} - {path.name, *((beside.name,) if stream else ())}
    return found.with_unread(dict.fromkeys(sorted(others), WHY_UNUSED)), stream
