"""How plots look: colours that everyone can tell apart, sheets with fixed margins, what is marked on every time axis.

Figures are made without pyplot, so that no window opens and nothing is kept that a caller would have to close. Margins
are fixed, in inches: legends stand beside the axes, never on the data.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any, BinaryIO

import matplotlib.style
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from matplotlib.transforms import blended_transform_factory

from pbd.pose import Array
from pbd.view.plot_values import DemoPlot

DPI = 110

ORANGE, SKY, GREEN, YELLOW = "#e69f00", "#56b4e9", "#009e73", "#f0e442"
BLUE, VERMILION, PURPLE = "#0072b2", "#d55e00", "#cc79a7"
"""Okabe and Ito's, told apart by everyone."""
AXES_RGB = (VERMILION, GREEN, BLUE)
"""x, y, z; roll, pitch, yaw."""
RUNS_RGB = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
KNOWN: dict[str, Any] = {"marker": "s", "markersize": 7.0, "markerfacecolor": "none", "markeredgecolor": PURPLE}
KNOWN |= {"linestyle": ""}
INK, GREY, REST = "#222222", "#6e6e6e", "#e9e9e9"
PALE: dict[str, Any] = {"alpha": 0.35, "linewidth": 4.0, "solid_capstyle": "butt"}
"""A truth is a broad, pale line under the thin one that was tracked."""

FAMILY = "DejaVu Sans"
"""Comes with matplotlib, so that a plot looks the same everywhere."""

_STYLE: dict[str, Any] = {
    "font.family": FAMILY,
    "font.size": 10.0,
    "axes.labelsize": "medium",
    "axes.titlesize": "medium",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-5, 6),
    "grid.color": "#b0b0b0",
    "grid.alpha": 0.35,
    "grid.linewidth": 0.6,
    "xtick.labelsize": "small",
    "ytick.labelsize": "small",
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.fontsize": "small",
    "legend.frameon": False,
    "legend.borderaxespad": 0.0,
    "lines.linewidth": 1.1,
    "savefig.facecolor": "white",
    "agg.path.chunksize": 10000,
    "svg.hashsalt": "pbd",
}

WIDTH = 10.0
LEFT, RIGHT, TOP, BOTTOM, BETWEEN = 1.0, 1.75, 0.85, 0.55, 0.22
"""Width of a sheet, its margins and the space between its rows, inches."""

POINTS_PER_INCH, PIXEL = 72.0, 64.0
"""In which fonts are measured: 26.6 fixed point."""

DIGIT_EM, LINE_EM = 0.64, 1.25
"""Width of a digit and height of a line of FAMILY, per font size."""


def style() -> AbstractContextManager[None]:
    """Draw and save within this; a user's own matplotlibrc is left out, and comes back afterwards."""
    return matplotlib.style.context(["default", _STYLE])


def write(figure: Figure, file: BinaryIO, format_name: str) -> None:
    """Write a figure as png, svg or pdf; the same figure gives the same bytes."""
    stamps: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}
    with style():
        figure.savefig(file, format=format_name, dpi=DPI, metadata=stamps[format_name])


def sheet(
    title: str, subtitle: str, heights: Sequence[float], shared: bool = True, between: float = BETWEEN
) -> tuple[Figure, list[Axes]]:
    """Make a figure with a title and rows of axes, of heights in inches; if `shared`, they have one time axis."""
    width, height = WIDTH, TOP + sum(heights) + between * (len(heights) - 1) + BOTTOM
    figure = Figure(figsize=(width, height))
    head(figure, title, subtitle)
    axes: list[Axes] = []
    top = height - TOP
    for row in heights:
        box = (LEFT / width, (top - row) / height, (width - LEFT - RIGHT) / width, row / height)
        axes.append(figure.add_axes(box, sharex=axes[0] if axes and shared else None))
        top -= row + between
    for ax in axes[:-1] if shared else ():
        ax.tick_params(labelbottom=False)
    figure.align_ylabels(axes)
    return figure, axes


def head(figure: Figure, title: str, subtitle: str, right: float = 0.2) -> None:
    """Write title and subtitle into the top left corner; what is longer is cut, so many inches from the right edge."""
    width, height = figure.get_size_inches()
    left = 0.2
    room = width - left - right
    bold: dict[str, Any] = {"fontsize": "large", "fontweight": "bold", "color": INK}
    say(figure.text(left / width, 1.0 - 0.13 / height, "", va="top", **bold), title, room)
    say(figure.text(left / width, 1.0 - 0.38 / height, "", va="top", fontsize="small", color=GREY), subtitle, room)


def say(text: Text, words: str, inches: float = np.inf) -> None:
    """Set a text that a person wrote: no mathematics, a ? for what the font lacks, cut to so many inches."""
    font = get_font(findfont(text.get_fontproperties()))
    words = "".join(c if c.isprintable() and font.get_char_index(ord(c)) else "?" for c in words)
    font.set_size(float(text.get_fontsize()), POINTS_PER_INCH)

    def too_wide(shown: str) -> bool:
        font.set_text(shown)
        return bool(font.get_width_height()[0] / PIXEL / POINTS_PER_INCH > inches)

    if too_wide(words):
        fits = bisect_left(range(len(words)), True, key=lambda n: too_wide(words[:n] + "…")) - 1
        words = words[: max(fits, 0)].rstrip() + "…"
    text.set_parse_math(False)
    text.set_text(words)


def shortened(name: str, length: int) -> str:
    """Cut a name to so many characters."""
    return name if len(name) <= length else name[: length - 1] + "…"


def tracked_by(method: str) -> str:
    """Name the method in a subtitle."""
    return "tracked as the paper does" if method == "paper" else f"tracked by the {method} method"


def font_points(size: str) -> float:
    """Points of a font size in words."""
    return FontProperties(size=size).get_size_in_points()


def size_of(ax: Axes) -> Array:
    """Width and height of axes (2,), inches."""
    figure = ax.figure
    assert isinstance(figure, Figure)
    return np.asarray(ax.get_position().size * figure.get_size_inches())


def length_unit(metres: float) -> tuple[float, str]:
    """The unit for lengths up to so many metres: how many of it make a metre, and its name."""
    if metres < 0.02:
        return 1e3, "mm"
    return (100.0, "cm") if metres < 2.0 else (1.0, "m")


def largest(values: Array) -> float:
    """The largest magnitude, NaN aside; 0 where there is none."""
    return float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0


def mark(ax: Axes, plot: DemoPlot, numbers: bool = False) -> None:
    """Shade the rests, mark the grip, and set the time axis; with `numbers` those of the keyframes stand on top."""
    t, stops = plot.path.t, plot.path.stops
    across = blended_transform_factory(ax.transData, ax.transAxes)
    spans = [(t[stop.start], t[stop.stop - 1]) for stop in stops]
    boxes = [[(a, 0.0), (b, 0.0), (b, 1.0), (a, 1.0)] for a, b in spans]
    shade = PolyCollection(boxes, transform=across, facecolor=REST, edgecolor=REST, linewidth=0.8, zorder=0.0)
    ax.add_collection(shade, autolim=False)
    for event in plot.path.grip:
        ax.axvline(event.t, color=ORANGE, linewidth=1.0, linestyle="--", zorder=1.5)
        ax.plot(event.t, 1.0, transform=across, clip_on=False, **_grip(event.closed), zorder=3.0)
    span = max(float(t[-1] - t[0]), 1e-3)
    ax.set_xlim(float(t[0]) - 0.005 * span, float(t[-1]) + 0.005 * span)
    if numbers:
        _number(ax, plot)


def _grip(closed: bool) -> dict[str, Any]:
    return {
        "marker": "v" if closed else "^",
        "markersize": 6.0,
        "markeredgecolor": ORANGE,
        "markerfacecolor": ORANGE if closed else "white",
        "linestyle": "",
    }


def _number(ax: Axes, plot: DemoPlot) -> None:
    """Number the keyframes above the axes, as many as there is room for; known ones in a box."""
    size = font_points("x-small")
    width_in = float(size_of(ax)[0])
    t0, t1 = ax.get_xlim()
    free = -np.inf
    across = blended_transform_factory(ax.transData, ax.transAxes)
    for number, keyframe in enumerate(plot.keyframes):
        at = 72.0 * width_in * (keyframe.t - t0) / (t1 - t0)  # points
        half = 0.5 * DIGIT_EM * size * len(str(number))
        if at - half < free:
            continue
        free = at + half + 0.6 * size
        frame = {"boxstyle": "square,pad=0.15", "facecolor": "none", "edgecolor": PURPLE, "linewidth": 1.0}
        known = plot.is_known(keyframe.t)
        ax.annotate(
            str(number), (keyframe.t, 1.0), (0.0, 7.0), xycoords=across, textcoords="offset points",
            ha="center", va="bottom", fontsize=size, color=INK, bbox=frame if known else None,
        )  # fmt: skip


def legend(ax: Axes, plot: DemoPlot | None = None) -> None:
    """Say beside the axes what their lines are; with `plot` also what `mark` marks."""
    handles: list[Artist] = list(ax.get_legend_handles_labels()[0])
    if plot is not None:
        handles += marks(plot)
    ax.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.015, 1.0))


def marks(plot: DemoPlot) -> list[Artist]:
    """What is marked on a time axis, for a legend."""
    handles: list[Artist] = [Patch(facecolor=REST, edgecolor="#cccccc", label="at rest")]
    for closed, what in ((True, "closes"), (False, "opens")):
        if any(event.closed == closed for event in plot.path.grip):
            handles.append(Line2D([], [], **_grip(closed), label=f"grip {what}"))
    if plot.path.claims:
        handles.append(Line2D([], [], **KNOWN, label="known place"))
    return handles
