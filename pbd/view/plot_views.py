"""The path in space: in perspective, and seen along an axis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d.axes3d import Axes3D

from pbd.pose import Array, quat_to_matrix
from pbd.view.plot_labels import place_labels
from pbd.view.plot_space import SMALLEST_M, corners, middle_and_extent, projected
from pbd.view.plot_style import AXES_RGB, GREY, INK, KNOWN, PALE, SIGMA, SKY, largest, length_unit, size_of
from pbd.view.plot_text import step
from pbd.view.plot_values import DemoPlot

YX, YZ = (1, 0), (1, 2)
"""Across and up, as indices of nav's axes. y grows to the left, so that the first is seen from above and the second
along x, as by the person who stands behind the sensor; with y to the right the first would be a mirror image."""

TRIAD = 0.1
"""Length of a triad's axes, as a share of the path's extent."""
CROWD = 100
"""Of more keyframes than this not all are drawn with their triads and ellipses."""


def path_3d(ax: Axes3D, plot: DemoPlot, scale: float) -> None:
    """The path with its shadow, and at each keyframe a triad: the sensor's axes."""
    p = scale * plot.path.p_nav_sensor[plot.tracked]
    floor = ax.get_zlim()[0]
    ax.plot(p[:, 0], p[:, 1], floor, color="#c8c8c8", linewidth=1.0, zorder=1.0)
    if plot.truth is not None:
        ax.plot(*(scale * truth_within(plot)).T, color=SKY, zorder=2.0, label="truth", **PALE)
    ax.plot(*p.T, color=INK, zorder=4.0, label="path")
    size = TRIAD * float(max(np.ptp(p, axis=0).max(), scale * SMALLEST_M))
    at = scale * np.array([keyframe.T_nav_sensor.p for keyframe in plot.keyframes])
    every = step(len(at), CROWD)
    origins = at[::every]
    below = np.column_stack((origins[:, :2], np.full(len(origins), floor)))
    ax.plot(*_strokes(origins, below).T, color=GREY, linewidth=0.6, linestyle=":", zorder=1.5)
    ax.plot(*at.T, color=INK, marker="o", markersize=3.5, linestyle="", zorder=6.0, label="keyframe")
    axes = quat_to_matrix(np.array([keyframe.T_nav_sensor.wxyz for keyframe in plot.keyframes[::every]]))
    covered = [p]
    for k, (name, colour) in enumerate(zip("xyz", AXES_RGB, strict=True)):
        ends = origins + size * axes[:, :, k]
        ax.plot(*_strokes(origins, ends).T, color=colour, linewidth=1.8, zorder=5.0, label=f"sensor's {name}")
        covered += [origins + share * (ends - origins) for share in np.linspace(0.0, 1.0, 20)]
    place_labels(ax, *(projected(ax, xyz) for xyz in (at, np.vstack(covered), corners(ax))))


def _strokes(begins: Array, ends: Array) -> Array:
    """One line (3 k, 3) that draws k strokes, without what lies between them."""
    strokes: Array = np.stack((begins, ends, np.full_like(begins, np.nan)), axis=1).reshape(-1, 3)
    return strokes


def truth_within(plot: DemoPlot) -> Array:
    """The truth while the hand is tracked, (m, 3) m."""
    assert plot.truth is not None
    t = plot.path.t[plot.tracked]
    rows = (plot.truth.t >= t[0]) & (plot.truth.t <= t[-1])
    within: Array = plot.truth.p_nav_sensor[rows]
    return within


def view(ax: Axes, shown: Sequence[Array], axes: tuple[int, int], scale: float, unit: str) -> None:
    """Set axes to one scale with room for paths (m, 3) in m, seen with axes[0] across, to the left, and axes[1] up."""
    width, height = size_of(ax)
    centre, extent = middle_and_extent(scale * np.vstack(shown)[:, list(axes)], scale * SMALLEST_M)
    per_inch = 1.2 * max(extent[0] / width, extent[1] / height)
    half = 0.5 * per_inch * np.array([width, height])
    ax.set_xlim(centre[0] + half[0], centre[0] - half[0])
    ax.set_ylim(centre[1] - half[1], centre[1] + half[1])
    ax.set(xlabel=f"{'xyz'[axes[0]]} ({unit})", ylabel=f"{'xyz'[axes[1]]} ({unit})")


def path_view(ax: Axes, plot: DemoPlot, axes: tuple[int, int]) -> None:
    """The path along one axis, keyframes numbered, each with an ellipse of two sigma."""
    columns = list(axes)
    inside = plot.path.p_nav_sensor[plot.tracked]
    scale, unit = length_unit(largest(inside))
    shown = [inside] if plot.truth is None else [inside, truth_within(plot)]
    low, high = _room(np.vstack(shown))
    beyond = False
    for keyframe in plot.keyframes:
        reach = 2.0 * np.sqrt(np.diagonal(keyframe.cov)[:3])
        corners = keyframe.T_nav_sensor.p + np.stack((-reach, reach))
        inner = np.clip(corners, low, high)
        beyond |= bool((inner != corners)[:, columns].any())
        shown.append(inner)
    view(ax, shown, axes, scale, unit)
    if plot.truth is not None:
        ax.plot(*(scale * truth_within(plot)[:, columns]).T, color=SKY, label="truth", **PALE)
    p = scale * inside[:, columns]
    ax.plot(*p.T, color=INK, label="path")
    at = scale * np.array([keyframe.T_nav_sensor.p[columns] for keyframe in plot.keyframes])
    covered = [p]
    label: str | None = "2 σ, some\nbeyond the edge" if beyond else "2 σ"
    every = step(len(at), CROWD)
    for centre, keyframe in zip(at[::every], plot.keyframes[::every], strict=True):
        covered.append(ellipse(centre, scale**2 * keyframe.cov[np.ix_(columns, columns)], 2.0))
        ax.plot(*covered[-1].T, color=SIGMA, linewidth=0.9, label=label)
        label = None
    ax.plot(*at.T, color=INK, marker="o", markersize=3.5, linestyle="", label="keyframe")
    known = [centre for centre, keyframe in zip(at, plot.keyframes, strict=True) if plot.is_known(keyframe.t)]
    if known:
        ax.plot(*np.transpose(known), label="known place", **KNOWN)
    place_labels(ax, at, np.vstack(covered))


def _room(points: Array) -> tuple[Array, Array]:
    """Lowest and highest corner, m, of what a view may show: the path, and half its extent around it."""
    middle, extent = middle_and_extent(points, SMALLEST_M)
    reach = 0.5 * extent + 0.5 * float(extent.max())
    return middle - reach, middle + reach


def ellipse(centre: Array, cov: Array, sigmas: float) -> Array:
    """Points (m, 2) at so many sigmas of a covariance (2, 2) about a centre (2,)."""
    values, vectors = np.linalg.eigh(cov)
    angle = np.linspace(0.0, 2.0 * np.pi, 61)
    circle = np.stack((np.cos(angle), np.sin(angle)))
    outline: Array = centre + (sigmas * vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle)).T
    return outline
