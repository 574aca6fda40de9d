"""Numbers beside places in a picture, out of each other's way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from pbd.pose import Array
from pbd.view.plot_style import INK
from pbd.view.plot_text import DIGIT_EM, LINE_EM, font_points, step

NEAR = 4.0
"""Places nearer than this, in points, share a label."""
DIRECTIONS = np.radians([45, 135, 315, 225, 90, 0, 180, 270])
RADII = (8.0, 14.0, 22.0, 32.0)
"""Where a label may stand, in points from its place, the nearest first."""
HALO = [withStroke(linewidth=2.0, foreground="white")]
"""A label that must stand on a line remains legible."""
CROWD = 100
"""So many places are numbered, at most."""
MOST = 3
"""So many numbers, or ranges of them, in one label; more are cut."""


def place_labels(ax: Axes, at: Array, lines: Array, within: Array | None = None) -> None:
    """Number places (k, 2), beside what lines (m, 2) cover, all in the axes' data coordinates.

    Places that coincide share one label; of a crowd every so-manieth is numbered. A label stands where it covers no
    text, no place and as little of the lines as can be, and within the axes, or between the outermost of the points
    `within` (j, 2); where there is no room, it is left out.
    """
    to_points = 72.0 / ax.figure.dpi
    spots = to_points * ax.transData.transform(at)
    passed = _inked(to_points * ax.transData.transform(lines[np.isfinite(lines).all(axis=1)]))
    frame = to_points * np.asarray(ax.bbox.extents)
    if within is not None:
        bounds = to_points * ax.transData.transform(within)
        frame = np.concatenate((bounds.min(axis=0), bounds.max(axis=0)))
    size = font_points("small")
    taken = [to_points * np.asarray(text.get_window_extent().extents) for text in ax.texts]
    every = step(len(spots), CROWD)
    for members in _groups(spots[::every]):
        text = _ranges([every * k for k in members])
        spot = spots[every * members[0]]
        half = 0.5 * size * np.array([DIGIT_EM * len(text), LINE_EM])
        best = _best(spot, half, spots, passed, taken, frame)
        if best is None:
            continue
        taken.append(np.concatenate((best - half, best + half)))
        ax.annotate(
            text, at[every * members[0]].tolist(), (best - spot).tolist(), textcoords="offset points", ha="center",
            va="center", fontsize=size, color=INK, zorder=9.0, annotation_clip=False, path_effects=HALO,
        )  # fmt: skip


def _ranges(numbers: Sequence[int]) -> str:
    """Write increasing numbers: 0, 4–6, 9."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    words = [str(run[0]) if len(run) == 1 else f"{run[0]}{', ' if len(run) == 2 else '–'}{run[-1]}" for run in runs]
    return ", ".join(words if len(words) <= MOST else [*words[: MOST - 1], "…"])


def _inked(passed: Array) -> Array:
    """One point for each spot that lines cover, however many samples lie there."""
    return np.unique(np.round(passed), axis=0)


def _groups(spots: Array) -> list[list[int]]:
    groups: list[list[int]] = []
    for k, spot in enumerate(spots):
        near = next((group for group in groups if np.linalg.norm(spots[group[0]] - spot) < NEAR), None)
        if near is None:
            groups.append([k])
        else:
            near.append(k)
    return groups


def _best(spot: Array, half: Array, spots: Array, passed: Array, taken: Sequence[Array], frame: Array) -> Array | None:
    """The centre (2,) of the best free place for a label of half its size, in points."""
    best, least = None, np.inf
    for ring, radius in enumerate(RADII):
        for angle in DIRECTIONS:
            direction = np.array([np.cos(angle), np.sin(angle)])
            centre = spot + direction * (radius + half * np.abs(direction))
            low, high = centre - half, centre + half
            if (low < frame[:2]).any() or (high > frame[2:]).any():
                continue
            if any((low < other[2:]).all() and (high > other[:2]).all() for other in taken):
                continue
            cost = 20.0 * ring + 50.0 * _inside(spots, low - 2.0, high + 2.0) + _inside(passed, low, high)
            if cost < least:
                best, least = centre, cost
    return best


def _inside(places: Array, low: Array, high: Array) -> int:
    return int(((places > low) & (places < high)).all(axis=1).sum())
