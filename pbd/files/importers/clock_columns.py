"""Which column of a table is its clock, and times that increase, without wraps.

Times may be in two columns: whole seconds, and the part of a second, as `sec,usec` or `Time,ms`. The values tell. A
part is less than a second, and starts anew where the seconds step; milliseconds since the start of a device do not.
"""

import re
import shlex
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from pbd.data.source_columns import SourceColumns
from pbd.data.units import unit_factor
from pbd.errors import RecordingError, listed, printable, warn
from pbd.files.importers.header_names import is_device_time, is_time, plain, split_unit, time_unit
from pbd.files.table import Sheet, Table
from pbd.io.numbers import DAY_S, HOUR_S, date_order, is_stamp, seconds
from pbd.pose import Array


def dated_column(sheet: Sheet) -> str:
    """Return the first column whose dates or times of day increase from the first row to the last; "": none."""
    for name in sheet.header:
        cells = sheet.first_and_last(name)
        order = date_order(cells)
        with suppress(ValueError):
            if len(cells) == 2 and all(map(is_stamp, cells)) and seconds(cells[0], order) < seconds(cells[1], order):
                return name
    return ""


@np.errstate(invalid="ignore")
def choose_clock(
    sheet: Sheet, table: Table, clocks: Sequence[str], others: Collection[str], units: Mapping[str, str]
) -> tuple[Table, str, str]:
    """Choose the best clock; if it has whole seconds, add the part of a second from another clock, or else column.

    Args:
        others: columns that are not read, but may hold the part of a second.

    Returns:
        The table, the clock, and the name of the column with the part, or "".

    Raises:
        RecordingError: no clock has any time; or a column looks like the part of a second, but its unit is not known,
            or it falls within one.
    """
    parts = {}
    for name in clocks:
        whole = table.columns(name)[:, 0]
        for other in clocks if _in_whole_seconds(sheet, name, whole, units) else ():
            part = _seconds(other, table.columns(other)[:, 0])
            if _is_part(part) and _starts_anew(part, whole):
                table, parts[name] = _added(table, name, part), other
    clock = _best_clock(sheet.path, table, [name for name in clocks if name not in parts.values()])
    if clock in parts:
        return table, clock, parts[clock]
    whole, doubts = table.columns(clock)[:, 0], []
    candidates = [name for name in dict.fromkeys(others) if name != clock]
    for name in candidates if _in_whole_seconds(sheet, clock, whole, units) else ():
        try:
            values = (table if name in table.header else sheet.read([name])).columns(name)[:, 0]
        except RecordingError:  # a column of text
            continue
        part = _seconds(name, values)
        if _is_part(part) and _starts_anew(part, whole):
            return _added(table, clock, part), clock, name
        doubts += _doubt(sheet, name, values, whole)
    if doubts:
        what, line = doubts[0]
        raise RecordingError.at(sheet.path, f"the times in column '{printable(clock)}' are whole seconds; {what}", line)
    return table, clock, ""


def _best_clock(path: Path, table: Table, clocks: Sequence[str]) -> str:
    """Return the clock with the most distinct times; of equals the device's own, then one with a unit, then the first.

    A clock that runs backwards or stands still is the last choice.

    Raises:
        RecordingError: no clock has any time (Xsens' MT Manager writes such columns for some devices).
    """
    values = table.columns(*clocks).T
    if not np.isfinite(values).any():
        what = f"the column{'s' * (len(clocks) > 1)} {listed(clocks)} for the time "
        raise RecordingError.at(path, f"{what}hold{'s' * (len(clocks) == 1)} no number; import it with its --rate HZ")
    with np.errstate(invalid="ignore"):
        backward = [(np.diff(each) < 0.0).any() for each in values]
    distinct = [np.unique(each[np.isfinite(each)]).size for each in values]
    good = [count > 1 and not back for count, back in zip(distinct, backward, strict=True)]
    rank = [
        (good[k], distinct[k], is_device_time(name), bool(split_unit(name)[1]) or plain(name) == "seconds_elapsed", -k)
        for k, name in enumerate(clocks)
    ]
    return clocks[max(range(len(clocks)), key=rank.__getitem__)]


def numbers_of_samples(name: str, counter: Array) -> Array | None:
    """Return the number of each sample, from 0, by the values (n,) of a counter, which leap where samples were lost.

    None if most steps are not the same, so that the column counts something else; or if some are no whole ones or
    backwards, with a warning.
    """
    steps = np.diff(counter)
    steps = steps + _counter_size(counter) * (steps < 0.0)
    usual = float(np.median(steps)) if len(steps) else 0.0
    if not usual > 0.0 or np.mean(steps == usual) < 0.9:  # of ten samples at most one may be lost
        return None
    if (wrong := np.flatnonzero((steps < 0.0) | (steps % usual != 0.0))).size:
        row = int(wrong[0])
        leap = f"leaps from {counter[row]:.15g} to {counter[row + 1]:.15g} after row {row}"
        warn(
            f"the column '{name}', which counts samples, {leap}: how many are missing there is unknown; "
            "cut the file there"
        )
        return None
    return np.concatenate(([0.0], np.cumsum(steps / usual)))


def unwrapped(t: Array, found: SourceColumns, sheet: Sheet) -> Array:
    """Unwrap times (n,), s, if they are a counter that wraps, or times of day that pass midnight."""
    clock = found.of("t")[0]
    if t[0] < DAY_S and is_stamp(first := sheet.cell(clock.name, 0)[1]):
        wraps = DAY_S if first.count(":") > 1 else HOUR_S
    else:
        wraps = clock.factor * _counter_size(t / clock.factor)
    return t + wraps * np.cumsum(np.diff(t, prepend=t[0]) < -0.5 * wraps)


def _counter_size(ticks: Array) -> float:
    """Return the size of the counter, as Arduino's micros(), by which ticks (n,) drop without a lost step; 0: none."""
    whole = np.rint(ticks)
    steps = np.diff(whole)
    drops, forward = steps[steps < 0.0], steps[steps >= 0.0]
    if not (len(drops) and len(forward)) or (np.abs(ticks - whole) > 1e-3).any():
        return 0.0
    longest = 3.0 * float(np.median(forward))
    sizes = (size for size in (2.0**16, 2.0**32) if np.nanmax(ticks) < size and (drops + size <= longest).all())
    return next(sizes, 0.0)


def refuse_backwards(sheet: Sheet, name: str, t: Array) -> None:
    """Refuse a clock of t (n,) s that runs backwards, in the words and with the line of the file."""
    if (backwards := np.flatnonzero(np.diff(t) < 0.0)).size:
        row = int(backwards[0])
        (_, before), (line, after) = sheet.cell(name, row), sheet.cell(name, row + 1)
        restarted = len(backwards) == 1 and (t[row + 1 : row + 3] < t[row]).sum() == 2  # sorting would mix both parts
        do = "the device restarted, so cut the file there" if restarted else "sort the file, or cut it there"
        parts = re.fullmatch(r"(.*[.,])(\d+) \1(\d+)", f"{before} {after}")
        if parts and int(parts[2]) < int(parts[3]):  # as 7.90 and 7.100, in ms
            do = "its parts of a second lack their leading zeros, so import it with --rate HZ in place of the times"
        what = f"time runs backwards from {printable(before)} to {printable(after)} in column '{name}'; {do}"
        if (t > 0.0).all():
            what += f"; if it holds the time since the row before, import it with --column dt={name}"
        raise RecordingError.at(sheet.path, what, line, row=row + 1, value=after, bound=before)


def _doubt(sheet: Sheet, name: str, values: Array, whole: Array) -> list[tuple[str, int | None]]:
    """Say what is wrong with a column (n,) that looks like the part of whole seconds (n,), and in which line."""
    steps, looks = np.diff(values), f"the column '{printable(name)}' looks like the part of a second"
    counts = np.median(steps) == 1.0  # the samples of each second
    if _starts_anew(values, whole) and 2 * (steps > 0.0).sum() > len(steps) and not counts:
        next_step = f"name it with its unit, as '{printable(split_unit(name)[0])} (ms)', or remove it"
        return [(f"{looks}, but its name has no unit that fits; {next_step}", None)]
    falls = np.flatnonzero((steps < 0.0) & (np.diff(whole) == 0.0))
    if not (len(falls) and is_time(name) and _is_part(_seconds(name, values))):
        return []
    line, cell = sheet.cell(name, int(falls[0]) + 1)
    option = f"--column {shlex.quote(f'dt={printable(name)}')}"
    next_step = f"correct or remove it; if it is the time since the row before, import it with {option}"
    return [(f"{looks}, but falls to {cell} within one; {next_step}", line)]


def _in_whole_seconds(sheet: Sheet, name: str, values: Array, units: Mapping[str, str]) -> bool:
    unit = "s" if is_stamp(sheet.cell(name, 0)[1]) else units.get("t") or time_unit(name) or "s"
    values = values[np.isfinite(values)]
    steps = np.diff(values)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    return unit_factor("t", unit) == usual == 1.0 and not (values % 1.0).any()


def _seconds(name: str, values: Array) -> Array:
    """Values in s, by the unit that the column's name tells; NaN: it tells none."""
    return values * (unit_factor("t", time_unit(name)) or np.nan)


def _is_part(values: Array) -> bool:
    """Whether values (n,), s, are parts of a second."""
    return bool(np.isfinite(values).any() and ((values >= 0.0) & (values < 1.0) | np.isnan(values)).all())


def _starts_anew(part: Array, whole: Array) -> bool:
    """Whether parts (n,) never fall within a whole second (n,), and fall where most of these step."""
    falls, steps = np.diff(part) < 0.0, np.diff(whole) != 0.0
    return not falls[~steps].any() and 2 * int(falls[steps].sum()) > int(steps.sum())


def _added(table: Table, name: str, part: Array) -> Table:
    values = table.values.copy()
    values[:, table.header.index(name)] += part
    return replace(table, values=values)
