"""Which column of a table contains what: by the caller's options, names, units, and known programs' conventions.

For a file without a table's header it lists the columns, which the caller's options may correct (`remapped`).
"""

import re
import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from pbd.data import Recording
from pbd.data.source_columns import CHANNEL_OF, CHANNELS, NO_UNIT, QUANTITIES, RPY, Column, SourceColumns
from pbd.data.units import UNITS, normalized_unit, unit_factor
from pbd.errors import RecordingError, UsageError, listed, printable
from pbd.files.importers.header_names import (
    in_counts,
    looks_inertial,
    our_name,
    plain,
    split_unit,
    time_unit,
    why_never_read,
)
from pbd.files.table import Sheet, Table, refuse_missing
from pbd.pose import Array

WHY_UNUSED = "a file that isn't used"


@dataclass(frozen=True)
class Program:
    """How a program writes its tables, beyond what the columns' names tell.

    Attributes:
        header: plain names (`plain`) of columns that it always writes.
        units: channel -> its unit; -UNIT: with reversed signs, which the name does not tell.
        sensor: the sensor, as in `Recording.info`.
        preamble: a pattern that must occur above the header; "": none.
    """

    title: str
    header: AbstractSet[str]
    units: Mapping[str, str]
    sensor: str = "unknown"
    preamble: str = ""


PROGRAMS = (
    Program("Xsens MT Manager", {"packet_counter"}, {"t": "0.1ms", "gyr": "rad/s", "mag": "a.u."}, "xsens", r"(?m)^//"),
    Program("Movella (Xsens) DOT", {"packet_counter", "sample_time_fine"}, {"t": "us", "gyr": "deg/s", "mag": "a.u."}),
    Program("Physics Toolbox", {"g_fx", "g_fy", "g_fz"}, {"acc": "g", "gyr": "rad/s", "mag": "uT"}, "phone"),
    Program("rostopic", {"field_header_stamp"}, {"t": "ns"}),
    Program("Core Motion", {"gravity_x", "user_acceleration_x"}, {"acc": "-g"}, "phone"),
    Program("SensorLog", {"accelerometer_acceleration_x"}, {"acc": "-g"}, "phone"),
    Program(
        "SparkFun OpenLog Artemis", {"rtc_date", "rtc_time"}, {"acc": "mg", "gyr": "deg/s", "mag": "uT"}, "openlog"
    ),
)
"""Programs whose units can't be read from the names.

MT Manager: SampleTimeFine of an MTi counts at 10 kHz (Xsens, Low-Level Communication Protocol). DOT: SampleTimeFine is
in us, rates are in deg/s (Movella DOT User Manual XD0502P). SensorLog and Core Motion: acceleration and gravity are in
g, -1 on z when an iPhone lies face up (Apple, Getting raw accelerometer events). Physics Toolbox: gF is specific force
over g. ROS 1's `rostopic echo -p` prints times in ns. OpenLog Artemis: SparkFun's library of the ICM-20948 gives mg,
deg/s, uT.
"""


def _program_of(sheet: Sheet) -> Program:
    """Return the program that wrote a table; one without title, units and sensor if it is unknown.

    Gyroflow gives the units of s, rad/s and g above the header, as `gscale,0.00053263`.
    """
    if sheet.preamble.startswith("GYROFLOW IMU LOG"):
        scales = dict(re.findall(r"(?m)^([tga]scale)\s*,\s*([\d.]+(?:[eE][-+]?\d+)?)", sheet.preamble))
        of = {"t": ("tscale", "s"), "gyr": ("gscale", "rad/s"), "acc": ("ascale", "g")}
        units = {key: scales[scale] + unit for key, (scale, unit) in of.items() if scale in scales}
        return Program("Gyroflow", set(), units)
    words = set(map(plain, sheet.header))
    known = (p for p in PROGRAMS if p.header <= words and re.search(p.preamble, sheet.preamble))
    return next(known, Program("", set(), {}))


def understand(sheet: Sheet, columns: Mapping[str, str], units: Mapping[str, str]) -> SourceColumns:
    """Find which column contains what.

    Args:
        columns: the caller's, our name -> the file's column; -NAME reverses the sign.
        units: the caller's, channel -> unit; -UNIT reverses the sign.

    Raises:
        UsageError: the caller names an unknown channel or unit.
        RecordingError: a column or its unit is unknown, or a column that looks inertial is not understood.
    """
    if channel := next((channel for channel in units if channel not in UNITS), ""):
        raise UsageError(f"no unit can be given for '{channel}'; give it for {', '.join(UNITS)}", value=channel)
    path, header, program = sheet.path, sheet.header, _program_of(sheet)
    stems = {word[:-1] for word in map(plain, header) if word.endswith("_w")}  # x, y, z beside a w are a quaternion
    named = [name for name in header if plain(name)[:-1] not in stems]
    found = {ours: (name, 1.0, "its name") for ours, name in _by_name(named).items()}
    for ours, given in columns.items():
        _channel(ours)
        sign, name = (1.0, given) if given in header else _split_sign(given)
        refuse_missing(path, header, [name], RecordingError)
        found[ours] = name, sign, "--column"
    for angles in (CHANNELS["angle"], RPY):
        if not set(angles) <= set(found) and not set(columns) & set(angles):
            # The origin and sign of a single angle are unknown: the gyro is more reliable.
            found = {ours: each for ours, each in found.items() if ours not in angles}
    beside = {CHANNEL_OF[ours]: unit for ours, (name, _, _) in found.items() if (unit := split_unit(name)[1])}
    read = []
    for ours, (name, sign, by) in sorted(found.items(), key=lambda each: header.index(each[1][0])):
        unit_sign, unit, unit_by = _unit(path, name, ours, units, beside, program)
        read.append(Column(name, ours, sign * unit_sign, unit, by, unit_by))
    used = {"", *(column.name for column in read)}
    why = {name: why_not_read(name, found) if name in named else "a quaternion" for name in header if name not in used}
    _refuse_not_understood(path, why)
    return SourceColumns(tuple(read), why, program.title)


def scaled(table: Table, found: SourceColumns, channel: str) -> Array:
    """Return a channel's columns of a table (rows, axes), in our units."""
    columns = found.of(channel)
    return table.columns(*(column.name for column in columns)) * [column.factor for column in columns]


def _by_name(header: Sequence[str]) -> dict[str, str]:
    """Map our names to the file's columns: for each channel the first complete set of axes, else the first set.

    Raw counts come last. Of several devices, the first with an accelerometer and a gyro is read.
    """
    sets: dict[str, dict[str, dict[str, str]]] = {}
    device_of: dict[str, str] = {}
    for name in header:
        if given := our_name(name):
            ours, group, device_of[given[1]] = given
            sets.setdefault(CHANNEL_OF[ours], {}).setdefault(group, {}).setdefault(ours, name)
    for channel, groups in sets.items():
        ordered = sorted(groups.items(), key=lambda each: each[0] == "g")  # beside another gyro, gx is gravity
        complete = {group: axes for group, axes in ordered if len(axes) == len(CHANNELS[channel])} or groups
        measured = {group: axes for group, axes in complete.items() if not any(map(in_counts, axes.values()))}
        sets[channel] = measured or complete
    of_gyro = [device_of[group] for group in sets.get("gyr", ())]
    device = next((device_of[group] for group in sets.get("acc", ()) if device_of[group] in of_gyro), "")
    # Beside these, others are without gravity. gF is Physics Toolbox's, total_acc UCI HAR's.
    with_gravity = re.compile("gravity|^g_f$|^total_")
    found: dict[str, str] = {}
    for groups in sets.values():
        found |= groups[min(groups, key=lambda group: (not with_gravity.search(group), device_of[group] != device))]
    return found


def _channel(ours: str) -> str:
    """Return the channel of one of our names; UsageError: it is unknown."""
    if ours not in CHANNEL_OF:
        raise UsageError(f"unknown channel '{ours}'; choose one of {', '.join(CHANNEL_OF)}", value=ours)
    return CHANNEL_OF[ours]


def _split_sign(given: str) -> tuple[float, str]:
    """Return the sign that -NAME or -UNIT gives, and the name or unit."""
    return (-1.0, given[1:]) if given.startswith("-") else (1.0, given)


def _unit(
    path: Path, name: str, ours: str, units: Mapping[str, str], beside: Mapping[str, str], program: Program
) -> tuple[float, str, str]:
    """Return a column's sign and unit, and who decided the unit; `beside` has the units that names of axes tell."""
    channel = "angle" if CHANNEL_OF[ours] == "rpy" else CHANNEL_OF[ours]
    standard = next(iter(UNITS[channel]))
    given, by = units.get(channel) or "", "--unit"
    if not given:
        given, by = time_unit(name) if channel == "t" else split_unit(name)[1], "its name"
    if not given and channel != "t":
        given, by = beside.get(CHANNEL_OF[ours], ""), "another axis's name"
    reversed_ = by != "--unit" and program.units.get(channel) == f"-{given.lower()}"
    if channel in program.units and (reversed_ or not given):
        given, by = program.units[channel], program.title
    if not given:
        return 1.0, standard, NO_UNIT
    sign, unit = _split_sign(normalized_unit(given))
    if unit_factor(channel, unit) is None:
        what = f"the unit '{printable(given)}' of column '{printable(name)}' is not known; import it with"
        what += f" --unit {channel}=UNIT, one of {', '.join(UNITS[channel])}" + ", or --rate HZ" * (channel == "t")
        raise (UsageError if by == "--unit" else RecordingError).at(path, what, value=given)
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


def unused(files: Iterable[str]) -> dict[str, str]:
    """Return CSV files that aren't used, of these names without suffix, and why they aren't read."""
    return {f"{name}.csv": WHY_UNUSED for name in sorted(files)}


def _refuse_not_understood(path: Path, unread: Mapping[str, str]) -> None:
    """Refuse to ignore a column that looks like a gyro, accelerometer or magnetometer if none is found."""
    for letter in "gam":
        alike = [name for name, why in unread.items() if not why and looks_inertial(name) == letter]
        if alike:
            look, are, them = ("looks", "is", "it") if len(alike) == 1 else ("look", "are", "them")
            column = f"--column {letter}x={shlex.quote(printable(alike[0]))}"
            what = f"{listed(alike)} {look} like {'a gyro' if letter == 'g' else 'inertial data'}, but {are} not"
            what = f"{what} understood; import it with {column} and its like, or remove {them}"
            raise RecordingError.at(path, what, value=alike[0])


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


def remapped(
    path: Path,
    recording: Recording,
    columns: Mapping[str, str],
    units: Mapping[str, str] = MappingProxyType({}),
) -> Recording:
    """Swap and reverse axes of an imported recording, and change its units.

    Args:
        columns: our name -> our name, or the file's; -NAME reverses the sign.
        units: unit of acc, gyr or mag; -UNIT reverses the sign.

    Raises:
        UsageError: a channel or a unit is unknown.
        RecordingError: a column is unknown.
    """
    if not (columns or units):
        return recording
    understood = recording.info.source
    read = {name: values for name in ("gyr", "acc", "mag") if (values := getattr(recording, name)) is not None}
    changed = {name: values.copy() for name, values in read.items()}
    by_ours = {(column.ours, column.name if column.ours == "t" else ""): column for column in understood.columns}
    for ours, name in columns.items():
        channel = _channel(ours)
        axes = understood.of(channel) if channel in read else []
        sign, bare = (1.0, name) if name in [column.name for column in axes] else _split_sign(name)
        source = next((column for column in axes if bare in (column.name, column.ours)), None)
        if source is None:
            have = f"its columns for {ours} are {listed(column.name for column in axes)}"
            raise RecordingError.at(path, f"no column '{printable(name)}'; {have}", value=name)
        # The file's name means the values in the file; our name means our values, whose sign may be reversed already.
        sign *= source.sign if bare == source.name else 1.0
        to, origin = CHANNELS[channel].index(ours), CHANNELS[channel].index(source.ours)
        changed[channel][:, to] = sign * read[channel][:, origin]
        by_ours[ours, ""] = replace(source, ours=ours, sign=sign * source.sign, named_by="--column")
    for channel, given in units.items():
        sign, unit = _split_sign(given)
        factor = unit_factor(channel, unit) if channel in read else None
        if factor is None:
            known = f"give one of {', '.join(UNITS[channel])}" if channel in read else f"give it for {', '.join(read)}"
            raise UsageError.at(path, f"the unit {channel}={printable(given)} is not known here; {known}", value=given)
        for k, ours in enumerate(CHANNELS[channel]):
            column = by_ours[ours, ""]
            changed[channel][:, k] *= sign * factor / (unit_factor(channel, column.unit) or 1.0)
            by_ours[ours, ""] = replace(column, sign=sign * column.sign, unit=unit, unit_by="--unit")
    info = replace(recording.info, source=replace(understood, columns=tuple(by_ours.values())))
    return replace(recording, **changed, info=info)
