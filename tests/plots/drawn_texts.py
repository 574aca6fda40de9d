"""The texts that a renderer wrote into a figure, each with the rectangle that it covers, rotated like the text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np
from matplotlib.figure import Figure
from matplotlib.text import Text

from pbd.plots.style import DPI, lay_out, style
from pbd.pose import Array


@dataclass(frozen=True, eq=False)
class Drawn:
    """A text and its corners (4, 2), pixels."""

    words: str
    corners: Array

    def overlaps(self, other: Drawn) -> bool:
        """Whether the two rectangles overlap by more than an edge (separating axes)."""
        sides = np.vstack((np.diff(self.corners[:3], axis=0), np.diff(other.corners[:3], axis=0)))
        normals = np.column_stack((-sides[:, 1], sides[:, 0])) / np.linalg.norm(sides, axis=1)[:, None]
        one, two = self.corners @ normals.T, other.corners @ normals.T
        depth = np.minimum(one.max(axis=0), two.max(axis=0)) - np.maximum(one.min(axis=0), two.min(axis=0))
        return bool(depth.min() > 1.0)


def texts(figure: Figure) -> list[Drawn]:
    """Draw a figure and return all texts in it."""
    found = []
    draw: Any = Text.draw

    def record(self: Text, renderer: Any, *args: Any, **kwargs: Any) -> None:
        if self.get_visible() and self.get_text().strip():
            box = self.get_window_extent(renderer)
            found.append(Drawn(self.get_text(), _corners(np.asarray(box.get_points()), self.get_rotation())))
        draw(self, renderer, *args, **kwargs)

    figure.set_dpi(DPI)
    with style():
        lay_out(figure)
        with patch.object(Text, "draw", record):
            figure.draw_without_rendering()
    return found


def overlaps(figure: Figure, drawn: list[Drawn] | None = None) -> list[tuple[str, str]]:
    """Pairs of texts that overlap, and texts that cross the figure's edge."""
    drawn = texts(figure) if drawn is None else drawn
    width, height = DPI * figure.get_size_inches()
    outside = [
        (one.words, "the edge") for one in drawn if (one.corners < 0.0).any() or (one.corners > (width, height)).any()
    ]
    low, high = (reach([one.corners for one in drawn], axis=1) for reach in (np.min, np.max))
    near = (low[:, None] < high[None]).all(axis=2) & (low[None] < high[:, None]).all(axis=2)
    pairs = [(drawn[i], drawn[j]) for i, j in np.argwhere(np.triu(near, 1))]
    return outside + [(one.words, other.words) for one, other in pairs if one.overlaps(other)]


def _corners(box: Array, degrees: float) -> Array:
    """Corners of the rectangle, rotated, whose bounding box is given as (2, 2)."""
    middle, (width, height) = box.mean(axis=0), np.ptp(box, axis=0)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    half = 0.5 * np.linalg.solve(np.abs([[c, s], [s, c]]), [width, height])
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    corners: Array = middle + (signs * half) @ np.array([[c, s], [-s, c]])
    return corners
