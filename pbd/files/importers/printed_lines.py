"""Names beside the numbers: lines that an Arduino sketch prints, and messages that ROS's `topic echo` prints.

They have no header. A serial monitor or `cat` saves a sketch's lines. Examples:

    AccelX:0.12,AccelY:-0.33,AccelZ:9.83                 Adafruit_MPU6050, examples/plotter
    Acceleration X: 0.12, Y: -0.33, Z: 9.83 m/s^2        Adafruit_MPU6050, examples/basic_readings
    Rotation X: 0.01, Y: 0.00, Z: -0.02 rad/s
    Acceleration: X=0.12, Y=-0.33, Z=0.98                M5StickC's MPU6886 sketches; the library gives g and deg/s
    AX:0.12 AY:-0.33 AZ:0.98
    12:34:56.789 -> ax: 0.12 ...                         with the times of Arduino's serial monitor

A new sample begins when a name is repeated. `rostopic echo` and `ros2 topic echo` print YAML, with --- after a message:

    angular_velocity:
      x: 0.01
"""

from __future__ import annotations

import re
from pathlib import Path

from pbd.errors import RecordingError
from pbd.files.importers.header_names import is_time
from pbd.files.table import Sheet

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_UNIT = r"(m/s\^?2|rad/s|deg/s|dps|uT|mg|g)(?![\w/])"
_PAIR = re.compile(
    rf"([A-Za-z][\w ./()-]{{0,40}}?)\x22?\s{{0,9}}[:=]\s{{0,9}}({_NUMBER})?(?![\d:])(?:\s{{0,9}}{_UNIT})?"
)
_KEY = re.compile(r"( *)(\w+):(.*)")
_STAMP = re.compile(r"\s*(\d{1,2}:\d{2}:\d{2}\.\d+)\s*->\s*")

NAMED_LINES = 20
"""Number of first lines by which the format is recognised."""

LONGEST_LINE = 1000
"""Number of characters that are read of a line."""

_MESSAGE_END = re.compile(r"(?m)^---\s*$")
ECHO_START = 10_000
"""Number of characters in which the first message of `topic echo` must end. One of sensor_msgs/Imu has about 1,000."""


def is_printed(text: str) -> bool:
    """Whether at least a third of the first lines have names beside their numbers, or ROS printed the text."""
    lines = [line for line in text.split("\n", NAMED_LINES)[:NAMED_LINES] if line.strip()]
    named = [line for line in lines if len(_pairs(line)) >= 3]
    return (3 * len(named) >= len(lines) > 0 and bool(named)) or _is_echoed(text)


def printed_sheet(path: Path, text: str) -> Sheet:
    """Convert printed lines to a table; RecordingError: no sample has three numbers with names."""
    if _is_echoed(text):
        return _echoed_sheet(path, text)
    samples: list[dict[str, str]] = [{}]
    units: dict[str, str] = {}
    for line in (line[:LONGEST_LINE] for line in text.split("\n")):
        stamp = _STAMP.match(line)
        pairs = _pairs(line[stamp.end() :] if stamp else line)
        if any(name in samples[-1] for name, *_ in pairs):
            samples.append({})
        if stamp and pairs:
            samples[-1].setdefault("time", stamp[1])
        unit = ""
        for name, _, its_unit in reversed(pairs):  # `X: 1, Y: 2, Z: 3 m/s^2`: of all three
            unit = its_unit or unit
            units |= {name: unit} if unit else {}
        samples[-1] |= {name: value for name, value, _ in pairs}
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
        what = "no line has three numbers with names; give --columns as for `pbd record --sensor lines`"
        raise RecordingError.at(path, what)
    columns = tuple(f"{name} ({units[name]})" if name in units else name for name in header)
    return Sheet(path, columns, "\n".join(rows), ",", 1, foreign=True, preamble="printed lines")


def _is_echoed(text: str) -> bool:
    """Whether ROS's `topic echo` printed the text: keys, values and items of lists, among them a vector's z."""
    messages = (message.strip() for message in _MESSAGE_END.split(text[:ECHO_START])[:-1])
    yaml = re.compile(r" *(?:\w+:|- )").match
    return any("\n  z: " in message and all(map(yaml, message.split("\n"))) for message in messages)


def _echoed_sheet(path: Path, text: str) -> Sheet:
    """Convert ROS's messages to a table, with `angular_velocity_x` for x below angular_velocity."""
    messages: list[dict[str, str]] = []
    for message in _MESSAGE_END.split(text)[:-1]:  # what follows the last one is cut off
        keys: list[tuple[int, str]] = []
        messages.append({})
        for line in filter(None, map(_KEY.fullmatch, message.split("\n"))):
            indent, key, value = len(line[1]), line[2], line[3].strip(" '\"\r")
            keys = [*((depth, above) for depth, above in keys if depth < indent), (indent, key)]
            if key == "frame_id" or re.fullmatch(_NUMBER, value):
                messages[-1]["_".join(name for _, name in keys)] = value.replace(",", " ")
    header = max(messages, key=len)
    timed = any(map(is_time, header))
    rows = [
        ",".join(message.get(name, "") for name in header)
        for k, message in enumerate(messages)
        if (k > 0 and not timed) or message.keys() == header.keys()  # without times each sample counts
    ]
    return Sheet(path, tuple(header), "\n".join(rows), ",", 1, foreign=True, preamble="ROS's messages")


def _pairs(line: str) -> list[tuple[str, str, str]]:
    """Return names, numbers, units ("": none). A bare X, Y or Z gets the word before it: `Rotation X: 1, Y: 2`."""
    found, word = [], ""
    for name, value, unit in _PAIR.findall(line[:LONGEST_LINE]):
        axis = re.fullmatch(r"(.*?)[\s_]*([XYZxyz])", name)
        if axis and axis[1]:
            word = axis[1]
        elif axis and word:
            name = f"{word} {axis[2]}"
        elif not value:
            word = name
        if value:
            found.append((name, value, unit))
    return found
