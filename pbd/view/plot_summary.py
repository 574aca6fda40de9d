"""One sheet, A4 landscape: one look tells what is wrong with a demonstration."""

from __future__ import annotations

import textwrap
from collections.abc import Callable

import matplotlib
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pbd.view import plot_panels as panels
from pbd.view.plot_space import space
from pbd.view.plot_style import AXES_RGB, GREY, INK, PALE, VERMILION, head, mark, marks, say, tracked_by
from pbd.view.plot_values import DemoPlot
from pbd.view.plot_views import path_3d, truth_within

WIDTH, HEIGHT = 11.69, 8.27
"""A4, inches."""

COLUMNS = ((0.62, 5.1), (6.42, 5.1))
"""Left edge and width of the two columns of time axes, inches."""
ROWS = (3.62, 2.08, 0.52)
"""Lower edges of their rows, inches."""
ROW_HEIGHT = 1.2

FACTS_X, FIGURES_X, FINDINGS_X = 5.2, 6.6, 9.05
"""Left edges of what is said in words, inches."""
FIRST_LINE, LINE = 8.0, 0.165
"""Upper edge of the first line, and how far apart they are, inches."""
LINES, FINDING_LINES, FINDING_WIDTH = 15.0, 4, 42
"""So many lines of findings, each finding with so many lines of so many characters, have room."""


def summary(plot: DemoPlot) -> Figure:
    """The path, what happened over time, and in words what is to be looked at."""
    with matplotlib.rc_context({"font.size": 8.0, "lines.linewidth": 0.9}):
        figure = Figure(figsize=(WIDTH, HEIGHT))
        head(figure, plot.name, f"summary, {tracked_by(plot.method)}", right=WIDTH - FACTS_X + 0.2)
        inside = plot.path.p_nav_sensor[plot.tracked]
        shown = [inside] if plot.truth is None else [inside, truth_within(plot)]
        box = (0.1 / WIDTH, 5.12 / HEIGHT, 5.0 / WIDTH, 2.76 / HEIGHT)
        space_axes, scale = space(figure, box, shown)
        path_3d(space_axes, plot, scale)
        _words(figure, plot)
        last = panels.intervals if plot.field is None else panels.field_strength
        columns: tuple[tuple[Callable[[Axes, DemoPlot], None], ...], ...] = (
            (panels.position, panels.attitude, panels.resulting),
            (panels.velocity, panels.overall_sigma, last),
        )
        for (left, width), column in zip(COLUMNS, columns, strict=True):
            axes = [figure.add_axes((left / WIDTH, low / HEIGHT, width / WIDTH, ROW_HEIGHT / HEIGHT)) for low in ROWS]
            for ax, panel in zip(axes, column, strict=True):
                panel(ax, plot)
                mark(ax, plot, numbers=ax is axes[0])
                ax.tick_params(labelbottom=ax is axes[-1])
            axes[-1].set_xlabel("time (s)")
            figure.align_ylabels(axes)
        _legend(figure, plot)
        return figure


def _legend(figure: Figure, plot: DemoPlot) -> None:
    """One for all axes of the sheet."""
    names = zip(("x, roll", "y, pitch", "z, yaw"), AXES_RGB, strict=True)
    handles: list[Artist] = [Line2D([], [], color=colour, label=name) for name, colour in names]
    if plot.truth is not None:
        handles.append(Line2D([], [], color=GREY, label="truth", **PALE))
    handles += marks(plot)
    corner = (FACTS_X / WIDTH, 5.08 / HEIGHT)
    figure.legend(handles=handles, loc="lower left", ncols=len(handles), bbox_to_anchor=corner, columnspacing=1.2)


def _words(figure: Figure, plot: DemoPlot) -> None:
    """Facts and findings, beside the path."""

    def at(left: float, line: float, words: str, right: float, colour: str = INK) -> None:
        where = (left / WIDTH, (FIRST_LINE - LINE * line) / HEIGHT)
        say(figure.text(*where, "", va="top", color=colour), words, right - left)

    for line, (what, how_much) in enumerate(plot.facts):
        at(FACTS_X, line, what, FIGURES_X, GREY)
        at(FIGURES_X, line, how_much, FINDINGS_X - 0.1)
    right = WIDTH - 0.15
    heading, colour = ("to be looked at", VERMILION) if plot.findings else ("nothing to remark", GREY)
    at(FINDINGS_X, 0.0, heading, right, colour)
    y = 1.2
    for number, finding in enumerate(plot.findings):
        words = textwrap.wrap(finding, FINDING_WIDTH, max_lines=FINDING_LINES, placeholder=" …")
        if y + len(words) > LINES:
            at(FINDINGS_X, y, f"and {len(plot.findings) - number} more", right, GREY)
            break
        for k, each in enumerate(words):
            at(FINDINGS_X, y + k, each, right)
        y += len(words) + 0.3
