"""The plots of one demonstration: the paper's figures 5 to 10 for it, and ours."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pbd.view import plot_panels as panels
from pbd.view.plot_space import space
from pbd.view.plot_style import BOTTOM, LEFT, RIGHT, TOP, head, legend, mark, sheet, style, tracked_by
from pbd.view.plot_summary import summary
from pbd.view.plot_text import shortened
from pbd.view.plot_values import DemoPlot
from pbd.view.plot_views import YX, YZ, path_3d, path_view, truth_within


def draw(name: str, plot: DemoPlot) -> Figure:
    """Draw one of the figures that `names` lists."""
    with style():
        return FIGURES[name](plot)


def names(plot: DemoPlot) -> tuple[str, ...]:
    """The figures that there are of a demonstration: without a magnetometer none of the field."""
    return tuple(name for name in FIGURES if name != "field" or plot.field is not None)


def resulting_acceleration(plot: DemoPlot) -> Figure:
    """The paper's equation 7."""
    figure, (ax,) = _sheet(plot, "Resulting acceleration, equation 7 (as the paper's figure 5)", 3.2)
    panels.resulting(ax, plot)
    return _marked(figure, plot, ax)


def variance(plot: DemoPlot) -> Figure:
    """The paper's equations 8 and 9."""
    title = "Variance of the resulting acceleration, equations 8 and 9 (as the paper's figure 6)"
    figure, (ax,) = _sheet(plot, title, 3.2)
    panels.variance(ax, plot)
    return _marked(figure, plot, ax)


def motion(plot: DemoPlot) -> Figure:
    """When the hand moves and when it stands still."""
    figure, (upper, lower) = _sheet(plot, "Motion and stops (as the paper's figure 7)", 2.6, 0.9)
    panels.speed(upper, plot)
    panels.moves(lower, plot)
    return _marked(figure, plot, upper, lower)


def path(plot: DemoPlot) -> Figure:
    """The path in space."""
    figure = Figure(figsize=(8.6, 6.6))
    head(figure, "Path, with the sensor's axes at the keyframes (as the paper's figure 8)", _subtitle(plot))
    inside = plot.path.p_nav_sensor[plot.tracked]
    shown = [inside] if plot.truth is None else [inside, truth_within(plot)]
    ax, scale = space(figure, (0.015, 0.0, 0.825, 0.92), shown)
    path_3d(ax, plot, scale)
    figure.legend(handles=ax.get_legend_handles_labels()[0], loc="upper right", bbox_to_anchor=(0.98, 0.88))
    return figure


def view_yx(plot: DemoPlot) -> Figure:
    """The path from above."""
    return _view(plot, "Path seen from above, yx (as the paper's figure 9)", YX)


def view_yz(plot: DemoPlot) -> Figure:
    """The path along x."""
    return _view(plot, "Path seen along x, yz (as the paper's figure 10)", YZ)


def _view(plot: DemoPlot, title: str, axes: tuple[int, int]) -> Figure:
    width, height = 8.2, 6.2
    figure = Figure(figsize=(width, height))
    head(figure, title, _subtitle(plot))
    box = (LEFT / width, BOTTOM / height, (width - LEFT - RIGHT) / width, (height - TOP - BOTTOM) / height)
    ax = figure.add_axes(box)
    path_view(ax, plot, axes)
    legend(ax)
    return figure


def position(plot: DemoPlot) -> Figure:
    """Where the hand is."""
    figure, (ax,) = _sheet(plot, "Position", 3.6)
    panels.position(ax, plot)
    return _marked(figure, plot, ax)


def attitude(plot: DemoPlot) -> Figure:
    """Roll, pitch, yaw."""
    figure, (ax,) = _sheet(plot, "Attitude", 3.6)
    panels.attitude(ax, plot)
    return _marked(figure, plot, ax)


def gravity(plot: DemoPlot) -> Figure:
    """Specific force before, and acceleration after gravity has been taken out."""
    figure, (upper, lower) = _sheet(plot, "Specific force, and motion acceleration without gravity", 2.3, 2.3)
    panels.specific_force(upper, plot)
    panels.motion_acceleration(lower, plot)
    return _marked(figure, plot, upper, lower)


def velocity(plot: DemoPlot) -> Figure:
    """Velocity, and what of it was left over at each stop."""
    figure, (upper, lower) = _sheet(plot, "Velocity, and its residual at each stop (closure)", 2.7, 1.7)
    panels.velocity(upper, plot)
    panels.closure(lower, plot)
    return _marked(figure, plot, upper, lower)


def sigma(plot: DemoPlot) -> Figure:
    """How sure the tracker is along the path, and how right."""
    error = "" if plot.truth is None else ", and the error against the truth"
    figure, axes = _sheet(plot, f"Sigma along the path, interpolated between the stops{error}", 1.25, 1.25, 1.25, 1.25)
    scale, unit = panels.sigma_unit(plot)
    for axis, ax in enumerate(axes[:3]):
        panels.sigma(ax, plot, axis, scale, unit)
    bound = max(max(map(abs, ax.get_ylim())) for ax in axes[:3])
    for ax in axes[:3]:
        ax.set_ylim(-bound, bound)
    panels.sigma_turn(axes[3], plot)
    return _marked(figure, plot, *axes, silent=axes[1:3])  # what is in these is what is in the first


def field(plot: DemoPlot) -> Figure:
    """The magnetic field."""
    figure, (upper, lower) = _sheet(plot, "Magnetic field, against the first rest", 2.0, 2.0)
    panels.field_strength(upper, plot)
    panels.field_dip(lower, plot)
    return _marked(figure, plot, upper, lower)


def sampling(plot: DemoPlot) -> Figure:
    """When the samples came."""
    title = "Sampling intervals, as recorded"
    figure, (upper, lower) = sheet(title, _subtitle(plot), (2.2, 1.9), shared=False, between=0.75)
    panels.intervals(upper, plot)
    mark(upper, plot, numbers=True)
    upper.set_xlabel("time (s)")
    legend(upper, plot)
    panels.histogram(lower, plot)
    return figure


def _sheet(plot: DemoPlot, title: str, *heights: float) -> tuple[Figure, list[Axes]]:
    return sheet(title, _subtitle(plot), heights)


def _subtitle(plot: DemoPlot) -> str:
    return f"{shortened(plot.name, 40)}, {shortened(plot.sensor, 24)}, {tracked_by(plot.method)}"


def _marked(figure: Figure, plot: DemoPlot, *axes: Axes, silent: Sequence[Axes] = ()) -> Figure:
    """Mark rests, grip and keyframes, and say what lines are, but for `silent` axes."""
    for ax in axes:
        mark(ax, plot, numbers=ax is axes[0])
        if ax not in silent:
            legend(ax, plot if ax is axes[0] else None)
    axes[-1].set_xlabel("time (s)")
    return figure


FIGURES: Mapping[str, Callable[[DemoPlot], Figure]] = MappingProxyType(
    {
        "summary": summary,
        "resulting-acceleration": resulting_acceleration,
        "variance": variance,
        "motion": motion,
        "path": path,
        "view-yx": view_yx,
        "view-yz": view_yz,
        "position": position,
        "attitude": attitude,
        "gravity": gravity,
        "velocity": velocity,
        "sigma": sigma,
        "field": field,
        "sampling": sampling,
    }
)
"""By the name of its file."""
