"""Plot of a calibration: the tool's positions in base at the keyframes, their sigma, and its sources."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pbd.calibration.tool_poses import KeyframesInBase, tool_poses
from pbd.calibration.uncertainty import SOURCES, tool_covariances
from pbd.plots.space import ellipse
from pbd.plots.style import AXES_RGB, BLUE, GREY, INK, ORANGE, PURPLE, new_figure, plain_text, style
from pbd.pose import Array, Pose


def draw_calibration(demo: str, placed: KeyframesInBase) -> Figure:
    """Draw the tool's positions from above with ellipses of 2 sigma, and the sources' shares of each variance."""
    p, by_part = np.array([pose.p for pose in tool_poses(placed)]), tool_covariances(placed)
    with style():
        figure = new_figure(f"calibration '{plain_text(placed.calibration.name, 60)}'", 10.0, 4.8)
        above, shares = figure.subplots(1, 2)
        title = f"the tool in base at the keyframes of {plain_text(demo, 30)}, with 2 sigma"
        above.set(title=title, xlabel="x in base (m)", ylabel="y in base (m)")
        _from_above(above, placed.T_base_nav, p, np.sum(list(by_part.values()), axis=0))
        shares.set(title="what it comes from (share of the variance)", xlabel="keyframe")
        shares.set_ylabel("sigma of the position (mm)")
        _shares(shares, by_part)
    return figure


def _from_above(ax: Axes, T_base_nav: Pose, p: Array, cov: Array) -> None:
    ax.plot(p[:, 0], p[:, 1], "o-", color=GREY, linewidth=0.8, markerfacecolor=INK, markersize=3.0)
    for place, each in zip(p, cov, strict=True):
        ax.fill(*ellipse(place[:2], each[:2, :2]).T, color=BLUE, alpha=0.25)
    for frame, name, reach in ((Pose.identity(), "base", 0.08), (T_base_nav, "nav", 0.06)):
        for axis, colour in zip(np.eye(3)[:2], AXES_RGB, strict=False):
            ax.plot(*np.transpose([frame.p[:2], frame.act(reach * axis)[:2]]), color=colour, linewidth=2.0)
        ax.annotate(name, tuple(frame.p[:2]), (4.0, -12.0), textcoords="offset points", fontsize="small")
    ax.set_aspect("equal", adjustable="datalim")


def _shares(ax: Axes, parts: Mapping[str, Array]) -> None:
    """Draw bars: the height is the position's sigma (rms over the axes), the colours are shares of the variance."""
    variance = {name: np.trace(cov[:, :3, :3], axis1=1, axis2=2) / 3.0 for name, cov in parts.items()}
    total = np.sum(list(variance.values()), axis=0)
    colours = {"start": ORANGE, "mount": PURPLE, "tracking": BLUE}
    sigma_mm, below = 1e3 * np.sqrt(total), np.zeros(len(total))
    for name, share in variance.items():
        height = sigma_mm * share / np.maximum(total, 1e-18)
        ax.bar(range(len(total)), height, bottom=below, color=colours[name], width=0.7, label=SOURCES[name])
        below = below + height
    ax.legend(loc="upper left")
    ax.set_ylim(0.0, 1.35 * max(float(sigma_mm.max()), 1e-3))
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
