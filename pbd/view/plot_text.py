"""Words in a plot: measured, cut and broken to the room that there is, with the font that comes with matplotlib."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator

import numpy as np
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.text import Text

POINTS_PER_INCH, PIXEL = 72.0, 64.0
"""In which fonts are measured: 26.6 fixed point."""

DIGIT_EM, LINE_EM = 0.64, 1.25
"""Width of a digit and height of a line of plot_style's FAMILY, per font size."""


def say(text: Text, words: str, inches: float = np.inf) -> None:
    """Set a text that a person wrote: no mathematics, a ? for what the font lacks, cut to so many inches."""
    properties = text.get_fontproperties()
    words, width = _shown(words, properties), _ruler(properties)
    if width(words) > inches:
        words = _cut(words, inches, width)
    text.set_parse_math(False)
    text.set_text(words)


def wrapped(words: str, inches: float, most: int) -> list[str]:
    """Break words in the style's font into lines of so many inches, at most so many; what is too long is cut."""
    properties = FontProperties()
    width = _ruler(properties)
    lines: list[str] = []
    rest = _shown(words, properties).split()
    while rest:
        # The first word stands in any case: `say` cuts it where it is too wide alone.
        fits = bisect_left(range(2, len(rest) + 1), True, key=lambda n: width(" ".join(rest[:n])) > inches) + 1
        line, rest = " ".join(rest[:fits]), rest[fits:]
        if len(lines) == most - 1 and rest:
            return [*lines, _cut(" ".join((line, *rest)), inches, width)]
        lines.append(line)
    return lines


def shortened(name: str, length: int) -> str:
    """Cut a name to so many characters."""
    return name if len(name) <= length else name[: length - 1] + "…"


def font_points(size: str) -> float:
    """Points of a font size in words."""
    return FontProperties(size=size).get_size_in_points()


def step(count: int, room: float) -> int:
    """The least of 1, 2, 5, 10, 20, ... of which count / step have room."""
    steps: Iterator[int] = (digit * 10**power for power in range(9) for digit in (1, 2, 5))
    return next(every for every in steps if count <= every * room)


def _shown(words: str, properties: FontProperties) -> str:
    font = get_font(findfont(properties))
    return "".join(c if c.isprintable() and font.get_char_index(ord(c)) else "?" for c in words)


def _ruler(properties: FontProperties) -> Callable[[str], float]:
    """What measures a line in this font, in inches."""
    font = get_font(findfont(properties))

    def width(line: str) -> float:
        font.set_size(properties.get_size_in_points(), POINTS_PER_INCH)  # matplotlib has one font for all sizes
        font.set_text(line)
        return float(font.get_width_height()[0]) / PIXEL / POINTS_PER_INCH

    return width


def _cut(words: str, inches: float, width: Callable[[str], float]) -> str:
    """The longest beginning that fits, with an ellipsis."""
    fits = bisect_left(range(len(words)), True, key=lambda n: width(words[:n] + "…") > inches) - 1
    return words[: max(fits, 0)].rstrip() + "…"
