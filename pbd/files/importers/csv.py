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

from pbd.data import Demonstration, Recording, RecordingInfo
from pbd.data.imu_columns import ACC, rpy_from_compass
from pbd.data.one_line_repr import counted
from pbd.data.source_columns import CHANNELS, DATES, SourceColumns
from pbd.data.streams import RATE_TOLERANCE, Stream, joined
from pbd.data.units import unit_factor
from pbd.errors import RecordingError, listed, warn
from pbd.files.header_line import without_thousands
from pbd.files.importers.clock_columns import (
    choose_clock,
    dated_column,
    numbers_of_samples,
    refuse_backwards,
    unwrapped,
)
from pbd.files.importers.columns import PROGRAMS, remapped, scaled, understand
from pbd.files.importers.gravity_columns import add_rest, parts_of_force
from pbd.files.importers.grip_column import read_grip
from pbd.files.importers.header_names import is_counter, is_time, is_time_step, own_times_of, plain, time_unit
from pbd.files.importers.printed_lines import is_printed, printed_sheet
from pbd.files.importers.refuse_several_devices import refuse_alternating_devices, refuse_several_devices
from pbd.files.importers.request import Request, check_rate
from pbd.files.importers.rows_of_sensors import with_columns_for_each_sensor
from pbd.files.importers.ximu3 import INERTIAL, files_of_ximu3, magnetometer_beside
from pbd.files.table import Sheet, Table, foreign_text, open_sheet
from pbd.io.numbers import is_stamp
from pbd.pose import Array

TEXT = (".csv", ".txt", ".tsv", ".log", ".lvm", ".gcsv")


def read_csv(request: Request) -> Demonstration | None:
    """Read a recording from a table with a header, or from lines with names beside the numbers; None: it is no text.

    If an x-IMU3's Inertial.csv has no magnetometer, the one beside it is joined. The column `dt` that a caller names is
    the time since the row before, in place of t.

    Raises:
        RecordingError: a column or unit is missing or unknown, or the file is not a table.
    """
    path, files = request.path, files_of_ximu3(request.path)
    if request.suffix == ".zip" and files:
        path = path / INERTIAL
    elif request.suffix not in TEXT:
        return None
    given = {ours: name for ours, name in request.columns.items() if ours not in request.beside}
    grip_column = given.pop("grip", "")
    text = foreign_text(path, files[path.stem]() if files else None)
    sheet, rate_hz = _opened(replace(request, path=path), text), request.rate_hz
    if rate_hz is None:  # else it is not known of which rows it is the rate
        sheet = with_columns_for_each_sensor(sheet)
    units = request.units if rate_hz is None else {"t": "s", **request.units}  # of times that are not read
    refuse_several_devices(sheet)
    found, in_steps = _understood(sheet, given, units, rate_hz)
    gravity, other_parts = parts_of_force(sheet.header, found)
    if gravity:
        given = {**gravity, **given}
        found, in_steps = _understood(sheet, given, units, rate_hz)
    if rate_hz is None and not found.of("t"):
        rate_hz = _rate_of_remarks(sheet)
    _refuse_missing(sheet, found, rate_hz)
    refuse_alternating_devices(sheet, found)
    if found.of("t"):
        table, found, own = _timed(sheet, found, given, units, in_steps)
    else:
        table, own = sheet.read([column.name for column in found.columns]), {}
    with np.errstate(all="ignore"):  # infinite values are repaired later, like other invalid samples
        channels = {channel: scaled(table, found, channel) for channel in CHANNELS if found.of(channel)}
        found, magnetometer = magnetometer_beside(path, files, found, units)
        if gravity:
            channels["acc"] = add_rest(sheet, channels["acc"], found, other_parts)
            for column in found.of("acc"):
                by = "--column" if column.ours in request.columns else "its name"
                found = found.with_column(column.name, named_by=by)
                found = found.with_unread({other_parts[column.name]: f"added to {column.name}"})
        for channel in {"angle", "rpy"} & channels.keys():  # WitMotion leaves an output that is off empty
            if not np.isfinite(channels[channel]).any():
                found = found.without(channel, "no number in any row")
                del channels[channel]
        if "t" in channels:
            steps = channels["t"][:, 0]
            t = unwrapped(np.cumsum(steps) if in_steps else steps, found, sheet)
        else:
            t, counted_by = _at_rate(sheet, rate_hz or 1.0, len(table.values))
            found = found.with_unread(counted_by)
        read_as_grip, grip = read_grip(sheet, grip_column, t - t[np.isfinite(t)][0])
        found = found.with_unread(read_as_grip)
        if "t" in channels:
            t, channels = _with_times(sheet, table, found, t, channels, own)
        mag, compass = channels.get("mag"), channels.get("angle")
        sensor = next((program.sensor for program in PROGRAMS if program.title == found.program), "unknown")
        recording = Recording(
            t=t - t[0],
            acc=channels["acc"],
            gyr=channels.get("gyr"),
            mag=magnetometer.at(t) if mag is None and magnetometer is not None else mag,
            device_rpy=channels.get("rpy") if compass is None else rpy_from_compass(compass),
            grip=grip,
            info=RecordingInfo(sensor=sensor, rate_hz=rate_hz, source=found),
        )
        recording = _without_repeats(path, recording)
    return Demonstration(remapped(path, recording, request.beside))


def _opened(request: Request, text: str) -> Sheet:
    """Open a table, or convert printed lines to one."""
    path, rate_hz = request.path, request.rate_hz
    sheet = printed_sheet(path, text) if is_printed(text) else open_sheet(path, foreign=True, text=text)
    if rate_hz is not None:
        check_rate(path, rate_hz, "the rate is")
    unit = request.units.get("t") or ("s" if rate_hz is not None else "")
    if any((unit_factor("t", unit or time_unit(name)) or 1.0) < 1.0 for name in sheet.header):
        sheet = replace(sheet, body=without_thousands(sheet.body, sheet.delimiter))  # `100.010` may be ms, not s
    if (top := sheet.body[:5000].rpartition("\n")[0]) and '"' not in top:
        replace(sheet, body=top).read(())  # the first rows: wider ones are refused before names are asked for
    return sheet


def _rate_of_remarks(sheet: Sheet) -> float | None:
    """Return the rate of the samples that lines above the header tell; None: none, or several."""
    sampling = r"(?im)(?:^|[:;,])\W*(?:(?:update|sampl\w+|data|output)[ _]?)+rate\W{1,3}(\d+\.?\d*)\s?hz"
    rates = set(map(float, re.findall(sampling, sheet.preamble)))
    if len(rates) != 1:
        return None
    (rate_hz,) = rates
    check_rate(sheet.path, rate_hz, "the rate above the header is")
    return rate_hz


def _understood(
    sheet: Sheet, given: Mapping[str, str], units: Mapping[str, str], rate_hz: float | None
) -> tuple[SourceColumns, bool]:
    """Find which column contains what, and whether the time is that since the row before. With a rate it is not read.

    A column of dates is recognised by its contents: it may have any name.
    """
    columns = {"t" if ours == "dt" else ours: name for ours, name in given.items()}
    found = understand(sheet, columns, units)
    if rate_hz is not None and (wrong := found.of("t")):
        name = wrong[0].name
        other = _other_rate(sheet, name, rate_hz)
        warn(f"{sheet.path}: --rate {rate_hz:g} is used instead of the times in the column '{name}'{other}")
        found = found.without("t", "--rate is used instead")
    elif rate_hz is None and not found.of("t"):
        if dates := dated_column(sheet):
            return understand(sheet, {**columns, "t": dates}, units).with_column(dates, named_by=DATES), False
        if steps := next(filter(is_time_step, sheet.header), ""):
            found = understand(sheet, {**columns, "t": steps}, units)
            return found.with_column(steps, named_by="its name: steps of time"), True
    return found, "dt" in given


def _refuse_missing(sheet: Sheet, found: SourceColumns, rate_hz: float | None) -> None:
    """Refuse a table without times, without an accelerometer, or without an axis of a sensor."""
    path, known = sheet.path, f"the columns are {listed(sheet.header)}"
    say = "import it with --column for each, for example --column ax=NAME"
    if not found.of("t") and rate_hz is None:
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
            raise RecordingError.at(
                path, f"{what}; {known}: import it with --column {missing[0]}=NAME", value=missing[0]
            )


def _timed(
    sheet: Sheet, found: SourceColumns, given: Mapping[str, str], units: Mapping[str, str], in_steps: bool
) -> tuple[Table, SourceColumns, dict[str, str]]:
    """Read the rows with the best clock of several; also return the columns of the gyro's and the magnetometer's times.

    Raises:
        RecordingError: a cell is no number, no clock is good, or a date has a unit.
    """
    clocks = [column.name for column in found.of("t")]
    if found.of("t")[0].named_by == "its name":
        clocks = [name for name in sheet.header if is_time(name)]
    measured = [channel for channel in ("gyr", "mag") if found.of(channel)]
    own = {channel: name for channel in measured for name in sheet.header if own_times_of(name) == channel[0]}
    stamped = [*clocks, *own.values()]
    table = sheet.read([*(column.name for column in found.columns), *stamped], times=stamped)
    read = {"", *(column.name for column in found.columns if column.ours != "t")}
    unread = () if in_steps else [name for name in sheet.header if name not in read]
    table, best, part = choose_clock(sheet, table, clocks, unread, units)
    if best != found.of("t")[0].name:
        found = understand(sheet, {**given, "t": best}, units)
        found = found.with_column(best, named_by="the best of several times")
    if is_stamp(sheet.cell(best, 0)[1]):
        if "t" in units:
            what = f"the column '{best}' has dates or times of day, whose unit is known; leave --unit t out"
            raise RecordingError.at(sheet.path, what)
        found = found.with_column(best, unit="s", unit_by=DATES)  # whatever its name says
    if part:
        found = found.with_unread({part: f"read with {best}"})
    if own_times_of(best) != "a":
        own = {}  # those of the rows may be of another clock
    return table, found.with_unread(dict.fromkeys(own.values(), "its sensor's times")), own


def _at_rate(sheet: Sheet, rate_hz: float, rows: int) -> tuple[Array, dict[str, str]]:
    """Return the times of rows at a rate, and which column shows that samples are missing, if there is one."""
    name = next(filter(is_counter, sheet.header), "")
    numbers = numbers_of_samples(name, sheet.read([name]).values[:, 0]) if name else None
    if numbers is None:
        return np.arange(rows) / rate_hz, {}
    return numbers / rate_hz, {name: "the rate is used, and this shows which samples are missing"}


def _with_times(
    sheet: Sheet, table: Table, found: SourceColumns, t: Array, channels: Mapping[str, Array], own: Mapping[str, str]
) -> tuple[Array, dict[str, Array]]:
    """Leave out rows without any number; join sensors with rows, or times of their own (`own`: their columns)."""
    clock = found.of("t")[0]
    refuse_backwards(sheet, clock.name, t)
    filled = ~np.isnan(table.values).all(axis=1)  # spreadsheets write rows of empty cells
    rows = slice(None) if filled.all() else filled
    t, read = t[rows], {channel: values[rows] for channel, values in channels.items()}
    times = {}
    for channel, name in own.items():
        its = unwrapped(clock.factor * table.columns(name)[:, 0], found, sheet)
        refuse_backwards(sheet, name, its)
        if not np.array_equal(its[rows], t, equal_nan=True):
            times[channel] = its[rows]
    return _joined(t, read, times) or (t, read)


def _joined(
    t: Array, channels: Mapping[str, Array], times: Mapping[str, Array]
) -> tuple[Array, dict[str, Array]] | None:
    """Join accelerometer, gyro and magnetometer if they have rows or `times` of their own; None: they share both."""
    known = {name: np.isfinite(channels[name]).all(axis=1) for name in ("acc", "gyr", "mag") if name in channels}
    acc, gyr = known["acc"], known.get("gyr", known["acc"])
    alone = 2 * (acc & gyr).sum() < min(acc.sum(), gyr.sum())
    apart = alone or (acc | gyr).mean() <= 0.95  # else rows without both are losses
    if not times and not (apart and (np.diff(t[gyr]) > 0.0).all()):
        return None
    at, values = joined({name: Stream.of(times.get(name, t), channels[name]) for name in known})
    return (at, values) if len(at) > 1 else None  # else there are holes in every row


def _without_repeats(path: Path, recording: Recording) -> Recording:
    """Leave out rows that repeat the row before with its time, if most do, and samples don't share coarse times."""
    known = np.isfinite(recording.t)
    if not len(steps := np.diff(recording.t[known])) or np.median(steps) > 0.0:
        return recording
    channels: dict[str, Any] = {"t": recording.t, **recording.channels}
    rows = np.column_stack(list(channels.values()))
    kept = np.concatenate(([True], ~((rows[1:] == rows[:-1]) | np.isnan(rows[1:]) & np.isnan(rows[:-1])).all(axis=1)))
    left = np.diff(recording.t[kept & known])
    if not len(left) or not np.median(left) > 0.0:
        return recording
    warn(f"{path}: {counted(int((~kept).sum()), 'row')} that repeat the row before are left out")
    return replace(recording, **{name: values[kept] for name, values in channels.items()})


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
