"""Words in plots: broken and cut to the room there is; numbers thinned out; colours that everyone tells apart."""

from __future__ import annotations

from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pbd.pose import Array
from pbd.view.plot_style import AXES_RGB, RUNS_RGB, style
from pbd.view.plot_text import say, step, wrapped

words = st.lists(st.text("abcdefgx%$_^ (0.1 cm/s)", min_size=1, max_size=12), max_size=30).map(" ".join)


HINTED = 1.1
"""A renderer sets each letter on whole dots: a line's width differs by up to so much."""


def width_in(line: str) -> float:
    """As matplotlib itself measures it."""
    say(TEXT, line)
    return float(TEXT.get_window_extent(RENDERER).width) / FIGURE.dpi


FIGURE = Figure(dpi=72.0)  # at which the words are measured
CANVAS: Any = FigureCanvasAgg(FIGURE)
RENDERER = CANVAS.get_renderer()
TEXT = FIGURE.text(0.0, 0.0, "")


@settings(max_examples=40, deadline=None)
@given(words, st.floats(1.5, 4.0), st.integers(1, 5))
def test_lines_fit_and_lose_nothing_but_the_end(text: str, inches: float, most: int) -> None:
    with style():
        lines = wrapped(text, inches, most)
        assert len(lines) <= most
        assert all(width_in(line) < HINTED * inches or " " not in line for line in lines)
        whole = " ".join(lines)
        if whole.endswith("…"):
            assert " ".join(text.split()).startswith(whole[:-1].rstrip())
            assert len(lines) == most
        else:
            assert whole == " ".join(text.split())
        # As few lines as can be: no word would have fitted on the line before it.
        for line, following in pairwise(lines):
            if not following.endswith("…"):
                assert width_in(f"{line} {following.split()[0]}") > inches / HINTED


@given(st.integers(1, 100_000), st.floats(1.0, 500.0))
def test_a_step_is_the_least_round_one(count: int, room: float) -> None:
    every = step(count, room)
    assert str(every).rstrip("0") in ("1", "2", "5")
    assert count <= every * room
    smaller = {1: 0.5, 2: 0.5, 5: 0.4}[int(str(every)[0])] * every
    assert every == 1 or count > smaller * room


# What two of the three kinds of cones see, from Machado, Oliveira and Fernandes, "A Physiologically-based Model for
# Simulation of Color Vision Deficiency" (IEEE TVCG 15(6), 2009), severity 1, on linear RGB.
BLIND = {
    "none": np.eye(3).tolist(),
    "red": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "green": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "blue": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
XYZ_OF_SRGB = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.072175], [0.0193339, 0.119192, 0.9503041]])  # fmt: skip # noqa: E501
AT_A_GLANCE = 10.0
"""CIE76 difference: 2.3 is just seen, side by side."""


def lab(colour: str, seen: Array) -> Array:
    srgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    xyz = XYZ_OF_SRGB @ np.clip(seen @ linear, 0.0, 1.0) / (0.95047, 1.0, 1.08883)
    f = np.where(xyz > (6.0 / 29.0) ** 3, np.cbrt(xyz), xyz * (29.0 / 6.0) ** 2 / 3.0 + 4.0 / 29.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("kind", BLIND)
@pytest.mark.parametrize("colours", [AXES_RGB, RUNS_RGB], ids=["axes", "demonstrations"])
def test_colours_are_told_apart_by_everyone(colours: tuple[str, ...], kind: str) -> None:
    seen = np.array(BLIND[kind])
    for one, other in combinations(colours, 2):
        assert np.linalg.norm(lab(one, seen) - lab(other, seen)) > AT_A_GLANCE, (one, other)
    black, white = lab("#000000", np.eye(3)), lab("#ffffff", np.eye(3))  # the formulas' own check
    assert black == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert white == pytest.approx([100.0, 0.0, 0.0], abs=0.01)
