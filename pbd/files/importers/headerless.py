"""Recordings without a table's header: the list of their columns, and `--column` and `--unit` to correct them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from pbd.data import Recording
from pbd.data.source_columns import CHANNEL_OF, CHANNELS, Column, SourceColumns
from pbd.data.units import UNITS, unit_factor
from pbd.errors import RecordingError, UsageError, listed, printable


def with_source(
    recording: Recording,
    names: Mapping[str, str],
    by: str,
    unread: Mapping[str, str],
    units: Mapping[str, str] = MappingProxyType({}),
) -> Recording:
    """Add to a recording which columns of its file were read, by default in our units.

    Args:
        names: channel -> its name in the file.
        by: who decided names and units.
        unread: what was not read, and why.
        units: channel -> its unit in the file, if it is not ours.
    """
    columns = []
    for channel, name in names.items():
        if getattr(recording, "device_rpy" if channel == "rpy" else channel) is not None:
            unit = units.get(channel) or next(iter(UNITS["angle" if channel == "rpy" else channel]))
            axes = [""] if channel == "t" else [".x", ".y", ".z"]
            for ours, axis in zip(CHANNELS[channel], axes, strict=True):
                columns.append(Column(f"{name}{axis}", ours, 1.0, unit, by, by))
    return replace(recording, info=replace(recording.info, source=SourceColumns(tuple(columns), unread)))


def remapped(path: Path, recording: Recording, columns: Mapping[str, str], units: Mapping[str, str]) -> Recording:
    """Swap and reverse axes of an imported recording, and change its units.

    Args:
        columns: our name -> our name, or the file's; -NAME reverses the sign.
        units: unit of acc, gyr or mag; -UNIT reverses the sign.

    Raises:
        UsageError: a channel or a unit is unknown.
        RecordingError: a column is unknown.
    """
    understood = recording.info.source
    read = {name: values for name in ("gyr", "acc", "mag") if (values := getattr(recording, name)) is not None}
    changed = {name: values.copy() for name, values in read.items()}
    by_ours = {(column.ours, column.name if column.ours == "t" else ""): column for column in understood.columns}
    for ours, name in columns.items():
        channel = CHANNEL_OF.get(ours, "")
        if not channel:
            raise UsageError(f"unknown channel '{ours}'; choose one of {', '.join(CHANNEL_OF)}", value=ours)
        axes = understood.of(channel) if channel in read else []
        bare = name if any(name == column.name for column in axes) else name.removeprefix("-")
        source = next((column for column in axes if bare in (column.name, column.ours)), None)
        if source is None:
            have = f"its columns for {ours} are {listed(column.name for column in axes)}"
            raise RecordingError.at(path, f"no column '{printable(name)}'; {have}", value=name)
        # The file's name means the values in the file; our name means our values, whose sign may be reversed already.
        sign = (1.0 if bare == name else -1.0) * (source.sign if bare == source.name else 1.0)
        to, origin = CHANNELS[channel].index(ours), CHANNELS[channel].index(source.ours)
        changed[channel][:, to] = sign * read[channel][:, origin]
        by_ours[ours, ""] = replace(source, ours=ours, sign=sign * source.sign, named_by="--column")
    for channel, given in units.items():
        unit, sign = given.removeprefix("-"), -1.0 if given.startswith("-") else 1.0
        factor = unit_factor(channel, unit) if channel in read else None
        if factor is None:
            known = f"give one of {', '.join(UNITS[channel])}" if channel in read else f"give it for {', '.join(read)}"
            raise UsageError(f"{path}: the unit {channel}={printable(given)} is not known here; {known}", value=given)
        for k, ours in enumerate(CHANNELS[channel]):
            column = by_ours[ours, ""]
            changed[channel][:, k] *= sign * factor / (unit_factor(channel, column.unit) or 1.0)
            by_ours[ours, ""] = replace(column, sign=sign * column.sign, unit=unit, unit_by="--unit")
    info = replace(recording.info, source=replace(understood, columns=tuple(by_ours.values())))
    return replace(recording, **changed, info=info)
