"""Numbers and times in text. Python's own extensions, such as `1_000`, are refused."""

import math
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from datetime import date

_STAMP = re.compile(
    r"\s*(?=\d)(?:(\d{1,4})[-/.](\d{1,2}|[A-Za-z]{3})[-/.](\d{1,4})(?:[T\s]\s*(?=\d)|\s*$))?"
    r"(?:(?:(\d{1,2}):(?=\d+:)|(?=\d+:\d+[.,]\d))(\d{1,2}):(\d{1,2})(?:([.,])(\d+)|:(\d{1,3}))?(?:\s+([AaPp])\.?[Mm]\.?)?"
    r"\s*(?:Z|UTC|([+-])(\d{2})(?::?(\d{2}))?)?)?\s*"
)
_CTIME = re.compile(r"^\s*(?:[A-Za-z]{3},?\s+)?([A-Za-z]{3})\s+(\d\d?)\s+([\d:.]+)\s+(\d{4})\s*$")
"""Pattern of C's and Python's `Wed Dec 22 21:09:46 2021`."""
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
DAY_S, HOUR_S = 86400.0, 3600.0
NO_NUMBER = frozenset(
    ("", "-", "--", "none", "null", "na", "n/a", "#n/a", "#nv", "<na>", "-nan(ind)", "1.#qnan", "-1.#ind")
)
"""Cells without a number, in lower case: pandas.read_csv's, dashes, German spreadsheets' #NV, Windows' NaN."""
DATE_ORDERS = ("ymd", "dmy", "mdy", "ydm")
"""Orders of year, month and day in a date. If several fit equally well, the first is taken."""
LARGEST_NUDGE_M = 0.5
"""Largest nudge or tolerance along an axis, m. A larger one was probably meant in millimetres."""


def number(text: str) -> float:
    """Parse a number; NaN and infinity are numbers. ValueError: anything else, `1_000` and non-ASCII digits too."""
    if "_" in text or not text.isascii():
        raise ValueError(f"{text[:40]!r} is not a number")
    return float(text)


def finite(text: str) -> float:
    """Parse a finite number; ValueError: it is none."""
    value = number(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]!r} is not a finite number")
    return value


def finite_list(text: str, count: int) -> tuple[float, ...]:
    """Parse `count` finite numbers separated by spaces; ValueError: it is anything else."""
    words = text.split(maxsplit=count)
    if len(words) != count:
        raise ValueError(f"{text[:40]!r} is not {count} numbers")
    return tuple(map(finite, words))


def _stamp(text: str) -> re.Match[str] | None:
    return _STAMP.fullmatch(_CTIME.sub(r"\2-\1-\4 \3", text))


def is_stamp(text: str) -> bool:
    """Whether the text is a date, a time of day or both."""
    return _stamp(text) is not None


def seconds(text: str, order: str = "") -> float:
    """Parse a time, s: a number, a date, a time of day, or both: `2026-10-02T07:48:45.830+02:00`.

    `12:05:00 AM` is five past midnight; `25:14.5` is in minutes and s. In `2025-10-9 8:18:9:94` the last number is ms.
    MATLAB writes `09-Jul-2025 8:18:09` and `0.5 sec`, C `Wed Jul  9 08:18:09 2025`. Dates count from the year 2000,
    times of day from midnight. With a date, a time zone counts, because it changes in spring and autumn. `order`: in
    which order a date gives year, month and day (`date_order`). ValueError: it is none of these.
    """
    match = _stamp(text)
    if match is None:
        return number(text.strip().removesuffix(" sec"))
    first, second, third, hour, minute, second_of_minute, mark, fraction, ms, half, *zone = match.groups()
    days = 0
    if first is not None:
        days = _day((first, second, third), order or date_order((text,)))
    hours = int(hour or 0) if half is None else int(hour or 0) % 12 + 12 * (half in "Pp")
    part = float(f"0.{fraction}") if mark else int(ms or 0) / 1e3
    if zone[0] and first is not None:
        hours, minute = hours - int(zone[0] + zone[1]), int(minute or 0) - int(zone[0] + (zone[2] or "0"))
    return days * DAY_S + HOUR_S * hours + 60.0 * int(minute or 0) + int(second_of_minute or 0) + part


def date_order(texts: Iterable[str]) -> str:
    """Return in which order the dates of a column give year, month and day, such as "ymd".

    Of possible orders it is the one in which they are nearest together: across midnight only the day changes.
    """
    given = {match.groups()[:3] for text in texts if (match := _stamp(text)) and match[1] is not None}
    spans = {}
    for order in DATE_ORDERS:
        with suppress(ValueError):
            days = [_day(parts, order) for parts in given]
            spans[order] = max(days, default=0) - min(days, default=0)
    return min(spans, key=spans.__getitem__, default=DATE_ORDERS[0])


def _day(parts: Sequence[str | None], order: str) -> int:
    """Return the number of days since the year 2000 of a date's three parts."""
    named = {part: parts[order.index(part)] or "0" for part in "ymd"}
    if named["m"].isalpha():
        named["m"] = str(_MONTHS.index(named["m"].lower()) + 1)
    year, month, day = map(int, named.values())
    return (date(year + 2000 * (year < 100), month, day) - date(2000, 1, 1)).days
