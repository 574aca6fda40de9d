"""Which column of a table contains what: by the caller's options, names, units, and known programs' conventions."""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import log
from pathlib import Path
from types import MappingProxyType

from pbd.data.units import UNITS, spelled, unit_factor
from pbd.errors import RecordingError, UsageError, listed, printable
from pbd.files.importers.header_names import TIME_UNITS, looks_inertial, our_name, plain, split_unit, why_never_read
from pbd.files.imu_columns import ACC, DEVICE, GYR, MAG
from pbd.files.table import Sheet

RPY = ("anglex", "angley", "anglez")
"""The device's own attitude as rotations about x, y, z; the one about z counts from east to north."""

CHANNELS = {"t": ("t",), "gyr": GYR, "acc": ACC, "mag": MAG, "angle": DEVICE, "rpy": RPY}
CHANNEL_OF = {ours: channel for channel, names in CHANNELS.items() for ours in names}
QUANTITIES = {"t": "time", "gyr": "turn rate", "acc": "specific force", "mag": "field"} | dict.fromkeys(
    ("angle", "rpy"), "the device's own attitude"
)

UNUSED = "a file that isn't used"
NO_UNIT, DATES = "no unit given", "its dates"
"""Source of a unit that neither the file nor the caller gives; ours is assumed. Source of the unit of dates: s."""

_NOT_A_UNIT = r"txt|local|.*\b(?:utc|gmt|iso\W*8601)\b.*|(?:[ydmo]{2,4}\W+){2}.*|h{1,2}:mm\b.*"
"""Notes, in lower case, of a column of dates or times of day: their format, such as `hh:mm:ss.ms`, or the zone."""


@dataclass(frozen=True)
class Program:
    """How a program writes its tables, beyond what the columns' names tell.

    Attributes:
        title: the program's name.
        header: plain names (`plain`) of columns that it always writes.
        preamble: a pattern that must occur above the header; "": none.
        units: channel -> its unit.
        wraps: the value at which its clock wraps to zero, in the clock's unit; 0: never.
        sensor: the sensor, as in `Recording.info`.
    """

    title: str
    header: frozenset[str]
    preamble: str = ""
    units: Mapping[str, str] = field(default_factory=dict)
    wraps: float = 0.0
    sensor: str = "unknown"


_XSENS = frozenset(("packet_counter", "sample_time_fine"))
_GFORCE = {"acc": "g", "gyr": "rad/s", "mag": "uT"}
_ICM20948 = {"acc": "mg", "gyr": "deg/s", "mag": "uT"}
PROGRAMS = (
    Program("Xsens MT Manager", _XSENS, r"(?m)^//", {"t": "0.1ms", "gyr": "rad/s", "mag": "a.u."}, 2.0**32),
    Program("Movella (Xsens) DOT", _XSENS, "", {"t": "us", "gyr": "deg/s", "mag": "a.u."}, 2.0**32),
    Program("Physics Toolbox", frozenset(("g_fx", "g_fy", "g_fz")), units=_GFORCE, sensor="phone"),
    Program("rostopic", frozenset(("field_header_stamp",)), units={"t": "ns"}),
    Program("SparkFun OpenLog Artemis", frozenset(("rtc_date", "rtc_time")), units=_ICM20948, sensor="openlog"),
)
"""Programs whose units can't be read from the names.

MT Manager: SampleTimeFine of an MTi counts at 10 kHz (Xsens, Low-Level Communication Protocol). DOT: SampleTimeFine is
in us and wraps after 1.2 h, rates are in deg/s (Movella DOT User Manual XD0502P). Physics Toolbox: gF is specific force
over g. ROS 1's `rostopic echo -p` prints times in ns. OpenLog Artemis: SparkFun's library of the ICM-20948 gives mg,
deg/s, uT.
"""


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
class Understood:
    """How a file was understood: the columns that were read, the unread ones and why, and the program that wrote it."""

    columns: tuple[Column, ...] = ()
    unread: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    program: str = ""

    def of(self, channel: str) -> list[Column]:
        """Return the columns of a channel, in the order of its axes."""
        found = self._found()
        return [found[ours] for ours in CHANNELS[channel] if ours in found]

    def _found(self) -> dict[str, Column]:
        """Map our names to columns. The file's own replace those of `with_file`."""
        return {column.ours: column for column in reversed(self.columns)}

    def with_clock(self, name: str, by: str) -> Understood:
        """Set how the column of the time was found."""
        return replace(self, columns=tuple(replace(c, named_by=by) if c.name == name else c for c in self.columns))

    def with_dates(self, name: str) -> Understood:
        """Read a column of dates or times of day in seconds, whatever its name says."""
        columns = (replace(c, unit="s", unit_by=DATES) if c.name == name else c for c in self.columns)
        return replace(self, columns=tuple(columns))

    def with_file(self, file: str, other: Understood) -> Understood:
        """Add the columns of another file."""
        columns = (replace(column, name=f"{file}: {column.name}") for column in other.columns)
        unread = {f"{file}: {name}": why for name, why in other.unread.items()}
        return replace(self, columns=(*self.columns, *columns), unread={**self.unread, **unread})

    def with_unread(self, unread: Mapping[str, str]) -> Understood:
        """Add columns or files that were not read, and why."""
        return replace(self, unread={**self.unread, **unread})

    def in_file_names(self, message: str) -> str:
        """Replace our names of columns in a message, our signs in its options `--column ax=-ay`, and a unit of time.

        The unit that a message advises is for numbers that were read as seconds. If they were read in another unit,
        both factors count. `--unit acc=-g` reverses the signs that were read.
        """
        found = self._found()

        def renamed(option: re.Match[str]) -> str:
            ours, minus, source = option.groups()
            if source not in found:
                return option[0]
            sign = "-" if (found[source].sign < 0) != bool(minus) else ""
            value = f"{ours}={sign}{found[source].name}"
            return f"--column {value}" if re.fullmatch(r"[\w=./-]+", value) else f"--column '{value}'"

        times = f"the column '{found['t'].name}' must be seconds" if "t" in found else "give another --rate"
        message = message.replace("the column 't' must be seconds", times)
        by = found["t"].unit_by if "t" in found else NO_UNIT
        if by == DATES or (by != NO_UNIT and "record faster" in message):
            message = re.sub(r"; if the time is in .*", "", message)
            message = re.sub(r"; the time is likely in .*", "; record faster", message)
        elif "t" in found and "--unit t=" in message:

            def nearest(advised: re.Match[str]) -> str:
                factor = abs(found["t"].factor) * UNITS["t"][advised[0]]
                return min(("s", "ms", "us", "ns"), key=lambda unit: abs(log(UNITS["t"][unit] / factor)))

            message = re.sub(r"\b[mun]s\b", nearest, message)
        if acc := self.of("acc"):
            turned = f"--unit acc={'-' if acc[0].sign > 0 else ''}{acc[0].unit}"
            message = message.replace("--unit acc=-g (or -m/s2)", turned)
        return re.sub(r"--column (\w+)=(-?)([agm][xyz])\b", renamed, message)


def understand(sheet: Sheet, columns: Mapping[str, str], units: Mapping[str, str]) -> Understood:
    """Find which column contains what.

    Args:
        sheet: the table.
        columns: the caller's, our name -> the file's column; -NAME reverses the sign.
        units: the caller's, channel -> unit; -UNIT reverses the sign.

    Raises:
        UsageError: the caller names an unknown channel or unit.
        RecordingError: a column or its unit is unknown, or a column that looks inertial is not understood.
    """
    if channel := next((channel for channel in units if channel not in UNITS), ""):
        raise UsageError(f"no unit can be given for '{channel}'; give it for {', '.join(UNITS)}", value=channel)
    path, header = sheet.path, sheet.header
    words = {plain(name) for name in header}
    program = next((p for p in PROGRAMS if p.header <= words and re.search(p.preamble, sheet.preamble)), None)
    stems = {word[:-1] for word in words if word.endswith("_w")}  # x, y, z beside a w are a quaternion
    named = [name for name in header if plain(name)[:-1] not in stems]
    found = {ours: (name, 1.0, "its name") for ours, name in _by_name(named).items()}
    for ours, name in columns.items():
        if ours not in CHANNEL_OF:
            raise UsageError(f"unknown channel '{ours}'; choose one of {', '.join(CHANNEL_OF)}", value=ours)
        reversed_ = name not in header and name.startswith("-")
        name = name[1:] if reversed_ else name
        if name not in header:
            raise RecordingError.at(path, f"no column '{name}'; the columns are {listed(header)}", value=name)
        found[ours] = name, -1.0 if reversed_ else 1.0, "--column"
    for angles in (DEVICE, RPY):
        if not set(angles) <= set(found) and not set(columns) & set(angles):
            # The origin and sign of a single angle are unknown: the gyro is more reliable.
            found = {ours: given for ours, given in found.items() if ours not in angles}
    beside = {CHANNEL_OF[ours]: unit for ours, (name, _, _) in found.items() if (unit := split_unit(name)[1])}
    read = []
    for ours, (name, sign, by) in sorted(found.items(), key=lambda each: header.index(each[1][0])):
        unit_sign, unit, unit_by = _unit(path, name, ours, units, beside, program)
        read.append(Column(name, ours, sign * unit_sign, unit, by, unit_by))
    used = {"", *(column.name for column in read)}
    why = {name: why_not_read(name, found) if name in named else "a quaternion" for name in header if name not in used}
    _refuse_not_understood(path, why)
    return Understood(tuple(read), why, program.title if program else "")


def _by_name(header: Sequence[str]) -> dict[str, str]:
    """Map our names to the file's columns: for each channel the first complete set of axes, else the first set.

    Of several devices, the first with an accelerometer and a gyro is read.
    """
    sets: dict[str, dict[str, dict[str, str]]] = {}
    device_of: dict[str, str] = {}
    for name in header:
        if given := our_name(name):
            ours, group, device_of[given[1]] = given
            sets.setdefault(CHANNEL_OF[ours], {}).setdefault(group, {}).setdefault(ours, name)
    for channel, groups in sets.items():
        ordered = sorted(groups.items(), key=lambda each: each[0] == "g")  # beside another gyro, gx is gravity
        sets[channel] = {group: axes for group, axes in ordered if len(axes) == len(CHANNELS[channel])} or groups
    of_gyro = [device_of[group] for group in sets.get("gyr", ())]
    device = next((device_of[group] for group in sets.get("acc", ()) if device_of[group] in of_gyro), "")
    found: dict[str, str] = {}
    for groups in sets.values():
        found |= groups[min(groups, key=lambda group: (device_of[group] != device, "gravity" not in group))]
    return found


def _unit(
    path: Path, name: str, ours: str, units: Mapping[str, str], beside: Mapping[str, str], program: Program | None
) -> tuple[float, str, str]:
    """Return a column's sign and unit, and who decided the unit; `beside` has the units that names of axes tell."""
    channel = "angle" if CHANNEL_OF[ours] == "rpy" else CHANNEL_OF[ours]
    standard = next(iter(UNITS[channel]))
    given, by = units.get(channel) or "", "--unit"
    if not given:
        given, by = split_unit(name)[1], "its name"
        if channel == "t":
            given = re.sub(r"^(?:epoch|unix)\W+|\W*\b(?:epoch|unix|since)\b.*", "", given, flags=re.IGNORECASE)
            given = "" if re.fullmatch(_NOT_A_UNIT, given.lower()) else given
    if not given and channel == "t" and not re.fullmatch(_NOT_A_UNIT, name.lower()):
        suffix = re.search(TIME_UNITS, word := plain(name))
        word = suffix[1] if suffix else word.removesuffix("_elapsed")
        given = "" if unit_factor("t", word) is None else word
    if not given and channel != "t":
        given, by = beside.get(CHANNEL_OF[ours], ""), "another axis's name"
    if not given and program is not None and channel in program.units:
        given, by = program.units[channel], program.title
    if not given:
        return 1.0, standard, NO_UNIT
    unit = spelled(given)
    sign = -1.0 if unit.startswith("-") else 1.0
    unit = unit.removeprefix("-")
    if unit_factor(channel, unit) is None:
        raise (UsageError if by == "--unit" else RecordingError).at(
            path,
            f"the unit '{printable(given)}' of column '{printable(name)}' is not known; give one of "
            f"{', '.join(UNITS[channel])} with --unit {channel}=UNIT" + ", or --rate HZ" * (channel == "t"),
            value=given,
        )
    return sign, next((name for name in UNITS[channel] if name.lower() == unit), unit), by


def why_not_read(name: str, found: Collection[str]) -> str:
    """Return why a column isn't read; "" if it looks like a gyro, accelerometer or magnetometer, but none is found."""
    given, letter = our_name(name), looks_inertial(name)
    if given is None and ((why := why_never_read(name)) or not letter):
        return why or "nothing inertial"
    channel = CHANNEL_OF[given[0] if given else f"{letter}x"]
    if channel in ("angle", "rpy"):
        return "an attitude that isn't used"
    return f"another column has the {QUANTITIES[channel]}" if set(CHANNELS[channel]) & set(found) else ""


def _refuse_not_understood(path: Path, unread: Mapping[str, str]) -> None:
    """Refuse to ignore a column that looks like a gyro, accelerometer or magnetometer if none is found."""
    for letter in "gam":
        alike = [name for name, why in unread.items() if not why and looks_inertial(name) == letter]
        if alike:
            look, are, them = ("looks", "is", "it") if len(alike) == 1 else ("look", "are", "them")
            column = f"--column {letter}x={shlex.quote(printable(alike[0]))}"
            raise RecordingError.at(
                path,
                f"{listed(alike)} {look} like {'a gyro' if letter == 'g' else 'inertial data'}, but {are} not "
                f"understood; import it with {column} and its like, or remove {them}",
                value=alike[0],
            )
