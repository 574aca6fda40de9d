"""Lines that a sketch printed, with names beside the numbers, as a serial monitor or `cat` keeps.

Recognised by names before the numbers, not by a header (Arduino's serial plotter wants `name:value`):

    AccelX:0.12,AccelY:-0.33,AccelZ:9.83                 Adafruit_MPU6050, examples/plotter
    Acceleration X: 0.12, Y: -0.33, Z: 9.83 m/s^2        Adafruit_MPU6050, examples/basic_readings
    Rotation X: 0.01, Y: 0.00, Z: -0.02 rad/s
    Acceleration: X=0.12, Y=-0.33, Z=0.98                M5StickC's MPU6886 sketches; the library gives g and deg/s
    AX:0.12 AY:-0.33 AZ:0.98
    12:34:56.789 -> ax: 0.12 ...                         with the times of Arduino's serial monitor

A sample begins where its first name comes again.
"""

from __future__ import annotations

import re
from pathlib import Path

from pbd.errors import RecordingError
from pbd.files.table import Sheet

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_PAIR = re.compile(rf"([A-Za-z][\w ./()-]{{0,40}}?)\s{{0,9}}[:=]\s{{0,9}}({_NUMBER})?(?![\d:])")
_STAMP = re.compile(r"\s*(\d{1,2}:\d{2}:\d{2}\.\d+)\s*->\s*")
_UNIT = re.compile(r"\d\.?\s{0,9}(m/s\^?2|rad/s|deg/s|dps|uT|g)\s*$")

NAMED_LINES = 20
"""How many of the first lines show whether names are beside the numbers."""

LONGEST_LINE = 1000
"""Characters of a line that are looked at."""


def is_printed(text: str) -> bool:
    """Whether most of the first lines have names beside their numbers."""
    lines = [line for line in text.split("\n", NAMED_LINES)[:NAMED_LINES] if line.strip()]
    named = [line for line in lines if len(_pairs(line)) >= 3]
    return 3 * len(named) >= len(lines) > 0 and bool(named)


def printed_sheet(path: Path, text: str) -> Sheet:
    """Make a table of such lines; RecordingError: no sample has all its names."""
    samples: list[dict[str, str]] = [{}]
    units: dict[str, str] = {}
    for line in (whole[:LONGEST_LINE] for whole in text.split("\n")):
        stamp = _STAMP.match(line)
        pairs = _pairs(line[stamp.end() :] if stamp else line)
        if any(name in samples[-1] for name, _ in pairs):
            samples.append({})
        if stamp and pairs:
            samples[-1].setdefault("time", stamp[1])
        if unit := _UNIT.search(line):
            units |= dict.fromkeys((name for name, _ in pairs), unit[1])
        samples[-1] |= dict(pairs)
    # The first and the last may be cut off; what is printed now and then, such as a temperature, is none of them.
    names = max(samples, key=len)
    header = [name for name in names if sum(name in sample for sample in samples) * 2 > len(samples)]
    rows = [",".join(sample[name] for name in header) for sample in samples if all(name in sample for name in header)]
    if len(header) < 3 or not rows:
        what = "no line has three numbers with names; give --columns as for `pbd record --sensor lines`"
        raise RecordingError.at(path, what)
    columns = tuple(f"{name} ({units[name]})" if name in units else name for name in header)
    return Sheet(path, columns, "\n".join(rows), ",", 1, foreign=True, preamble="printed lines")


def _pairs(line: str) -> list[tuple[str, str]]:
    """Names and numbers; a bare X, Y or Z takes the word that stood before: `Rotation X: 1, Y: 2`."""
    found, word = [], ""
    for name, value in _PAIR.findall(line[:LONGEST_LINE]):
        axis = re.fullmatch(r"(.*?)[\s_]*([XYZxyz])", name)
        if axis and axis[1]:
            word = axis[1]
        elif axis and word:
            name = f"{word} {axis[2]}"
        elif not value:
            word = name
        if value:
            found.append((name, value))
    return found
