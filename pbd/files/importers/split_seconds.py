"""Times in two columns: whole seconds, and the part of a second, as `sec,usec` or `Time,ms`.

The values tell. A part is less than a second, and starts anew where the seconds step; milliseconds since the start of a
device do not.
"""

from __future__ import annotations

import shlex
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from pbd.data.units import UNITS, unit_factor
from pbd.errors import RecordingError, printable
from pbd.files.importers.header_names import is_time, time_unit
from pbd.files.table import Sheet, Table
from pbd.io.numbers import is_stamp
from pbd.pose import Array


def with_parts(
    sheet: Sheet, table: Table, clocks: Collection[str], units: Mapping[str, str]
) -> tuple[Table, dict[str, str]]:
    """Add to each clock of whole seconds the clock that has the part of a second; return clock -> part too."""
    parts = {}
    for name in clocks:
        if _has_whole_seconds(sheet, table, name, units):
            for other in clocks:
                if _is_part(part := _part(table, other)) and _starts_anew(part, table.columns(name)[:, 0]):
                    table, parts[name] = _added(table, name, part), other
                    break
    return table, parts


def with_unread_part(
    sheet: Sheet, table: Table, clock: str, unread: Collection[str], units: Mapping[str, str]
) -> tuple[Table, dict[str, str]]:
    """Do the same for the clock that is used, with all columns that are not read.

    Raises:
        RecordingError: a column looks like the part of a second, but its unit is not known, or no second fits it.
    """
    if not _has_whole_seconds(sheet, table, clock, units):
        return table, {}
    doubt, whole = "", table.columns(clock)[:, 0]
    for name in dict.fromkeys(unread):
        with suppress(RecordingError):  # a column of text
            values = (table if name in table.header else sheet.read([name])).columns(name)[:, 0]
            part, steps, anew = _factor(name) * values, np.diff(values), _starts_anew(values, whole)
            if _is_part(part) and anew:
                return _added(table, clock, part), {clock: name}
            looks = f"the column '{printable(name)}' looks like the part of a second, but"
            if anew and 2 * (steps > 0.0).sum() > len(steps):
                unit = next((unit for unit in ("s", "ms", "us") if values.max() * UNITS["t"][unit] < 1.0), "ns")
                doubt = doubt or f"{looks} its unit is not known; if it is {unit}, call it '{printable(name)}_{unit}'"
            elif _is_part(part) and is_time(name) and (steps < 0.0).any():
                option = f"--column {shlex.quote(f'dt={printable(name)}')}"
                next_step = f"correct or remove it; if it is the time since the row before, import it with {option}"
                doubt = doubt or f"{looks} does not start anew where the seconds step; {next_step}"
    if doubt:
        raise RecordingError.at(sheet.path, f"the times in column '{printable(clock)}' are whole seconds; {doubt}")
    return table, {}


def _has_whole_seconds(sheet: Sheet, table: Table, name: str, units: Mapping[str, str]) -> bool:
    unit = "s" if is_stamp(sheet.cell(name, 0)[1]) else units.get("t") or time_unit(name) or "s"
    values = table.columns(name)[:, 0]
    values = values[np.isfinite(values)]
    steps = np.diff(values)
    steps_up = steps[steps > 0.0]
    return (
        unit_factor("t", unit) == 1.0
        and (values % 1.0 == 0.0).all()
        and bool(len(steps_up))
        and np.median(steps_up) == 1.0
    )


def _part(table: Table, name: str) -> Array:
    return _factor(name) * table.columns(name)[:, 0]


def _factor(name: str) -> float:
    """Return the factor to s of the unit that a column's name tells; NaN: none."""
    return unit_factor("t", time_unit(name) or "?") or float("nan")


def _is_part(values: Array) -> bool:
    """Whether values (n,), s, are parts of a second."""
    return bool(np.isfinite(values).any() and ((values >= 0.0) & (values < 1.0) | np.isnan(values)).all())


def _starts_anew(part: Array, whole: Array) -> bool:
    """Whether parts (n,) rise within each of the whole seconds (n,), and drop where most of these step."""
    steps, drops = np.diff(whole) != 0.0, np.diff(part) < 0.0
    return not drops[~steps].any() and 2 * drops[steps].sum() > steps.sum()


def _added(table: Table, name: str, part: Array) -> Table:
    values = table.values.copy()
    values[:, table.header.index(name)] += part
    return replace(table, values=values)
