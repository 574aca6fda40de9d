"""What a column's name says: the quantity, the axis and often the unit.

`Gyroscope X (deg/s)`, `acc_x [g]`, `rotationRateX`. Names as programs write them: x-io's, WitMotion's (each version
another, two in Chinese), SensorLog's, Shimmer's Consensys, Movella's DOT app, ROS's, and what Arduino sketches print.
No such device was at hand; the sources are published readers, examples and files: docs/imports.md lists them.
"""

from __future__ import annotations

import re

from pbd.files.imu_columns import DEVICE

_WORDS = {
    "g": r"(?:.*_)?(?:gyr|gyro|gyroscope|gyro_?rotation|rotation_?rate|angular_?velocity|angular_?rate)|"
    r"g|w|omega|as|rotation|rot|ω|角速度",
    "a": r"(?:.*_)?(?:acc|accel|acceleration|accelerometer|specific_?force)|a|加速度",
    "m": r"(?:.*_)?(?:mag|magn|magnetometer|magnetic_?field)|m|h|磁场",
    "angle": r"angle|角度",
}
_PART = r"(?:_(?:ln|wr|ag|data|cal|calibrated))*"
"""What may follow a quantity: the chip (Shimmer has two accelerometers, low-noise and wide-range), or `calibrated`."""

_TIME = (
    r"t|time|timestamp|time_?stamp|seconds|secs?|时间|(?:seconds_|time_)?elapsed|millis|micros|date_?time|"
    r"sample_?time_?fine|(?:.*_)?time_?stamp(?:_unix|_sync|_formatted_unix)*_cal|(?:system_|unix_|logging_)?time(?:_?stamp)?"
)
_DEVICE_TIME = r"chip_?time|片上时间"
_DATE = r"(?:.*_)?date|日期"
TIME_UNITS = r"_(ns|us|ms|s|sec|min)$"
"""A unit of time at the end of a name: `timestamp_us`."""

_SUFFIXES = {"mps2": "m/s2", "ms2": "m/s2", "g": "g", "mg": "mg", "dps": "dps", "degs": "deg/s", "deg_s": "deg/s"} | {
    "rads": "rad/s",
    "rad_s": "rad/s",
    "radps": "rad/s",
    "uT": "ut",
    "ut": "ut",
    "gauss": "gauss",
}
"""Units that are part of a name: `accel_x_mps2`."""

_OTHER = (
    (r"(?:.*_)?(?:user|free|cal_free|earth|world|global|lin)_?acc\w*|(?:.*_)?gravity", "without gravity, or gravity"),
    (r"(?:.*_)?(?:raw|uncal\w*)(?:_.*)?", "raw counts"),
    (r"(?:quat|q|quaternion|orientation|euler|roll|pitch|yaw|mat)(?!.*rate).*", "an attitude that isn't used"),
    (r"d[qv]|i[qv]", "increments between samples"),
    (r"(?:.*_)?(?:temp(?:erature)?(?:_[a-z])?|温度)", "a temperature"),
    (r"(?:.*_)?(?:norm|total|magnitude|accuracy|status|range|bias|offset)", "not along one axis"),
)
"""Columns with axes that are no measurement of ours, and why."""


def plain(name: str) -> str:
    """`Gyroscope X (deg/s)` -> `gyroscope_x`, `rotationRateX` -> `rotation_rate_x`."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", split_unit(name)[0])
    return re.sub(r"[\s.\-/:_]+", "_", words.lower()).strip("_")


def split_unit(name: str) -> tuple[str, str]:
    """`Gyroscope X (deg/s)` -> `Gyroscope X`, `deg/s`; no unit is ""."""
    name = name.strip()
    opening = max(name.rfind(" ("), name.rfind("[")) if name.endswith("))") else max(name.rfind("("), name.rfind("["))
    if opening < 0 or not name.endswith((")", "]")):
        suffix = re.fullmatch(rf"(.+[xyzXYZ])_({'|'.join(_SUFFIXES)})", name)
        return (suffix[1], _SUFFIXES[suffix[2]]) if suffix else (name, "")
    return name[:opening].rstrip(), name[opening:].strip()[1:-1].strip()


def is_time(name: str) -> bool:
    """Whether a column holds a time."""
    word = plain(name)
    return re.fullmatch(f"{_TIME}|{_DEVICE_TIME}", re.sub(TIME_UNITS, "", word) or word) is not None


def is_date(name: str) -> bool:
    """Whether a column holds a date, which is a time where its rows have the time of day too."""
    return re.fullmatch(_DATE, plain(name)) is not None


def is_device_time(name: str) -> bool:
    """Whether it is by the clock of the device itself."""
    return re.fullmatch(_DEVICE_TIME, plain(name)) is not None


def our_name(name: str) -> tuple[str, str] | None:
    """Ours, and the set of three that it belongs to: `Accel_LN_X` -> ax, `accel_ln`; None for a column of no use."""
    word = plain(name)
    if is_time(name):
        return "t", word
    if word in DEVICE:
        return word, "compass"
    if match := re.fullmatch(r"(.+?)_?([xyz])((?:_cal)?)", word):
        group = match[1] + match[3]
        if any(re.fullmatch(pattern, match[1]) for pattern, _ in _OTHER):
            return None
        for first, words in _WORDS.items():
            if re.fullmatch(rf"(?:{words}){_PART}", match[1]):
                return first + match[2], group
    return None


def why_unread(name: str) -> str:
    """Say why a column isn't read."""
    word = re.sub(r"_?([xyz]|\d)(_cal)?$", "", plain(name))
    return next((why for pattern, why in _OTHER if re.fullmatch(pattern, word)), "")
