"""Draw the factor graph of docs/tracking.md: python docs/factor_graph.py."""

from itertools import pairwise
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

HERE = Path(__file__).parent

LEG, STOP, HAND, FIELD, PRIOR = "#0072b2", "#009e73", "#cc79a7", "#e69f00", "0.35"
"""Colours of the factors; told apart by everyone."""

KNOTS = (0.0, 1.3, 2.6, 4.3, 6.0, 7.7, 9.0)
"""Of a stop, a move and another stop."""
STILL = (0, 1, 2, 5, 6)
SHARED = (4.9, 2.4)


def main() -> None:
    """Write factor-graph.png beside this file."""
    plt.rcParams.update({"font.size": 10})
    figure, ax = plt.subplots(figsize=(9.0, 4.3))
    for x, width, name in ((-0.5, 3.6, "first stop"), (3.3, 3.7, "move"), (7.2, 2.3, "next stop")):
        ax.axvspan(x, x + width, ymin=0.2, ymax=0.93, color="0.95" if name != "move" else "1.0", zorder=0)
        ax.text(x + 0.5 * width, 3.3, name, ha="center", va="center", color="0.4")
    for k, (x, after) in enumerate(pairwise(KNOTS)):
        middle = 0.5 * (x + after)
        edge(ax, (x, 0.0), (after, 0.0))
        edge(ax, (middle, 0.0), SHARED, "0.8")
        factor(ax, (middle, 0.0), LEG)
        if k in STILL and k + 1 in STILL:
            ax.annotate("", (after - 0.1, -0.25), (x + 0.1, -0.25), arrowprops=curve())
            factor(ax, (middle, -0.62), STOP)
    for k, x in enumerate(KNOTS):
        above, below = ((FIELD, STOP), (FIELD, HAND))[k not in STILL]
        for y, colour in ((0.95, above), (-1.15, below)):
            edge(ax, (x, 0.0), (x, y))
            factor(ax, (x, y), colour)
        ax.plot(x, 0.0, "o", markersize=25, color="white", markeredgecolor="black", zorder=3)
        ax.text(x, 0.0, f"$x_{k}$", ha="center", va="center", zorder=4)
    edge(ax, (0.0, 0.0), (-0.85, 0.0))
    factor(ax, (-0.85, 0.0), PRIOR)
    edge(ax, SHARED, (SHARED[0] + 2.3, SHARED[1]))
    factor(ax, (SHARED[0] + 2.3, SHARED[1]), PRIOR)
    box = {"boxstyle": "round,pad=0.5", "facecolor": "white", "edgecolor": "black"}
    ax.text(*SHARED, "lag, M, N, g, r", ha="center", va="center", bbox=box, zorder=4)
    legend(ax)
    ax.set(xlim=(-1.3, 9.7), ylim=(-2.85, 3.5))
    ax.set_axis_off()
    figure.savefig(HERE / "factor-graph.png", dpi=110, bbox_inches="tight", facecolor="white")


def curve() -> dict[str, object]:
    """A line that bends below the knots."""
    return {"arrowstyle": "-", "color": "0.6", "connectionstyle": "arc3,rad=0.45"}


def edge(ax: Axes, start: tuple[float, float], end: tuple[float, float], colour: str = "0.6") -> None:
    """Join a factor and what it depends on."""
    ax.plot(*zip(start, end, strict=True), color=colour, linewidth=1.0, zorder=1)


def factor(ax: Axes, at: tuple[float, float], colour: str) -> None:
    """A black box of a factor graph, in its colour."""
    ax.plot(*at, "s", markersize=10, color=colour, zorder=3)


def legend(ax: Axes) -> None:
    """What the colours are."""
    words = (
        (LEG, "leg: the samples between two knots, integrated"),
        (STOP, "stop: it turns about its pivot, and goes nowhere"),
        (FIELD, "compass: the field points north"),
        (HAND, "hand: no further than a hand"),
        (PRIOR, "prior: origin, biases, the sensor's class"),
    )
    for i, (colour, text) in enumerate(words):
        x, y = 5.5 * (i // 3) - 0.9, -1.85 - 0.42 * (i % 3)
        factor(ax, (x, y), colour)
        ax.text(x + 0.25, y, text, va="center", fontsize=9)


if __name__ == "__main__":
    main()
