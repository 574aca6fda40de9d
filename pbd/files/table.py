"""Tables of numbers in text: a header line, then rows. What is wrong is named by line and column."""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pbd.doors.numbers import number
from pbd.doors.opening import read_bytes, unix_lines
from pbd.errors import PbdError, RecordingError, listed, printable
from pbd.files.stamps import seconds
from pbd.pose import Array

FOREIGN = ("utf-8-sig", "gb18030", "cp1252")
"""How programs of others write text: as all do, as a Chinese Windows does, as a western one does."""

HEADER_CELLS = 4
"""A foreign table may begin with remarks; its header is the first line with so many cells (t, ax, ay, az)."""

MOST_COLUMNS = 1000
"""Most columns of a table: a motion capture system's export has some hundreds."""

LONGEST_NAME = 200
"""Longest name of a column, characters."""

LONGEST_LINE = 100_000
"""Longest line of a table, characters: MOST_COLUMNS numbers of a hundred digits."""

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
        return {row[k].strip() for _, row in self._rows() if row[k:]}

    def read(self, names: Sequence[str] | None = None, times: Collection[str] = ()) -> Table:
        """Read the columns of these names (all); those of `times` may hold dates, and are seconds then.

        Raises:
            RecordingError: a row of another length, or text where a number should be: with line and column.
        """
        wanted = self.header if names is None else tuple(dict.fromkeys(names))
        require(self.path, self.header, wanted)
        times_there = Counter(self.header)
        if twice := next((name for name in wanted if times_there[name] > 1), None):
            message = f"{self.path}: the column '{printable(twice)}' is there twice; rename one"
            raise RecordingError(message, path=self.path, value=twice)
        columns = [self.header.index(name) for name in wanted]
        dated = [k for k, name in zip(columns, wanted, strict=True) if name in times]
        cells = {line.count(self.delimiter) for line in self.body.splitlines() if line.strip()}
        if cells == {len(self.header) - 1}:
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
        for line, cells in self._rows():
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

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        lines = enumerate(io.StringIO(self.body), start=self.line)
        return split_rows(self.path, lines, self.delimiter, RecordingError)

    def _number(self, line: int, column: int, cell: str, dated: bool) -> float:
        try:
            if self.foreign and self.delimiter != "," and _DECIMAL_COMMA.fullmatch(cell):
                cell = cell.replace(",", ".")
            if dated:
                return seconds(cell)
            return number(cell) if cell.strip() else float("nan")
        except ValueError:
            name = self.header[column]
            what = f"'{printable(cell)}' in column '{printable(name)}' is not a number"
            raise RecordingError(
                f"{self.path}:{line}: {what}; {_next_step(cell)}",
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
    there = set(header)
    missing = [name for name in names if name not in there]
    if missing:
        raise RecordingError(
            f"{path}: no column '{missing[0]}'; the columns are {listed(header)}", path=path, value=missing[0]
        )


def split_rows(
    path: Path, lines: Iterable[tuple[int, str]], delimiter: str, error: type[PbdError]
) -> Iterator[tuple[int, list[str]]]:
    """Split numbered lines into cells; yield each row with the number of its last line.

    Raises:
        error: a line or a cell is too long, or a quote is never closed: with the line.
    """
    at = 0

    def fed() -> Iterator[str]:
        nonlocal at
        for count, line in lines:
            at = count
            if len(line) > LONGEST_LINE:
                raise csv.Error(f"a line of {len(line)} characters, more than {LONGEST_LINE}")
            yield line

    rows = csv.reader(fed(), delimiter=delimiter)
    while True:
        try:
            row = next(rows)
        except StopIteration:
            return
        except csv.Error as reason:
            raise error(f"{path}:{at}: {reason}; mend or remove the line", path=path, line=at) from None
        yield at, row


def split_header(path: Path, line: int, text: str, error: type[PbdError]) -> tuple[list[str], str]:
    """Split a header line into names; return them and the delimiter.

    Raises:
        error: more or longer names than a table has.
    """
    delimiter = max(",;\t", key=text.count)
    count = text.count(delimiter) + 1
    if count > MOST_COLUMNS:
        what = f"{count} columns; at most {MOST_COLUMNS} are read: take out those that are no sensor's"
        raise error(f"{path}:{line}: {what}", path=path, line=line, value=count, bound=MOST_COLUMNS)
    names = [name.strip().strip('"') for name in text.split(delimiter)]
    if long := next((name for name in names if len(name) > LONGEST_NAME), None):
        what = f"a column's name of {len(long)} characters ({printable(long)}); shorten it"
        raise error(f"{path}:{line}: {what}", path=path, line=line, value=len(long), bound=LONGEST_NAME)
    return names, delimiter


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
    header, delimiter = split_header(path, above + 1, first, RecordingError)
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
    data = read_bytes(path, RecordingError, "give a CSV file")
    if len(encodings) > 1 and data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encodings = ("utf-16",)  # what spreadsheets call Unicode text
    for encoding in encodings[:-1]:
        with suppress(UnicodeDecodeError):
            return unix_lines(data.decode(encoding))
    try:
        return unix_lines(data.decode(encodings[-1]))
    except UnicodeDecodeError as reason:
        raise RecordingError(f"{path}: can't be read as text ({reason}); give a CSV file", path=path) from None


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
