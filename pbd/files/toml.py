"""Strict reading of a TOML file: what it lacks, what it has too much and what is of the wrong kind is an error.

A reader asks a `Section` for each key that it knows; `done` then refuses every key that nobody asked for, so that a
misspelt key can't be passed over in silence. Every error names the file, the line where it is known, and the key.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

from pbd.errors import PbdError, in_words


def read_toml(path: Path, error: type[PbdError]) -> Section:
    """Parse a file; whatever is wrong with it is raised as `error`."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as reason:
        raise error(f"{path}: can't be read ({in_words(reason)}); give the path of a TOML file", path=path) from None
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as reason:
        raise error(f"{path}: not valid TOML: {reason}; correct it", path=path) from None
    return Section(path, "", values, text, error)


class Section:
    """One table of a TOML file. `name` is its dotted name, empty for the file's top level."""

    def __init__(
        self, path: Path, name: str, values: Mapping[str, Any], text: str, error: type[PbdError], index: int = 0
    ) -> None:
        self.path = path
        self.name = name
        self._index = index  # among the [[name]] tables
        self._values = values
        self._text = text
        self._error = error
        self._asked: list[str] = []
        self._sections: list[Section] = []

    def __contains__(self, key: str) -> bool:
        self._ask(key)
        return key in self._values

    def section(self, key: str) -> Section:
        """Return the table under `key`."""
        value = self._get(key)
        if not isinstance(value, dict):
            self.fail(key, "must be a table")
        inner = Section(self.path, f"{self.name}.{key}".lstrip("."), value, self._text, self._error)
        self._sections.append(inner)
        return inner

    def tables(self, key: str) -> list[Section]:
        """Return the tables under `[[key]]`; none where there is no such key."""
        values = self._get(key) if key in self else []
        if not isinstance(values, list) or not all(isinstance(value, dict) for value in values):
            self.fail(key, f"must be [[{key}]] tables")
        name = f"{self.name}.{key}".lstrip(".")
        inner = [Section(self.path, name, value, self._text, self._error, i) for i, value in enumerate(values)]
        self._sections.extend(inner)
        return inner

    def text(self, key: str) -> str:
        """Return a string that is not empty."""
        value = self._get(key)
        if not isinstance(value, str) or not value.strip():
            self.fail(key, f"must be a non-empty string, got {value!r}")
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of strings."""
        value = self._get(key)
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            self.fail(key, f"must be a list of strings, got {value!r}")
        return tuple(value)

    def flag(self, key: str) -> bool:
        """Return true or false."""
        value = self._get(key)
        if not isinstance(value, bool):
            self.fail(key, f"must be true or false, got {value!r}")
        return value

    def number(self, key: str, *, positive: bool = False) -> float:
        """Return a finite number."""
        value = self._get(key)
        if not _is_number(value):
            self.fail(key, f"must be a finite number, got {value!r}")
        if positive and value <= 0:
            self.fail(key, f"must be above zero, got {value!r}")
        return float(value)

    def numbers(self, key: str, count: int | None, *, positive: bool = False) -> tuple[float, ...]:
        """Return a list of `count` finite numbers; None: of any number of them."""
        value = self._get(key)
        if not isinstance(value, list) or not all(_is_number(item) for item in value):
            self.fail(key, f"must be a list of {'' if count is None else f'{count} '}finite numbers, got {value!r}")
        if count is not None and len(value) != count:
            self.fail(key, f"must have {count} numbers, got {len(value)}")
        if positive and min(value, default=1.0) <= 0:
            self.fail(key, f"must hold only numbers above zero, got {value!r}")
        return tuple(float(item) for item in value)

    def figures(self, key: str) -> dict[str, float]:
        """Return a table of finite numbers, whatever their names."""
        value = self._get(key)
        if not isinstance(value, dict) or not all(_is_number(item) for item in value.values()):
            self.fail(key, f"must be a table of finite numbers, got {value!r}")
        return {name: float(item) for name, item in value.items()}

    def done(self) -> None:
        """Refuse what nobody asked for, here and in the tables below."""
        for key in self._values:
            if key not in self._asked:
                self.fail(key, f"is unknown; the keys here are {', '.join(self._asked)}", "remove or rename it")
        for inner in self._sections:
            inner.done()

    def refuse_misspelt(self, keys: tuple[str, ...]) -> None:
        """Refuse a key that nobody asked for and that is nearly one of these."""
        for given in self._unasked():
            for key in keys:
                if _alike(given, key):
                    self.fail(given, f"is unknown; '{key}' may be meant", "rename it")

    def fail(self, key: str, what: str, next_step: str = "correct it") -> NoReturn:
        """Raise the file's error, at `key`."""
        line = self.line(key)
        where = f"{self.path}:{line}" if line else f"{self.path}"
        place = f"[{self.name}] {key}" if self.name else key
        raise self._error(f"{where}: {place} {what}; {next_step}", path=self.path, line=line, key=key)

    def line(self, key: str) -> int | None:
        """Return the line of `key`, counted from 1, or of what is around it."""
        return _find_line(self._text, self.name, key, self._index)

    def _unasked(self) -> list[str]:
        return [given for given in self._values if given not in self._asked]

    def _ask(self, key: str) -> None:
        if key not in self._asked:
            self._asked.append(key)

    def _get(self, key: str) -> Any:
        self._ask(key)
        if key not in self._values:
            misspelt = [given for given in self._unasked() if _alike(given, key)]
            self.fail(key, f"is missing (there is '{misspelt[0]}')" if misspelt else "is missing", next_step="add it")
        return self._values[key]


def _find_line(text: str, section: str, key: str, index: int = 0) -> int | None:
    """Find the line, counted from 1, that sets `key` of `section` or the table around it; tomllib keeps none.

    `index` tells which one is meant where there are several [[section]] tables.
    """
    full_name, current, around = f"{section}.{key}".lstrip("."), "", None
    seen = -1 if section else index  # the top has no header
    for number, line in enumerate(text.splitlines(), start=1):
        if header := re.match(r"\s*\[\[?\s*([\w.\-]+)\s*\]", line):
            current = header[1]
            seen += current == section
        here = current == section and seen == index
        if (here and re.match(rf"\s*{re.escape(key)}\s*=", line)) or (header and current == full_name):
            return number
        around = number if header and here else around
    outer, _, name = section.rpartition(".")
    return around or (_find_line(text, outer, name) if section else None)


def _alike(given: str, key: str) -> bool:
    """Tell whether a word may be another one misspelt."""
    return abs(len(given) - len(key)) <= 2 and difflib.SequenceMatcher(None, given, key).ratio() > 0.6


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
