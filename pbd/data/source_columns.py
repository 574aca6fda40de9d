"""The columns of the file from which a recording was imported, and advice in that file's terms."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import log
from typing import Any

from pbd.data.imu_columns import ACC, ATTITUDE, GYR, MAG
from pbd.data.units import UNITS, unit_factor
from pbd.lazy import cached_property

RPY = ("anglex", "angley", "anglez")
"""The device's own attitude as rotations about x, y, z; the one about z counts from east to north."""

CHANNELS = {"t": ("t",), "gyr": GYR, "acc": ACC, "mag": MAG, "angle": ATTITUDE, "rpy": RPY}
"""Channel of an imported file -> our names of its columns."""

CHANNEL_OF = {ours: channel for channel, names in CHANNELS.items() for ours in names}
"""Our name of a column -> its channel."""

QUANTITIES = {"t": "time", "gyr": "turn rate", "acc": "specific force", "mag": "field"} | dict.fromkeys(
    ("angle", "rpy"), "the device's own attitude"
)
"""Channel -> what it measures, for people."""

NO_UNIT, DATES = "no unit given", "its dates"
"""Values of `Column.unit_by` besides a person and the file's header. NO_UNIT: nobody gave the unit, so ours is assumed.
DATES: the column holds dates, so its unit is s."""


@dataclass(frozen=True)
class Column:
    """A column that was read: its name in the file, our name, sign and unit; who decided the name and the unit."""

    name: str
    ours: str
    sign: float
    unit: str
    named_by: str
    unit_by: str

    @property
    def factor(self) -> float:
        """Factor from the file's values to ours."""
        channel = CHANNEL_OF[self.ours]
        return self.sign * (unit_factor("angle" if channel == "rpy" else channel, self.unit) or 0.0)

    def row(self) -> dict[str, str]:
        """Return the column's row of the table that `pbd import` prints, as text."""
        unit = NO_UNIT if self.unit_by == NO_UNIT else f"unit: {self.unit_by}"
        how = self.named_by if self.named_by == self.unit_by else f"{self.named_by}; {unit}"
        return {
            "column": self.name,
            "read_as": f"{'-' if self.sign < 0 else ''}{self.ours}",
            "quantity": QUANTITIES[CHANNEL_OF[self.ours]],
            "unit": self.unit,
            "decided_by": how,
        }


@dataclass(frozen=True)
class SourceColumns:
    """The columns of a file that were read, the unread ones and why, and the program that wrote the file.

    Without columns, the recording is one of ours: advice then has our names and units.
    """

    columns: tuple[Column, ...] = ()
    unread: Mapping[str, str] = field(default_factory=dict)
    program: str = ""

    def of(self, channel: str) -> list[Column]:
        """Return the columns of a channel, in the order of its axes."""
        return [self._found[ours] for ours in CHANNELS[channel] if ours in self._found]

    @cached_property
    def _found(self) -> dict[str, Column]:
        """Our names, and their columns. The file's own replace those of `with_file`."""
        return {column.ours: column for column in reversed(self.columns)}

    def names(self, channel: str) -> str:
        """Return the names of a channel's columns, for messages."""
        return ", ".join(column.name for column in self.of(channel)) or ", ".join(CHANNELS[channel])

    @property
    def acc_factor(self) -> float:
        """Factor, without its sign, from the file's values of specific force to m/s2."""
        acc = self.of("acc")
        return abs(acc[0].factor) if acc else 1.0

    @property
    def acc_unit_sign(self) -> str:
        """The minus of a unit of specific force that has one, which reverses all three signs; else ""."""
        acc = self.of("acc")
        return "-" * bool(acc and all(each.sign < 0.0 and each.named_by != "--column" for each in acc))

    @property
    def has_no_times(self) -> bool:
        """Whether the file has no times, so that its samples come at a rate that a person gave."""
        return bool(self.columns) and "t" not in self._found

    def with_column(self, name: str, **changes: Any) -> SourceColumns:
        """Change what is known of a column: who named it, or its unit."""
        return replace(self, columns=tuple(replace(c, **changes) if c.name == name else c for c in self.columns))

    def with_file(self, file: str, other: SourceColumns) -> SourceColumns:
        """Add the columns of another file."""
        columns = (replace(column, name=f"{file}: {column.name}") for column in other.columns)
        unread = {f"{file}: {name}": why for name, why in other.unread.items()}
        return replace(self, columns=(*self.columns, *columns), unread={**self.unread, **unread})

    def with_unread(self, unread: Mapping[str, str]) -> SourceColumns:
        """Add columns or files that were not read, and why."""
        return replace(self, unread={**self.unread, **unread})

    def without(self, channel: str, why: str) -> SourceColumns:
        """Leave out the columns of a channel, which were not read, and say why."""
        columns = tuple(column for column in self.columns if column not in self.of(channel))
        return replace(self, columns=columns).with_unread({column.name: why for column in self.of(channel)})

    @property
    def time_unit_by(self) -> str:
        """Who decided the unit of the times: NO_UNIT, DATES, or another one."""
        return self._found["t"].unit_by if "t" in self._found else NO_UNIT

    def column_option(self, ours: str, theirs: str, reverse: bool) -> str:
        """Return the option of `pbd import` that reads, as `ours`, the column that was read as `theirs` (our names)."""
        name = theirs
        if theirs in self._found:
            name, reverse = self._found[theirs].name, (self._found[theirs].sign < 0) != reverse
        sign = "-" if reverse else ""
        return f"--column {shlex.quote(f'{ours}={sign}{name}')}"

    def reverse_acc_option(self) -> str:
        """Return the option of `pbd import` that reverses all signs of the accelerometer."""
        if not (acc := self.of("acc")):
            return "--unit acc=-g (or -m/s2)"
        return f"--unit acc={'-' if acc[0].sign > 0 else ''}{acc[0].unit}"

    def time_advice(self) -> str:
        """Return what to do about times that can't be in seconds, or in the unit that the file gives."""
        if self.has_no_times:
            return "correct the rate (--rate, or an npz's rate_hz)"
        name, unit = (self._found["t"].name, self._found["t"].unit) if self.columns else ("t", "s")
        return f"the column '{name}' must be {'seconds' if unit == 's' else unit}"

    @property
    def time_factor(self) -> float:
        """Factor, without its sign, from the file's times to s."""
        return abs(self._found["t"].factor) if "t" in self._found else 1.0

    def time_unit(self, unit: str) -> str:
        """Return the unit of the file's times, if the recording's are in `unit` in place of s: both factors count."""
        factor = self.time_factor * UNITS["t"][unit]
        return min(("s", "ms", "us", "ns"), key=lambda each: abs(log(UNITS["t"][each] / factor)))


IMU_CSV = SourceColumns()
"""The value for a recording that was not imported."""
