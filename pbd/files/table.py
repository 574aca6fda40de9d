"""Tables of numbers in text: a header line, then rows. What is wrong is named by line and column."""

from __future__ import annotations

import csv
import io
import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pbd.errors import RecordingError
from pbd.pose import Array


@dataclass(frozen=True, eq=False)
class Table:
    """Column names and values (rows, columns); an empty cell is NaN."""

    path: Path
    header: tuple[str, ...]
    values: Array

    def columns(self, *names: str) -> Array:
        """Return the columns of these names, (rows, len(names)).

        Raises:
            RecordingError: lists the columns that are there.
        """
        missing = [name for name in names if name not in self.header]
        if missing:
            raise RecordingError(
                f"{self.path}: no column '{missing[0]}'; the columns are {', '.join(self.header)}",
                path=self.path,
                value=missing[0],
            )
        return self.values[:, [self.header.index(name) for name in names]]


def read_table(path: Path) -> Table:
    """Read a table whose cells are separated by commas, semicolons or tabs.

    Raises:
        RecordingError: empty, no rows, a row of another length, or text where a number should be: with line and column.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as reason:
        raise RecordingError(f"{path}: can't be read as text ({reason}); give a CSV file", path=path) from None
    first, _, body = text.partition("\n")
    if not first.strip():
        raise RecordingError(f"{path}: the file is empty; it needs a header line and rows of numbers", path=path)
    delimiter = max(",;\t", key=first.count)
    header = tuple(name.strip().strip('"') for name in first.split(delimiter))
    if len(set(header)) != len(header):
        twice = next(name for name in header if header.count(name) > 1)
        raise RecordingError(f"{path}: the column '{twice}' is there twice; rename one", path=path, value=twice)
    if not body.strip():
        raise RecordingError(f"{path}: a header but no rows; record again", path=path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            values = np.loadtxt(io.StringIO(body), delimiter=delimiter, ndmin=2, comments=None)
        if values.shape[1] == len(header):
            return Table(path, header, values)
    except ValueError:
        pass  # an empty cell, or a fault: the slow reader tells which
    return Table(path, header, _read_slowly(path, body, delimiter, header))


def _read_slowly(path: Path, body: str, delimiter: str, header: tuple[str, ...]) -> Array:
    rows = []
    for line, cells in enumerate(csv.reader(io.StringIO(body), delimiter=delimiter), start=2):
        if not cells:
            continue
        if len(cells) != len(header):
            raise RecordingError(
                f"{path}:{line}: {len(cells)} cells where the header has {len(header)}; mend or remove the line",
                path=path,
                line=line,
                value=len(cells),
                bound=len(header),
            )
        rows.append([_number(path, line, name, cell) for name, cell in zip(header, cells, strict=True)])
    return np.array(rows, dtype=np.float64).reshape(-1, len(header))


def _number(path: Path, line: int, column: str, cell: str) -> float:
    try:
        return float(cell) if cell.strip() else float("nan")
    except ValueError:
        raise RecordingError(
            f"{path}:{line}: '{cell}' in column '{column}' is not a number; {_next_step(cell)}",
            path=path,
            line=line,
            column=column,
            value=cell,
        ) from None


def _next_step(cell: str) -> str:
    if re.fullmatch(r"\s*[-+]?\d+,\d+\s*", cell):
        return "it has a decimal comma: write numbers with a point (export it again, or put a point for each comma)"
    return "mend the cell, or leave it empty"


def write_table(path: Path, header: tuple[str, ...], values: Array, decimals: tuple[int, ...]) -> None:
    """Write a table with a fixed number of decimals for each column; NaN becomes an empty cell."""
    formats = [f"%.{places}f" for places in decimals]
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(header) + "\n")
        if np.isfinite(values).all():
            np.savetxt(file, values, fmt=formats, delimiter=",")
            return
        for row in values:
            file.write(",".join("" if np.isnan(x) else f % x for f, x in zip(formats, row, strict=True)) + "\n")
