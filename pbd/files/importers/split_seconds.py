"""Times in two columns: whole seconds, and the part of a second, as `sec,usec` or `Time,ms`.

The values tell. A part is less than a second, and starts anew where the seconds step; milliseconds since the start of a
device do not.
"""

from __future__ import annotations

import shlex
from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from pbd.data.units import unit_factor
from pbd.errors import RecordingError, printable
from pbd.files.importers.header_names import is_time, split_unit, time_unit
from pbd.files.table import Sheet, Table
from pbd.io.numbers import is_stamp
from pbd.pose import Array


@np.errstate(invalid="ignore")
def with_parts(
    sheet: Sheet, table: Table, clocks: Collection[str], units: Mapping[str, str]
) -> tuple[Table, dict[str, str]]:
    """Add to each clock of whole seconds the clock that has the part of a second; return clock -> part too."""
    parts = {}
    for name in clocks:
        whole = table.columns(name)[:, 0]
        for other in clocks if _in_whole_seconds(sheet, name, whole, units) else ():
            part = _seconds(other, table.columns(other)[:, 0])
            if _is_part(part) and _starts_anew(part, whole):
                table, parts[name] = _added(table, name, part), other
    return table, parts


@np.errstate(invalid="ignore")
def with_unread_part(
    sheet: Sheet, table: Table, clock: str, unread: Collection[str], units: Mapping[str, str]
) -> tuple[Table, dict[str, str]]:
    """Do the same for the clock that is used, with all columns that are not read.

    Raises:
        RecordingError: a column looks like the part of a second, but its unit is not known, or it falls within one.
    """
    whole, doubts = table.columns(clock)[:, 0], []
    for name in dict.fromkeys(unread) if _in_whole_seconds(sheet, clock, whole, units) else ():
        try:
            values = (table if name in table.header else sheet.read([name])).columns(name)[:, 0]
        except RecordingError:  # a column of text
            continue
        part = _seconds(name, values)
        if _is_part(part) and _starts_anew(part, whole):
            return _added(table, clock, part), {clock: name}
        doubts += _doubt(sheet, name, values, whole)
    if doubts:
        what, line = doubts[0]
        raise RecordingError.at(sheet.path, f"the times in column '{printable(clock)}' are whole seconds; {what}", line)
    return table, {}


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
    return values * (unit_factor("t", time_unit(name) or "?") or np.nan)


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
