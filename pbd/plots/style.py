"""How plots look: colours that the colour-blind can distinguish, titles, legends, marks on a time axis.

Figures are made without pyplot, so no window opens and no figure needs to be closed. matplotlib's constrained layout
places all parts; legends are outside the axes.
"""

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from importlib import import_module
from typing import Any, BinaryIO

import matplotlib.style
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pbd.io.made_by_pbd import PICTURE_MADE_BY
from pbd.plots.demo_values import DemoValues
from pbd.pose import Array

DPI = 110
"""Pixels per inch of a PNG."""

MADE_BY = f"{PICTURE_MADE_BY}matplotlib"
"""The program that made a figure, in the figure's file."""

_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": MADE_BY},
    "svg": {"Date": None, "Creator": MADE_BY},
    "pdf": {"CreationDate": None, "Creator": MADE_BY},
}

ORANGE, SKY, GREEN = "#e69f00", "#56b4e9", "#009e73"
BLUE, VERMILION, PURPLE = "#0072b2", "#d55e00", "#cc79a7"
"""Okabe and Ito's palette, which the colour-blind can distinguish."""
AXES_RGB = (VERMILION, GREEN, BLUE)
"""Colours of x, y, z, and of roll, pitch, yaw."""
AXES_DASHES: tuple[Any, ...] = ("-", (0.0, (6.0, 1.2)), (0.0, (2.0, 1.0)))
"""Line styles of the same, for a print in grey."""
DEMOS_RGB = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
"""Colours of several demonstrations."""
SIGMA_RGB = PURPLE
"""Colour of sigmas and their ellipses."""
INK, GREY, REST = "#222222", "#6e6e6e", "#e9e9e9"
"""Colours of text and lines, of what is secondary, and of the rests on a time axis."""
KNOWN_LOOK: dict[str, Any] = {"marker": "s", "markersize": 7.0, "markerfacecolor": "none", "markeredgecolor": PURPLE}
KNOWN_LOOK |= {"linestyle": "", "label": "known place"}
"""Look of a keyframe whose place is known."""
FINDING_LOOK: dict[str, Any] = {"facecolor": "#f4ec8c", "edgecolor": "#f4ec8c", "linewidth": 2.0}
"""Highlight of a finding. The edge keeps a very short one visible."""
TRUTH_LOOK: dict[str, Any] = {"alpha": 0.35, "linewidth": 4.0, "solid_capstyle": "butt"}
"""Look of the truth: a broad, pale line below the thin line of the tracked value."""

FAMILY = "DejaVu Sans"
"""A font that comes with matplotlib, so that a plot looks the same everywhere."""

_STYLE: dict[str, Any] = {
    "font.family": FAMILY,
    "axes.titlesize": "small",
    "axes.titlelocation": "left",
    "axes.titlecolor": GREY,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "figure.constrained_layout.w_pad": 0.12,
    "figure.constrained_layout.h_pad": 0.09,
    "figure.constrained_layout.wspace": 0.0,
    "figure.constrained_layout.hspace": 0.0,
    "figure.titleweight": "bold",
    "grid.alpha": 0.35,
    "grid.linewidth": 0.6,
    "xtick.labelsize": "small",
    "ytick.labelsize": "small",
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.fontsize": "small",
    "legend.frameon": False,
    "lines.linewidth": 1.1,
    "savefig.facecolor": "white",
    "agg.path.chunksize": 10000,
    "pdf.fonttype": 42,  # TrueType: journals refuse Type 3
    "svg.hashsalt": "pbd",
}


def style() -> AbstractContextManager[None]:
    """Context in which figures are drawn and saved. It replaces the user's matplotlibrc meanwhile."""
    return matplotlib.style.context(["default", _STYLE])


def write(figure: Figure, file: BinaryIO, format_name: str) -> None:
    """Write a figure as png, svg or pdf. The same figure gives the same bytes."""
    backend = import_module(f"matplotlib.backends.backend_{'agg' if format_name == 'png' else format_name}")
    with style():
        lay_out(figure)
        # The canvas's own function; `Figure.savefig` would draw the figure once more.
        getattr(backend.FigureCanvas(figure), f"print_{format_name}")(file, metadata=_METADATA[format_name])


def lay_out(figure: Figure) -> None:
    """Compute a figure's layout once, and then freeze it; saving would compute it three times."""
    if engine := figure.get_layout_engine():
        figure.set_dpi(DPI)
        engine.execute(figure)
        figure.set_layout_engine(None)


def plain_text(words: str, limit: int) -> str:
    """A user's text, with a ? for characters that the font lacks, and $ escaped.

    A text of more than `limit` characters keeps its beginning and its end.
    """
    font = get_font(findfont(FAMILY))
    words = "".join(c if c.isprintable() and font.get_char_index(ord(c)) else "?" for c in words)
    if len(words) > limit:
        words = f"{words[: limit // 2]}…{words[len(words) - (limit - 1) // 2 :]}"
    return words.replace("$", r"\$")


def new_figure(title: str, width: float, height: float) -> Figure:
    """Make a figure, width and height in inches, with a title at its top left."""
    figure = Figure(figsize=(width, height), layout="constrained")
    figure.suptitle(title, x=0.015, ha="left", color=INK)
    return figure


def legend(figure: Figure, axes: Iterable[Axes], more: Sequence[Artist] = ()) -> None:
    """Add a legend beside the axes, with one entry for each label in them."""
    found = [handle for ax in axes for handle in ax.get_legend_handles_labels()[0]] + list(more)
    named = {str(handle.get_label()): handle for handle in reversed(found)}
    figure.legend(handles=list(reversed(named.values())), loc="outside right upper")


def length_unit(*metres: Array) -> tuple[float, str]:
    """The unit for lengths of this size (m, NaN ignored): how many of it make a metre, and its name."""
    size = largest(*metres)
    if size < 0.02:
        return 1e3, "mm"
    return (100.0, "cm") if size < 2.0 else (1.0, "m")


def largest(*values: Array) -> float:
    """The largest magnitude, NaN ignored; 0 for no values."""
    every = np.concatenate([np.abs(np.ravel(each)) for each in values])
    return float(np.nanmax(every)) if np.isfinite(every).any() else 0.0


def mark_events(ax: Axes, demo: DemoValues, numbers: bool = False) -> None:
    """Shade the rests, highlight the findings, mark the grip events and set the limits of the time axis.

    With `numbers`, the keyframes are numbered above the axes: a box marks a known place, a ? a doubted stop.
    """
    t, low_to_high = demo.path.t, ax.get_xaxis_transform()
    rests = [(begin, end - begin) for begin, end in demo.path.rests]
    ax.broken_barh(rests, (0.0, 1.0), transform=low_to_high, facecolor=REST, edgecolor=REST, linewidth=0.8, zorder=0.0)
    spans = [(begin, end - begin) for finding in demo.findings for begin, end in finding.spans]
    ax.broken_barh(spans, (0.0, 1.0), transform=low_to_high, zorder=0.1, **FINDING_LOOK)
    for event in demo.path.grip:
        at = min(max(event.t, t[0]), t[-1])  # one far from the recording would leave the axes no room
        ax.axvline(at, color=ORANGE, linewidth=1.0, linestyle="--", zorder=1.5)
        ax.plot(at, 1.0, transform=low_to_high, clip_on=False, zorder=3.0, **_grip(event.closed))
    margin = 0.005 * max(float(t[-1] - t[0]), 1e-3)
    ax.set_xlim(float(t[0]) - margin, float(t[-1]) + margin)
    if numbers:
        _number(ax, demo)


def _grip(closed: bool) -> dict[str, Any]:
    fill = ORANGE if closed else "white"
    look = {"marker": "v" if closed else "^", "markersize": 6.0, "markeredgecolor": ORANGE, "markerfacecolor": fill}
    return look | {"linestyle": "", "label": ""}


def _number(ax: Axes, demo: DemoValues) -> None:
    """Number the keyframes above the axes; numbers that would overlap are left out."""
    begin, end = ax.get_xlim()
    shown, free = [], -np.inf
    for number, keyframe in enumerate(demo.keyframes):
        words = f"{number}{'?' if demo.is_doubted(keyframe) else ''}"
        half = 0.0075 * len(words) * (end - begin)
        if keyframe.t - half > free:
            shown.append((keyframe, words))
            free = keyframe.t + half
    top = ax.secondary_xaxis("top")
    top.set_xticks([keyframe.t for keyframe, _ in shown], [words for _, words in shown], fontsize="small")
    top.tick_params(length=0.0, pad=6.0)
    top.spines["top"].set_visible(False)
    frame = {"boxstyle": "square,pad=0.15", "facecolor": "none", "edgecolor": PURPLE}
    for (keyframe, words), label in zip(shown, top.get_xticklabels(), strict=True):
        if demo.is_known(keyframe):
            label.set_bbox(frame)
        elif words.endswith("?"):
            label.set_bbox(frame | FINDING_LOOK)


def event_legend(demo: DemoValues) -> list[Artist]:
    """The legend's entries for the marks on a time axis."""
    handles: list[Artist] = [Patch(facecolor=REST, edgecolor="#cccccc", label="at rest")]
    for closed, what in ((True, "closes"), (False, "opens")):
        if any(event.closed == closed for event in demo.path.grip):
            handles.append(Line2D([], [], **_grip(closed) | {"label": f"grip {what}"}))
    if demo.path.claims:
        handles.append(Line2D([], [], **KNOWN_LOOK))
    if any(finding.spans for finding in demo.findings):
        handles.append(Patch(**FINDING_LOOK, label="check"))
    return handles
