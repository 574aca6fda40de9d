"""One way to read a number in text, for tables and XML: as C reads it, not as Python does."""

from __future__ import annotations

import math


def number(text: str) -> float:
    """Read a decimal number; NaN and infinity are numbers too.

    Raises:
        ValueError: no number, or one with what only Python takes: `1_000`, other alphabets' digits.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"{text[:40]!r} is not a number")
    return float(text)


def finite(text: str) -> float:
    """Read a finite number.

    Raises:
        ValueError: none.
    """
    value = number(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]!r} is not a finite number")
    return value


def finite_list(text: str, count: int) -> tuple[float, ...]:
    """Read `count` finite numbers with spaces between.

    Raises:
        ValueError: other than that.
    """
    words = text.split(maxsplit=count)
    if len(words) != count:
        raise ValueError(f"{text[:40]!r} is not {count} numbers")
    return tuple(map(finite, words))
