"""Tables of numbers in text: a header line, then rows. Errors name line and column."""

from __future__ import annotations

import csv
import re
import warnings
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pbd.errors import PbdError, RecordingError, listed, printable
from pbd.files.header_line import find_header, with_units
from pbd.io.numbers import number, seconds
from pbd.io.read_file import decoded, read_bytes
from pbd.pose import Array

FOREIGN_ENCODINGS = ("utf-8-sig", "gb18030", "cp1252")
"""Encodings of other programs' text files: UTF-8, Chinese Windows, western Windows."""

NEXT_STEP = "give a CSV file"

LONGEST_PREAMBLE = 100
"""Most lines above the header."""

BLOCK = 1_000_000
"""Characters that are split into lines at once."""

NUMERIC = b"0123456789+-.eE,\n "
"""All that is in rows of plain numbers."""

ROWS_AT_ONCE = 20_000
"""Rows that are written at once: a few MB of text."""

_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*")


@dataclass(frozen=True, eq=False)
class Table:
    """Column names and values (rows, columns); an empty cell is NaN."""

    path: Path
    header: tuple[str, ...]
    values: Array

    def columns(self, *names: str) -> Array:
        """Return the columns of these names, (rows, len(names)); a RecordingError lists those that are there."""
        require(self.path, self.header, names)
        return self.values[:, [self.header.index(name) for name in names]]


@dataclass(frozen=True)
class Sheet:
    """A table's text, of which only the header has been read; `line` is that of the first row.

    A cell of a `complete` one must not be empty. What stands above the header is the `preamble`.
    """

    path: Path
    header: tuple[str, ...]
    body: str
    delimiter: str
    line: int
    foreign: bool = False
    error: type[PbdError] = RecordingError
    complete: bool = False
    preamble: str = ""

    def words(self, name: str) -> list[str]:
        """Return what a column of text says, row by row."""
        k = self.header.index(name)
        return [row[k].strip() for _, row in self._rows(self.body, self.line) if row[k:]]

    def read(self, names: Sequence[str] | None = None, times: Collection[str] = ()) -> Table:
        """Read the columns of these names (all); those of `times` may hold dates, and are seconds then.

        The error says line and column: a row of another length, or text where a number should be.
        """
        wanted = self.header if names is None else tuple(dict.fromkeys(names))
        require(self.path, self.header, wanted, self.error)
        count = Counter(self.header)
        if twice := next((name for name in wanted if count[name] > 1), None):
            raise self._fault(None, f"the column '{printable(twice)}' is there twice", "rename one", value=twice)
        columns = [self.header.index(name) for name in wanted]
        dated = [k for k, name in zip(columns, wanted, strict=True) if name in times]
        parts, line = [], self.line
        for block in [self.body] if '"' in self.body else _blocks(self.body):  # a quoted cell may hold line ends
            parts.append(self._read_block(block, line, columns, dated))
            line += block.count("\n") + 1
        return Table(self.path, wanted, np.concatenate(parts))

    def _read_block(self, block: str, line: int, columns: list[int], dated: list[int]) -> Array:
        if (rows := self._read_numbers(block)) is not None:
            return rows[:, columns]
        first = block.lstrip().partition("\n")[0].split(self.delimiter)
        plain = all(k < len(first) and re.fullmatch(r"\s*[-+.\deE]+\s*", first[k]) for k in dated)
        with suppress(ValueError), warnings.catch_warnings():  # a fault: row by row it is found
            warnings.simplefilter("ignore")
            rows = np.loadtxt(
                self._filled(block),
                delimiter=self.delimiter,
                usecols=columns,
                converters=None if plain else dict.fromkeys(dated, seconds),
                ndmin=2,
                comments=None,
            )
            return rows.reshape(-1, len(columns))
        return self._read_slowly(block, line, columns, dated)

    def _read_numbers(self, block: str) -> Array | None:
        """Read rows of plain numbers, twice as fast as loadtxt; None where anything else is in them."""
        import orjson

        data = block.strip("\n").replace(self.delimiter, ",").encode()
        # JSON's words and quoted texts would pass for numbers, and a decimal comma for a delimiter.
        if data.translate(None, NUMERIC) or (self.delimiter != "," and "," in block):
            return None
        with suppress(ValueError):  # rows of several lengths, too
            rows = np.array(orjson.loads(b"[[" + data.replace(b"\n", b"],[") + b"]]"), dtype=np.float64)
            return rows if rows.shape[1:] == (len(self.header),) else None
        return None

    def _filled(self, block: str) -> Iterator[str]:
        """Yield each row with nan in its empty cells; ValueError where one has another length."""
        mark, most = self.delimiter, len(self.header) - 1
        both, filled = mark + mark, f"{mark}nan{mark}"
        for row in block.split("\n"):
            count = row.count(mark)
            if count != most or not row:
                row = row.strip(" ")
                if not row or row.isspace():
                    continue
                if count != most + 1 or row[-1] != mark:
                    raise ValueError("a row of another length")
                row = row[:-1]  # a delimiter ends the line
            if not self.complete and (both in row or row[0] == mark or row[-1] == mark):
                row = f"{'nan' if row[0] == mark else ''}{row}{'nan' if row[-1] == mark else ''}"
                row = row.replace(both, filled).replace(both, filled)
            yield row

    def _read_slowly(self, block: str, first: int, columns: list[int], dated: list[int]) -> Array:
        rows, width = [], len(self.header)
        for line, cells in self._rows(block, first):
            if len(cells) == width + 1 and not cells[-1].strip():
                cells.pop()  # a delimiter ends the line
            if len(cells) != width:
                what = f"{len(cells)} cell{'s' if len(cells) != 1 else ''} where the header has {width}"
                raise self._fault(line, what, "correct or remove the line", value=len(cells), bound=width)
            rows.append([self._number(line, k, cells[k], k in dated) for k in columns])
        return np.array(rows, dtype=np.float64).reshape(-1, len(columns))

    def _rows(self, text: str, first: int) -> Iterator[tuple[int, list[str]]]:
        """Yield each row that is not empty with the number of its last line; `first` is that of the first."""
        rows = csv.reader((line for block in _blocks(text) for line in block.split("\n")), delimiter=self.delimiter)
        try:
            for row in rows:
                if row:
                    yield first - 1 + rows.line_num, row
        except csv.Error as reason:
            raise self._fault(first - 1 + rows.line_num, str(reason), "mend or remove the line") from None

    def _number(self, line: int, column: int, cell: str, dated: bool) -> float:
        try:
            if self.foreign and self.delimiter != "," and _DECIMAL_COMMA.fullmatch(cell):
                cell = cell.replace(",", ".")
            if dated:
                return seconds(cell)
            return number(cell) if cell.strip() or self.complete else float("nan")
        except ValueError:
            name, next_step = self.header[column], "correct the cell" + ", or leave it empty" * (not self.complete)
            if _DECIMAL_COMMA.fullmatch(cell):
                write = "write numbers with a point (export it again, or put a point for each comma)"
                next_step = f"it has a decimal comma: {write}"
            what = f"'{printable(cell)}' in column '{printable(name)}' is not a number"
            raise self._fault(line, what, next_step, column=name, value=cell) from None

    def _fault(self, line: int | None, what: str, next_step: str, **fields: object) -> PbdError:
        return self.error.at(self.path, f"{what}; {next_step}", line, **fields)


def _blocks(text: str) -> Iterator[str]:
    at = 0
    while at < len(text):
        end = text.find("\n", at + BLOCK) + 1 or len(text) + 1
        yield text[at : end - 1]
        at = end


def require(path: Path, header: Sequence[str], names: Sequence[str], error: type[PbdError] = RecordingError) -> None:
    """Refuse a table without these columns; the `error` lists those that are there."""
    if missing := [name for name in names if name not in header]:
        raise error.at(path, f"no column '{missing[0]}'; the columns are {listed(header)}", value=missing[0])


def foreign_text(path: Path, data: bytes | None = None, error: type[PbdError] = RecordingError) -> str:
    """Read another program's text, in any encoding that such have; `data` is what it holds, where that is known."""
    data = read_bytes(path, error, NEXT_STEP) if data is None else data
    # UTF-16 is what spreadsheets call Unicode text.
    encodings = ("utf-16",) if data[:2] in (b"\xff\xfe", b"\xfe\xff") else FOREIGN_ENCODINGS
    return decoded(data, path, error, NEXT_STEP, encodings)


def open_sheet(
    path: Path, foreign: bool = False, error: type[PbdError] = RecordingError, text: str | None = None
) -> Sheet:
    """Open a table whose cells are separated by commas, semicolons or tabs, and read its header.

    Lines that begin with # are remarks.

    Args:
        path: the file.
        foreign: another program wrote it: there may be remarks above the header, text in some columns, another
            encoding than UTF-8, decimal commas where no comma separates.
        error: what is raised.
        text: the file's, where it has been read.

    Raises:
        error: empty, no rows, not text.
    """
    if text is None and foreign:
        text = foreign_text(path, error=error)
    elif text is None:
        text = decoded(read_bytes(path, error, NEXT_STEP), path, error, NEXT_STEP, FOREIGN_ENCODINGS[:1])
    if "#" in text:
        text = re.sub(r"(?m)^[ \t]*#.*$", "", text)
    lines = text.split("\n", LONGEST_PREAMBLE)
    above, skipped = (find_header(lines[:LONGEST_PREAMBLE]) if foreign else None) or (
        next((k for k, line in enumerate(lines) if line.strip()), 0),
        0,
    )
    first, body = lines[above], "\n".join(lines[above + 1 + skipped :])
    if not first.strip():
        raise error.at(path, "the file is empty; it needs a header line and rows of numbers")
    if "\0" in first:
        raise error.at(path, "can't be read as text (NUL bytes, as a crash may leave); give a CSV file")
    if not body.strip():
        raise error.at(path, "a header but no rows; record again")
    delimiter = max(",;\t", key=first.count)
    header = [name.strip().strip('"') for name in first.split(delimiter)]
    if skipped:
        header = with_units(header, [cell.strip().strip('"') for cell in lines[above + 1].split(delimiter)])
    if foreign and re.fullmatch(r"[-+.,\deE\s]+", "".join(header)):
        what = "numbers where the column names should be"
        add = "add a line with the column names above them, such as t,ax,ay,az,gx,gy,gz"
        raise error.at(path, f"{what}; {add}", above + 1)
    if not header[-1]:
        header.pop()
    line, preamble = above + 2 + skipped, "\n".join(lines[:above])
    return Sheet(path, tuple(header), body, delimiter, line, foreign, error, preamble=preamble)


def read_table(path: Path) -> Table:
    """Read a table of numbers; a RecordingError says line and column."""
    return open_sheet(path).read()


def write_table(path: Path, header: tuple[str, ...], values: Array, decimals: tuple[int, ...] = ()) -> None:
    """Write a table, each column rounded to so many decimals, if any are given; NaN becomes an empty cell."""
    import orjson

    with path.open("wb") as file:
        file.write(",".join(header).encode() + b"\n")
        for k in range(0, len(values), ROWS_AT_ONCE):
            part = values[k : k + ROWS_AT_ONCE]
            if decimals:
                part = np.column_stack([column.round(places) for column, places in zip(part.T, decimals, strict=True)])
            rows = orjson.dumps(part, option=orjson.OPT_SERIALIZE_NUMPY)
            file.write(rows[2:-2].replace(b"],[", b"\n").replace(b"null", b"") + b"\n")
