"""A TOML file's text: parsed, bounded, and which line sets what. Every failure is the caller's error, with its line."""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Mapping
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import Any, NoReturn

from pbd.doors.opening import read_text
from pbd.errors import PbdError, printable

MOST_BYTES = 1_000_000
"""Largest TOML file: 2000 keyframes."""

MOST_PARTS = 100
"""Most parts of a dotted key: tomllib's time grows with their square."""

MOST_LEVELS = 10
"""Deepest nesting of tables and lists; ours have four."""

LONGEST_KEY = 200
"""How far into a line its key is looked for, characters."""


_KEY_PART = re.compile(r"""\s*(?:[\w\-]+|"[^"]*"|'[^']*')\s*""")


class Source:
    """A TOML file's text: which line sets what. tomllib keeps no lines."""

    def __init__(self, path: Path, text: str, error: type[PbdError]) -> None:
        self.path, self._text, self._error = path, text, error

    @staticmethod
    def open(path: Path, error: type[PbdError]) -> tuple[Source, Mapping[str, Any]]:
        """Parse a file; return its text and its values."""
        return Source.parse(path, read_text(path, error, "give the path of a TOML file", MOST_BYTES), error)

    @staticmethod
    def parse(path: Path, text: str, error: type[PbdError]) -> tuple[Source, Mapping[str, Any]]:
        """Parse the text of a file; return it and its values."""
        source = Source(path, text, error)
        if line := _long_key_line(text):
            source.refuse(line, f"a dotted key of more than {MOST_PARTS} parts", "correct it")
        try:
            values = tomllib.loads(text)
        except tomllib.TOMLDecodeError as reason:
            place = re.search(r"at line (\d+)", str(reason))
            line = int(place[1]) if place else text.rstrip().count("\n") + 1
            source.refuse(line, f"not valid TOML: {reason}", "correct it")
        except RecursionError:
            source.refuse(_deepest_line(text), f"nested more than {MOST_LEVELS} levels deep", "correct it")
        except ValueError:  # int() takes 4300 digits at most
            long = re.search(r"\d{1000,}", text.replace("_", "0"))
            where = text.count("\n", 0, long.start()) + 1 if long else None
            source.refuse(where, "not valid TOML: a number with thousands of digits", "correct it")
        _refuse_oversize(source, values)
        return source, values

    def refuse(self, line: int | None, what: str, next_step: str, **fields: object) -> NoReturn:
        """Raise the file's error."""
        where = f"{self.path}:{line}" if line else f"{self.path}"
        raise self._error(f"{where}: {what}; {next_step}", path=self.path, line=line, **fields)

    def line(self, section: str, key: str, index: int = 0) -> int | None:
        """Find the line, counted from 1, that sets `key` of a section, or else the line of the table around it.

        `index` tells which one is meant where there are several [[section]] tables.
        """
        keys, headers = self._lines
        found = (keys.get((section, index, key)), headers.get((inside(section, key), 0)))
        if any(found):
            return min(filter(None, found))
        outer, _, name = section.rpartition(".")
        return headers.get((section, index)) or (self.line(outer, name) if section else None)

    @cached_property
    def _lines(self) -> tuple[dict[tuple[str, int, str], int], dict[tuple[str, int], int]]:
        """Lines by (section, which of that name, key), and of the headers by (section, which)."""
        keys: dict[tuple[str, int, str], int] = {}
        headers: dict[tuple[str, int], int] = {}
        seen: Counter[str] = Counter()
        section = ""
        for number, line in enumerate(self._text.split("\n"), start=1):
            if header := re.match(r"\s*\[\[?\s*([\w.\-]+)\s*\]", line):
                section = header[1]
                headers[section, seen[section]] = number
                seen[section] += 1
            elif key := re.match(r"""\s*["']?([^"'=]*?)["']?\s*=""", line[:LONGEST_KEY]):
                keys.setdefault((section, max(0, seen[section] - 1), key[1]), number)
        return keys, headers


def _long_key_line(text: str) -> int | None:
    """Return the line of a dotted key of too many parts."""
    for number, line in enumerate(text.split("\n"), start=1):
        if line.count(".") >= MOST_PARTS:
            words = (word.split(".") for word in re.split(r"[=,\[\]{}]", line))
            if any(len(parts) > MOST_PARTS and all(map(_KEY_PART.fullmatch, parts)) for parts in words):
                return number
    return None


def _deepest_line(text: str) -> int:
    """Return the line where most brackets are open."""
    depths = accumulate(
        line.count("[") + line.count("{") - line.count("]") - line.count("}") for line in text.split("\n")
    )
    return max(enumerate(depths, start=1), key=lambda each: each[1])[0]


def _refuse_oversize(source: Source, values: Mapping[str, Any]) -> None:
    """Refuse what TOML lets readers refuse, and what nothing here needs: integers over 64 bits, deep nesting."""
    waiting: list[tuple[str, int, str, Any, int]] = [("", 0, key, value, 1) for key, value in values.items()]
    while waiting:
        section, index, key, value, level = waiting.pop()
        if level > MOST_LEVELS:
            what = f"is nested more than {MOST_LEVELS} levels deep"
        elif isinstance(value, int) and not -(2**63) <= value < 2**63:
            what = "is an integer of more than 64 bits"
        else:
            inner = inside(section, key)
            if isinstance(value, dict):
                waiting += [(inner, 0, k, v, level + 1) for k, v in value.items()]
            elif isinstance(value, list):
                for i, item in enumerate(value):
                    if isinstance(item, dict):
                        waiting += [(inner, i, k, v, level + 1) for k, v in item.items()]
                    else:
                        waiting.append((section, index, key, item, level + 1))
            continue
        source.refuse(source.line(section, key, index), f"{place(section, key)} {what}", "correct it", key=key)


def inside(section: str, key: str) -> str:
    """Join the dotted name of a table and a key in it."""
    return f"{section}.{key}".lstrip(".")


def place(section: str, key: str) -> str:
    """Name a key for people; a name may hold what a terminal obeys."""
    return printable(f"[{section}] {key}" if section else key)


def shown(value: object) -> str:
    """Write a value for a message."""
    return printable(repr(value))
