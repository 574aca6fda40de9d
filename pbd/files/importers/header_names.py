"""What the name of a column tells: the quantity, the axis and often the unit.

Examples are `Gyroscope X (deg/s)`, `acc_x [g]`, `rotationRateX`. The names are those of x-io, WitMotion (they differ
between versions, two are Chinese), SensorLog, AndroSensor, HyperIMU, Physics Toolbox, Shimmer's Consensys, Movella's
DOT app, Vicon's Blue Trident, EuRoC, ROS and Arduino sketches. No such device was at hand; docs/imports.md lists the
published readers, examples and files that were used. German names are plain translations.
"""

import re
from functools import lru_cache

from pbd.data.imu_columns import ATTITUDE
from pbd.data.units import normalized_unit, unit_factor
from pbd.files.header_line import MOST_COLUMNS

_WORDS = {
    "g": r"(?P<before>.*_)?(?:gyr|gyro|gyroscope|gyro_?rotation|rotation_?rate|ang(?:ular)?_?(?:vel(?:ocity)?|rate))|"
    r"g|gy|w|pqr|omega|as|rotation|rot|ω|角速度|dreh(?:rate)?|winkelgeschwindigkeit|gyroskop",
    "a": r"(?P<before>.*_)?(?:accl?|accel(?:eration|erometer)?|specific_?force)(?:_(?:including|with)_gravity)?|"
    r"ac?|g_?f|加速度|beschl(?:eunigung)?",
    "m": r"(?P<before>.*_)?(?:mag|magn|magnetometer|magnetic_?field)|m|b|h|磁场|magnetfeld",
    "angle": r"angle|角度",
}
_CHIP = r"_(?!std|var|rms|mean|avg|max|min|raw|bias|lin)[a-z]{1,4}\d[a-z\d]{2,}(?:_[a-z])?"
"""A chip after a quantity or an axis: HyperIMU's `gyroscope_lsm6ds3_c.x`, `ax_mpu6050`; `ax_std100` is a statistic."""

_SUFFIX = "_(?:ln|wr|ag|data|sensor|adc|cal|calibrated|corrected|smooth|rs_s|rad|m_s2)"
_PART = rf"(?P<number>\d?)(?:{_SUFFIX})*(?P<chip>{_CHIP})?"
"""Suffixes of a quantity: a number, the part (Shimmer has a low-noise and a wide-range accelerometer), `calibrated`,
Betaflight's `gyroADC` and `accSmooth`, a frame (EuRoC), the SI unit (PX4), and the chip."""

_NUMBERED = r"(?P<numbered>[a-z]+\d+_)?"
"""A device before a quantity, as in `s1_ax` and `bmi160_a_x`."""

_AXES = (
    r"(?P<quantity>.+?)_?(?P<axis>[xyz])(?P<device>(?:_cal)?)",
    rf"(?P<quantity>.+?)_?(?P<axis>[xyz])(?P<device>_?\d\d?|_[a-dlrxy]|{_CHIP})",
    r"(?:.*_)?(?P<axis>[xyz])_?(?P<quantity>(?:acc|gyr|ang|mag)\w*)(?P<device>)",
)
"""Patterns of an axis: `acc_x`; `acc_x_1`, `acc_x_l` (a device, a side, one of two joined tables); `x_acc`."""

_TIME = (
    r"t|ts|epoch?|x_value|时间|(?:uhr)?zeit|zeitstempel|(?:seconds_|time_)?elapsed|elapsed_?time|"
    r"date_?time|time_?since_?start|time_?start_?up|time(?:_?stamp)?_(?:\d|[a-dlrxy])|"
    r"sample_?time_?fine|(?:.*_)?time_?stamp(?:_unix|_sync|_formatted_unix)*_cal|gpst|(?:gps_)?tow|"
    r"(?:(?:system|unix|unit|logging|server|host|pc|mac|phone|device|sensor|imu|received|arrival|local)_?)?time(?:_?stamp)?"
)
_DEVICE_TIME = (
    r"chip_?time|片上时间|(?:.*_)?header_stamp(?:_secs?)?|"
    r"(?:device|sensor|imu|mcu|board|arduino|esp\d*)_(?:time(?:_?stamp)?_)?(?:ms|us)"
)
_TIME_STEP = r"d_?t|delta_?t(?:ime)?|time_?(?:delta|diff(?:erence)?|step)|(?:sample_|sampling_)(?:interval|period|time)"
_COUNTER = (
    r"(?:(?:packet|sample|frame|message|msg|row)_?)?(?:counter|count|number|num|nr|no|index|idx|zähler)|sample|packet|"
    r"(?:.*_)?seq(?:uence)?(?:_?number)?"
)
_SECONDS = r"(?:n|u|m|nano|micro|milli)?s(?:ecs?|econds?)?"
_TIME_UNITS = rf"_({_SECONDS}|min)$"
"""A unit of time at the end of a name, as in `timestamp_us`."""

_NOT_A_UNIT = r"txt|local|.*\b(?:utc|gmt|iso\W*8601)\b.*|(?:[ydmo]{2,4}\W+){2}.*|h{1,2}:mm\b.*"
"""Notes, in lower case, of a column of dates or times of day: their format, such as `hh:mm:ss.ms`, or the zone."""

_TEMPERATURES = r"[°º℃℉]\s?[cfk]?|deg\w*[\s_]?[cfk]?|[cfk]|celsius|kelvin"
"""Units of temperatures, in lower case."""

_COMPUTED = "about the sensor, or computed from its readings"

_NEVER_READ = (
    (
        r"(?:.*_)?(?:user|free|cal_free|earth|world|global|lin)_?acc\w*|linear\w*_beschleunigung"
        r"|(?:.*_)?(?<!including_)(?<!with_)gravity",
        "gravity, or gravity removed",
    ),
    (r"(?:.*_)?(?:raw|uncal\w*)(?:_.*)?", "raw counts"),
    (r"(?:.*_)?ang(?:ular)?_?acc\w*", "an angular acceleration"),
    (r"(?:.*_)?(?:bias|offset|std|var|cov|sigma|rms|mean|avg|max|min|noise|err|error|delta)_.*", _COMPUTED),
    (r"(?:.*_)?(?:ref|cmd|target|desired|pred|predicted|prev|gps|gnss)_(?!.*imu).*", "no reading of the sensor"),
    (
        r"(?:.*_)?(?:quat|orientation|euler|rotation_vector).*|(?:q|roll|pitch|yaw|mat)(?!.*rate).*",
        "an attitude that isn't used",
    ),
    (r"d[qv]|i[qv]", "increments between samples"),
    (r"(?:.*_)?dat(?:e|um)(?:_.*)?", "the date"),
)
"""Patterns of columns that aren't read, and why."""

_DERIVED = (
    r"(?:.*_)?(?:time|time_?stamp|temp|temperature|norm|abs\w*|magnitude|total|resultant|bias|range|scale|fs|"
    r"sens(?:itivity)?|offset|status|state|valid|ok|error|clip\w*|accuracy|count\w*|samples|num\w*|seq|id|name|unit|"
    r"version|calibration|std\w*|var\w*|cov\w*|rms|mean|avg|max|min|heading|declination|inclination|dip)"
    r"(?:_?\d+|_.*)?"
)
"""Patterns of columns about a sensor, or computed from its readings: `gyroTimestamp_sinceReboot`, `acc_norm`."""

_INERTIAL = {
    "g": (
        r"gyr|omega|dreh(?:_|rate)|winkelgeschw|ang(?:ular)?_?(?:vel|rate|speed)|(?:rotation|turn|roll|pitch|yaw)_?rate",
        r"rot|ang|turn|rate",
    ),
    "a": (r"acc(?!ur|ess|um|ount|ept)|specific_?force|beschl(?:_|eunigung)", r"force"),
    "m": (r"magn?(?:_|\d|$)|magnet", r"mag|field_?[xyz]$"),
}
"""Word beginnings of a gyro (g), accelerometer (a), magnetometer (m): first in any name, second only beside an axis."""


def plain(name: str) -> str:
    """Normalise a name without its unit: `Gyro X-Axis (deg/s)` is `gyro_x`, `rotationRateX` `rotation_rate_x`."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", split_unit(name)[0])
    return re.sub(r"_axis$", "", re.sub(r"[\s.,\-/:_%]+", "_", words.lower()).strip("_"))


@lru_cache(maxsize=MOST_COLUMNS)  # names recur in every printed line
def split_unit(name: str) -> tuple[str, str]:
    """Split off the unit, "" if there is none: `Gyroscope X (deg/s)` -> `Gyroscope X`, `deg/s`.

    It may follow ` / `, ` in `, a comma or an axis too (`accel_x_mps2`), and a slash or an underscore if it is known
    (`a_x/g`, `X_gyro_dps`). An index is an axis: `gyro_rad[0]` -> `gyro_rad_x`, `Gyroscope (z) [rad/s]` ->
    `Gyroscope_z`, `rad/s`.
    """
    name = re.sub(r"\s*[\[(]([012xyzXYZ])[\])](?=$|\s*[\[(])", _index, name.strip())
    if separated := re.fullmatch(r"(.*\w)(?: (?:/|in) |, ?)(?![xyzXYZ]$)(\S*)", name):
        return separated[1], separated[2]
    opening = max(name.rfind(" ("), name.rfind("[")) if name.endswith("))") else max(name.rfind("("), name.rfind("["))
    if opening < 0 or not name.endswith((")", "]")):
        slash = name.find("/", 1)
        of_time = ("t",) if slash > 0 and re.fullmatch(_TIME, name[:slash].lower()) else ()
        behind = [found.start() for found in re.finditer("_(?=[a-zA-Z])", name)]
        behind = [k for k in behind if re.search("(?<=.)[xyzXYZ]$|^[xyzXYZ]_.", name[:k])]
        for k in [*behind, *[slash] * (slash > 0)]:
            if any(unit_factor(quantity, name[k + 1 :]) for quantity in ("acc", "gyr", "mag", "angle", *of_time)):
                return name[:k], name[k + 1 :]
        return name, ""
    return name[:opening].rstrip(), name[opening:].strip()[1:-1].strip()


def _index(found: re.Match[str]) -> str:
    return "_" + {"0": "x", "1": "y", "2": "z"}.get(found[1], found[1])


def is_time(name: str) -> bool:
    """Whether a column contains times: of the rows, or the accelerometer's own. `T (°C)` is a temperature."""
    if re.fullmatch(_TEMPERATURES, split_unit(name)[1].lower()):
        return False
    word = plain(name)
    words = (word, re.sub(_TIME_UNITS, "", word))
    return any(re.fullmatch(f"{_TIME}|{_DEVICE_TIME}|{_SECONDS}", each) for each in words) or own_times_of(name) == "a"


def time_unit(name: str) -> str:
    """Return the unit that the name of a column of times tells, as `time_ms`, `Time (ms)` and `millis` do; "": none."""
    given = re.sub(r"^(?:epoch|unix)\W+|\W*\b(?:epoch|unix|since)\b.*", "", split_unit(name)[1], flags=re.IGNORECASE)
    if given and not re.fullmatch(_NOT_A_UNIT, given.lower()):
        return given
    suffix = re.search(_TIME_UNITS, word := plain(name))
    word = suffix[1] if suffix else word.removesuffix("_elapsed")
    return "" if re.fullmatch(_NOT_A_UNIT, name.lower()) or unit_factor("t", word) is None else word


def is_time_step(name: str) -> bool:
    """Whether a column contains the time since the row before."""
    word = plain(name)
    return re.fullmatch(_TIME_STEP, re.sub(_TIME_UNITS, "", word)) is not None


def is_counter(name: str) -> bool:
    """Whether a column counts the samples, as Xsens' `PacketCounter` and ROS's `header.seq` do."""
    return re.fullmatch(_COUNTER, plain(name)) is not None


def own_times_of(name: str) -> str:
    """Return g, a or m if a column contains that sensor's own times, as `Gyro_TimeStamp` or `time_acc`, else ""."""
    word = re.sub(_TIME_UNITS, "", plain(name))
    for sensor, time in (word.partition("_")[::2], word.rpartition("_")[::-2]):
        if re.fullmatch(_TIME, time):
            return looks_inertial(sensor)
    return ""


def is_device_time(name: str) -> bool:
    """Whether a column contains times of the device's own clock."""
    return re.fullmatch(_DEVICE_TIME, plain(name)) is not None


def our_name(name: str) -> tuple[str, str, str] | None:
    """Return our name for a column, its set of axes and its device ("" for none); None if we have no name for it.

    `Accel_LN_X` -> ax, `accel_ln`, ""; `left_gyr_x_2` -> gx, `left_gyr_2`, `left__2`.
    """
    word = plain(name)
    if is_time(name):
        return "t", word, ""
    if word in ATTITUDE:
        return word, "compass", ""
    for match in filter(None, (re.fullmatch(axis, word) for axis in _AXES)):
        quantity = match["quantity"]
        if any(re.fullmatch(pattern, quantity) for pattern, _ in _NEVER_READ):
            return None
        for first, words in _WORDS.items():
            if found := re.fullmatch(rf"{_NUMBERED}(?:{words}){_PART}", quantity):
                device = "".join(filter(None, (*found.groups(), match["device"])))
                return first + match["axis"], quantity + match["device"], device
    return None


def in_counts(name: str) -> bool:
    """Whether a column's unit says that it holds raw counts, as Garmin's `accel_x (counts)`."""
    return re.fullmatch("counts?|lsb|raw|adc", split_unit(name)[1].lower()) is not None


def looks_inertial(name: str) -> str:
    """Return g, a or m if a column looks like a gyro, an accelerometer or a magnetometer, else ""."""
    word = plain(name)
    has_axis = re.search(r"[xyz](?:_|$)|^[xyz]_", word) is not None
    for letter, (alone, with_axis) in _INERTIAL.items():
        if re.search(rf"(?:^|_|(?<=imu))(?:{alone}{'|' + with_axis if has_axis else ''})", word):
            return letter
    return "g" if has_axis and re.search("(?:deg|rad)/s$|dps$", normalized_unit(split_unit(name)[1])) else ""


def why_never_read(name: str) -> str:
    """Return why a column of this name is never read; "" if the name doesn't tell."""
    word = plain(name)
    of_axes = re.sub(r"_?([xyz]|\d)(_cal)?$", "", word)
    known = next((why for pattern, why in _NEVER_READ if re.fullmatch(pattern, of_axes)), "")
    return known or (_COMPUTED if re.fullmatch(_DERIVED, word) else "")
