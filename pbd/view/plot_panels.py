"""One thing over time, each: drawn into axes that the figures and the summary lay out."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from pbd.data import Stop
from pbd.pose import Array
from pbd.view.plot_style import AXES_RGB, BLUE, GREY, INK, PALE, SIGMA, SKY, VERMILION, largest, length_unit
from pbd.view.plot_values import DemoPlot

XYZ = ("x", "y", "z")
SMALLEST_VARIANCE = 1e-7
"""(m/s2)^2: less is no sensor's."""
MANY = 5000
"""More points than this become an image within a vector graphic, or are thinned out."""


def _lines(ax: Axes, t: Array, values: Array, names: tuple[str, ...] = XYZ) -> None:
    for column, colour, name in zip(values.T, AXES_RGB, names, strict=True):
        ax.plot(t, column, color=colour, label=name)


def _truth_lines(ax: Axes, t: Array, values: Array) -> None:
    for column, colour in zip(values.T, AXES_RGB, strict=True):
        ax.plot(t, column, color=colour, zorder=1.8, **PALE)
    ax.plot([], [], color=GREY, label="truth", **PALE)


def position(ax: Axes, plot: DemoPlot) -> None:
    """Where the hand is, beside the truth."""
    rows, path = plot.tracked, plot.path
    scale, unit = length_unit(largest(path.p_nav_sensor[rows]))
    if plot.truth is not None:
        _truth_lines(ax, plot.truth.t, scale * plot.truth.p_nav_sensor)
    _lines(ax, path.t[rows], scale * path.p_nav_sensor[rows])
    ax.set_ylabel(f"position ({unit})")


def velocity(ax: Axes, plot: DemoPlot) -> None:
    """Velocity, beside the truth's."""
    rows, path = plot.tracked, plot.path
    scale, unit = _speed_unit(plot)
    if plot.truth is not None:
        _truth_lines(ax, plot.truth.t, scale * plot.truth.v_nav_sensor)
    _lines(ax, path.t[rows], scale * path.v_nav_sensor[rows])
    ax.set_ylabel(f"velocity ({unit})")


def closure(ax: Axes, plot: DemoPlot) -> None:
    """The velocity that was left over when the hand stopped, at each stop."""
    path = plot.path
    scale, unit = _closure_unit(plot)
    at = path.t[[stop.start for stop in path.stops[1:]]]
    apart = 0.004 * float(path.t[-1] - path.t[0])
    if len(at):
        ax.axhline(0.0, color=GREY, linewidth=0.8)
    for axis, (values, colour) in enumerate(zip(path.closure.T, AXES_RGB, strict=True)):
        x = at + (axis - 1) * apart
        ax.vlines(x, 0.0, scale * values, color=colour, linewidth=1.5)
        ax.plot(x, scale * values, color=colour, marker="o", markersize=3.5, linestyle="", label=XYZ[axis])
    if not len(at):
        ax.text(0.5, 0.5, "one stop, so no move", transform=ax.transAxes, ha="center", va="center", color=GREY)
    ax.set_ylabel(f"closure ({unit})")


def _closure_unit(plot: DemoPlot) -> tuple[float, str]:
    scale, unit = length_unit(largest(plot.path.closure))
    return scale, f"{unit}/s"


def _speed_unit(plot: DemoPlot) -> tuple[float, str]:
    scale, unit = length_unit(largest(plot.path.v_nav_sensor[plot.tracked]))
    return scale, f"{unit}/s"


def speed(ax: Axes, plot: DemoPlot) -> None:
    """How fast the hand is."""
    rows, path = plot.tracked, plot.path
    scale, unit = _speed_unit(plot)
    if plot.truth is not None:
        ax.plot(
            plot.truth.t, scale * np.linalg.norm(plot.truth.v_nav_sensor, axis=1), color=GREY, label="truth", **PALE
        )
    ax.plot(path.t[rows], scale * np.linalg.norm(path.v_nav_sensor[rows], axis=1), color=INK, label="speed")
    ax.set_ylabel(f"speed ({unit})")


def moves(ax: Axes, plot: DemoPlot) -> None:
    """When the hand moves, by the method that tracked and by the paper's Algorithm 1."""
    lanes = [("paper", plot.paper_stops, SKY)]
    if plot.method != "paper":
        lanes.insert(0, (plot.method, plot.path.stops, BLUE))
    for lane, (_, stops, colour) in enumerate(lanes):
        bars = _between(stops, plot.path.t)
        ax.broken_barh(bars, (lane - 0.32, 0.64), facecolor=colour, linewidth=0.0, zorder=2.0)
        if not bars:
            ax.text(plot.path.t[0], lane, " none", ha="left", va="center", fontsize="small", color=GREY)
    ax.set_ylim(len(lanes) - 0.5, -0.5)
    ax.set_yticks(range(len(lanes)), [name for name, _, _ in lanes])
    ax.grid(visible=False, axis="y")
    ax.set_ylabel("moves, by")


def _between(stops: tuple[Stop, ...], t: Array) -> list[tuple[float, float]]:
    """Beginning and length, s, of what is no stop."""
    edges = [float(t[0]), *(float(t[row]) for stop in stops for row in (stop.start, stop.stop - 1)), float(t[-1])]
    return [(begin, end - begin) for begin, end in zip(edges[::2], edges[1::2], strict=True) if end > begin]


def attitude(ax: Axes, plot: DemoPlot) -> None:
    """Roll, pitch and yaw."""
    if plot.truth is not None:
        _truth_lines(ax, plot.truth.t, np.degrees(plot.truth.rpy_nav_sensor))
    _lines(ax, plot.path.t, np.degrees(plot.rpy_nav_sensor), ("roll", "pitch", "yaw"))
    ax.set_ylabel("attitude (°)")


def specific_force(ax: Axes, plot: DemoPlot) -> None:
    """What the accelerometer says, in sensor axes."""
    ax.axhline(plot.gravity, color=GREY, linewidth=0.8, linestyle="--", label="g, at rest")
    _lines(ax, plot.path.t, plot.acc_sensor)
    ax.set_ylabel("specific force\nin sensor (m/s²)")


def motion_acceleration(ax: Axes, plot: DemoPlot) -> None:
    """What is left of it without gravity, in nav."""
    _lines(ax, plot.path.t, plot.a_nav)
    ax.set_ylabel("acceleration\nin nav (m/s²)")


def resulting(ax: Axes, plot: DemoPlot) -> None:
    """The paper's equation 7."""
    ax.plot(plot.path.t, plot.resulting, color=INK, label="resulting\nacceleration")
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("acceleration (m/s²)")


def variance(ax: Axes, plot: DemoPlot) -> None:
    """The paper's equations 8 and 9, with its threshold."""
    ax.plot(
        plot.path.t,
        np.maximum(plot.variance, SMALLEST_VARIANCE),
        color=INK,
        linewidth=0.8,
        label="variance of\ntwo samples",
    )
    ax.axhline(
        plot.threshold, color=VERMILION, linewidth=1.2, linestyle="--", label=f"$\\lambda_v$ = {plot.threshold:g}"
    )
    ax.set_yscale("log")
    # Two samples may agree by chance to any digit: what the least twentieth does says nothing.
    low = max(float(np.percentile(plot.variance, 5.0)), SMALLEST_VARIANCE)
    ax.set_ylim(0.5 * low, 3.0 * max(largest(plot.variance), plot.threshold))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.set_ylabel("variance ((m/s²)²)")


def sigma(ax: Axes, plot: DemoPlot, axis: int, scale: float, unit: str) -> None:
    """Sigma of position along one axis, and the error where the truth is known."""
    t = plot.path.t[plot.tracked]
    rows = _thinned(plot)
    at, one = plot.path.t[rows], scale * plot.sigma_p[rows, axis]
    for factor, alpha in ((2.0, 0.12), (1.0, 0.22)):
        label = f"± {factor:g} σ"
        ax.fill_between(at, -factor * one, factor * one, color=AXES_RGB[axis], alpha=alpha, linewidth=0.0, label=label)
    if plot.truth is not None:
        ax.plot(t, scale * plot.truth.error[plot.tracked, axis], color=INK, label="error")
    ax.set_ylabel(f"{XYZ[axis]} ({unit})")


def _thinned(plot: DemoPlot) -> NDArray[np.intp]:
    """Rows at which sigma is filled: all, or, of many, those at the stops' edges and enough between (svg keeps all)."""
    first, last = plot.tracked.start, plot.tracked.stop - 1
    edges = [row for stop in plot.path.stops for row in (stop.start, stop.stop - 1)]
    between = np.linspace(first, last, min(last - first + 1, MANY)).astype(np.intp)
    return np.union1d(between, np.array(edges, dtype=np.intp))


def sigma_unit(plot: DemoPlot) -> tuple[float, str]:
    """One unit for all axes of sigma."""
    error = 0.0 if plot.truth is None else largest(plot.truth.error[plot.tracked])
    return length_unit(max(2.0 * largest(plot.sigma_p), error))


def sigma_turn(ax: Axes, plot: DemoPlot) -> None:
    """Sigma of the attitude: tilt (the larger of the two) and heading."""
    t, turn = plot.path.t[plot.tracked], np.degrees(plot.sigma_turn[plot.tracked])
    ax.plot(t, turn[:, :2].max(axis=1), color=SIGMA, label="tilt")
    ax.plot(t, turn[:, 2], color=BLUE, label="heading")
    ax.set_ylim(0.0, 1.25 * max(largest(turn), 0.1))
    ax.set_ylabel("attitude, σ (°)")


def overall_sigma(ax: Axes, plot: DemoPlot) -> None:
    """Sigma of position, the largest over the axes, beside the error's length."""
    scale, unit = sigma_unit(plot)
    t = plot.path.t[plot.tracked]
    ax.plot(t, scale * plot.sigma_p[plot.tracked].max(axis=1), color=SIGMA, linewidth=1.6, label="σ")
    if plot.truth is not None:
        ax.plot(t, scale * np.linalg.norm(plot.truth.error[plot.tracked], axis=1), color=INK, label="error")
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel(f"σ{', error' if plot.truth is not None else ''} ({unit})")


def field_strength(ax: Axes, plot: DemoPlot) -> None:
    """Strength of the magnetic field, and what the tracker takes for undisturbed."""
    field = plot.field
    assert field is not None
    _field(ax, plot.path.t, field.strength, field.rest_strength, field.strength_bound, field.block_s)
    ax.set_ylabel("strength (µT)")


def field_dip(ax: Axes, plot: DemoPlot) -> None:
    """How steeply the magnetic field points down."""
    field = plot.field
    assert field is not None
    rest, bound = np.degrees([field.rest_dip, field.dip_bound]).tolist()
    _field(ax, plot.path.t, np.degrees(field.dip), rest, bound, field.block_s)
    ax.set_ylabel("dip (°)")


def _field(ax: Axes, t: Array, values: Array, rest: float, bound: float, block_s: float) -> None:
    for edge in (rest - bound, rest + bound):
        ax.axhline(edge, color=VERMILION, linewidth=1.0, linestyle="--")
    ax.plot([], [], color=VERMILION, linewidth=1.0, linestyle="--", label="disturbed\nbeyond")
    ax.axhline(rest, color=GREY, linewidth=0.8, label="first rest")
    ax.plot(t, values, color=SKY, linewidth=0.6, label="each sample")
    blocks = np.arange(0, len(t), max(1, round(block_s / float(np.median(np.diff(t))))))
    size = np.diff(blocks, append=len(t))
    means = [np.add.reduceat(column, blocks) / size for column in (t, values)]
    ax.plot(*means, color=BLUE, linewidth=1.6, label=f"mean over\n{block_s:g} s")
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, rest - 1.2 * bound), max(high, rest + 1.2 * bound))


def intervals(ax: Axes, plot: DemoPlot) -> None:
    """How long after the one before it each sample came."""
    n = len(plot.interval_s)
    ax.plot(
        plot.interval_t, 1e3 * plot.interval_s, color=BLUE, marker=".", markersize=3.0, linestyle="",
        label="interval", rasterized=n > MANY,
    )  # fmt: skip
    ax.axhline(_median_ms(plot), color=VERMILION, linestyle="--", linewidth=1.0, label="median")
    ax.set_ylim(*_interval_range(plot))
    ax.set_ylabel("interval (ms)")


def histogram(ax: Axes, plot: DemoPlot) -> None:
    """How often each interval comes."""
    bins = np.linspace(*_interval_range(plot), 82)
    ax.hist(1e3 * plot.interval_s, bins=list(bins), color=BLUE, log=True)
    ax.axvline(_median_ms(plot), color=VERMILION, linestyle="--", linewidth=1.0)
    ax.set(xlabel="interval (ms)", ylabel="samples", xlim=_interval_range(plot))
    ax.set_ylim(0.7, 2.0 * len(plot.interval_s))
    ax.yaxis.set_minor_locator(NullLocator())


def _median_ms(plot: DemoPlot) -> float:
    return 1e3 * float(np.median(plot.interval_s))


def _interval_range(plot: DemoPlot) -> tuple[float, float]:
    """All of them, and a tenth of the median on either hand at least."""
    ms, median = 1e3 * plot.interval_s, _median_ms(plot)
    low, high = min(float(ms.min()), 0.9 * median), max(float(ms.max()), 1.1 * median)
    return low - 0.05 * (high - low), high + 0.05 * (high - low)
