"""A CSV with a header: our own imu.csv, x-io's export, or any whose columns can be told by name.

A header names the channel and often its unit: `Gyroscope X (deg/s)`, `acc_x [g]`, `Timestamp (us)`, `gx`. What it
doesn't tell, the caller does. A unit that nobody tells is SI; specific force in another is found out by its norm at
rest.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pbd.data import GRAVITY, Demonstration, Recording, RecordingInfo
from pbd.errors import RecordingError
from pbd.files.columns import ACC, DEVICE, GYR, MAG, device_rpy
from pbd.files.table import Table, read_table
from pbd.pose import Array

DEG = np.pi / 180.0
UNITS: Mapping[str, Mapping[str, float]] = {
    "t": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "gyr": {"rad/s": 1.0, "deg/s": DEG, "dps": DEG, "mdps": 1e-3 * DEG},
    "acc": {"m/s2": 1.0, "m/s^2": 1.0, "m/s/s": 1.0, "g": GRAVITY, "mg": 1e-3 * GRAVITY, "mm/s2": 1e-3, "cm/s2": 1e-2},
    "mag": {"ut": 1.0, "mg": 0.1, "g": 100.0, "gauss": 100.0, "mgauss": 0.1, "t": 1e6, "nt": 1e-3, "a.u.": 1.0},
    "angle": {"rad": 1.0, "deg": DEG},
}
"""What one of each unit is in ours (s, rad/s, m/s2, uT, rad)."""

NO_COLUMNS: Mapping[str, str] = {}
CHANNELS = {"t": ("t",), "gyr": GYR, "acc": ACC, "mag": MAG, "angle": DEVICE}

_WORDS = {
    "gyr": r"g|gyr|gyro|gyroscope|w|omega|angular_?velocity|angular_?rate",
    "acc": r"a|acc|accel|acceleration|accelerometer|linear_?acceleration|specific_?force",
    "mag": r"m|mag|magn|magnetometer|magnetic_?field",
}
_TIME = r"t|time|timestamp|time_?stamp|seconds|sec"
_UNIT = re.compile(r"\s*[\[(]\s*([^\])]+?)\s*[\])]\s*$")


def read_csv(path: Path, columns: Mapping[str, str], units: Mapping[str, str]) -> Demonstration:
    """Read a recording from a table with a header.

    Args:
        path: the file; x-io's Magnetometer.csv beside it, where the file has no magnetometer, is joined by its time.
        columns: ours -> the file's column, for those that the header doesn't tell.
        units: channel (t, gyr, acc, mag, angle) -> unit, likewise.

    Raises:
        RecordingError: a column or unit is missing or unknown; the table is no table.
    """
    for channel in units:
        if channel not in UNITS:
            raise RecordingError(f"no unit can be given for '{channel}'; give it for {', '.join(UNITS)}", value=channel)
    table = read_table(path)
    names = _match(table, columns)
    t = _channel(table, names, units, "t")
    acc = _channel(table, names, units, "acc")
    if t is None or acc is None:
        lacking = "t (time)" if t is None else "ax, ay, az (specific force)"
        raise RecordingError(
            f"{path}: no column for {lacking}; the columns are {', '.join(table.header)}: say which is which with "
            "--column, for example --column ax=NAME",
            path=path,
        )
    mag = _channel(table, names, units, "mag")
    if mag is None:
        mag = _magnetometer_beside(path, t[:, 0])
    angles = _channel(table, names, units, "angle", columns)
    return Demonstration(
        recording=Recording(
            t=t[:, 0] - t[0, 0],
            acc=acc,
            gyr=_channel(table, names, units, "gyr"),
            mag=mag,
            device_rpy=None if angles is None else device_rpy(angles),
            info=RecordingInfo(name=path.stem, sensor="unknown (imported)"),
        ),
        notes=f"Imported from {path.name}.",
    )


def _match(table: Table, columns: Mapping[str, str]) -> dict[str, str]:
    """Ours -> the file's name of each column that is there."""
    ours = [name for names in CHANNELS.values() for name in names]
    found: dict[str, str] = {}
    for given in table.header:
        name = _our_name(_UNIT.sub("", given))
        if name is not None:
            found.setdefault(name, given)
    for name, given in columns.items():
        if name not in ours:
            raise RecordingError(f"there is no column '{name}' to fill; ours are {', '.join(ours)}", value=name)
        table.columns(given)  # complains where there is none
        found[name] = given
    return found


def _our_name(given: str) -> str | None:
    """`Gyroscope X` -> gx; None for a column that is none of ours."""
    plain = re.sub(r"[\s.\-/]+", "_", given.strip().lower())
    if re.fullmatch(_TIME, plain):
        return "t"
    if plain in DEVICE:
        return plain
    for channel, words in _WORDS.items():
        if match := re.fullmatch(rf"(?:{words})_?([xyz])", plain):
            return channel[0] + match[1]
    return None


def _channel(
    table: Table,
    names: Mapping[str, str],
    units: Mapping[str, str],
    channel: str,
    columns: Mapping[str, str] = NO_COLUMNS,
) -> Array | None:
    """A channel in our units, (n, 1 or 3); None where the file has none of its columns."""
    wanted = CHANNELS[channel]
    if not any(name in names for name in wanted):
        return None
    missing = [name for name in wanted if name not in names]
    if missing and channel == "angle" and not set(columns) & set(DEVICE):
        return None  # a yaw, say, of which nobody knows from where and which way it counts: the gyro knows better
    if missing:
        there = next(name for name in wanted if name in names)
        raise RecordingError(
            f"{table.path}: no column for '{missing[0]}', though there is '{there}'; the columns are "
            f"{', '.join(table.header)}: name it with --column {missing[0]}=NAME",
            path=table.path,
            value=missing[0],
        )
    files = [names[name] for name in wanted]
    return table.columns(*files) * [_scale(table, file, channel, units) for file in files]


def _scale(table: Table, column: str, channel: str, units: Mapping[str, str]) -> float:
    told = _UNIT.search(column)
    unit = units.get(channel) or (told[1] if told else "")
    if not unit:
        return 1.0
    plain = unit.lower().replace("°", "deg").replace("µ", "u").replace("μ", "u").replace("²", "2").replace(" ", "")
    if plain not in UNITS[channel]:
        raise RecordingError(
            f"{table.path}: the unit '{unit}' of column '{column}' is not known; give one of "
            f"{', '.join(UNITS[channel])} with --unit {channel}=UNIT",
            path=table.path,
            value=unit,
        )
    return UNITS[channel][plain]


def _magnetometer_beside(path: Path, t: Array) -> Array | None:
    """x-io writes Inertial.csv and Magnetometer.csv, each with the device's own time."""
    beside = path.with_name("Magnetometer.csv")
    if path.name != "Inertial.csv" or not beside.is_file():
        return None
    table = read_table(beside)
    names = _match(table, {})
    t_mag, mag = _channel(table, names, {}, "t"), _channel(table, names, {}, "mag")
    if t_mag is None or mag is None:
        return None
    return np.column_stack([np.interp(t, t_mag[:, 0], axis) for axis in mag.T])
