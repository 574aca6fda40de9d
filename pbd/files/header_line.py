"""Find the header of a table that another program wrote, or say how to import one without a header."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path

from pbd.files.imu_columns import ACC, GYR, MAG

HEADER_CELLS = 4
"""Smallest number of cells in a header (t, ax, ay, az). The lines of a preamble have fewer."""


def find_header(lines: Sequence[str]) -> tuple[int, int] | None:
    """Return the header's index and the number of lines with units below it (0 or 1); None if no line is wide enough.

    The header is the last wide line above the first row of numbers, or the one before it if the last has the units.
    """
    wide = [k for k, line in enumerate(lines) if max(map(line.count, ",;\t")) >= HEADER_CELLS - 1]
    if not wide:
        return None
    row = next((k for k in wide if _is_row(lines[k])), None)
    above = [k for k in wide if row is None or k < row]
    if row is None or not above:
        return wide[0], 0
    header = above[-1]
    delimiter = max(",;\t", key=lines[header].count)
    cells = [cell.strip() for cell in lines[header].split(delimiter) if cell.strip()]
    if len(above) > 1 and len(set(cells)) < len(cells) and len(lines[above[-2]].split(delimiter)) >= len(cells):
        return above[-2], header - above[-2]  # cells that repeat are units: names don't repeat
    return header, 0


def _is_row(line: str) -> bool:
    # Between other delimiters, a comma is a decimal mark.
    delimiter = next((mark for mark in ";\t" if line.count(mark) >= HEADER_CELLS - 1), ",")
    cells = [cell.strip() for cell in line.split(delimiter) if cell.strip()]
    numbers = sum(re.fullmatch(r"[-+]?[\d.,]+([eE][-+]?\d+)?|nan", cell) is not None for cell in cells)
    return numbers >= HEADER_CELLS - 1 and 2 * numbers >= len(cells)


def without_comment_sign(text: str) -> str:
    """Remove the # before a header: the last comment before the first row, with as many cells (EuRoC's data.csv)."""
    match = re.match(r"(?:\s*#.*\n)*?(\s*#\s*)(.*)\n([^#\n].*)", text)
    if match is None or not _is_row(match[3]):
        return text
    delimiter = max(",;\t", key=match[3].count)
    if match[2].count(delimiter) != match[3].count(delimiter):
        return text
    return text[: match.start(1)] + text[match.end(1) :]


def with_units(header: Sequence[str], units: Sequence[str]) -> list[str]:
    """Append each unit to its column's name: `acc_x` and `g` become `acc_x (g)`."""
    given = [*units, *[""] * (len(header) - len(units))]
    return [f"{name} ({unit})" if unit and name else name for name, unit in zip(header, given, strict=False)]


def import_command(path: Path, count: int, delimiter: str) -> str:
    """Return the command that imports a table of `count` columns without a header, with likely names of the columns."""
    t = ["t"] if count % 3 else []
    axes = [*ACC, *GYR, *MAG][: (count - len(t)) // 3 * 3]
    columns = ",".join([*t, *axes, *"_" * (count - len(t) - len(axes))])
    more = {";": " --separator ';'", "\t": " --separator tab"}.get(delimiter, "") + ("" if t else " --rate HZ")
    return f"pbd import {shlex.quote(str(path))} NAME --sensor lines --columns {columns}{more}"
