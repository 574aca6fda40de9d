"""Which column of a table is its clock, and times that increase, without wraps."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np

from pbd.data.source_columns import SourceColumns
from pbd.errors import RecordingError, listed, warn
from pbd.files.importers.header_names import is_device_time, plain, split_unit
from pbd.files.table import Sheet, Table
from pbd.io.numbers import DAY_S, HOUR_S, date_order, is_stamp, seconds
from pbd.pose import Array

COUNTER_SIZES, LONGEST_COUNT = (2.0**16, 2.0**32), 3.0
"""Numbers of values of a device's counter, and its longest step, as a multiple of the usual one, when it wraps."""

MOST_STEPS = 0.9
"""Smallest share of equal steps in a column that counts samples: of ten samples at most one may be lost."""


def dated_column(sheet: Sheet) -> str:
    """Return the first column whose dates or times of day increase from the first row to the last; "": none."""
    for name in sheet.header:
        cells = sheet.first_and_last(name)
        order = date_order(cells)
        with suppress(ValueError):
            if len(cells) == 2 and all(map(is_stamp, cells)) and seconds(cells[0], order) < seconds(cells[1], order):
                return name
    return ""


def best_clock(path: Path, table: Table, clocks: list[str]) -> str:
    """Return the clock with the most distinct times; of equals the device's own, then one with a unit, then the first.

    A clock that runs backwards is the last choice.

    Raises:
        RecordingError: no clock has any time (Xsens' MT Manager writes such columns for some devices).
    """
    values = table.columns(*clocks).T
    if not np.isfinite(values).any():
        what = f"the column{'s' * (len(clocks) > 1)} {listed(clocks)} for the time "
        raise RecordingError.at(path, f"{what}hold{'s' * (len(clocks) == 1)} no number; import it with its --rate HZ")
    with np.errstate(invalid="ignore"):
        forward = [not (np.diff(each) < 0.0).any() for each in values]
    distinct = [np.unique(each[np.isfinite(each)]).size for each in values]
    rank = [
        (ahead, count, is_device_time(name), bool(split_unit(name)[1]) or plain(name) == "seconds_elapsed", -k)
        for k, (name, ahead, count) in enumerate(zip(clocks, forward, distinct, strict=True))
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
    if not usual > 0.0 or np.mean(steps == usual) < MOST_STEPS:
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
    longest = LONGEST_COUNT * float(np.median(forward))
    sizes = (size for size in COUNTER_SIZES if ticks.max() < size and (drops + size <= longest).all())
    return next(sizes, 0.0)


def refuse_backwards(sheet: Sheet, name: str, t: Array) -> None:
    """Refuse a clock of t (n,) s that runs backwards, in the words and with the line of the file."""
    if (backwards := np.flatnonzero(np.diff(t) < 0.0)).size:
        row = int(backwards[0])
        (_, before), (line, after) = sheet.cell(name, row), sheet.cell(name, row + 1)
        restarted = len(backwards) == 1 and (t[row + 1 : row + 3] < t[row]).sum() == 2  # sorting would mix both parts
        do = "the device restarted, so cut the file there" if restarted else "sort the file, or cut it there"
        what = f"time runs backwards from {before} to {after} in column '{name}'; {do}"
        if (t > 0.0).all():
            what += f"; if it holds the time since the row before, import it with --column dt={name}"
        raise RecordingError.at(sheet.path, what, line, row=row + 1, value=after, bound=before)
