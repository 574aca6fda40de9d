"""Names beside the numbers: lines that an Arduino sketch prints, and messages that ROS's `topic echo` prints.

They have no header. A serial monitor or `cat` saves a sketch's lines. Examples:

    AccelX:0.12,AccelY:-0.33,AccelZ:9.83                 Adafruit_MPU6050, examples/plotter
    Acceleration X: 0.12, Y: -0.33, Z: 9.83 m/s^2        Adafruit_MPU6050, examples/basic_readings
    Rotation X: 0.01, Y: 0.00, Z: -0.02 rad/s
    Acceleration: X=0.12, Y=-0.33, Z=0.98                M5StickC's MPU6886 sketches; the library gives g and deg/s
    AX:0.12 AY:-0.33 AZ:0.98
    Gyro (dps): 0.12, -0.33, 0.98                        the axes in a row, also in tabs, bars or brackets
    Scaled. Acc (mg) [ 00012.21, ...], Gyr (DPS) [ ...   SparkFun's ICM-20948 library
    Acceleration:                                        Adafruit's BNO08x library
    X: 0.12  Y: -0.33 Z: 9.83  m/s^2
    >ax:1234:0.12                                        Teleplot, with or without its time in ms
    I (1234) imu: ax=0.12 ay=-0.33 az=0.98               ESP-IDF's log
    12:34:56.789 -> ax: 0.12 ...                         with the times of Arduino's serial monitor
    [2024-05-01 12:34:56.789] ax: 0.12 ...               with those of Tera Term

A new sample begins when a name is repeated. `rostopic echo` and `ros2 topic echo` print YAML, with --- after a message:

    angular_velocity:
      x: 0.01
"""

import re
from collections import Counter
from pathlib import Path

from pbd.errors import RecordingError
from pbd.files.importers.header_names import is_time, our_name, split_unit
from pbd.files.table import Sheet
from pbd.io.numbers import is_stamp

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_RATE = r"(?:rad(?:ians)?|deg(?:rees?)?|[°º])/s(?:ec)?|m?dps"
_UNIT = rf"(m/s\^?[2²]|m/s/s|{_RATE}|deg(?:rees?)?|[°º]|[uµμ]T|gauss|m?[gG]|[mu]?s)(?![\w/]|\s{{0,9}}[:=])"
_NEXT = r"\s{0,9}[\s,;|]\s{0,9}"
_MARK = rf"(?:[:=]\s{{0,9}}[\x22'(\[]?|\[(?=\s{{0,9}}{_NUMBER}{_NEXT}{_NUMBER}{_NEXT}))\s{{0,9}}"
_NAME = rf"([A-Za-z][\w ./()\[\]^°-]{{0,40}}?)[\x22']?\s{{0,9}}{_MARK}"
_AXES = rf"({_NUMBER}){_NEXT}({_NUMBER}){_NEXT}({_NUMBER})(?![\d.eE]|(?:{_NEXT})?[-+]?\.?\d)"
_PAIR = re.compile(rf"{_NAME}(?:{_AXES}|({_NUMBER})?(?![\d:]))(?:[\])§]?\s{{0,9}}{_UNIT})?")
_LOGGED = "logging_time_ms"
"""Our name of the times that Teleplot and ESP-IDF write. Each line has one; a sample has that of its first line."""

_TIMES = (
    (r">([^:|]{1,40}):(\d+(?:\.\d*)?):(?=[-+.\d])", rf"{_LOGGED}:\2 \1:"),
    (r"(?:\x1b\[[\d;]*m)?[EWIDV] \((\d+)\) [^:]{1,40}: ", rf"{_LOGGED}:\1 "),
)
"""Beginnings of the lines of Teleplot and of ESP-IDF's log, with a time in ms, and what replaces them."""

_HEADING = re.compile(r"\s*([A-Za-z][\w ./()\[\]^°-]{0,40}):\s*")
"""A line that is only a name, whose axes are in the next ones."""

_KEY = re.compile(r"( *)(\w+):(.*)")
_STAMP = re.compile(r"\s*(?:\[([^\]]{8,40})\]|(\w[\w :.,/-]{7,39}?)\s*->|(\d\S{7,30}(?: [\d:.,]{8,20})?)(?=\s))\s*")
_FINE = re.compile(r":\d\d(?:[.,]\d|:\d\d:\d)")
"""In a time of day, more than whole seconds."""

NAMED_LINES = 20
"""Number of first lines by which the format is recognised."""

LONGEST_LINE = 1000
"""Number of characters that are read of a line."""

_MESSAGE_END = re.compile(r"(?m)^---\s*$")


def is_printed(text: str) -> bool:
    """Whether ROS printed the text, or a third of the first lines have three named numbers, or an axis that recurs."""
    lines = [line for line in text.split("\n", NAMED_LINES)[:NAMED_LINES] if line.strip()]
    names = [[name for name, *_ in _pairs(line)] for line in lines]
    count = Counter(name for each in names for name in each if (our_name(name) or "t")[0] != "t")
    named = [each for each in names if len(each) >= 3 or any(count[name] > 1 for name in each)]
    return (3 * len(named) >= len(lines) > 0 and bool(named)) or _is_echoed(text)


def printed_sheet(path: Path, text: str) -> Sheet:
    """Convert printed lines to a table; RecordingError: no sample has three numbers with names."""
    samples, units = (_echoed_samples(text), {}) if _is_echoed(text) else _printed_samples(text)
    # The first and last sample may be incomplete. Numbers that are printed rarely, such as temperatures, are ignored.
    names = max(samples, key=len)
    header = [name for name in names if sum(name in sample for sample in samples) * 2 > len(samples)]
    # Without times each sample counts, even one of which a line was lost.
    last = 0 if any(map(is_time, header)) else len(samples) - 1
    rows = [
        ",".join(sample.get(name, "") for name in header)
        for k, sample in enumerate(samples)
        if 0 < k < last or all(name in sample for name in header)
    ]
    if len(header) < 3 or not rows:
        what = 'no line has three numbers with names; import it with --sensor lines --columns "..."'
        raise RecordingError.at(path, what)
    columns = tuple(f"{name} ({units[name]})" if name in units else name for name in header)
    return Sheet(path, columns, "\n".join(rows), ",", 1)


def _printed_samples(text: str) -> tuple[list[dict[str, str]], dict[str, str]]:
    """Return each sample's numbers by their names, and the units of the names that have one."""
    samples: list[dict[str, str]] = [{}]
    units: dict[str, str] = {}
    word = ""
    for line in (line[:LONGEST_LINE] for line in text.split("\n")):
        stamp, rest = _stamped(line)
        if heading := _HEADING.fullmatch(rest):
            word = heading[1]
        pairs = _pairs(rest, word)
        if any(name in samples[-1] for name, *_ in pairs if name != _LOGGED):
            samples.append({})
        if stamp and pairs:
            samples[-1].setdefault("time", stamp)
        units |= {name: unit for name, _, unit in pairs if unit}
        samples[-1] |= {name: value for name, value, _ in pairs if name not in samples[-1]}
    return samples, units


def _is_echoed(text: str) -> bool:
    """Whether ROS's `topic echo` printed the text: keys, values and items of lists, among them a vector's z."""
    # The first message must end early: one of sensor_msgs/Imu has about 1,000 characters.
    messages = (message.strip() for message in _MESSAGE_END.split(text[:10_000])[:-1])
    yaml = re.compile(r" *(?:\w+:|- )").match
    return any("\n  z: " in message and all(map(yaml, message.split("\n"))) for message in messages)


def _echoed_samples(text: str) -> list[dict[str, str]]:
    """Return the numbers of each of ROS's messages, with the name `angular_velocity_x` for x below angular_velocity."""
    messages: list[dict[str, str]] = []
    for message in _MESSAGE_END.split(text)[:-1]:  # what follows the last one is cut off
        keys: list[tuple[int, str]] = []
        messages.append({})
        for line in filter(None, map(_KEY.fullmatch, message.split("\n"))):
            indent, key, value = len(line[1]), line[2], line[3].strip(" '\"\r")
            keys = [*((depth, above) for depth, above in keys if depth < indent), (indent, key)]
            if key == "frame_id" or re.fullmatch(_NUMBER, value):
                messages[-1]["_".join(name for _, name in keys)] = value.replace(",", " ")
    return messages


def _stamped(line: str) -> tuple[str, str]:
    """Split off a serial monitor's time of day, "" if there is none."""
    found = _STAMP.match(line)
    stamp = next(filter(None, found.groups()), "") if found else ""
    return (stamp, line[found.end() :]) if found and is_stamp(stamp) and _FINE.search(stamp) else ("", line)


def _pairs(line: str, word: str = "") -> list[tuple[str, str, str]]:
    """Return names, numbers, units ("": none).

    A bare X, Y or Z gets the word before it: `Rotation X: 1, Y: 2`, at first `word`. Three numbers after a name are its
    axes.
    """
    found = []
    word, its_unit = split_unit(word)
    for beginning, named in _TIMES:
        line = re.sub(rf"\A{beginning}", named, line)
    for name, x, y, z, value, unit in _PAIR.findall(line[:LONGEST_LINE]):
        axis = re.fullmatch(r"(.*?)[\s_]*([XYZxyz])", name)
        if x:
            stem, its_unit = split_unit(name)
            found += [(f"{stem} {axis}", value, unit or its_unit) for axis, value in zip("xyz", (x, y, z), strict=True)]
        elif value and axis and axis[1]:
            word, its_unit = axis[1], ""
        elif axis and not axis[1] and word:
            name, unit = f"{word} {axis[2]}", unit or its_unit
        elif not value:
            word, its_unit = split_unit(name)
        if value:
            found.append((name, value, unit))
    return found
