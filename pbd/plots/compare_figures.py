"""Figures of several demonstrations of one task: compared, with their spread at each keyframe, or fused."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.axes3d import Axes3D

from pbd.data import Fusion
from pbd.data.one_line_repr import counted
from pbd.plots.compare import Comparison
from pbd.plots.panels import XYZ
from pbd.plots.space import YX, YZ, ellipse, fit_3d, fit_view, label_keyframes, label_keyframes_3d
from pbd.plots.style import AXES_RGB, DEMOS_RGB, GREY, INK, legend, length_unit, new_figure, plain_text
from pbd.pose import Array

DASHES: tuple[Any, ...] = ("-", "--", ":", "-.", (0.0, (8.0, 1.5)))
DOTS = "os^Dv"
"""Line styles and markers, one fewer than colours: 30 demonstrations look different, and a few do in grey too."""
MAX_NAMED, LONGEST_NAME = 16, 18
"""Largest number of demonstrations in a legend, and of characters in a name."""


def _paths(comparison: Comparison) -> Figure:
    """All paths in 3-D, with numbers at the mean keyframes."""
    figure = new_figure("Paths in nav, aligned at the first stop", 8.6, 6.6)
    ax = figure.add_subplot(projection="3d", computed_zorder=False, title=_subtitle(comparison))
    assert isinstance(ax, Axes3D)
    shown = [demo.p for demo in comparison.demos]
    scale = fit_3d(ax, [*shown, *map(comparison.positions, range(len(shown)))])
    for k, demo in enumerate(comparison.demos):
        ax.plot(*(scale * demo.p).T, **_line(k))
        ax.plot(*(scale * comparison.positions(k)).T, **_dots(k))
    legend(figure, [], _legend_entries(comparison))
    means = np.array([keyframe.p for keyframe in comparison.keyframes])
    label_keyframes_3d(ax, scale * means, [scale * path for path in shown])
    return figure


def _views(comparison: Comparison) -> Figure:
    """All paths from above and along x, with ellipses of the keyframes' spread."""
    figure = new_figure("Paths from above (yx) and along x (yz)", 13.0, 6.0)
    both = figure.subplots(1, 2)
    both[0].set_title(_subtitle(comparison))
    shown = [demo.p for demo in comparison.demos]
    shown += map(comparison.positions, range(len(shown)))
    numbered = []
    for ax, axes in zip(both, (YX, YZ), strict=True):
        scale, columns = fit_view(ax, shown, axes, 1.0), list(axes)
        covered = [scale * demo.p[:, columns] for demo in comparison.demos]
        for k, path in enumerate(covered):
            ax.plot(*path.T, **_line(k))
            ax.plot(*(scale * comparison.positions(k)[:, columns]).T, **_dots(k))
        for keyframe in comparison.keyframes:
            if keyframe.count > 1:
                points = np.array([pose.p[columns] for pose in keyframe.poses if pose is not None])
                covered.append(ellipse(scale * keyframe.p[columns], scale**2 * np.cov(points.T)))
                ax.plot(*covered[-1].T, color=INK, linewidth=0.8, zorder=6.0)
        numbered.append((ax, scale * np.array([keyframe.p[columns] for keyframe in comparison.keyframes]), covered))
    more: Artist = Line2D([], [], color=INK, linewidth=0.8, label="2 standard\ndeviations")
    legend(figure, [], [*_legend_entries(comparison), more])
    for ax, at, covered in numbered:
        label_keyframes(ax, at, covered)
    return figure


def _positions(comparison: Comparison) -> Figure:
    """x, y and z over the progress from keyframe to keyframe."""
    figure = new_figure("Position from keyframe to keyframe", 10.0, 6.6)
    axes = figure.subplots(3, sharex=True)
    axes[0].set_title(_subtitle(comparison))
    scale, unit = length_unit(*(demo.p for demo in comparison.demos))
    for axis, ax in enumerate(axes):
        for k, demo in enumerate(comparison.demos):
            ax.plot(demo.progress, scale * demo.p[:, axis], **_line(k))
            ax.plot(range(len(comparison.keyframes)), scale * comparison.positions(k)[:, axis], **_dots(k))
        ax.set_ylabel(f"{XYZ[axis]} in nav ({unit})")
    _keyframe_axis(axes[-1], len(comparison.keyframes))
    figure.align_ylabels(axes)
    legend(figure, [], _legend_entries(comparison))
    return figure


def _spread(comparison: Comparison) -> Figure:
    """Spread of the keyframes, and the trackers' own sigmas."""
    spreads = np.array([keyframe.spread for keyframe in comparison.keyframes])
    turns = np.array([keyframe.turn for keyframe in comparison.keyframes])
    sigmas = np.array([keyframe.sigma for keyframe in comparison.keyframes]).max(axis=1)
    title = "Spread at each keyframe, between the demonstrations"
    return _standard_deviations(title, _subtitle(comparison), spreads, turns, sigmas=sigmas)


def _standard_deviations(
    title: str, subtitle: str, spreads: Array, turns: Array, log_sigma: Array | None = None, sigmas: Array | None = None
) -> Figure:
    """Draw bars at each keyframe: standard deviations of position (k, 3) m and of attitude (k,) rad.

    Args:
        log_sigma: (k, 4) one sigma of each bar's logarithm, drawn as an error bar.
        sigmas: (k,) m, the trackers' own sigmas, drawn across the bars of position.
    """
    figure = new_figure(title, 10.0, 5.4)
    upper, lower = figure.subplots(2, sharex=True, height_ratios=(3, 2))
    upper.set_title(subtitle)
    k = np.arange(len(spreads))
    scale, unit = length_unit(spreads, *([] if sigmas is None else [sigmas]))
    for i, height in enumerate(np.nan_to_num(np.column_stack((scale * spreads, np.degrees(turns)))).round(6).T):
        look: dict[str, Any] = {"color": [*AXES_RGB, GREY][i], "label": [*XYZ, ""][i], "ecolor": INK, "capsize": 2.0}
        if log_sigma is not None:
            look["yerr"] = height * np.abs(np.expm1(np.outer((-1.0, 1.0), log_sigma[:, i])))
        ax, at, width = (lower, k, 0.4) if i == 3 else (upper, k + 0.24 * (i - 1), 0.22)
        ax.bar(at, height, width, **look)
    if sigmas is not None:
        look = {"color": INK, "marker": "_", "markersize": 16.0, "linestyle": ""}
        upper.plot(k, scale * sigmas, **look, label="the trackers'\nown σ")
    upper.set(ylabel=f"standard deviation ({unit})", ylim=(0.0, None))
    lower.set(ylabel="of the attitude (°)", ylim=(0.0, None))
    _keyframe_axis(lower, len(k))
    figure.align_ylabels([upper, lower])
    legend(figure, [upper])
    return figure


def _keyframe_axis(ax: Axes, count: int) -> None:
    ax.set_xlim(-0.6, count - 0.4)
    ax.xaxis.set_major_locator(MaxNLocator(15, integer=True))
    ax.set_xlabel("keyframe")


def _subtitle(comparison: Comparison) -> str:
    how = "matched by order" if comparison.by_order else "matched by their moves and the grip"
    return f"{len(comparison.demos)} demonstrations, {counted(len(comparison.keyframes), 'keyframe')} {how}"


def _line(demo: int) -> dict[str, Any]:
    return {"color": DEMOS_RGB[demo % len(DEMOS_RGB)], "linestyle": DASHES[demo % len(DASHES)]}


def _dots(demo: int) -> dict[str, Any]:
    look = {"color": DEMOS_RGB[demo % len(DEMOS_RGB)], "marker": "o", "markersize": 3.5}
    return look | {"linestyle": "", "zorder": 5.0}


def _legend_entries(comparison: Comparison) -> list[Artist]:
    named: list[Artist] = [
        Line2D([], [], **_line(k), label=plain_text(demo.name, LONGEST_NAME))
        for k, demo in enumerate(comparison.demos[:MAX_NAMED])
    ]
    if len(comparison.demos) > MAX_NAMED:
        named.append(Line2D([], [], linestyle="", label=f"and {len(comparison.demos) - MAX_NAMED} more"))
    return named


COMPARISONS: Mapping[str, Callable[[Comparison], Figure]] = {
    "paths": _paths,
    "views": _views,
    "positions": _positions,
    "spread": _spread,
}
"""File name -> how the figure is drawn, within `style`."""


def _match(fusion: Fusion) -> Figure:
    """Each take's keyframes minus the fused ones, along each axis. A cross is an outlier, which the fusion ignores."""
    figure = new_figure("Keyframes of each take, minus the task's", 10.0, 6.6)
    axes = figure.subplots(3, sharex=True, sharey=True)
    axes[0].set_title(_used_takes(fusion))
    k = np.arange(len(fusion.scatter))
    for axis, ax in enumerate(axes):
        ax.fill_between(k, *(sign * 1e3 * fusion.tolerance_m[:, axis] for sign in (-1, 1)), color=GREY, alpha=0.15)
        for i, take in enumerate(fusion.takes):
            if take.left_out:
                continue
            look = {"color": DEMOS_RGB[i % len(DEMOS_RGB)], "linestyle": "", "markersize": 4.5}
            dot = DOTS[i % len(DOTS)]
            shift = 0.5 * (i + 0.5) / len(fusion.takes) - 0.25
            label = plain_text(take.name, LONGEST_NAME) if i < MAX_NAMED else None
            out = np.isin(k, take.outliers)
            ax.plot(k[~out] + shift, 1e3 * take.off[~out, axis], marker=dot, label=label, **look)
            ax.plot(k[out] + shift, 1e3 * take.off[out, axis], marker="x", **look)
        ax.set_ylabel(f"{XYZ[axis]} (mm)")
    _keyframe_axis(axes[-1], len(k))
    axes[-1].set_xlabel("keyframe (grey: the tolerance that is learned; a cross: an outlier, left out)")
    figure.align_ylabels(axes)
    legend(figure, [axes[0]])
    return figure


def _scatter(fusion: Fusion) -> Figure:
    """The hand's scatter at each keyframe, and the sigma of that estimate."""
    title = "How the hand scatters from take to take, without the tracker's uncertainty"
    return _standard_deviations(title, _used_takes(fusion), fusion.scatter, fusion.turn, fusion.log_sigma)


def _used_takes(fusion: Fusion) -> str:
    used = sum(not take.left_out for take in fusion.takes)
    return f"{used} of {len(fusion.takes)} takes, {counted(len(fusion.scatter), 'keyframe')}"


FUSION_FIGURES: Mapping[str, Callable[[Fusion], Figure]] = {"match": _match, "scatter": _scatter}
"""File name -> how the figure is drawn, within `style`."""
