"""Strict reading of a TOML file: what it lacks, what it has too much and what is of the wrong kind is an error.

A reader asks a `Section` for each key that it knows; `done` then refuses every key that nobody asked for, so that a
misspelt key can't be passed over in silence. Every error names the file, the line where it is known, and the key.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from pbd.doors.toml import Source, inside, place, shown
from pbd.errors import PbdError

LARGEST = 1e9
"""Largest magnitude of a number, in any of our units: beyond every length, angle, time, rate and limit of an arm."""

SMALLEST = 1e-9
"""Smallest number where one must be above zero, likewise."""


def read_toml(path: Path, error: type[PbdError]) -> Section:
    """Parse a file; whatever is wrong with it is raised as `error`."""
    source, values = Source.open(path, error)
    return Section(source, "", values)


class Section:
    """One table of a TOML file. `name` is its dotted name, empty for the file's top level."""

    def __init__(self, source: Source, name: str, values: Mapping[str, Any], index: int = 0) -> None:
        self.path = source.path
        self.name = name
        self._index = index  # among the [[name]] tables
        self._values = values
        self._source = source
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
        inner = Section(self._source, inside(self.name, key), value)
        self._sections.append(inner)
        return inner

    def tables(self, key: str) -> list[Section]:
        """Return the tables under `[[key]]`; none where there is no such key."""
        values = self._get(key) if key in self else []
        if not isinstance(values, list) or not all(isinstance(value, dict) for value in values):
            self.fail(key, f"must be [[{key}]] tables")
        name = inside(self.name, key)
        inner = [Section(self._source, name, value, i) for i, value in enumerate(values)]
        self._sections.extend(inner)
        return inner

    def text(self, key: str) -> str:
        """Return a string that is not empty."""
        value = self._get(key)
        if not isinstance(value, str) or not value.strip():
            self.fail(key, f"must be a non-empty string, got {shown(value)}")
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of strings."""
        value = self._get(key)
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            self.fail(key, f"must be a list of strings, got {shown(value)}")
        return tuple(value)

    def flag(self, key: str) -> bool:
        """Return true or false."""
        value = self._get(key)
        if not isinstance(value, bool):
            self.fail(key, f"must be true or false, got {shown(value)}")
        return value

    def number(self, key: str, *, positive: bool = False, within: float = LARGEST) -> float:
        """Return a finite number, `within` at the most, whatever its sign."""
        value = self._get(key)
        if not _is_number(value):
            self.fail(key, f"must be a finite number, got {shown(value)}")
        self._check(key, (value,), positive, within, "")
        return float(value)

    def numbers(
        self, key: str, count: int | None, *, positive: bool = False, within: float = LARGEST
    ) -> tuple[float, ...]:
        """Return a list of `count` finite numbers; None: of any number of them."""
        value = self._get(key)
        if not isinstance(value, list) or not all(_is_number(item) for item in value):
            what = f"must be a list of {'' if count is None else f'{count} '}finite numbers"
            self.fail(key, f"{what}, got {shown(value)}")
        if count is not None and len(value) != count:
            self.fail(key, f"must have {count} numbers, got {len(value)}")
        self._check(key, value, positive, within, "hold only numbers ")
        return tuple(float(item) for item in value)

    def _check(self, key: str, values: Sequence[float], positive: bool, within: float, hold: str) -> None:
        got = shown(list(values) if hold else values[0])
        if positive and min(values, default=1.0) <= 0:
            self.fail(key, f"must {hold or 'be '}above zero, got {got}")
        if max(map(abs, values), default=0.0) > within or (positive and min(values, default=1.0) < SMALLEST):
            least = f"{SMALLEST:g}" if positive else f"-{within:g}"
            self.fail(key, f"must {hold or 'be '}from {least} to {within:g}, got {got}")

    def figures(self, key: str) -> dict[str, float]:
        """Return a table of finite numbers, whatever their names."""
        value = self._get(key)
        if not isinstance(value, dict) or not all(_is_number(item) for item in value.values()):
            self.fail(key, f"must be a table of finite numbers, got {shown(value)}")
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
        self._source.refuse(self.line(key), f"{place(self.name, key)} {what}", next_step, key=key)

    def line(self, key: str) -> int | None:
        """Return the line of `key`, counted from 1, or of what is around it."""
        return self._source.line(self.name, key, self._index)

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


def _alike(given: str, key: str) -> bool:
    """Tell whether a word may be another one misspelt."""
    return abs(len(given) - len(key)) <= 2 and difflib.SequenceMatcher(None, given, key).ratio() > 0.6


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < math.inf
