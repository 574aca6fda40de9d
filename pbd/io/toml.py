"""Strict reading of TOML: a missing key, an unknown key or a wrong type is an error with file, line and key.

A reader asks a `Section` for each key that it knows. `refuse_unread` then refuses all other keys, so a misspelt key is
never ignored.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from pbd.data.world import IN_METRES, REACH_M, beyond_reach
from pbd.errors import PbdError, listed, printable
from pbd.io.read_file import read_text
from pbd.io.toml_source import DECIMAL_POINTS, TO_THE_TOP, TomlSource, dotted_name

FORMAT = 1
"""Version of the formats of demonstrations, keyframes, calibrations and robots."""

LONGEST_LINE = 20_000
"""Longest line of a TOML file, characters. tomllib's time grows with the square of a dotted key's length."""

LARGEST_NUMBER = 1e9
"""Largest magnitude of a number, in any unit."""

SMALLEST_POSITIVE = 1e-9
"""Smallest value of a number that must be above zero, in any unit."""

T = TypeVar("T")
_REQUIRED: Any = object()


def read_toml(path: Path, error: type[PbdError]) -> Section:
    """Parse a TOML file; `error`: it can't be read or is not valid TOML."""
    return parse_toml(path, read_text(path, error, "give the path of a TOML file", most=1_000_000), error)


def parse_toml(path: Path, text: str, error: type[PbdError]) -> Section:
    """Parse the text of a TOML file; `error`: it is not valid TOML."""
    source = TomlSource(path, text, error)
    if long := next((number for number, line in enumerate(text.split("\n"), 1) if len(line) > LONGEST_LINE), None):
        source.refuse(long, f"a line of more than {LONGEST_LINE} characters", "break it")
    try:
        return Section(source, "", tomllib.loads(text))
    except tomllib.TOMLDecodeError as reason:
        place = re.search(r"at line (\d+)", str(reason))
        line = int(place[1]) if place else text.rstrip().count("\n") + 1
        source.refuse(line, f"not valid TOML: {reason}", source.advice(line, str(reason)))
    except (RecursionError, ValueError):
        source.refuse(None, "not valid TOML: nested too deeply, or a number with thousands of digits", "correct it")


def instant_of(created: str) -> datetime:
    """Return the instant of a date in ISO 8601, which is UTC where it names no time zone."""
    instant = datetime.fromisoformat(created)
    return instant if instant.tzinfo is not None else instant.replace(tzinfo=UTC)


def utc_now() -> str:
    """Return the present time in UTC, as `instant_of` reads it."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


class Section:
    """One table of a TOML file. `name` is its dotted name, empty for the top level.

    Each method that reads a key raises the file's error if the key is missing and no `default` is given.
    """

    def __init__(
        self,
        source: TomlSource,
        name: str,
        values: Mapping[str, Any],
        index: int = 0,
        top: Section | None = None,
    ) -> None:
        self.path, self.name, self._top = source.path, name, top or self
        self._source, self._values, self._index = source, values, index
        self._asked: dict[str, None] = {}
        self._sections: list[Section] = []

    def __contains__(self, key: str) -> bool:
        self._asked[key] = None
        return key in self._values

    def section(self, key: str, default: T = _REQUIRED) -> Section | T:
        """Return the table under `key`."""
        if key not in self and default is not _REQUIRED:
            return default
        values = self._get(key, "must be a table", _is_table)
        inner = Section(self._source, dotted_name(self.name, key), values, 0, self._top)
        self._sections.append(inner)
        return inner

    def tables(self, key: str) -> list[Section]:
        """Return the `[[key]]` tables; an empty list without the key."""
        values = self._get(key, f"must be [[{key}]] tables", _list_of(_is_table), [])
        name = dotted_name(self.name, key)
        inner = [Section(self._source, name, value, i, self._top) for i, value in enumerate(values)]
        self._sections.extend(inner)
        return inner

    def text(self, key: str, default: T = _REQUIRED, *, blank: bool = False) -> str | T:
        """Return a string. It must not be empty, unless `blank`."""
        kind = f"must be a {'' if blank else 'non-empty '}string, got {{}}"
        text: str | T = self._get(key, kind, lambda v: isinstance(v, str) and (blank or v.strip()), default)
        return text

    def date(self, key: str, default: T = _REQUIRED) -> str | T:
        """Return a date and time in ISO 8601: in the file a string, or TOML's own without quotes."""
        rule = "must be a date and time such as 2026-05-01T12:00:00Z, got {}"
        given = self._get(key, rule, _is_date, default)
        text: str | T = given.isoformat() if isinstance(given, date) else given
        return text

    def texts(self, key: str, default: T = _REQUIRED) -> tuple[str, ...] | T:
        """Return a list of strings."""
        values = self._get(key, "must be a list of strings, got {}", _list_of(lambda v: isinstance(v, str)), default)
        return tuple(values)

    def pairs(self, key: str) -> tuple[tuple[str, str], ...]:
        """Return a list of pairs of strings; empty without the key."""
        is_pair = lambda v: _list_of(lambda name: isinstance(name, str))(v) and len(v) == 2  # noqa: E731
        values = self._get(key, "must be a list of pairs of strings, got {}", _list_of(is_pair), [])
        return tuple((first, second) for first, second in values)

    def flag(self, key: str, default: bool = _REQUIRED) -> bool:
        """Return true or false."""
        return bool(self._get(key, "must be true or false, got {}", lambda v: isinstance(v, bool), default))

    def number(
        self, key: str, default: T = _REQUIRED, *, positive: bool = False, within: float = LARGEST_NUMBER
    ) -> float | T:
        """Return a finite number whose magnitude is at most `within`."""
        value = self._get(key, "must be a finite number, got {}", _is_number, default)
        return value if value is default else self._bounded(key, value, positive, within)[0]

    def numbers(
        self,
        key: str,
        count: int | Sequence[str] | None,
        default: T = _REQUIRED,
        *,
        positive: bool = False,
        within: float = LARGEST_NUMBER,
    ) -> tuple[float, ...] | T:
        """Return a list of `count` finite numbers, or one for each of these names; any count if it is None."""
        names = "" if count is None or isinstance(count, int) else f" ({listed(count)})"
        count = len(count) if count is not None and not isinstance(count, int) else count
        kind = f"must be a list of {'' if count is None else f'{count} '}finite numbers, got {{}}"
        values = self._get(key, kind, _list_of(_is_number), default)
        if values is default:
            return values
        if count is not None and len(values) != count:
            comma = len(values) > count and self._source.has_decimal_comma(self.line(key))
            self.fail(
                key, f"must have {count} numbers{names}, got {len(values)}", DECIMAL_POINTS if comma else "correct it"
            )
        return self._bounded(key, values, positive, within)

    def sigmas(self, key: str, default: T = _REQUIRED) -> tuple[float, ...] | T:
        """Return three standard deviations; each may be zero."""
        values: tuple[float, ...] | T = self.numbers(key, 3, default)
        if isinstance(values, tuple) and min(values) < 0.0:
            self.fail(key, f"must not be below zero, got {_shown(list(values))}")
        return values

    def length(self, key: str) -> float | None:
        """Return a length or a coordinate, m, or None. One beyond any arm's reach is refused: it is not in metres."""
        value = self.number(key, None)
        return None if value is None else self._within_reach(key, [value], REACH_M)[0]

    def lengths(
        self, key: str, count: int, default: T = _REQUIRED, *, positive: bool = False, within: float = REACH_M
    ) -> tuple[float, ...] | T:
        """Return a list of `count` lengths or coordinates, m, each as `length`."""
        values: tuple[float, ...] | T = self.numbers(key, count, default, positive=positive)
        return values if values is default else self._within_reach(key, values, within)

    def named_numbers(self, key: str) -> dict[str, float]:
        """Return a table of finite numbers under any names; empty without the key."""
        kind = "must be a table of finite numbers, got {}"
        values = self._get(key, kind, lambda v: _is_table(v) and all(map(_is_number, v.values())), {})
        return {name: float(item) for name, item in values.items()}

    def require_format(self) -> None:
        """Refuse a file whose `format` is not FORMAT."""
        if (found := self.number("format")) != FORMAT:
            next_step = "it was written by a newer pbd: update pbd" if found > FORMAT else "correct it"
            self.fail("format", f"must be {FORMAT}, the only format that this version reads", next_step)

    def choice(self, key: str, choices: Mapping[str, T], default: T = _REQUIRED) -> T:
        """Return the value in `choices` of the word under `key`."""
        rule = f"must be one of {', '.join(choices)}, got {{}}"
        word = self._get(key, rule, lambda v: isinstance(v, str) and v in choices, default)
        return default if word is default else choices[word]

    def refuse_unread(self) -> None:
        """Refuse keys that were not read, here and in the tables inside."""
        for key in self._unread():
            if key in self._top._asked and key not in self._top._values:
                self.fail(key, "is about the whole file", TO_THE_TOP)
            self.fail(key, f"is unknown; the keys here are {', '.join(self._asked)}", "remove or rename it")
        for inner in self._sections:
            inner.refuse_unread()

    def fail(self, key: str, what: str, next_step: str = "correct it") -> NoReturn:
        """Raise the file's error with the name and line of `key`."""
        where = printable(f"[{self.name}] {key}" if self.name else key)
        self._source.refuse(self.line(key), f"{where} {what}", next_step, key=key)

    def line(self, key: str) -> int | None:
        """Return the line of `key`, counted from 1, or else of the innermost table around it."""
        return self._source.line(self.name, key, self._index)

    def _get(self, key: str, rule: str, is_valid: Callable[[Any], object], default: Any = _REQUIRED) -> Any:
        if key not in self:
            if default is not _REQUIRED:
                return default
            similar = [given for given in self._unread() if abs(len(given) - len(key)) <= 2]
            misspelt = difflib.get_close_matches(key, similar, n=1)
            self.fail(key, f"is missing (there is '{misspelt[0]}')" if misspelt else "is missing", next_step="add it")
        value = self._values[key]
        if not is_valid(value):
            self.fail(key, rule.format(_shown(value)))
        return value

    def _bounded(self, key: str, given: Any, positive: bool, within: float) -> tuple[float, ...]:
        values, must = (given, "hold only numbers ") if isinstance(given, list) else ([given], "be ")
        if positive and min(values, default=1.0) <= 0:
            self.fail(key, f"must {must}above zero, got {_shown(given)}")
        if max(map(abs, values), default=0.0) > within or (positive and min(values, default=1.0) < SMALLEST_POSITIVE):
            least = f"{SMALLEST_POSITIVE:g}" if positive else f"-{within:g}"
            self.fail(key, f"must {must}from {least} to {within:g}, got {_shown(given)}")
        return tuple(map(float, values))

    def _within_reach(self, key: str, values: Any, most_m: float) -> tuple[float, ...]:
        if far := beyond_reach(values, most_m):
            self.fail(key, f"has {far}", IN_METRES)
        return tuple(values)

    def _unread(self) -> list[str]:
        return [given for given in self._values if given not in self._asked]


def _shown(value: object) -> str:
    try:
        return printable(repr(value))
    except ValueError:
        return "a number with thousands of digits"


def _is_table(value: object) -> bool:
    return isinstance(value, dict)


def _is_date(value: object) -> bool:
    try:
        return isinstance(value, date) or (isinstance(value, str) and bool(datetime.fromisoformat(value)))
    except ValueError:
        return False


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < math.inf


def _list_of(is_valid: Callable[[Any], object]) -> Callable[[Any], bool]:
    return lambda values: isinstance(values, list) and all(map(is_valid, values))
