"""Tables of numbers in text: a header line, then rows. What is wrong is named by line and column."""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pbd.errors import RecordingError, in_words
from pbd.files.stamps import seconds
from pbd.pose import Array

FOREIGN = ("utf-8-sig", "gb18030", "cp1252")
"""How programs of others write text: as all do, as a Chinese Windows does, as a western one does."""

HEADER_CELLS = 4
"""A foreign table may begin with remarks; its header is the first line with so many cells (t, ax, ay, az)."""

_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*")


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
        require(self.path, self.header, names)
        return self.values[:, [self.header.index(name) for name in names]]


@dataclass(frozen=True)
class Sheet:
    """A table's text, of which only the header has been read; `line` is that of the first row."""

    path: Path
    header: tuple[str, ...]
    body: str
    delimiter: str
    line: int
    foreign: bool = False

    def words(self, name: str) -> set[str]:
        """Return what a column of text says, each once."""
        k = self.header.index(name)
        return {cells[k].strip() for cells in csv.reader(io.StringIO(self.body), delimiter=self.delimiter) if cells[k:]}

    def read(self, names: Sequence[str] | None = None, times: Collection[str] = ()) -> Table:
        """Read the columns of these names (all); those of `times` may hold dates, and are seconds then.

        Raises:
            RecordingError: a row of another length, or text where a number should be: with line and column.
        """
        wanted = self.header if names is None else tuple(dict.fromkeys(names))
        require(self.path, self.header, wanted)
        for name in wanted:
            if self.header.count(name) > 1:
                raise RecordingError(
                    f"{self.path}: the column '{name}' is there twice; rename one", path=self.path, value=name
                )
        columns = [self.header.index(name) for name in wanted]
        dated = [k for k, name in zip(columns, wanted, strict=True) if name in times]
        if {line.count(self.delimiter) for line in self.body.splitlines() if line.strip()} == {len(self.header) - 1}:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    return Table(self.path, wanted, self._read_fast(columns, dated))
            except ValueError:
                pass  # an empty cell, or a fault: the slow reader tells which
        return Table(self.path, wanted, self._read_slowly(columns, dated))

    def _read_fast(self, columns: list[int], dated: list[int]) -> Array:
        first = self.body.lstrip().partition("\n")[0].split(self.delimiter)
        plain = all(re.fullmatch(r"\s*[-+.\deE]+\s*", first[k]) for k in dated)
        return np.loadtxt(
            io.StringIO(self.body),
            delimiter=self.delimiter,
            usecols=columns,
            converters=None if plain else dict.fromkeys(dated, seconds),
            ndmin=2,
            comments=None,
        )

    def _read_slowly(self, columns: list[int], dated: list[int]) -> Array:
        rows, width = [], len(self.header)
        reader = csv.reader(io.StringIO(self.body), delimiter=self.delimiter)
        for line, cells in enumerate(reader, start=self.line):
            if not cells:
                continue
            if len(cells) == width + 1 and not cells[-1].strip():
                cells.pop()  # a delimiter ends the line
            if len(cells) != width:
                raise RecordingError(
                    f"{self.path}:{line}: {len(cells)} cells where the header has {width}; correct or remove the line",
                    path=self.path,
                    line=line,
                    value=len(cells),
                    bound=width,
                )
            rows.append([self._number(line, k, cells[k], k in dated) for k in columns])
        return np.array(rows, dtype=np.float64).reshape(-1, len(columns))

    def _number(self, line: int, column: int, cell: str, dated: bool) -> float:
        try:
            if self.foreign and self.delimiter != "," and _DECIMAL_COMMA.fullmatch(cell):
                cell = cell.replace(",", ".")
            if dated:
                return seconds(cell)
            return float(cell) if cell.strip() else float("nan")
        except ValueError:
            name = self.header[column]
            raise RecordingError(
                f"{self.path}:{line}: '{cell}' in column '{name}' is not a number; {_next_step(cell)}",
                path=self.path,
                line=line,
                column=name,
                value=cell,
            ) from None


def require(path: Path, header: Sequence[str], names: Sequence[str]) -> None:
    """Refuse a table without these columns.

    Raises:
        RecordingError: lists the columns that are there.
    """
    missing = [name for name in names if name not in header]
    if missing:
        raise RecordingError(
            f"{path}: no column '{missing[0]}'; the columns are {', '.join(header)}", path=path, value=missing[0]
        )


def open_sheet(path: Path, foreign: bool = False) -> Sheet:
    """Open a table whose cells are separated by commas, semicolons or tabs, and read its header.

    Args:
        path: the file.
        foreign: another program wrote it: there may be remarks above the header, text in some columns, another
            encoding than UTF-8, decimal commas where no comma separates.

    Raises:
        RecordingError: empty, no rows, not text.
    """
    text, above = _text(path, FOREIGN[: None if foreign else 1]), 0
    if foreign:
        lines = text.split("\n", 10)
        above = next((k for k, line in enumerate(lines) if max(map(line.count, ",;\t")) >= HEADER_CELLS - 1), 0)
        text = "\n".join(lines[above:])
    first, _, body = text.partition("\n")
    if not first.strip():
        raise RecordingError(f"{path}: the file is empty; it needs a header line and rows of numbers", path=path)
    if not body.strip():
        raise RecordingError(f"{path}: a header but no rows; record again", path=path)
    delimiter = max(",;\t", key=first.count)
    header = [name.strip().strip('"') for name in first.split(delimiter)]
    if foreign and re.fullmatch(r"[-+.,\deE\s]+", "".join(header)):
        raise RecordingError(
            f"{path}:{above + 1}: numbers where the column names should be; add a line with the column names above "
            "them, "
            "such as t,ax,ay,az,gx,gy,gz",
            path=path,
            line=above + 1,
        )
    if not header[-1]:
        header.pop()
    return Sheet(path, tuple(header), body, delimiter, above + 2, foreign)


def read_table(path: Path) -> Table:
    """Read a table of numbers.

    Raises:
        RecordingError: empty, no rows, a row of another length, or text where a number should be: with line and column.
    """
    return open_sheet(path).read()


def _text(path: Path, encodings: Sequence[str]) -> str:
    try:
        data = path.read_bytes()
        if len(encodings) > 1 and data[:2] in (b"\xff\xfe", b"\xfe\xff"):
            encodings = ("utf-16",)  # what spreadsheets call Unicode text
        for encoding in encodings[:-1]:
            with suppress(UnicodeDecodeError):
                return _lines(data.decode(encoding))
        return _lines(data.decode(encodings[-1]))
    except (OSError, UnicodeDecodeError) as reason:
        raise RecordingError(
            f"{path}: can't be read as text ({in_words(reason)}); give a CSV file", path=path
        ) from None


def _lines(text: str) -> str:
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def _next_step(cell: str) -> str:
    if _DECIMAL_COMMA.fullmatch(cell):
        return "it has a decimal comma: write numbers with a point (export it again, or put a point for each comma)"
    return "correct the cell, or leave it empty"


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
