"""Several demonstrations of one task over each other, and how far they spread at each keyframe."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from pbd.view.plot_labels import place_labels
from pbd.view.plot_panels import XYZ
from pbd.view.plot_space import corners, projected, space
from pbd.view.plot_style import (
    AXES_RGB,
    BOTTOM,
    GREY,
    INK,
    LEFT,
    RUNS_RGB,
    TOP,
    head,
    largest,
    length_unit,
    sheet,
    style,
)
from pbd.view.plot_text import say, shortened
from pbd.view.plot_values import ComparePlot
from pbd.view.plot_views import YX, YZ, ellipse, view

DASHES = ("-", "--", ":", "-.")
"""After the last colour the first one comes again, dashed."""
NAMED = 16
"""So many demonstrations are named in a legend."""
NAME_LENGTH = 18
"""Characters of a name in a legend."""


def draw_comparison(name: str, plot: ComparePlot) -> Figure:
    """Draw one of COMPARISONS."""
    with style():
        return COMPARISONS[name](plot)


def paths(plot: ComparePlot) -> Figure:
    """All paths in space, the mean keyframes numbered."""
    figure = Figure(figsize=(8.6, 6.6))
    head(figure, "Paths, laid on each other at the first stop", _subtitle(plot))
    shown = [run.p for run in plot.runs]
    ax, scale = space(figure, (0.015, 0.0, 0.785, 0.92), shown)
    for run, look in zip(plot.runs, _looks(plot), strict=True):
        ax.plot(*(scale * run.p).T, **look)
    for number in range(len(plot.runs)):
        ax.plot(*(scale * plot.positions(number)).T, **_dots(number), zorder=5.0)
    means = scale * np.array([keyframe.p for keyframe in plot.keyframes])
    place_labels(ax, *(projected(ax, xyz) for xyz in (means, scale * np.vstack(shown), corners(ax))))
    _legend(figure, plot, 6.95)
    return figure


def views(plot: ComparePlot) -> Figure:
    """From above and along x, with what the keyframes spread."""
    width, height, side, between = 13.0, 6.0, 4.5, 0.8
    figure = Figure(figsize=(width, height))
    head(figure, "Paths from above (yx) and along x (yz)", _subtitle(plot))
    shown = [run.p for run in plot.runs]
    scale, unit = length_unit(max(map(largest, shown)))
    for k, axes in enumerate((YX, YZ)):
        left = LEFT + k * (side + between)
        ax = figure.add_axes((left / width, BOTTOM / height, side / width, (height - BOTTOM - TOP) / height))
        view(ax, shown, axes, scale, unit)
        columns = list(axes)
        for run, look in zip(plot.runs, _looks(plot), strict=True):
            ax.plot(*(scale * run.p[:, columns]).T, **look)
        for number in range(len(plot.runs)):
            ax.plot(*(scale * plot.positions(number)[:, columns]).T, **_dots(number), zorder=5.0)
        covered = [scale * run.p[:, columns] for run in plot.runs]
        for keyframe in plot.keyframes:
            if keyframe.count > 1:
                there = np.array([pose.p[columns] for pose in keyframe.poses if pose is not None])
                outline = ellipse(scale * keyframe.p[columns], scale**2 * np.cov(there.T), 2.0)
                ax.plot(*outline.T, color=INK, linewidth=0.8, zorder=6.0)
                covered.append(outline)
        means = scale * np.array([keyframe.p[columns] for keyframe in plot.keyframes])
        place_labels(ax, means, np.vstack(covered))
    more: list[Artist] = [Line2D([], [], color=INK, linewidth=0.8, label="2 standard deviations")]
    _legend(figure, plot, LEFT + 2.0 * side + between + 0.2, more)
    return figure


def positions(plot: ComparePlot) -> Figure:
    """x, y and z from keyframe to keyframe."""
    figure, axes = sheet("Position from keyframe to keyframe", _subtitle(plot), (1.7, 1.7, 1.7))
    scale, unit = length_unit(max(largest(run.p) for run in plot.runs))
    for axis, ax in enumerate(axes):
        for run, look in zip(plot.runs, _looks(plot), strict=True):
            ax.plot(run.progress, scale * run.p[:, axis], **look)
        for number in range(len(plot.runs)):
            ax.plot(range(len(plot.keyframes)), scale * plot.positions(number)[:, axis], **_dots(number))
        ax.set_ylabel(f"{XYZ[axis]} ({unit})")
    _keyframe_axis(axes[-1], plot)
    _legend(figure, plot, 8.4)
    return figure


def spread(plot: ComparePlot) -> Figure:
    """How far the keyframes spread, beside what the trackers' sigmas make expect."""
    figure, (upper, lower) = sheet("Spread at each keyframe, between the demonstrations", _subtitle(plot), (2.4, 1.6))
    k = np.arange(len(plot.keyframes))
    spreads = np.array([keyframe.spread for keyframe in plot.keyframes])
    sigmas = np.array([keyframe.sigma for keyframe in plot.keyframes]).max(axis=1)
    scale, unit = length_unit(max(largest(spreads), largest(sigmas)))
    for axis in range(3):
        x, height = k + 0.24 * (axis - 1), scale * spreads[:, axis]
        upper.bar(x, np.nan_to_num(height), width=0.22, color=AXES_RGB[axis], label=XYZ[axis])
    upper.plot(k, scale * sigmas, color=INK, marker="_", markersize=16.0, linestyle="", label="the trackers'\nown σ")
    upper.set_ylabel(f"standard deviation ({unit})")
    turns = np.degrees([keyframe.turn for keyframe in plot.keyframes])
    lower.bar(k, np.nan_to_num(turns), width=0.4, color=GREY)
    lower.set_ylabel("of the attitude (°)")
    for ax in (upper, lower):
        ax.set_ylim(bottom=0.0)
    upper.legend(loc="upper left", bbox_to_anchor=(1.015, 1.0))
    _keyframe_axis(lower, plot)
    return figure


def _keyframe_axis(ax: Axes, plot: ComparePlot) -> None:
    ax.set_xlim(-0.6, len(plot.keyframes) - 0.4)
    ax.xaxis.set_major_locator(MaxNLocator(15, integer=True))
    ax.set_xlabel("keyframe")


def _subtitle(plot: ComparePlot) -> str:
    how = "matched by order" if plot.by_order else "matched by place, in order"
    return f"{len(plot.runs)} demonstrations, {len(plot.keyframes)} keyframes {how}"


def _looks(plot: ComparePlot) -> list[dict[str, Any]]:
    """Colour and dashes of each demonstration's line."""
    count = len(RUNS_RGB)
    return [
        {"color": RUNS_RGB[k % count], "linestyle": DASHES[k // count % len(DASHES)]} for k in range(len(plot.runs))
    ]


def _dots(run: int) -> dict[str, Any]:
    return {"color": RUNS_RGB[run % len(RUNS_RGB)], "marker": "o", "markersize": 3.5, "linestyle": ""}


def _legend(figure: Figure, plot: ComparePlot, left: float, more: list[Artist] | None = None) -> None:
    """Name the demonstrations, `left` inches from the edge."""
    width, height = figure.get_size_inches()
    looks = _looks(plot)[:NAMED]
    handles: list[Artist] = [Line2D([], [], **look) for look in looks]
    names = [shortened(run.name, NAME_LENGTH) for run in plot.runs[:NAMED]]
    if len(plot.runs) > NAMED:
        handles.append(Line2D([], [], linestyle=""))
        names.append(f"and {len(plot.runs) - NAMED} more")
    for handle in more or ():
        handles.append(handle)
        names.append(str(handle.get_label()))
    corner = (left / width, 1.0 - 0.85 / height)
    box = figure.legend(handles=handles, labels=[" "] * len(names), loc="upper left", bbox_to_anchor=corner)
    for text, name in zip(box.get_texts(), names, strict=True):
        say(text, name)


COMPARISONS: Mapping[str, Callable[[ComparePlot], Figure]] = MappingProxyType(
    {"paths": paths, "views": views, "positions": positions, "spread": spread}
)
"""By the name of its file."""
