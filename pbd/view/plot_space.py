"""Axes in space, with one scale for all three, that fill the place they are given."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullFormatter
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.axes3d import Axes3D

from pbd.pose import Array
from pbd.view.plot_style import INK, largest, length_unit
from pbd.view.plot_text import font_points

SMALLEST_M = 0.01
"""A path that is smaller is drawn into a box of this size."""
FLATTEST = 0.3
"""The box is at least so high and deep, as a share of its longest side."""
AROUND_IN = 0.055
"""Room for ticks and labels around the box, inches per point of the font."""
ELEVATION, AZIMUTH = 26.0, -164.0
"""Degrees: from behind, a little from the right and from above, so that x leads away and y to the left."""
EDGES = ("lll", "hll"), ("lll", "lhl"), ("lhl", "lhh")
"""Where x, y and z are written, seen from there: edges of the box, between corners that are low or high in x, y, z."""

Box = tuple[float, float, float, float]


def space(figure: Figure, box: Box, shown: Sequence[Array]) -> tuple[Axes3D, float]:
    """Make 3-D axes with one scale for all and room for paths (m, 3) in m; return also how many units make a metre.

    Args:
        figure: to make them in.
        box: left, bottom, width, height as shares of it; axes, ticks and labels stay within.
        shown: paths.
    """
    points = np.vstack(shown)
    scale, unit = length_unit(largest(points))
    middle, extent = middle_and_extent(scale * points, scale * SMALLEST_M)
    sides = 1.12 * np.maximum(extent, FLATTEST * extent.max())
    low, high = middle - 0.5 * sides, middle + 0.5 * sides
    ax = figure.add_axes(box, projection="3d", computed_zorder=False)
    assert isinstance(ax, Axes3D)
    ax.patch.set_visible(False)
    ax.set_proj_type("ortho")
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    ax.view_init(ELEVATION, AZIMUTH)
    _fit(ax, box, tuple((sides / sides.max()).tolist()))
    heart = _picture(ax, middle[None])[0]
    for k, (axis, edge) in enumerate(zip((ax.xaxis, ax.yaxis, ax.zaxis), EDGES, strict=True)):
        axis.set_major_locator(MaxNLocator(max(2, round(5.0 * sides[k] / sides.max()))))
        axis.set_pane_color((0.97, 0.97, 0.97, 1.0))
        ends = np.array([[{"l": low, "h": high}[c][i] for i, c in enumerate(corner)] for corner in edge])
        _write_axis(ax, k, ends, f"{'xyz'[k]} ({unit})", heart)
    return ax, scale


def middle_and_extent(points: Array, smallest: float) -> tuple[Array, Array]:
    """Middle (k,) and extent (k,) of points (m, k), NaN aside."""
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    return 0.5 * (low + high), np.maximum(high - low, smallest)


def projected(ax: Axes3D, places: Array) -> Array:
    """Where places (k, 3) in 3-D axes come to lie in the flat ones that they are drawn in, (k, 2)."""
    ax.apply_aspect()
    return np.column_stack(proj3d.proj_transform(*places.T, ax.get_proj())[:2])


def corners(ax: Axes3D) -> Array:
    """The corners of the axes' box, (8, 3)."""
    return np.array(list(product(ax.get_xlim(), ax.get_ylim(), ax.get_zlim())))


def _picture(ax: Axes3D, places: Array) -> Array:
    """Where places (k, 3) come to lie on the sheet, (k, 2) inches."""
    inches: Array = ax.transData.transform(projected(ax, places)) / ax.figure.dpi
    return inches


def _fit(ax: Axes3D, box: Box, aspect: tuple[float, ...]) -> None:
    """Make the picture of the corners fill the box, and move it to its middle.

    matplotlib's 3-D axes are square and leave much of a wide box empty: these are made larger than the box.
    """
    sheet = ax.figure.get_size_inches()
    size = np.array(box[2:]) * sheet
    middle, side = np.array(box[:2]) * sheet + 0.5 * size, 1.3 * size.max()

    def place(centre: Array, zoom: float) -> Array:
        ax.set_position((*((centre - 0.5 * side) / sheet), *(side / sheet)))
        ax.set_box_aspect(aspect, zoom=zoom)
        return _picture(ax, corners(ax))

    flat = place(middle, 1.0)
    zoom = float(((size - 2.0 * AROUND_IN * font_points("medium")) / np.ptp(flat, axis=0)).min())
    flat = place(middle, zoom)
    place(2.0 * middle - 0.5 * (flat.min(axis=0) + flat.max(axis=0)), zoom)


def _write_axis(ax: Axes3D, k: int, ends: Array, name: str, heart: Array) -> None:
    """Write ticks and name of axis k beside the edge with these ends (2, 3), away from the box's heart (2,) inches.

    matplotlib's own labels stand the nearer to a box the flatter it is, and then on each other.
    """
    axis = (ax.xaxis, ax.yaxis, ax.zaxis)[k]
    ticks = [tick for tick in axis.get_majorticklocs() if ends[0, k] <= tick <= ends[1, k]]
    begin, end = _picture(ax, ends)
    along = (end - begin) / np.linalg.norm(end - begin)
    away = np.array([-along[1], along[0]])
    away *= np.sign(away @ (0.5 * (begin + end) - heart))
    size = font_points("small")
    words = axis.get_major_formatter().format_ticks(ticks)
    axis.set_major_formatter(NullFormatter())
    wide = max((len(word) for word in words), default=1)
    half = 0.5 * size * np.array([0.64 * wide, 1.0])
    beside = (6.0 + float(np.abs(away) @ half)) * away
    places = np.tile(ends[0], (len(ticks), 1))
    places[:, k] = ticks
    for place, word in zip(projected(ax, places) if len(ticks) else (), words, strict=True):
        ax.annotate(
            word, place, beside, textcoords="offset points", ha="center", va="center", fontsize=size, color=INK,
            annotation_clip=False,
        )  # fmt: skip
    angle = float(np.degrees(np.arctan2(along[1], along[0])))
    angle = 90.0 - (90.0 - angle) % 180.0  # upright
    beyond = (12.0 + 2.0 * float(np.abs(away) @ half) + 0.6 * font_points("medium")) * away
    (centre,) = projected(ax, ends.mean(axis=0)[None])
    ax.annotate(
        name, centre, beyond, textcoords="offset points", ha="center", va="center", rotation=angle,
        rotation_mode="anchor", color=INK, annotation_clip=False,
    )  # fmt: skip
