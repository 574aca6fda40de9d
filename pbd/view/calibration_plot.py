"""A picture of a calibration: where the tool stands in base, how sure that is, and what it comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from matplotlib.ticker import MaxNLocator

from pbd.data import Calibration
from pbd.pose import Array, Pose
from pbd.view.plot_style import AXES_RGB, BLUE, GREY, INK, ORANGE, PURPLE, head, style
from pbd.view.plot_text import say

WIDTH, HEIGHT = 10.0, 4.6
"""Inches."""

PARTS = {"start": ("where the hand starts", ORANGE), "mount": ("the mount", PURPLE), "tracking": ("tracking", BLUE)}


def draw_calibration(
    calibration: Calibration,
    demo: str,
    T_base_nav: Pose,
    T_base_tool: Sequence[Pose],
    parts: Mapping[str, Array],
) -> Figure:
    """Draw the tool's places from above with their 2 sigma ellipses, and the shares of the variance at each.

    Args:
        calibration: for its name.
        demo: the demonstration's name.
        T_base_nav: where nav is.
        T_base_tool: k poses.
        parts: covariances (k, 6, 6) in base, m and rad, by the names of PARTS.
    """
    with style():
        figure = Figure(figsize=(WIDTH, HEIGHT))
        head(figure, f"calibration '{calibration.name}'", f"the tool in the robot's base at the keyframes of {demo}")
        above = figure.add_axes((0.08, 0.13, 0.42, 0.70))
        _from_above(above, T_base_nav, np.array([pose.p for pose in T_base_tool]), parts)
        shares = figure.add_axes((0.60, 0.13, 0.37, 0.70))
        _shares(shares, parts)
    return figure


def _from_above(ax: Axes, T_base_nav: Pose, p: Array, parts: Mapping[str, Array]) -> None:
    total = np.sum(list(parts.values()), axis=0)
    ax.plot(p[:, 0], p[:, 1], color=GREY, linewidth=0.8)
    ax.plot(p[:, 0], p[:, 1], "o", color=INK, markersize=3.0)
    for k, place in enumerate(p):
        size, axes = np.linalg.eigh(total[k, :2, :2])
        angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
        width, height = 4.0 * np.sqrt(np.maximum(size[::-1], 0.0))
        ax.add_patch(Ellipse(tuple(place[:2]), width, height, angle=angle, facecolor=BLUE, alpha=0.25))
    for frame, name, reach in ((Pose.identity(), "base", 0.08), (T_base_nav, "nav", 0.06)):
        for axis, colour in zip(np.eye(3)[:2], AXES_RGB, strict=False):
            tip = frame.act(reach * axis)
            ax.plot([frame.p[0], tip[0]], [frame.p[1], tip[1]], color=colour, linewidth=2.0)
        text = ax.annotate("", tuple(frame.p[:2]), (4.0, -12.0), textcoords="offset points", fontsize="small")
        say(text, name)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel="x in base (m)", ylabel="y in base (m)", title="from above, with 2 sigma")


def _shares(ax: Axes, parts: Mapping[str, Array]) -> None:
    """Each bar is as high as the sigma of the position (rms over the axes), its colours are shares of the variance."""
    variance = {name: np.trace(cov[:, :3, :3], axis1=1, axis2=2) / 3.0 for name, cov in parts.items()}
    total = np.sum(list(variance.values()), axis=0)
    sigma_mm, below = 1e3 * np.sqrt(total), np.zeros(len(total))
    for name, of_part in variance.items():
        label, colour = PARTS[name]
        height = sigma_mm * of_part / np.maximum(total, 1e-18)
        ax.bar(range(len(total)), height, bottom=below, color=colour, width=0.7, label=label)
        below = below + height
    ax.legend(loc="upper left")
    ax.set_ylim(0.0, 1.35 * max(float(sigma_mm.max()), 1e-3))
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set(xlabel="keyframe", ylabel="sigma of the position (mm)", title="what it comes from (share of the variance)")
