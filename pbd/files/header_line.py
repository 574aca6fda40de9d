"""Find the header of a table that another program wrote, or say how to import one without a header."""

import csv
import math
import re
import shlex
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from pbd.data.imu_columns import ACC, GYR, MAG
from pbd.errors import warn
from pbd.io.numbers import NO_NUMBER, is_stamp

FEWEST_CELLS = 4
"""Smallest number of cells in a header (t, ax, ay, az). The lines of a preamble have fewer."""

LONGEST_NAME = 1000
"""Largest number of characters of a column's name, so that patterns are matched fast. MATLAB's have up to 63."""

MOST_COLUMNS = 16_384
"""Largest number of columns, so that patterns are matched fast. It is a spreadsheet's (Excel)."""

FIRST_ROWS = 20
"""Number of rows that are read to see whether the first column of a table without a header is the time."""

_COMMENT = re.compile(r"(?mi)^[ \t]*#(?!n/a\b|nv\b).*$")
"""A line that begins with #, but not with a spreadsheet's cell without a number."""

_MONITOR = re.compile(r"(?m)^(?:\[(\d[\d:. /-]{7,30})\] *|(\d\d:\d\d:\d\d\.\d+) -> *)(.+)")
"""A line with the time of Tera Term, `[2024-05-01 12:34:56.789] 1,2,3`, or of Arduino, `12:34:56.789 -> 1,2,3`."""


def find_header(lines: Sequence[str]) -> tuple[int, int] | None:
    """Return the header's index and the number of lines of axes or units below it; None if no line is wide enough.

    The header is the last wide line above the first row of numbers, or the first above lines whose cells repeat.
    """
    # In a file of LabVIEW remarks come first; some are numbers.
    begin = max((k for k, line in enumerate(lines) if line.startswith("***End_of_Header***")), default=-1)
    wide = [k for k, line in enumerate(lines) if k > begin and line.count(delimiter_of(line)) >= FEWEST_CELLS - 1]
    if not wide:
        return None
    row = next((k for k in wide if _is_row(lines[k])), None)
    above = [k for k in wide if row is None or k < row]
    if row is None or not above:
        return wide[0], 0
    header = last = above.pop()
    while above and _repeats(cells := _words(lines[header])) and len(_words(lines[above[-1]])) >= sum(map(bool, cells)):
        header = above.pop()
        if "x" in cells:  # the line above the axes has the names
            break
    return header, last - header


def delimiter_of(line: str) -> str:
    """Return the delimiter that occurs most often in a line, outside of quotes.

    Between tabs or semicolons, a comma is a decimal mark, or stands before a unit.
    """
    bare = re.sub(r'"[^"]*"', "", line)
    return next((mark for mark in ";\t" if bare.count(mark) >= FEWEST_CELLS - 1), max(",;\t", key=bare.count))


def _words(line: str) -> list[str]:
    """Return the cells of a line of a header in lower case; of axes, such as `X (g)`, the axis alone."""
    cells = (cell.strip(' "').lower() for cell in line.split(delimiter_of(line)))
    return [re.sub(r"^([xyz])\W.*", r"\1", cell) for cell in cells]


def _repeats(cells: Sequence[str]) -> bool:
    """Whether cells are units or axes, which repeat, not names of columns."""
    filled = [cell for cell in cells if cell]
    return len(set(filled)) < len(filled)


def without_comments(text: str, foreign: bool) -> str:
    """Blank the lines that begin with #, but not a foreign table's header: the last of them, if numbers follow.

    numpy.savetxt writes its header so, and the EuRoC data sets theirs: `#timestamp [ns],w_RS_S_x [rad s^-1],...`.
    """
    header = re.match(r"(?:[ \t]*(?:#.*)?\n)*?[ \t]*(#)(.*)\n\s*([^#\s].*)", text) if foreign else None
    if header is not None and _is_row(header[3]) and max(map(header[2].count, ",;\t")) >= FEWEST_CELLS - 1:
        names = re.sub(r"^[^,;]*?\b(?:format|columns?|fields?|header|order)\s*:\s*", "", header[2])
        text = f"{text[: header.start(1)]} {names}{text[header.end(2) :]}"
    return _COMMENT.sub("", text)


def with_delimiters(text: str) -> str:
    """Replace bars or spaces by tabs in a text that has no other delimiter.

    A serial monitor's times (`12:00:01.250 ->`) become a column of their own.
    """
    stamped = _MONITOR.search(text[:2000])  # its first time comes early
    if stamped and is_stamp(stamped[1] or stamped[2]):
        text = _MONITOR.sub(rf"\1\2{delimiter_of(stamped[3])}\3", text)
    rows = _COMMENT.sub("", text) if "#" in text else text
    if any(mark in rows for mark in ",;\t"):
        return text
    return re.sub(r" *\| *" if "|" in rows else " +", "\t", re.sub(r"(?m)^ +| +$|(?<=#) +", "", text))


def without_thousands(body: str, delimiter: str) -> str:
    """Remove points between thousands, as in `1.250`, from rows with decimal commas.

    If any point can only be a decimal mark, as in `0.010`, all are.
    """
    begin, end = rf"(?<![^{delimiter}\n\"]) *[-+]?", rf" *(?![^{delimiter}\n\"])"
    decimal_point = rf"{begin}(?![1-9]\d?\d?\.\d{{3}}{end})\d*\.\d*(?:[eE][-+]?\d+)?{end}"
    if delimiter == "," or re.search(decimal_point, body) or not re.search(rf"{begin}\d*,\d+{end}", body):
        return body
    return re.sub(rf"{begin}[1-9]\d?\d?(?:\.\d{{3}})+(?:,\d+)?{end}", lambda cell: cell[0].replace(".", ""), body)


def without_cut_row(path: Path, body: str, cells: int, delimiter: str) -> str:
    """Leave out, with a warning, a last row that is cut off: it has no line end and fewer cells."""
    end = max(body.rfind("\n"), 0)
    last = body[end + 1 :]
    if (
        not last.strip()
        or last.count(delimiter) >= cells - 1
        or '"' in last
        or last[0] not in "0123456789-+."
        or not body[:end].strip()
    ):
        return body
    warn(f"{path}: the last row is cut off, and left out: it has no line end")
    return body[:end]


def _is_row(line: str) -> bool:
    cells = [cell for cell in map(str.strip, line.split(delimiter_of(line))) if cell.lower() not in NO_NUMBER]
    numbers = sum(re.fullmatch(r"[-+]?[\d.,]+([eE][-+]?\d+)?|nan", cell) is not None for cell in cells)
    return numbers >= FEWEST_CELLS - 1 and 2 * numbers >= len(cells)


def with_line_below(header: Sequence[str], below: Sequence[str]) -> list[str]:
    """Merge the names of columns with the line below them, which has axes (`Gyroscope,,` above `x,y,z`) or units.

    `Gyroscope` and `x` become `Gyroscope x`, `acc_x` and `g` become `acc_x (g)`.
    """
    names, group = [], ""
    for name, cell in zip(header, [*below, *[""] * (len(header) - len(below))], strict=False):
        group = name or group
        unit = re.sub(r"^[\[(](.*)[\])]$|^[\d.]+ ?Hz$", r"\1", cell)  # Delsys writes rates
        if re.fullmatch(r"(?:\w+_)?[xyzXYZ](?:\W.*)?", cell):
            words, *its_unit = re.split(r"(?=[(\[])", group, maxsplit=1)
            names.append(" ".join([words.strip(), cell, *its_unit]))
        else:
            names.append(f"{name} ({unit})" if unit and name else name or unit)
    return names


def cells_of(line: str, delimiter: str) -> list[str]:
    """Split a line of a header into its cells. A quoted cell may contain the delimiter.

    Axes that follow `Gyro: x` as bare `y` and `z` get its words. csv.Error: a cell is too long, or there are too many.
    """
    cells = next(csv.reader([line], delimiter=delimiter))
    if len(cells) > MOST_COLUMNS:
        raise csv.Error(f"{len(cells)} columns, more than the {MOST_COLUMNS} that are read")
    cells = [cell.strip().strip('"') for cell in (cells if len(cells) > 1 else line.split(delimiter))]
    if max(map(len, cells)) > LONGEST_NAME:
        raise csv.Error(f"a name of more than {LONGEST_NAME} characters")
    for k, cell in enumerate(cells[1:], 1):
        axis = re.search(r"(?:\w\W{1,3}|\w_|[a-z](?=[XY]))([xyXY])$", cells[k - 1])
        if axis and cell.lower() == {"x": "y", "y": "z"}[axis[1].lower()]:
            cells[k] = cells[k - 1][:-1] + cell
    return cells


def headerless_advice(path: Path, header: Sequence[str], text: str, above: int) -> str:
    """Return what to do about a table without a header, whose first row was read as one; "" if it has names.

    A word before the numbers that the next line repeats is no name, also before the first number, as `Raw:1,2,3`.

    Args:
        header: the cells that were read as names.
        above: number of lines above that row.
    """
    rows = text.split("\n", above + FIRST_ROWS)[above : above + FIRST_ROWS]
    labelled = _is_row("\t".join(header)) and header[0][:1].isalpha() and "".join(rows[1:2]).startswith(header[0])
    glued = re.match(r"[A-Za-z]\w*[:=] ?(?=[-+.\d])", header[0])
    prefix = glued[0] if glued and "".join(rows[1:2]).startswith(glued[0]) else ""
    cells = [header[0].removeprefix(prefix), *header[1:]][labelled:]
    if not re.fullmatch(r"[-+.,;\deE\s]+", "".join("0" if is_stamp(cell) else cell for cell in cells)):
        return ""
    what = "numbers where the column names should be; add a line with the names above them, "
    if len(cells) < len(ACC) or any(map(is_stamp, cells)):  # the times of --sensor lines are numbers
        return what + "as t,ax,ay,az,gx,gy,gz"
    if len(cells) > 30:  # a sample has the time, three sensors, attitude, place, and at most as many again
        return (
            f"{what}as t,ax,ay,az,gx,gy,gz; if its {len(cells)} columns are several samples, write each in its own row"
        )
    return f"{what}or give the right names: {_import_command(path, rows, labelled, prefix)}"


def _import_command(path: Path, lines: Sequence[str], labelled: bool, prefix: str) -> str:
    """Return the command that imports a table without a header, with likely names of the columns.

    Of the first two sensors, the accelerometer is the one whose norm scatters less, as at rest. `lines` are the file's
    first ones; some may be cut off. Only a first column that increases is taken for the time; if `labelled`, the
    second. `prefix`: text before each line's first number.
    """
    lines = [line.removeprefix(prefix) for line in lines]
    first = lines[0]
    mark = delimiter_of(first) if any(map(first.count, ",;\t")) else "|" if "|" in first else "space"
    rows = [line.split(None if mark == "space" else mark) for line in lines if line.strip() and line[0] != "#"]
    width = Counter(map(len, rows)).most_common(1)[0][0]
    known = [row for row in rows if len(row) == width]
    count, t = width - labelled, []
    with suppress(ValueError):
        times = [float(row[labelled]) for row in known]
        t = ["t"] if count % 3 and times[0] < times[-1] and times == sorted(times) else []
    at = labelled + len(t)
    gyro_first = count - len(t) >= 6 and _scatter(known, at + 3) < _scatter(known, at)
    axes = [*(GYR if gyro_first else ACC), *(ACC if gyro_first else GYR), *MAG][: (count - len(t)) // 3 * 3]
    columns = ",".join([*"_" * labelled, *t, *axes, *"_" * (count - len(t) - len(axes))])
    separator = {",": "", "\t": " --separator tab"}.get(mark, f" --separator {shlex.quote(mark)}")
    rate = (f" --prefix {shlex.quote(prefix)}" if prefix else "") + ("" if t else " --rate HZ")
    return f"pbd import {shlex.quote(str(path))} NAME --sensor lines --columns {columns}{separator}{rate}"


def _scatter(rows: Sequence[Sequence[str]], at: int) -> float:
    """Return the relative scatter of the norm of three numbers from rows: small for gravity, not for a gyro's noise."""
    with suppress(ValueError, ZeroDivisionError):
        norms = [math.hypot(*map(float, row[at : at + 3])) for row in rows]
        mean = sum(norms) / len(norms)
        return math.dist(norms, [mean] * len(norms)) / mean
    return math.inf
