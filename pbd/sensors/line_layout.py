"""Layout of a line of numbers, as the user gives it: the columns' names, order and units, and the separator.

Columns: ax ay az (specific force, +g up at rest); gx gy gz; mx my mz; roll, pitch, yaw (about x, y, z; yaw from east to
north) or roll, pitch, heading (as a compass: pitch nose up, heading clockwise from north); t (the device's own
clock); _ for a column to skip. A minus before a name flips the sign: `-ax`. The axes must be right-handed.

In TOML:

    separator = ","              # "space": any white space; "tab"
    columns = "t,ax,ay,az,gx,gy,gz"
    prefix = ""                  # what each line begins with
    wrap = 4294967296            # t wraps to 0 here, in t's unit; 0: never
    [units]                      # acc, gyr, mag, angle, t; a number before a unit multiplies it
    acc = "0.001 g"

Where several lines make one sample, each gets a [[line]] with its columns and prefix, in place of those above. The
first [[line]] begins a sample.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from types import MappingProxyType

from pbd.data.units import UNITS, unit_factor
from pbd.errors import SensorError, UsageError
from pbd.io.toml import parse_toml

QUANTITIES: Mapping[str, tuple[str, ...]] = {
    "acc": ("ax", "ay", "az"),
    "gyr": ("gx", "gy", "gz"),
    "mag": ("mx", "my", "mz"),
    "angle": ("roll", "pitch", "yaw", "heading"),
    "t": ("t",),
}
"""Quantity -> names of its columns."""

SEPARATORS = {"space": " ", "tab": "\t"}


@dataclass(frozen=True)
class Line:
    """One kind of line: the names of its columns in order, and the text that it begins with."""

    columns: tuple[str, ...]
    prefix: str = ""


@dataclass(frozen=True)
class LineLayout:
    """The kinds of lines that make a sample, and their units.

    Attributes:
        lines: the first begins a sample, the others complete it. If there are several, each needs its own prefix.
        units: quantity (acc, gyr, mag, angle, t) -> unit, such as "g" or "0.001 g".
        separator: one character; a space stands for any white space.
        wrap: value at which t restarts from zero, in t's unit; 0: never; None: as an Arduino's clock.

    Raises:
        UsageError: a name, unit, separator or wrap is unknown or contradicts the others.
    """

    lines: tuple[Line, ...]
    units: Mapping[str, str] = field(default_factory=dict)
    separator: str = ","
    wrap: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "lines", tuple(self.lines))
        object.__setattr__(self, "units", MappingProxyType(dict(self.units)))
        if len(self.separator) != 1 or not self.separator.isascii() or self.separator in "+-.0123456789eE\r\n":
            what = f"separator {self.separator!r} is not a single character"
            raise UsageError(f"{what}; give one such as , ; space or tab")
        if self.wrap is not None and not (isfinite(self.wrap) and self.wrap >= 0.0):
            what = f"wrap {self.wrap} must be in t's unit"
            raise UsageError(f"{what}; give a number above 0, or 0 for a clock without end")
        for quantity in self.units:
            self.factor(quantity)
        lines = [[name.removeprefix("-") for name in line.columns] for line in self.lines]
        _check_columns(lines)
        _check_prefixes([line.prefix for line in self.lines])

    def factor(self, quantity: str) -> float:
        """Factor that converts this quantity from its unit to the SI unit (uT for the field)."""
        if quantity not in UNITS:
            raise UsageError(f"no unit can be given for {quantity!r}; give it for {', '.join(UNITS)}", value=quantity)
        text = self.units.get(quantity, next(iter(UNITS[quantity])))
        factor = unit_factor(quantity, text)
        if factor is None:
            what = f"{text!r} is not a unit of {quantity}; give one of {', '.join(UNITS[quantity])}"
            sign = "; reverse signs in --columns, as -ax,-ay,-az" * text.startswith("-")
            raise UsageError(f"{what}, with a number before it if needed{sign}", value=text)
        return factor

    @property
    def wrap_s(self) -> float:
        """Time after which t restarts from zero, s; 0: never."""
        ticks = self.wrap
        if ticks is None:  # an Arduino's millis() and micros() have 32 bits
            ticks = 2.0**32 if self.units.get("t") in ("ms", "us") else 0.0
        return ticks * self.factor("t")


def _check_columns(lines: list[list[str]]) -> None:
    names = [name for line in lines for name in line]
    known = [name for group in QUANTITIES.values() for name in group]
    for name in names:
        if name not in (*known, "_"):
            raise UsageError(
                f"column {name!r} is unknown; the names are {', '.join(known)} and _ for a column to skip", value=name
            )
        if name != "_" and names.count(name) > 1:
            raise UsageError(f"column {name} is there twice; name the other one _", value=name)
    if "heading" in names and "yaw" in names:
        raise UsageError("heading and yaw are two words for one angle; name one of them _")
    if "ax" not in names:
        raise UsageError("no acceleration among the columns; without ax, ay, az there is nothing to track")
    for line in lines:
        angles = ("roll", "pitch", "heading" if "heading" in line else "yaw")
        for three in (QUANTITIES["acc"], QUANTITIES["gyr"], QUANTITIES["mag"], angles):
            missing = [name for name in three if name not in line]
            if 0 < len(missing) < 3:
                what = f"{', '.join(missing)} is missing in a line that has others of its kind"
                raise UsageError(f"{what}; add it, or name those _", value=missing)
        if not set(line) - {"t", "_"}:
            raise UsageError("a line has no column but t or _; remove it")


def _check_prefixes(prefixes: list[str]) -> None:
    for i, prefix in enumerate(prefixes):
        if not (prefix.isascii() and prefix.isprintable()):
            raise UsageError(f"prefix {prefix!r} is not plain text; give the characters that each line begins with")
        for other in prefixes[:i] + prefixes[i + 1 :]:
            if other.startswith(prefix):
                raise UsageError(f"lines that begin with {prefix!r} and {other!r} are ambiguous; give longer prefixes")


def layout_from_options(
    columns: str,
    units: Mapping[str, str] = MappingProxyType({}),
    separator: str = ",",
    prefix: str = "",
    wrap: float | None = None,
) -> LineLayout:
    """Make a layout from command-line options: `--columns "ax,ay,az,gx,gy,gz" --unit acc=g`."""
    return LineLayout((Line(_split_columns(columns), prefix),), units, SEPARATORS.get(separator, separator), wrap)


def layout_from_toml(text: str, name: str = "layout") -> LineLayout:
    """Make a layout from the text of a TOML file; messages call the file `name`."""
    top = parse_toml(Path(name), text, SensorError)
    if "columns" in top and "line" in top:
        top.fail("columns", "and [[line]] can't both be given", "remove one")
    lines = tuple(
        Line(_split_columns(table.text("columns")), table.text("prefix", "", blank=True))
        for table in top.tables("line") or [top]
    )
    units, wrap = top.section("units", None), top.number("wrap", None, within=2.0**64)
    separator = top.text("separator", ",", blank=True)
    given = {quantity: unit for quantity in UNITS if units and (unit := units.text(quantity, None))}
    top.refuse_unread()
    try:
        return LineLayout(lines, given, SEPARATORS.get(separator, separator), wrap)
    except UsageError as error:
        raise SensorError.at(name, error.message, **error.fields) from None


def _split_columns(columns: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in columns.split(","))
