"""A TOML file's text: finds the line of a key, which tomllib does not tell, and advises on a line that is not valid."""

import re
from collections import Counter
from pathlib import Path
from typing import NoReturn

from pbd.errors import PbdError, printable
from pbd.lazy import cached_property

DECIMAL_POINTS = "write decimal points, not commas: 0.5"
TO_THE_TOP = "move it above the first [table]"
"""What to do about a number with a decimal comma, and about a key of the whole file inside a table."""

_HEADER = r"\s*\[\[?\s*([\w.\-]+)\s*\]"
"""Pattern of a table's header, [name] or [[name]]."""


class TomlSource:
    """A TOML file's path and text, and the class of its errors."""

    def __init__(self, path: Path, text: str, error: type[PbdError]) -> None:
        self.path, self._text, self._error = path, text, error

    def refuse(self, line: int | None, what: str, next_step: str, **fields: object) -> NoReturn:
        """Raise the error that `read_toml` was given."""
        raise self._error.at(self.path, f"{what}; {next_step}", line, **fields)

    def advice(self, number: int, reason: str) -> str:
        """Return what to do about a line, counted from 1, that is not valid TOML."""
        lines = self._text.split("\n")
        if re.search(r"=\s*[-+]?\d+,\d", lines[number - 1]):
            return DECIMAL_POINTS
        if reason.startswith("Invalid value"):
            return "correct it: a value is a number, true, false, a [list] or a text in quotes"
        if not reason.startswith("Cannot overwrite a value"):
            return "correct it"
        header = next((line.strip() for line in reversed(lines[: number - 1]) if re.match(_HEADER, line)), None)
        if header is None:
            return "this key is there twice: remove one"
        return f"{printable(header)} has this key twice: remove one, or {TO_THE_TOP} if it is about the whole file"

    def has_decimal_comma(self, number: int | None) -> bool:
        """Whether a list on this line, counted from 1, may have a number with a decimal comma."""
        return number is not None and re.search(r"[\[\s,]-?\d+,\d", self._text.split("\n")[number - 1]) is not None

    def line(self, section: str, key: str, index: int = 0) -> int | None:
        """Return the line, counted from 1, of `key` in `section`, or else of the innermost table around it.

        `index` is the number of the [[section]] table, counted from 0.
        """
        keys, headers = self._lines
        found = [keys.get((section, index, key)), headers.get((dotted_name(section, key), 0))]
        if any(found):
            return min(filter(None, found))
        outer, _, name = section.rpartition(".")
        return headers.get((section, index)) or (self.line(outer, name) if section else None)

    @cached_property
    def _lines(self) -> tuple[dict[tuple[str, int, str], int], dict[tuple[str, int], int]]:
        """Lines of the keys by (section, index, key), and of the headers by (section, index)."""
        keys: dict[tuple[str, int, str], int] = {}
        headers: dict[tuple[str, int], int] = {}
        count: Counter[str] = Counter()
        section = ""
        for number, line in enumerate(self._text.split("\n"), start=1):
            if header := re.match(_HEADER, line):
                section = header[1]
                headers[section, count[section]] = number
                count[section] += 1
            elif "=" in line:
                key = line.partition("=")[0].strip().strip("\"'")
                keys.setdefault((section, max(0, count[section] - 1), key), number)
        return keys, headers


def dotted_name(section: str, key: str) -> str:
    """Return the dotted name of a table in a section; the top level's name is empty."""
    return f"{section}.{key}".lstrip(".")
