"""Panels: each draws one quantity over time into axes of a figure or of the summary."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator

from pbd.data import Stop
from pbd.plots.demo_values import DemoValues
from pbd.plots.style import (
    AXES_DASHES,
    AXES_RGB,
    BLUE,
    GREY,
    INK,
    SIGMA_RGB,
    SKY,
    TRUTH_LOOK,
    VERMILION,
    largest,
    length_unit,
)
from pbd.pose import Array
from pbd.tracking.paper import LAMBDA_V, paper_stops, resulting_variance
from pbd.tracking.residual_tests import FIELD_CHANGE
from pbd.tracking.smoother.knots import STOP_KNOT_S

XYZ = ("x", "y", "z")
MAX_VECTOR_POINTS = 5000
"""Largest number of points that are drawn as vector graphics. More are rasterized or thinned out."""


def _lines(ax: Axes, t: Array, values: Array, names: tuple[str, ...] = XYZ) -> None:
    for column, colour, dashes, name in zip(values.T, AXES_RGB, AXES_DASHES, names, strict=True):
        ax.plot(t, column, color=colour, linestyle=dashes, label=name)


def _truth_lines(ax: Axes, t: Array, values: Array) -> None:
    for column, colour in zip(values.T, AXES_RGB, strict=True):
        ax.plot(t, column, color=colour, zorder=1.8, **TRUTH_LOOK)
    ax.plot([], [], color=GREY, label="truth", **TRUTH_LOOK)


def position(ax: Axes, demo: DemoValues) -> None:
    """Position of the hand, and the true one."""
    ax.set_ylabel(f"position\nin nav ({_beside_truth(ax, demo, 'p_nav_sensor')})")


def velocity(ax: Axes, demo: DemoValues) -> None:
    """Velocity of the hand, and the true one."""
    ax.set_ylabel(f"velocity\nin nav ({_beside_truth(ax, demo, 'v_nav_sensor')}/s)")


def _beside_truth(ax: Axes, demo: DemoValues, name: str) -> str:
    """Draw an attribute of the path, from the first to the last stop, and of the truth; return the unit of length."""
    values = getattr(demo.path, name)[demo.path.demonstrated]
    scale, unit = length_unit(values)
    if demo.truth is not None:
        _truth_lines(ax, demo.truth.t, scale * getattr(demo.truth, name))
    _lines(ax, demo.path.t[demo.path.demonstrated], scale * values)
    return unit


def closure(ax: Axes, demo: DemoValues) -> None:
    """The residual velocity at the end of each move, before it is corrected."""
    path = demo.path
    scale, unit = length_unit(path.closure)
    ax.set_ylabel(f"closure\nin nav ({unit}/s)")
    if len(path.stops) < 2:
        ax.text(0.5, 0.5, "one stop, so no move", transform=ax.transAxes, ha="center", va="center", color=GREY)
        return
    at = path.t[[stop.start for stop in path.stops[1:]]]
    apart = 0.004 * float(path.t[-1] - path.t[0])
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    for axis, (values, colour) in enumerate(zip(path.closure.T, AXES_RGB, strict=True)):
        x = at + (axis - 1) * apart
        ax.vlines(x, 0.0, scale * values, color=colour, linewidth=1.5)
        ax.plot(x, scale * values, color=colour, marker="o", markersize=3.5, linestyle="", label=XYZ[axis])


def speed(ax: Axes, demo: DemoValues) -> None:
    """Speed of the hand, and the true one."""
    rows, path = demo.path.demonstrated, demo.path
    scale, unit = length_unit(path.v_nav_sensor[rows])
    if demo.truth is not None:
        true = np.linalg.norm(demo.truth.v_nav_sensor, axis=1)
        ax.plot(demo.truth.t, scale * true, color=GREY, label="truth", **TRUTH_LOOK)
    ax.plot(path.t[rows], scale * np.linalg.norm(path.v_nav_sensor[rows], axis=1), color=INK, label="speed")
    ax.set_ylabel(f"speed ({unit}/s)")


def moves(ax: Axes, demo: DemoValues) -> None:
    """Moves found by the method that tracked the hand, and by the paper's Algorithm 1."""
    method = demo.tracking.method
    by_paper = demo.path.stops if method == "paper" else paper_stops(demo.tracking.recording.t, demo.tracking.a_nav)
    rows = {method: (demo.path.stops, BLUE), "paper": (by_paper, SKY)}
    for row, (stops, colour) in enumerate(rows.values()):
        bars = _between(stops, demo.path.t)
        ax.broken_barh(bars, (row - 0.32, 0.64), facecolor=colour, linewidth=0.0, zorder=2.0)
        if not bars:
            ax.text(demo.path.t[0], row, " none", ha="left", va="center", fontsize="small", color=GREY)
    ax.set_ylim(len(rows) - 0.5, -0.5)
    ax.set_yticks(range(len(rows)), list(rows))
    ax.grid(visible=False, axis="y")
    ax.set_ylabel("moves, by")


def _between(stops: tuple[Stop, ...], t: Array) -> list[tuple[float, float]]:
    """Start and duration, s, of the moves between stops."""
    edges = [float(t[0]), *(float(t[row]) for stop in stops for row in (stop.start, stop.stop - 1)), float(t[-1])]
    return [(begin, end - begin) for begin, end in zip(edges[::2], edges[1::2], strict=True) if end > begin]


def attitude(ax: Axes, demo: DemoValues) -> None:
    """Roll, pitch and yaw, and the true ones."""
    if demo.truth is not None:
        _truth_lines(ax, demo.truth.t, np.degrees(demo.truth.rpy_nav_sensor))
    _lines(ax, demo.path.t, np.degrees(demo.rpy_nav_sensor), ("roll", "pitch", "yaw"))
    ax.set_ylabel("attitude (°)")


def specific_force(ax: Axes, demo: DemoValues) -> None:
    """Specific force in sensor axes."""
    ax.axhline(demo.tracking.gravity, color=GREY, linewidth=0.8, linestyle="--", label="g, at rest")
    _lines(ax, demo.path.t, demo.tracking.recording.acc)
    ax.set_ylabel("specific force\nin sensor (m/s²)")


def motion_acceleration(ax: Axes, demo: DemoValues) -> None:
    """Specific force without gravity, in nav."""
    _lines(ax, demo.path.t, demo.tracking.a_nav)
    ax.set_ylabel("acceleration\nin nav (m/s²)")


def resulting(ax: Axes, demo: DemoValues) -> None:
    """Resulting acceleration (the paper's equation 7)."""
    ax.plot(demo.path.t, demo.resulting, color=INK, label="resulting\nacceleration")
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("acceleration (m/s²)")


def variance(ax: Axes, demo: DemoValues) -> None:
    """Variance of the resulting acceleration (the paper's equations 8 and 9), and the paper's threshold."""
    values = np.maximum(resulting_variance(demo.tracking.a_nav), 1e-7)  # smaller than any sensor's
    ax.plot(demo.path.t, values, color=INK, linewidth=0.8, label="variance of\ntwo samples")
    ax.axhline(LAMBDA_V, color=VERMILION, linewidth=1.2, linestyle="--", label=f"λᵥ = {LAMBDA_V:g}")
    ax.set_yscale("log")
    # Two samples may be equal by chance: the lowest 5 % do not set the scale.
    ax.set_ylim(0.5 * np.percentile(values, 5.0), 3.0 * max(largest(values), LAMBDA_V))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.set_ylabel("variance ((m/s²)²)")


def sigma(ax: Axes, demo: DemoValues, axis: int) -> None:
    """Sigma of the position along one axis, and the error where the truth is known. All axes have the same scale."""
    scale, unit, limit = _sigma_unit(demo)
    begin, end = demo.path.demonstrated.start, demo.path.demonstrated.stop
    # Vector graphics keep every point of a filled area.
    rows = slice(begin, end, -(-(end - begin) // MAX_VECTOR_POINTS))
    one = scale * demo.sigma[rows, axis]
    for factor, alpha in ((2.0, 0.12), (1.0, 0.22)):
        area = ax.fill_between(demo.path.t[rows], -factor * one, factor * one, label=f"± {factor:g} σ")
        area.set(color=AXES_RGB[axis], alpha=alpha, linewidth=0.0)
    if demo.truth is not None:
        error = scale * demo.truth.error[demo.path.demonstrated, axis]
        ax.plot(demo.path.t[demo.path.demonstrated], error, color=INK, label="error")
    ax.set_ylim(-1.1 * scale * limit, 1.1 * scale * limit)
    ax.set_ylabel(f"{XYZ[axis]} in nav ({unit})")


def _sigma_unit(demo: DemoValues) -> tuple[float, str, float]:
    """Scale and unit for sigma along all axes, and the largest value shown, m."""
    shown = [2.0 * demo.sigma[:, :3]] + ([] if demo.truth is None else [demo.truth.error[demo.path.demonstrated]])
    return *length_unit(*shown), max(largest(*shown), 1e-4)


def sigma_turn(ax: Axes, demo: DemoValues) -> None:
    """Sigma of the attitude: tilt (about the worse horizontal axis) and heading."""
    t, turn = demo.path.t[demo.path.demonstrated], np.degrees(demo.sigma[demo.path.demonstrated, 3:])
    ax.plot(t, turn[:, :2].max(axis=1), color=SIGMA_RGB, label="tilt")
    ax.plot(t, turn[:, 2], color=BLUE, label="heading")
    ax.set_ylim(0.0, 1.25 * max(largest(turn), 0.1))
    ax.set_ylabel("attitude, σ (°)")


def overall_sigma(ax: Axes, demo: DemoValues) -> None:
    """Sigma of the position, the largest over the axes, and the norm of the error."""
    scale, unit, _ = _sigma_unit(demo)
    t = demo.path.t[demo.path.demonstrated]
    ax.plot(t, scale * demo.sigma[demo.path.demonstrated, :3].max(axis=1), color=SIGMA_RGB, linewidth=1.6, label="σ")
    if demo.truth is not None:
        ax.plot(t, scale * np.linalg.norm(demo.truth.error[demo.path.demonstrated], axis=1), color=INK, label="error")
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel(f"σ{', error' if demo.truth is not None else ''} ({unit})")


def field_strength(ax: Axes, demo: DemoValues) -> None:
    """Strength of the magnetic field, and the range in which the tracker uses it."""
    assert demo.field is not None
    rest = demo.field.rest_strength
    _field(ax, demo.path.t, demo.field.strength, rest, FIELD_CHANGE * rest, "strength (µT)")


def field_dip(ax: Axes, demo: DemoValues) -> None:
    """Dip of the magnetic field, and the range in which the tracker uses it."""
    assert demo.field is not None
    rest, bound = np.degrees([demo.field.rest_dip, FIELD_CHANGE]).tolist()
    _field(ax, demo.path.t, np.degrees(demo.field.dip), rest, bound, "dip (°)")


def _field(ax: Axes, t: Array, values: Array, rest: float, bound: float, label: str) -> None:
    block_s = 2.0 * STOP_KNOT_S  # the tracker averages the field over this time
    for edge in (rest - bound, rest + bound):
        ax.axhline(edge, color=VERMILION, linewidth=1.0, linestyle="--", label="disturbed\nbeyond")
    ax.axhline(rest, color=GREY, linewidth=0.8, label="first rest")
    ax.plot(t, values, color=SKY, linewidth=0.6, label="each sample")
    blocks = np.arange(0, len(t), max(1, round(block_s / float(np.median(np.diff(t))))))
    size = np.diff(blocks, append=len(t))
    means = [np.add.reduceat(column, blocks) / size for column in (t, values)]
    ax.plot(*means, color=BLUE, linewidth=1.6, label=f"mean over\n{block_s:g} s")
    low, high = ax.get_ylim()
    ax.set(ylim=(min(low, rest - 1.2 * bound), max(high, rest + 1.2 * bound)), ylabel=label)


def intervals(ax: Axes, demo: DemoValues) -> None:
    """Interval between each sample and the previous one."""
    ms, median = _intervals_ms(demo)
    (dots,) = ax.plot(demo.tracking.demo.recording.t[1:], ms, ".", color=BLUE, markersize=3.0, label="interval")
    dots.set_rasterized(len(ms) > MAX_VECTOR_POINTS)
    ax.axhline(median, color=INK, linestyle="--", linewidth=1.0, label="median")
    ax.set_ylim(*_limits(ms, median))
    ax.set_ylabel("interval (ms)")


def histogram(ax: Axes, demo: DemoValues) -> None:
    """Histogram of the intervals."""
    ms, median = _intervals_ms(demo)
    low, high = _limits(ms, median)
    ax.hist(ms, bins=np.linspace(low, high, 82).tolist(), color=BLUE, log=True)
    ax.axvline(median, color=INK, linestyle="--", linewidth=1.0)
    ax.set(xlabel="interval (ms)", ylabel="samples", xlim=(low, high), ylim=(0.7, 2.0 * len(ms)))
    ax.yaxis.set_minor_locator(NullLocator())


def _intervals_ms(demo: DemoValues) -> tuple[Array, float]:
    """All recorded intervals, and their median, ms."""
    ms = 1e3 * np.diff(demo.tracking.demo.recording.t)
    return ms, float(np.median(ms))


def _limits(ms: Array, median: float) -> tuple[float, float]:
    """Limits of an axis, ms, that shows all intervals and at least 10 % on both sides of the median."""
    low, high = min(float(ms.min()), 0.9 * median), max(float(ms.max()), 1.1 * median)
    return low - 0.05 * (high - low), high + 0.05 * (high - low)
