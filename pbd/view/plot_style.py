"""How plots look: colours that everyone can tell apart, sheets with fixed margins, what is marked on every time axis.

Figures are made without pyplot, so that no window opens and nothing is kept that a caller would have to close. Margins
are fixed, in inches: legends stand beside the axes, never on the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any, BinaryIO

import matplotlib.style
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import blended_transform_factory

from pbd.pose import Array
from pbd.view.plot_text import DIGIT_EM, font_points, say, step
from pbd.view.plot_values import DemoPlot, Span

DPI = 110

ORANGE, SKY, GREEN, YELLOW = "#e69f00", "#56b4e9", "#009e73", "#f0e442"
BLUE, VERMILION, PURPLE = "#0072b2", "#d55e00", "#cc79a7"
"""Okabe and Ito's, told apart by everyone."""
AXES_RGB = (VERMILION, GREEN, BLUE)
"""x, y, z; roll, pitch, yaw."""
RUNS_RGB = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
KNOWN: dict[str, Any] = {"marker": "s", "markersize": 7.0, "markerfacecolor": "none", "markeredgecolor": PURPLE}
KNOWN |= {"linestyle": ""}
SIGMA = PURPLE
"""What the tracker is not sure of, in all figures; where it is told by axis, in the axis' own colour."""
LOOK: dict[str, Any] = {"facecolor": YELLOW, "edgecolor": YELLOW, "alpha": 0.5, "linewidth": 0.0}
"""What is to be looked at, as by a highlighter."""
NARROWEST = 0.006
"""A highlighted span is at least so wide, as a share of the time axis."""
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


def tracked_by(method: str) -> str:
    """Name the method in a subtitle."""
    return "tracked as the paper does" if method == "paper" else f"tracked by the {method} method"


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
    """Shade the rests, highlight the findings, mark the grip, and set the time axis.

    With `numbers` those of the keyframes stand on top.
    """
    t, stops = plot.path.t, plot.path.stops
    span = max(float(t[-1] - t[0]), 1e-3)
    across = blended_transform_factory(ax.transData, ax.transAxes)
    _shade(ax, [(t[stop.start], t[stop.stop - 1]) for stop in stops], facecolor=REST, edgecolor=REST, linewidth=0.8)
    spans = [_widened(*when, NARROWEST * span) for finding in plot.findings for when in finding.spans]
    _shade(ax, _joined(spans), **LOOK)
    for event in plot.path.grip:
        ax.axvline(event.t, color=ORANGE, linewidth=1.0, linestyle="--", zorder=1.5)
        ax.plot(event.t, 1.0, transform=across, clip_on=False, **_grip(event.closed), zorder=3.0)
    ax.set_xlim(float(t[0]) - 0.005 * span, float(t[-1]) + 0.005 * span)
    if numbers:
        _number(ax, plot)


def _shade(ax: Axes, spans: Sequence[Span], **look: Any) -> None:
    """Fill the axes' height over spans of time, s."""
    boxes = [[(a, 0.0), (b, 0.0), (b, 1.0), (a, 1.0)] for a, b in spans]
    across = blended_transform_factory(ax.transData, ax.transAxes)
    ax.add_collection(PolyCollection(boxes, transform=across, zorder=0.0, **look), autolim=False)


def _widened(begin: float, end: float, least: float) -> Span:
    more = 0.5 * max(least - (end - begin), 0.0)
    return begin - more, end + more


def _joined(spans: Sequence[Span]) -> list[Span]:
    """Spans that cover the same without covering anything twice."""
    joined: list[Span] = []
    for begin, end in sorted(spans):
        if joined and begin <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(end, joined[-1][1]))
        else:
            joined.append((begin, end))
    return joined


def _grip(closed: bool) -> dict[str, Any]:
    return {
        "marker": "v" if closed else "^",
        "markersize": 6.0,
        "markeredgecolor": ORANGE,
        "markerfacecolor": ORANGE if closed else "white",
        "linestyle": "",
    }


def _number(ax: Axes, plot: DemoPlot) -> None:
    """Number the keyframes above the axes, each or, of many, every so-manieth; known ones in a box."""
    size = font_points("x-small")
    t0, t1 = ax.get_xlim()
    points = 72.0 * float(size_of(ax)[0]) / (t1 - t0)
    widest = DIGIT_EM * size * len(str(len(plot.keyframes)))
    every = step(len(plot.keyframes), points * (t1 - t0) / (widest + 0.6 * size))
    free = -np.inf
    across = blended_transform_factory(ax.transData, ax.transAxes)
    for number, keyframe in list(enumerate(plot.keyframes))[::every]:
        at = points * (keyframe.t - t0)
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
    if any(finding.spans for finding in plot.findings):
        handles.append(Patch(**LOOK, label="check"))
    return handles
