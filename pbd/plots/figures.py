"""The figures of one demonstration: the paper's figures 5 to 10, our own, and a summary."""

import textwrap
from collections.abc import Callable, Mapping
from functools import partial
from typing import cast

import matplotlib
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.axes3d import Axes3D

from pbd.plots import panels
from pbd.plots.demo_values import DemoValues
from pbd.plots.space import YX, YZ, label_keyframes, label_keyframes_3d, path_3d, path_view
from pbd.plots.style import (
    AXES_DASHES,
    AXES_RGB,
    FINDING_LOOK,
    GREY,
    INK,
    SIGMA_RGB,
    TRUTH_LOOK,
    VERMILION,
    event_legend,
    legend,
    mark_events,
    new_figure,
    plain_text,
    style,
)

Panel = Callable[[Axes, DemoValues], None]

TIME_WIDTH = 10.0
"""Width of a figure over time, inches."""
VIEW_SIZE = (8.4, 6.4)
"""Size of a picture of the path, inches."""
FINDING_WIDTH, FINDING_LINES, ALL_FINDINGS_LINES = 46, 5, 14
"""In the summary: most characters in a line, most lines of one finding, and of all findings."""


def names(demo: DemoValues) -> tuple[str, ...]:
    """Names of a demonstration's figures; there is no "field" without a magnetometer."""
    return tuple(name for name in FIGURES if name != "field" or demo.field is not None)


def draw(name: str, demo: DemoValues) -> Figure:
    """Draw one of the figures that `names` lists."""
    with style():
        return FIGURES[name](demo)


def _over_time(title: str, *rows: tuple[float, Panel]) -> Callable[[DemoValues], Figure]:
    """A figure of panels with a common time axis, each with its height in inches."""

    def drawn(demo: DemoValues) -> Figure:
        heights = [height for height, _ in rows]
        figure = new_figure(title, TIME_WIDTH, 1.3 + sum(heights))
        axes = figure.subplots(len(rows), sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        axes[0].set_title(_subtitle(demo))
        for ax, (_, panel) in zip(axes, rows, strict=True):
            panel(ax, demo)
            mark_events(ax, demo, numbers=ax is axes[0])
        axes[-1].set_xlabel("time (s)")
        figure.align_ylabels(axes)
        legend(figure, axes, event_legend(demo))
        return figure

    return drawn


def _subtitle(demo: DemoValues) -> str:
    return f"{plain_text(demo.name, 40)}, {plain_text(demo.tracking.recording.info.sensor, 24)}, {_tracked_by(demo)}"


def _tracked_by(demo: DemoValues) -> str:
    method = demo.tracking.method
    return "tracked as the paper does" if method == "paper" else f"tracked by the {method} method"


def _path(demo: DemoValues) -> Figure:
    figure = new_figure("Path in nav, with the sensor's axes (as the paper's figure 8)", *VIEW_SIZE)
    ax = figure.add_subplot(projection="3d", computed_zorder=False, title=_subtitle(demo))
    assert isinstance(ax, Axes3D)
    numbered = path_3d(ax, demo)
    legend(figure, [ax])
    label_keyframes_3d(ax, *numbered)
    return figure


def _view(title: str, axes: tuple[int, int]) -> Callable[[DemoValues], Figure]:
    def drawn(demo: DemoValues) -> Figure:
        figure = new_figure(title, *VIEW_SIZE)
        ax = figure.add_subplot(title=_subtitle(demo))
        numbered = path_view(ax, demo, axes)
        legend(figure, [ax])
        label_keyframes(ax, *numbered)
        return figure

    return drawn


def _sampling(demo: DemoValues) -> Figure:
    figure = new_figure("Sampling intervals, as recorded", TIME_WIDTH, 5.5)
    upper, lower = figure.subplots(2)
    upper.set(title=_subtitle(demo), xlabel="time (s)")
    panels.intervals(upper, demo)
    mark_events(upper, demo, numbers=True)
    panels.histogram(lower, demo)
    legend(figure, [upper], event_legend(demo))
    return figure


def _summary(demo: DemoValues) -> Figure:
    """One page: the path, the motion over time, and the findings in words."""
    with matplotlib.rc_context({"font.size": 8.5, "axes.labelsize": "small", "lines.linewidth": 0.9}):
        figure = new_figure(plain_text(demo.name, 60), 11.69, 8.27)  # A4
        upper, lower = cast(list[SubFigure], figure.subfigures(2, height_ratios=(3.1, 5.0)))
        left, right = cast(list[SubFigure], upper.subfigures(1, 2, width_ratios=(4.4, 7.2)))
        space = left.add_subplot(projection="3d", computed_zorder=False)
        assert isinstance(space, Axes3D)
        numbered = path_3d(space, demo)
        _words(right, demo)
        last = panels.specific_force if demo.field is None else panels.field_strength
        rows: tuple[tuple[Panel, Panel], ...] = (
            (panels.position, panels.attitude),
            (panels.velocity, panels.closure),
            (panels.resulting, panels.overall_sigma),
            (panels.intervals, last),
        )
        axes = lower.subplots(len(rows), 2, sharex=True)
        for k, row in enumerate(rows):
            for ax, panel in zip(axes[k], row, strict=True):
                panel(ax, demo)
                mark_events(ax, demo, numbers=k == 0)
                ax.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3))
        for ax in axes[-1]:
            ax.set_xlabel("time (s)")
        for column in axes.T:
            lower.align_ylabels(column)
        right.legend(handles=_summary_legend(demo), loc="lower left", ncols=7, columnspacing=1.2, labelspacing=0.35)
        label_keyframes_3d(space, *numbered)
        return figure


def _summary_legend(demo: DemoValues) -> list[Artist]:
    looks = zip(("x, roll", "y, pitch", "z, yaw"), AXES_RGB, AXES_DASHES, strict=True)
    handles: list[Artist] = [Line2D([], [], color=rgb, linestyle=dashes, label=name) for name, rgb, dashes in looks]
    handles.append(Line2D([], [], color=SIGMA_RGB, linewidth=1.6, label="σ, worst axis"))
    if demo.truth is not None:
        handles += [Line2D([], [], color=GREY, label="truth", **TRUTH_LOOK), Line2D([], [], color=INK, label="error")]
    colour, label = (GREY, "g, at rest") if demo.field is None else (VERMILION, "disturbed beyond")
    levels = [Line2D([], [], color=c, linestyle="--", label=what) for c, what in ((colour, label), (INK, "median"))]
    return [*handles, *levels, *event_legend(demo)]


def _words(figure: SubFigure, demo: DemoValues) -> None:
    """Write facts and findings beside the path."""
    facts = [("tracked", _tracked_by(demo).removeprefix("tracked ")), *demo.facts]
    for k, (name, value) in enumerate(facts):
        figure.text(0.0, 0.97 - 0.058 * k, name, va="top", color=GREY)
        figure.text(0.2, 0.97 - 0.058 * k, plain_text(value, 44), va="top", color=INK)
    look = {"bbox": FINDING_LOOK | {"linewidth": 1.0}} if demo.findings else {}
    figure.text(0.59, 0.97, "check" if demo.findings else "no problems found", va="top", color=INK, **look)
    line = 0.0
    for k, finding in enumerate(demo.findings):
        words = plain_text(finding.words, len(finding.words))
        wrapped = textwrap.wrap(words, FINDING_WIDTH, max_lines=FINDING_LINES, placeholder=" …")
        full = line + len(wrapped) > ALL_FINDINGS_LINES
        text = f"and {len(demo.findings) - k} more" if full else "\n".join(wrapped)
        figure.text(0.59, 0.9 - 0.048 * line, text, va="top", color=INK, linespacing=1.25)
        if full:
            break
        line += len(wrapped) + 0.4


FIGURES: Mapping[str, Callable[[DemoValues], Figure]] = {
    "summary": _summary,
    "resulting-acceleration": _over_time(
        "Resulting acceleration, equation 7 (as the paper's figure 5)", (3.2, panels.resulting)
    ),
    "variance": _over_time(
        "Variance of the resulting acceleration, equations 8 and 9 (as the paper's figure 6)", (3.2, panels.variance)
    ),
    "motion": _over_time("Motion and stops (as the paper's figure 7)", (2.6, panels.speed), (0.9, panels.moves)),
    "path": _path,
    "view-yx": _view("Path seen from above, yx (as the paper's figure 9)", YX),
    "view-yz": _view("Path seen along x, yz (as the paper's figure 10)", YZ),
    "position": _over_time("Position", (3.6, panels.position)),
    "attitude": _over_time("Attitude", (3.6, panels.attitude)),
    "gravity": _over_time(
        "Specific force, and motion acceleration without gravity",
        (2.3, panels.specific_force),
        (2.3, panels.motion_acceleration),
    ),
    "velocity": _over_time(
        "Velocity, and its residual at each stop (closure)", (2.7, panels.velocity), (1.7, panels.closure)
    ),
    "sigma": _over_time(
        "Sigma along the path",
        *((1.25, partial(panels.sigma, axis=axis)) for axis in range(3)),
        (1.25, panels.sigma_turn),
    ),
    "field": _over_time(
        "Magnetic field, against the first rest", (2.0, panels.field_strength), (2.0, panels.field_dip)
    ),
    "sampling": _sampling,
}
"""File name -> how the figure is drawn: the summary, the paper's figures in its order, then ours."""
