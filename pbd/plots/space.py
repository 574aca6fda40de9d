"""Paths in 3-D, and seen along an axis. All axes of a picture have the same scale."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.axes3d import Axes3D

from pbd.plots.demo_values import DemoValues
from pbd.plots.findings import ranges
from pbd.plots.style import AXES_RGB, GREY, INK, KNOWN_LOOK, SIGMA_RGB, SKY, TRUTH_LOOK, lay_out, length_unit
from pbd.pose import Array, quat_to_matrix

YX, YZ = (1, 0), (1, 2)
"""Horizontal and vertical axis of a view, as indices of nav's axes. y grows to the left: YX is seen from above, YZ from
behind the sensor, along x."""

SMALLEST_BOX_M = 0.01
"""Smallest side, m, of the box into which a path is drawn."""
MAX_NUMBERED = 100
"""Largest number of keyframes that get a number, triad and ellipse. Of more, every second (third, ...) gets them."""


def fit_3d(ax: Axes3D, shown: Sequence[Array], around: Array | None = None) -> float:
    """Set 3-D axes to one scale that fits paths (m, 3) in m; return how many of their units make a metre.

    The paths are in the middle; points `around` them (k, 3), m, are inside too.
    """
    points = np.vstack(shown)
    scale, unit = length_unit(points)
    middle, extent = _middle_and_extent(scale * points, scale * SMALLEST_BOX_M)
    if around is not None:
        extent = np.maximum(extent, 2.0 * np.abs(scale * around - middle).max(axis=0))
    sides = 1.12 * np.maximum(extent, 0.3 * extent.max())  # no side is much shorter than the longest
    low, high = middle - 0.5 * sides, middle + 0.5 * sides
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    ax.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})", zlabel=f"z ({unit})")
    ax.set_proj_type("ortho")
    ax.view_init(26.0, -164.0)  # from behind, above and slightly right, so that x points away and y to the left
    ax.set_box_aspect(tuple((sides / sides.max()).tolist()), zoom=0.9)
    for axis, side in zip((ax.xaxis, ax.yaxis, ax.zaxis), sides / sides.max(), strict=True):
        axis.set_major_locator(MaxNLocator(max(2, round(5.0 * side))))
        axis.set_tick_params(pad=0.0)
        axis.labelpad = 7.0
        axis.set_pane_color((0.97, 0.97, 0.97, 1.0))
    return scale


def path_3d(ax: Axes3D, demo: DemoValues) -> tuple[Array, list[Array]]:
    """Draw the path, its shadow, and the sensor's axes at keyframes; return the arguments of `label_keyframes_3d`."""
    inside, truth = _paths(demo)
    at, every = np.array([keyframe.T_nav_sensor.p for keyframe in demo.keyframes]), _step(len(demo.keyframes))
    size = 0.1 * max(float(np.ptp(inside, axis=0).max()), SMALLEST_BOX_M)
    R = quat_to_matrix(np.array([keyframe.T_nav_sensor.wxyz for keyframe in demo.keyframes[::every]]))
    triads = at[::every, None] + size * R.transpose(0, 2, 1)  # keyframe, axis, (3,)
    scale = fit_3d(ax, [inside, *truth], triads.reshape(-1, 3))
    p, at, triads, floor = scale * inside, scale * at, scale * triads, ax.get_zlim()[0]
    ax.plot(p[:, 0], p[:, 1], floor, color="#c8c8c8", linewidth=1.0, zorder=1.0)
    for each in truth:
        ax.plot(*(scale * each).T, color=SKY, zorder=2.0, label="truth", **TRUTH_LOOK)
    ax.plot(*p.T, color=INK, zorder=4.0, label="path")
    ax.plot(*at.T, color=INK, marker="o", markersize=3.5, linestyle="", zorder=6.0, label="keyframe")
    origins = at[::every]
    below = np.column_stack((origins[:, :2], np.full(len(origins), floor)))
    ax.plot(*_strokes(origins, below).T, color=GREY, linewidth=0.6, linestyle=":", zorder=1.5)
    covered = [p]
    for ends, name, colour in zip(triads.transpose(1, 0, 2), "xyz", AXES_RGB, strict=True):
        covered.append(_strokes(origins, ends))
        ax.plot(*covered[-1].T, color=colour, linewidth=1.8, zorder=5.0, label=f"sensor's {name}")
    return at, covered


def _strokes(begins: Array, ends: Array) -> Array:
    """One line (3 k, 3) of k separate strokes: NaN separates them."""
    return np.stack((begins, ends, np.full_like(begins, np.nan)), axis=1).reshape(-1, 3)


def _paths(demo: DemoValues) -> tuple[Array, list[Array]]:
    """The path from the first to the last stop, (m, 3) m, and the truth during that time, if it is known."""
    path, truth = demo.path, demo.truth
    if truth is None:
        return path.p_nav_sensor[demo.path.demonstrated], []
    first, last = path.t[demo.path.demonstrated][[0, -1]]
    return path.p_nav_sensor[demo.path.demonstrated], [truth.p_nav_sensor[(truth.t >= first) & (truth.t <= last)]]


def _step(count: int) -> int:
    """Return k so that at most MAX_NUMBERED keyframes are numbered if every k-th is."""
    return -(-count // MAX_NUMBERED)


def fit_view(ax: Axes, shown: Sequence[Array], axes: tuple[int, int], aspect: float = 0.85) -> float:
    """Set axes to one scale that fits paths (m, 3) in m, with axes[0] to the left and axes[1] up.

    `aspect` is the axes' height over their width.

    Returns:
        How many of their units make a metre.
    """
    points = np.vstack(shown)
    scale, unit = length_unit(points)
    centre, extent = _middle_and_extent(scale * points[:, list(axes)], scale * SMALLEST_BOX_M)
    half = 0.6 * max(extent[0], extent[1] / aspect) * np.array((1.0, aspect))
    ax.set_box_aspect(aspect)
    ax.set(xlim=(centre[0] + half[0], centre[0] - half[0]), ylim=(centre[1] - half[1], centre[1] + half[1]))
    ax.set(xlabel=f"{'xyz'[axes[0]]} in nav ({unit})", ylabel=f"{'xyz'[axes[1]]} in nav ({unit})")
    return scale


def path_view(ax: Axes, demo: DemoValues, axes: tuple[int, int]) -> tuple[Array, list[Array]]:
    """Draw the path in a view, and keyframes with ellipses of two sigma; return the arguments of `label_keyframes`."""
    columns, every = list(axes), _step(len(demo.keyframes))
    inside, truth = _paths(demo)
    p = np.array([keyframe.T_nav_sensor.p for keyframe in demo.keyframes])
    low, high = _largest_view(np.vstack([inside, *truth, p]))
    reach = [2.0 * np.sqrt(np.diagonal(keyframe.cov)[:3]) for keyframe in demo.keyframes]
    corners = np.vstack((p - reach, p + reach))
    scale = fit_view(ax, [inside, *truth, corners.clip(low, high)], axes)
    beyond = bool(((corners < low) | (corners > high))[:, columns].any())
    for each in truth:
        ax.plot(*(scale * each[:, columns]).T, color=SKY, label="truth", **TRUTH_LOOK)
    ax.plot(*(scale * inside[:, columns]).T, color=INK, label="path")
    at = scale * p[:, columns]
    covered = [scale * inside[:, columns]]
    for centre, keyframe in zip(at[::every], demo.keyframes[::every], strict=True):
        covered.append(ellipse(centre, scale**2 * keyframe.cov[np.ix_(columns, columns)]))
        ax.plot(*covered[-1].T, color=SIGMA_RGB, linewidth=0.9, label="2 σ, some\nbeyond the edge" if beyond else "2 σ")
    ax.plot(*at.T, color=INK, marker="o", markersize=3.5, linestyle="", label="keyframe")
    known = at[[demo.is_known(keyframe) for keyframe in demo.keyframes]]
    if len(known):
        ax.plot(*known.T, **KNOWN_LOOK)
    return at, covered


def _largest_view(points: Array) -> tuple[Array, Array]:
    """Lowest and highest corner, m, of the largest box that a view of points shows: half their extent around them."""
    middle, extent = _middle_and_extent(points, SMALLEST_BOX_M)
    reach = 0.5 * extent + 0.5 * float(extent.max())
    return middle - reach, middle + reach


def _middle_and_extent(points: Array, smallest: float) -> tuple[Array, Array]:
    """Middle (k,) and extent (k,) of points (m, k); NaN is ignored."""
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    return 0.5 * (low + high), np.maximum(high - low, smallest)


def ellipse(centre: Array, cov: Array) -> Array:
    """Points (m, 2) of the two sigma ellipse of a covariance (2, 2) about a centre (2,)."""
    values, vectors = np.linalg.eigh(cov)
    angle = np.linspace(0.0, 2.0 * np.pi, 61)
    circle = np.stack((np.cos(angle), np.sin(angle)))
    return np.asarray(centre + (2.0 * vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle)).T)


# --- numbers beside keyframes ---

_ANGLES = np.tile(np.radians([45, 135, 315, 225, 90, 0, 180, 270]), 4)
DIRECTIONS = np.column_stack((np.cos(_ANGLES), np.sin(_ANGLES)))
RADII = np.repeat((8.0, 14.0, 22.0, 32.0), 8)[:, None]
"""Candidate positions of a label's box, relative to its keyframe; radii in points."""


def label_keyframes_3d(ax: Axes3D, at: Array, lines: Sequence[Array]) -> None:
    """Number points (k, 3) in 3-D axes, beside lines (m, 3)."""
    at, *lines = (np.column_stack(proj3d.proj_transform(*xyz.T, ax.get_proj())[:2]) for xyz in (at, *lines))
    label_keyframes(ax, at, lines)


def label_keyframes(ax: Axes, at: Array, lines: Sequence[Array]) -> None:
    """Number points (k, 2), beside lines (m, 2), both in data coordinates.

    Points that coincide share a label. A label covers no other label and as little of the lines as possible; it is left
    out where there is no room. The figure must be complete before: a change of its layout would move the labels.
    """
    figure = ax.get_figure(root=True)
    assert figure is not None
    lay_out(figure)
    ax.apply_aspect()
    to_points = 72.0 / figure.dpi
    spots = to_points * ax.transData.transform(at)
    lowest, highest = to_points * np.asarray(ax.bbox.get_points())
    drawn = (to_points * ax.transData.transform(line) for line in lines)
    inked = np.unique(np.vstack([_inked(line, lowest, highest) for line in drawn]), axis=0)
    size = FontProperties(size="small").get_size_in_points()
    taken = np.empty((0, 4))
    every = _step(len(spots))
    for members in _groups(spots[::every]):
        words, place = ranges([every * k for k in members]), every * members[0]
        half = 0.5 * size * np.array([0.64 * len(words) + 0.5, 1.25])
        centres = spots[place] + DIRECTIONS * (RADII + half * np.abs(DIRECTIONS))
        low, high = centres - half, centres + half
        free = (low >= lowest).all(axis=1) & (high <= highest).all(axis=1)
        free &= ~((low[:, None] < taken[:, 2:]) & (high[:, None] > taken[:, :2])).all(axis=2).any(axis=1)
        if free.any():
            covered = 50.0 * _inside(spots, low - 2.0, high + 2.0) + _inside(inked, low, high)
            best = int(np.argmin(np.where(free, covered + 1.5 * RADII[:, 0], np.inf)))
            taken = np.vstack((taken, np.concatenate((low[best], high[best]))))
            ax.annotate(
                words, tuple(at[place]), tuple(centres[best] - spots[place]), textcoords="offset points", ha="center",
                va="center", fontsize="small", color=INK, zorder=9.0, annotation_clip=False,
                path_effects=[withStroke(linewidth=2.0, foreground="white")],
            )  # fmt: skip


def _inked(line: Array, low: Array, high: Array) -> Array:
    """Points (m, 2) that a line (n, 2) covers in a box, all in points; NaN, or what is outside, interrupts it."""
    line = np.where(np.any((line < low) | (line > high), axis=1, keepdims=True), np.nan, line)
    along = np.append(0.0, np.nancumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    steps = np.arange(0.0, along[-1] + 1.0)
    covered = np.column_stack([np.interp(steps, along, axis) for axis in line.T])
    return np.asarray(np.round(covered[np.isfinite(covered).all(axis=1)]))


def _groups(spots: Array) -> list[list[int]]:
    """Indices of spots (k, 2), in points, that share a label."""
    groups: list[list[int]] = []
    for k, spot in enumerate(spots):
        near = next((group for group in groups if np.linalg.norm(spots[group[0]] - spot) < 4.0), None)
        if near is None:
            groups.append([k])
        else:
            near.append(k)
    return groups


def _inside(places: Array, low: Array, high: Array) -> Array:
    """Number of points (m, 2) in each box, whose corners are low and high (b, 2)."""
    return np.asarray(((places > low[:, None]) & (places < high[:, None])).all(axis=2).sum(axis=1).astype(np.float64))
