"""A CSV with a header: our own imu.csv, x-io's export, WitMotion's log, or any with recognisable column names.

A header names the channel and often its unit: `Gyroscope X (deg/s)`, `acc_x [g]`, `Timestamp (us)`, `gx`. The caller
gives what it lacks. The default unit is SI. Specific force in another unit is detected by its norm at
rest.

WitMotion's programs write what its modules send, and each version names it otherwise: `ax(g)`, `AccX(g)`,
`Acceleration X(g)` or a Chinese word; `wx(deg/s)` or `AsX(°/s)`; angles as roll, pitch and yaw; dates for times. The
names here are those in readers that others published (telemetry-parser's `witmotion` for one) and in WitMotion's own
examples; no such device was at hand.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pbd.data import GRAVITY, Recording, RecordingInfo
from pbd.errors import RecordingError, listed, printable
from pbd.files.importers import check_rate
from pbd.files.imu_columns import ACC, DEVICE, GYR, MAG, device_rpy
from pbd.files.table import Sheet, Table, open_sheet, require
from pbd.pose import Array

DEG = np.pi / 180.0
UNITS: Mapping[str, Mapping[str, float]] = {
    "t": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "gyr": {"rad/s": 1.0, "deg/s": DEG, "dps": DEG, "mdps": 1e-3 * DEG},
    "acc": {"m/s2": 1.0, "m/s^2": 1.0, "m/s/s": 1.0, "g": GRAVITY, "mg": 1e-3 * GRAVITY, "mm/s2": 1e-3, "cm/s2": 1e-2},
    "mag": {"ut": 1.0, "mg": 0.1, "g": 100.0, "gauss": 100.0, "mgauss": 0.1, "t": 1e6, "nt": 1e-3, "a.u.": 1.0},
    "angle": {"rad": 1.0, "deg": DEG},
}
"""Factor from each unit to ours (s, rad/s, m/s2, uT, rad)."""

RPY = ("anglex", "angley", "anglez")
"""The device's own attitude as turns about x, y, z; z counts from east to north."""

CHANNELS = {"t": ("t",), "gyr": GYR, "acc": ACC, "mag": MAG, "angle": DEVICE, "rpy": RPY}

_WORDS = {
    "g": r"g|gyr|gyro|gyroscope|w|omega|angular_?velocity|angular_?rate|as|角速度",
    "a": r"a|acc|accel|acceleration|accelerometer|linear_?acceleration|specific_?force|加速度",
    "m": r"m|mag|magn|magnetometer|magnetic_?field|h|磁场",
    "angle": r"angle|角度",
}
_TIME = r"t|time|timestamp|time_?stamp|seconds|sec|时间"
_DEVICE_TIME = r"chip_?time|片上时间"
_DEVICE = r"address|device_?name|设备名称"
_MANGLED = str.maketrans({"°": "deg", "µ": "u", "μ": "u", "ʯ": "u", "?": "u", "²": "2", " ": ""})
"""Variants of unit signs, with the micro sign as wrong encodings garble it."""


def read_csv(
    path: Path, columns: Mapping[str, str], units: Mapping[str, str], rate_hz: float | None = None
) -> Recording:
    """Read a recording from a table with a header.

    Args:
        path: the file; x-io's Magnetometer.csv beside it, where the file has no magnetometer, is joined by its time.
        columns: ours -> the file's column, for those that the header doesn't tell; -NAME turns the sign.
        units: channel (t, gyr, acc, mag, angle) -> unit, likewise; -UNIT turns the sign of all three axes.
        rate_hz: of a table without times: row k was read at k / rate_hz s.

    Raises:
        RecordingError: a column or unit is missing or unknown; there are both times and a rate; the table is no table.
    """
    if rate_hz is not None:
        check_rate(path, rate_hz, "the rate is")
    for channel in units:
        if channel not in UNITS:
            raise RecordingError(f"no unit can be given for '{channel}'; give it for {', '.join(UNITS)}", value=channel)
    sheet = open_sheet(path, foreign=True)
    _refuse_several_devices(sheet)
    names, turned = _match(sheet, columns)
    timed, known = "t" in names, f"the columns are {listed(sheet.header)}"
    say = "say which is which with --column, for example --column ax=NAME"
    if not timed and rate_hz is None:
        what = f"no column for t (time); {known}: {say}, or import it with its --rate HZ"
        raise RecordingError(f"{path}: {what}", path=path)
    if not set(ACC) & set(names):
        raise RecordingError(f"{path}: no column for ax, ay, az (specific force); {known}: {say}", path=path)
    if timed and rate_hz is not None:
        raise RecordingError(f"{path}: the column '{names['t']}' tells the time; leave --rate out", path=path)
    for angles in (DEVICE, RPY):
        if not set(angles) <= set(names) and not set(columns) & set(angles):
            # The origin and the sign of such a yaw are unknown: the gyro is more reliable.
            names = {ours: given for ours, given in names.items() if ours not in angles}
    for wanted in CHANNELS.values():
        missing = [name for name in wanted if name not in names]
        if missing and len(missing) < len(wanted):
            there = next(name for name in wanted if name in names)
            what = f"no column for '{missing[0]}', though there is '{there}'; {known}"
            raise RecordingError(
                f"{path}: {what}: name it with --column {missing[0]}=NAME", path=path, value=missing[0]
            )
    clocks = [names["t"]] if "t" in columns else _clocks(sheet)
    table = sheet.read([*names.values(), *clocks], times=clocks)
    if timed:  # the device's own clock, where it tells the samples apart as well as the computer's does
        distinct = [np.unique(values[np.isfinite(values)]).size for values in table.columns(*clocks).T]
        names["t"] = clocks[int(np.argmax(distinct))]

    with np.errstate(all="ignore"):  # what becomes infinite is found with all else that is no number
        channels = {
            channel: _values(table, names, turned, wanted, channel, units) for channel, wanted in CHANNELS.items()
        }
        clock = channels["t"]
        t = np.arange(len(table.values)) / (rate_hz or 1.0) if clock is None else clock[:, 0]
        acc, mag, compass = channels["acc"], channels["mag"], channels["angle"]
        assert acc is not None
        return Recording(
            t=t - t[0],
            acc=acc,
            gyr=channels["gyr"],
            mag=_magnetometer_beside(path, t) if mag is None else mag,
            device_rpy=channels["rpy"] if compass is None else device_rpy(compass),
            info=RecordingInfo(rate_hz=rate_hz),
        )


def _values(
    table: Table,
    names: Mapping[str, str],
    turned: set[str],
    wanted: tuple[str, ...],
    channel: str,
    units: Mapping[str, str],
) -> Array | None:
    """A channel's columns, converted to our units; None where the file doesn't have it."""
    if wanted[0] not in names:
        return None
    unit = "angle" if channel == "rpy" else channel
    scales = [_scale(table.path, names[ours], unit, units) * (-1.0 if ours in turned else 1.0) for ours in wanted]
    values: Array = table.columns(*(names[ours] for ours in wanted)) * scales
    return values


def _match(sheet: Sheet, columns: Mapping[str, str]) -> tuple[dict[str, str], set[str]]:
    """Ours -> the file's name of each column that is there; and those of ours whose sign is to be turned."""
    ours = [name for names in CHANNELS.values() for name in names]
    found: dict[str, str] = {}
    turned: set[str] = set()
    for given in sheet.header:
        name = _our_name(given)
        if name is not None:
            found.setdefault(name, given)
    for name, given in columns.items():
        if name not in ours:
            raise RecordingError(f"unknown channel '{name}'; choose one of {', '.join(ours)}", value=name)
        if given not in sheet.header and given.startswith("-"):
            given = given[1:]
            turned.add(name)
        require(sheet.path, sheet.header, [given])
        found[name] = given
    return found, turned


def _refuse_several_devices(sheet: Sheet) -> None:
    for name in sheet.header:
        if re.fullmatch(_DEVICE, _plain(name)) and len(devices := set(sheet.words(name))) > 1:
            what = f"the rows of {len(devices)} devices ({listed(sorted(devices)[:3])}) in the column '{name}'"
            keep = "keep those of one device in a file of its own"
            raise RecordingError(f"{sheet.path}: {what}; {keep}", path=sheet.path, value=len(devices))


def _clocks(sheet: Sheet) -> list[str]:
    """The column of the device's own time, and of the computer's, where there are such."""
    clocks = [name for name in sheet.header if _our_name(name) == "t"]
    own = [name for name in clocks if re.fullmatch(_DEVICE_TIME, _plain(name))]
    return [*own[:1], *[name for name in clocks if name not in own][:1]]


def _plain(given: str) -> str:
    return re.sub(r"[\s.\-/]+", "_", _split_unit(given)[0].lower())


def _split_unit(given: str) -> tuple[str, str]:
    """`Gyroscope X (deg/s)` -> `Gyroscope X`, `deg/s`; no unit is ""."""
    plain = given.strip()
    opening = max(plain.rfind("("), plain.rfind("["))
    if opening < 0 or not plain.endswith((")", "]")):
        return plain, ""
    return plain[:opening].rstrip(), plain[opening + 1 : -1].strip()


def _our_name(given: str) -> str | None:
    """`Gyroscope X (deg/s)` -> gx; None for a column that is none of ours."""
    plain = _plain(given)
    if re.fullmatch(f"{_TIME}|{_DEVICE_TIME}", plain):
        return "t"
    if plain in DEVICE:
        return plain
    for first, words in _WORDS.items():
        if match := re.fullmatch(rf"(?:{words})_?([xyz])", plain):
            return first + match[1]
    return None


def _scale(path: Path, column: str, channel: str, units: Mapping[str, str]) -> float:
    unit = units.get(channel) or _split_unit(column)[1]
    if not unit:
        return 1.0
    plain = unit.lower().translate(_MANGLED)
    sign = -1.0 if plain.startswith("-") else 1.0
    plain = plain.removeprefix("-")
    if plain not in UNITS[channel]:
        raise RecordingError(
            f"{path}: the unit '{printable(unit)}' of column '{printable(column)}' is not known; give one of "
            f"{', '.join(UNITS[channel])} with --unit {channel}=UNIT",
            path=path,
            value=unit,
        )
    return sign * UNITS[channel][plain]


def _magnetometer_beside(path: Path, t: Array) -> Array | None:
    """x-io writes Inertial.csv and Magnetometer.csv, each with the device's own time."""
    beside = path.with_name("Magnetometer.csv")
    if path.name != "Inertial.csv" or not beside.is_file():
        return None
    sheet = open_sheet(beside, foreign=True)
    names, _ = _match(sheet, {})
    if not {"t", *MAG} <= set(names):
        return None
    table = sheet.read([names["t"], *(names[axis] for axis in MAG)])
    t_mag, mag = (_values(table, names, set(), CHANNELS[channel], channel, {}) for channel in ("t", "mag"))
    assert t_mag is not None
    assert mag is not None
    return np.column_stack([np.interp(t, t_mag[:, 0], axis) for axis in mag.T])
