"""Tables of numbers as text: a header line, then rows. Errors tell line and column."""

import csv
import io
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from pbd.errors import PbdError, RecordingError, listed, printable
from pbd.files.header_line import (
    cells_of,
    delimiter_of,
    find_header,
    headerless_advice,
    with_delimiters,
    with_line_below,
    without_comments,
    without_cut_row,
)
from pbd.io.numbers import NO_NUMBER, date_order, number, seconds
from pbd.io.read_file import MOST_DATA_BYTES, decoded, read_bytes, read_text
from pbd.pose import Array

FOREIGN_ENCODINGS = ("utf-8", "gb18030", "cp1252")
"""Encodings of other programs' text files, in the order in which they are tried: UTF-8, Chinese, western Windows."""

NEXT_STEP = "give a CSV file"

LONGEST_PREAMBLE = 100
"""Largest number of lines above the header."""

BLOCK_CHARACTERS = 1_000_000
"""Length of a block of text that is parsed at once, characters. It bounds memory."""

ROWS_AT_ONCE = 20_000
"""Number of rows that are written at once: a few MB of text."""

_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*")


@dataclass(frozen=True, eq=False)
class Table:
    """Column names and values (rows, columns); an empty cell is NaN."""

    path: Path
    header: tuple[str, ...]
    values: Array

    def columns(self, *names: str) -> Array:
        """Return columns (rows, len(names)); the RecordingError of a missing one lists the header."""
        refuse_missing(self.path, self.header, names, RecordingError)
        return self.values.T[[self.header.index(name) for name in names]].T


@dataclass(frozen=True)
class Sheet:
    """A table whose header has been parsed, but not its rows.

    Attributes:
        first_line: the number of the first row's line in the file, counted from 1.
        foreign: another program wrote it; without commas as delimiters, numbers may have decimal commas.
        cells_required: no cell may be empty.
        preamble: the lines above the header, with comments.
    """

    path: Path
    header: tuple[str, ...]
    body: str
    delimiter: str
    first_line: int
    foreign: bool = False
    error: type[PbdError] = RecordingError
    cells_required: bool = False
    preamble: str = ""

    def words(self, name: str) -> list[str]:
        """Return the cells of a column of text."""
        k = self.header.index(name)
        return [row[k].strip() for _, row in self.rows(self.body, self.first_line) if row[k:]]

    def cell(self, name: str, row: int) -> tuple[int, str]:
        """Return the line number and the text of a column's cell in a row, counted from 0."""
        line, cells = next(islice(self.rows(self.body, self.first_line), row, None))
        k = self.header.index(name)
        return line, "".join(cells[k : k + 1]).strip()  # a row may be too short, which is refused when it is read

    def first_and_last(self, name: str) -> list[str]:
        """Return a column's first and last cell."""
        rows, k = self.body.strip("\n"), self.header.index(name)
        ends = (rows.partition("\n")[0], rows.rpartition("\n")[2])
        return [cells[k].strip(' "') for row in ends if len(cells := row.split(self.delimiter)) > k]

    def read(self, names: Sequence[str] | None = None, times: Collection[str] = ()) -> Table:
        """Read columns.

        Args:
            names: their names; None: all.
            times: names of columns that may contain dates, which become seconds.

        Raises:
            error: with line and column: a row of another length, or a cell that is not a number.
        """
        wanted = self.header if names is None else tuple(dict.fromkeys(names))
        refuse_missing(self.path, self.header, wanted, self.error)
        self.refuse_duplicates(wanted)
        columns = [self.header.index(name) for name in wanted]
        dated = {self.header.index(name): date_order(self.first_and_last(name)) for name in wanted if name in times}
        parts, line = [np.empty((0, len(columns)))], self.first_line
        for block in [self.body] if '"' in self.body else _blocks(self.body):  # a quoted cell may contain line ends
            rows = self._read_numbers(block)
            parts.append(self._read_cells(block, line, columns, dated) if rows is None else rows[:, columns])
            line += block.count("\n") + 1
        # Contiguous columns: they are read one sensor at a time, and tracking is several times as fast with them.
        return Table(self.path, wanted, np.concatenate([part.T for part in parts], axis=1).T)

    def refuse_duplicates(self, names: Sequence[str]) -> None:
        """Refuse columns of which the header has two: it is unknown which one is meant."""
        if twice := next((name for name in names if self.header.count(name) > 1), None):
            raise self._fault(None, f"the column '{printable(twice)}' is there twice", "rename one", value=twice)

    def _read_numbers(self, block: str) -> Array | None:
        """Read rows of plain numbers and empty cells as JSON, several times as fast; None if there is anything else."""
        import orjson

        data, width = block.strip("\n").replace(self.delimiter, ",").encode(), len(self.header)
        # Refuse JSON's words and strings, and decimal commas, which would become delimiters.
        if data.translate(None, b"0123456789+-.eE,\n ") or (self.delimiter != "," and "," in block):
            return None
        letters = np.frombuffer(data, np.uint8)
        ends = letters[(letters == ord(",")) | (letters == ord("\n"))] == ord("\n")
        if (len(ends) + 1) % width or ends[width - 1 :: width].sum() != ends.sum() or b"\n\n" in data:
            return None  # rows of different lengths
        data = b"[" + data.replace(b"\n", b",") + b"]"
        if not self.cells_required:
            for empty in (b",,", b",,", b"[,", b",]"):  # twice, for neighbouring empty cells
                data = data.replace(empty, empty[:1] + b"null" + empty[1:])
        with suppress(ValueError):  # not JSON
            return np.array(orjson.loads(data), dtype=np.float64).reshape(-1, width)
        return None

    def _read_cells(self, block: str, first: int, columns: list[int], dated: Mapping[int, str]) -> Array:
        rows, width = [], len(self.header)
        plain = block.isascii() and "_" not in block  # float() accepts 1_000
        for line, cells in self.rows(block, first):
            if len(cells) == width + 1 and not cells[-1].strip():
                cells.pop()  # the line ends with a delimiter
            if len(cells) != width:
                what = f"{len(cells)} cell{'s' if len(cells) != 1 else ''} where the header has {width}"
                next_step = "correct or remove the line"
                widths = [len(row) for _, row in islice(self.rows(block, first), 9)]
                whole = re.compile(r"\s*-?\d+(e[-+]?\d+)?\s*").fullmatch
                if 1.5 * width < len(cells) <= 2 * width and all(map(whole, cells)):
                    what += ", because commas are both its decimal marks and between its cells"
                    next_step = "export it again with decimal points, or with semicolons between the cells"
                elif len(cells) > width and len(widths) > 1 and set(widths) == {len(cells)}:
                    what, next_step = f"{what}, as in the lines below", "name each column in the header"
                raise self._fault(line, what, next_step, value=len(cells), bound=width)
            if plain:
                with suppress(ValueError):
                    rows.append([float(cells[k]) for k in columns])
                    continue
            rows.append([self._number(line, k, cells[k], dated.get(k)) for k in columns])
        return np.array(rows, dtype=np.float64).reshape(len(rows), len(columns))

    def rows(self, text: str, first: int) -> Iterator[tuple[int, list[str]]]:
        """Yield each row that is not empty: its first line's number, and its cells; the text begins in line `first`."""
        rows = csv.reader((line for block in _blocks(text) for line in block.split("\n")), delimiter=self.delimiter)
        line = first
        try:
            for row in rows:
                if row:
                    yield line, row
                line = first + rows.line_num
        except csv.Error as reason:
            raise self._fault(line, str(reason), "mend or remove the line") from None

    def _number(self, line: int, column: int, cell: str, order: str | None) -> float:
        try:
            if self.foreign and self.delimiter != "," and _DECIMAL_COMMA.fullmatch(cell):
                cell = cell.replace(",", ".")
            if not self.cells_required and cell.strip().lower() in NO_NUMBER:
                return float("nan")
            return seconds(cell, order) if order else number(cell)
        except ValueError:
            name = self.header[column]
            what = f"'{printable(cell)}' in column '{printable(name)}' is not a number"
            raise self._fault(line, what, self._advice(cell, name, order), column=name, value=cell) from None

    def _advice(self, cell: str, name: str, order: str | None) -> str:
        if cell.strip() == name:
            return "the header is there again: cut the file there, or remove the line if one recording goes on"
        if _DECIMAL_COMMA.fullmatch(cell):
            return "it has a decimal comma: write numbers with a point (export it again, or put a point for each comma)"
        empty = "" if self.cells_required else ", or leave it empty"
        return f"correct the cell{empty}" + ("; or import it with --rate HZ, in place of the times" if order else "")

    def _fault(self, line: int | None, what: str, next_step: str, **fields: object) -> PbdError:
        return self.error.at(self.path, f"{what}; {next_step}", line, **fields)


def _blocks(text: str) -> Iterator[str]:
    """Cut a text at line ends into blocks of about BLOCK_CHARACTERS characters."""
    at = 0
    while at < len(text):
        end = text.find("\n", at + BLOCK_CHARACTERS) + 1 or len(text) + 1
        yield text[at : end - 1]
        at = end


def refuse_missing(path: Path, header: Sequence[str], names: Sequence[str], error: type[PbdError]) -> None:
    """Refuse a table without these columns; the `error` lists its columns."""
    if missing := [name for name in names if name not in header]:
        raise error.at(path, f"no column '{missing[0]}'; the columns are {listed(header)}", value=missing[0])


def foreign_text(path: Path, data: bytes | None = None, error: type[PbdError] = RecordingError) -> str:
    """Read a text of another program in any of its usual encodings; `data`: the file's bytes, if already read."""
    data = read_bytes(path, error, NEXT_STEP) if data is None else data
    # Spreadsheets write UTF-16 as "Unicode text".
    # In western Windows a sign is one byte, as in `µT`; Chinese ones have two.
    lone = not data.isascii() and re.search(rb"[\x80-\xff]{2}", data) is None
    encodings: Sequence[str] = FOREIGN_ENCODINGS[::2] if lone else FOREIGN_ENCODINGS
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encodings = ("utf-16",)
    return decoded(data, path, error, NEXT_STEP, encodings)


def open_sheet(
    path: Path, foreign: bool = False, error: type[PbdError] = RecordingError, text: str | None = None
) -> Sheet:
    """Open a table whose delimiter is a comma, a semicolon or a tab, and parse its header.

    Lines that begin with # are comments.

    Args:
        foreign: another program wrote it. It may have lines above the header, text in some columns, an encoding other
            than UTF-8, and decimal commas if the delimiter is not a comma.
        text: the file's text, if already read.

    Raises:
        error: the file can't be read as text, is empty, or has no rows.
    """
    if text is None:
        text = foreign_text(path, error=error) if foreign else read_text(path, error, NEXT_STEP, MOST_DATA_BYTES)
    in_file = text
    if foreign:
        text = with_delimiters(text)
    if "#" in text:
        text = without_comments(text, foreign)
    lines = text.split("\n", LONGEST_PREAMBLE)[:LONGEST_PREAMBLE]  # without the rest, which is large
    above, skipped = (find_header(lines) if foreign else None) or (
        next((k for k, line in enumerate(lines) if line.strip()), 0),
        0,
    )
    first, body = lines[above], text[sum(len(line) + 1 for line in lines[: above + 1 + skipped]) :].rstrip("\0")
    if not first.strip():
        raise error.at(path, "the file is empty; it needs a header line and rows of numbers")
    if "\0" in first:
        raise error.at(path, "can't be read as text (NUL bytes, as a crash may leave); give a CSV file")
    if not body or body.isspace():
        raise error.at(path, "a header but no rows; record again")
    delimiter = delimiter_of(first)
    try:
        header = cells_of(first, delimiter)
        for line in lines[above + 1 : above + 1 + skipped]:
            header = with_line_below(header, cells_of(line, delimiter))
    except csv.Error as reason:
        raise error.at(path, f"the header can't be read ({reason}); {NEXT_STEP}", above + 1) from None
    recording = error is RecordingError
    if foreign and recording and (what := headerless_advice(path, header, in_file, above)):
        raise error.at(path, what, above + 1)
    if header[1:] and (not header[-1] or (header[0], header[-1]) == ("X_Value", "Comment")):
        header.pop()  # LabVIEW writes no empty comment
    header[0] = header[0] or "column 1"  # pandas' index, so that it can be named
    if recording:
        body = without_cut_row(path, body, len(header), delimiter)
    first_row, preamble = above + 2 + skipped, "\n".join(in_file.split("\n", above)[:above])
    return Sheet(path, tuple(header), body, delimiter, first_row, foreign, error, preamble=preamble)


@np.errstate(over="ignore")  # a value near the largest number becomes an empty cell, as infinity does
def write_table(path: Path, header: tuple[str, ...], values: Array, decimals: tuple[int, ...] = ()) -> None:
    """Write a table; `decimals`: each column's number of decimals; empty: all. NaN becomes an empty cell."""
    import orjson

    with path.open("wb") as file:
        line = io.StringIO()  # a URDF allows any character in a joint's name: "\r\n" has both kinds of newline quoted
        csv.writer(line, lineterminator="\r\n").writerow(header)
        file.write(line.getvalue().removesuffix("\r\n").encode() + b"\n")
        for k in range(0, len(values), ROWS_AT_ONCE):
            part = values[k : k + ROWS_AT_ONCE]
            if decimals:
                part = np.column_stack([column.round(places) for column, places in zip(part.T, decimals, strict=True)])
            rows = orjson.dumps(part, option=orjson.OPT_SERIALIZE_NUMPY)
            file.write(rows[2:-2].replace(b"],[", b"\n").replace(b"null", b"") + b"\n")
