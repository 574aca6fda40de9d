"""One way to read a number or a time in text: as C reads it, not as Python does."""

from __future__ import annotations

import math
import re
from datetime import date

_STAMP = re.compile(
    r"\s*(?=\d)(?:(\d{1,4})[-/.](\d{1,2})[-/.](\d{1,4})(?:[T\s]\s*(?=\d)|\s*$))?"
    r"(?:(\d{1,2}):(\d{1,2}):(\d{1,2})(?:([.,])(\d+)|:(\d{1,3}))?\s*(?:Z|UTC|[+-]\d{2}:?\d{2})?)?\s*"
)
DAY_S = 86400.0
MILLENNIUM = date(2000, 1, 1).toordinal()


def number(text: str) -> float:
    """A number, NaN and infinity too; ValueError: none, or one with what only Python takes (`1_000`, other digits)."""
    if "_" in text or not text.isascii():
        raise ValueError(f"{text[:40]!r} is not a number")
    return float(text)


def finite(text: str) -> float:
    """A finite number; ValueError: none."""
    value = number(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]!r} is not a finite number")
    return value


def finite_list(text: str, count: int) -> tuple[float, ...]:
    """`count` finite numbers with spaces between; ValueError: other than that."""
    words = text.split(maxsplit=count)
    if len(words) != count:
        raise ValueError(f"{text[:40]!r} is not {count} numbers")
    return tuple(map(finite, words))


def is_stamp(text: str) -> bool:
    """Whether it is a date, a time of day or both."""
    return _STAMP.fullmatch(text) is not None


def seconds(text: str) -> float:
    """Seconds of a number, of `2026-10-02T07:48:45.830+02:00`, `2025-10-9 8:18:9:94` (its ms), a date or a time of day.

    A zone is passed over: it is the same in all rows. An empty text, or "null", is NaN. Dates count from the year 2000,
    times of day from midnight. ValueError: none of these.
    """
    match = _STAMP.fullmatch(text)
    if match is None:
        return math.nan if text.strip().lower() in ("", "null") else number(text)
    first, second, third, hour, minute, second_of_minute, mark, fraction, ms = match.groups()
    days = 0
    if first is not None:
        # Which of day and month comes first matters at a midnight alone.
        year, month, day = (first, second, third) if len(first) == 4 else (third, second, first)
        month, day = (day, month) if int(month) > 12 else (month, day)
        days = date(int(year), int(month), int(day)).toordinal() - MILLENNIUM
    part = float(f"0.{fraction}") if mark else int(ms or 0) / 1e3
    return days * DAY_S + 3600.0 * int(hour or 0) + 60.0 * int(minute or 0) + int(second_of_minute or 0) + part
