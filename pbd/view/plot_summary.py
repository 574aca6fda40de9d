"""One sheet, A4 landscape: one look tells what is wrong with a demonstration."""

from __future__ import annotations

from collections.abc import Callable

import matplotlib
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator

from pbd.view import plot_panels as panels
from pbd.view.plot_space import space
from pbd.view.plot_style import AXES_RGB, GREY, INK, LOOK, PALE, SIGMA, VERMILION, head, mark, marks, tracked_by
from pbd.view.plot_text import say, wrapped
from pbd.view.plot_values import DemoPlot
from pbd.view.plot_views import path_3d, truth_within

WIDTH, HEIGHT = 11.69, 8.27
"""A4, inches."""

COLUMNS = ((0.62, 5.1), (6.42, 5.1))
"""Left edge and width of the two columns of time axes, inches."""
ROWS = (3.89, 2.76, 1.63, 0.5)
"""Lower edges of their rows, inches."""
ROW_HEIGHT = 0.88

FACTS_X, FIGURES_X, FINDINGS_X = 4.6, 5.95, 8.55
"""Left edges of what is said in words, inches."""
FIRST_LINE, LINE = 8.0, 0.16
"""Upper edge of the first line, and how far apart they are, inches."""
LINES, FINDING_LINES = 14.5, 5
"""So many lines of findings, and of each, have room."""


def summary(plot: DemoPlot) -> Figure:
    """The path, what happened over time, and in words what is to be looked at."""
    with matplotlib.rc_context({"font.size": 8.0, "lines.linewidth": 0.9}):
        figure = Figure(figsize=(WIDTH, HEIGHT))
        head(figure, plot.name, f"summary, {tracked_by(plot.method)}", right=WIDTH - FACTS_X + 0.2)
        inside = plot.path.p_nav_sensor[plot.tracked]
        shown = [inside] if plot.truth is None else [inside, truth_within(plot)]
        box = (0.1 / WIDTH, 5.12 / HEIGHT, 4.4 / WIDTH, 2.76 / HEIGHT)
        space_axes, scale = space(figure, box, shown)
        path_3d(space_axes, plot, scale)
        _words(figure, plot)
        last = panels.specific_force if plot.field is None else panels.field_strength
        columns: tuple[tuple[Callable[[Axes, DemoPlot], None], ...], ...] = (
            (panels.position, panels.velocity, panels.resulting, panels.intervals),
            (panels.attitude, panels.closure, panels.overall_sigma, last),
        )
        for (left, width), column in zip(COLUMNS, columns, strict=True):
            axes = [figure.add_axes((left / WIDTH, low / HEIGHT, width / WIDTH, ROW_HEIGHT / HEIGHT)) for low in ROWS]
            for ax, panel in zip(axes, column, strict=True):
                panel(ax, plot)
                mark(ax, plot, numbers=ax is axes[0])
                ax.tick_params(labelbottom=ax is axes[-1])
                ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3))
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
    handles.append(Line2D([], [], color=SIGMA, linewidth=1.6, label="σ"))
    if plot.truth is not None:
        handles.append(Line2D([], [], color=INK, label="error"))
    colour, label = (GREY, "g, at rest") if plot.field is None else (VERMILION, "disturbed beyond")
    handles.append(Line2D([], [], color=colour, linestyle="--", label=label))
    handles += marks(plot)
    figure.legend(
        handles=handles, loc="lower left", ncols=-(-len(handles) // 2), bbox_to_anchor=(FACTS_X / WIDTH, 5.05 / HEIGHT),
        columnspacing=1.2, labelspacing=0.35,
    )  # fmt: skip


def _words(figure: Figure, plot: DemoPlot) -> None:
    """Facts and findings, beside the path."""

    def at(left: float, line: float, words: str, right: float, colour: str = INK) -> Text:
        where = (left / WIDTH, (FIRST_LINE - LINE * line) / HEIGHT)
        text = figure.text(*where, "", va="top", color=colour)
        say(text, words, right - left)
        return text

    for line, (what, how_much) in enumerate(plot.facts):
        at(FACTS_X, line, what, FIGURES_X, GREY)
        at(FIGURES_X, line, how_much, FINDINGS_X - 0.1)
    right = WIDTH - 0.25
    heading = at(FINDINGS_X, 0.0, "check" if plot.findings else "no problems found", right)
    if plot.findings:
        heading.set_bbox(LOOK | {"pad": 2.0})
    y = 1.3
    for number, finding in enumerate(plot.findings):
        words = wrapped(finding.words, right - FINDINGS_X, FINDING_LINES)
        if y + len(words) > LINES:
            at(FINDINGS_X, y, f"and {len(plot.findings) - number} more", right, GREY)
            break
        for k, each in enumerate(words):
            at(FINDINGS_X, y + k, each, right)
        y += len(words) + 0.3
