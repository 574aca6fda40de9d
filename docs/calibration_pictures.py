"""Make the pictures of docs/calibration.md, all of simulated data: python docs/calibration_pictures.py."""

import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Ellipse, Polygon
from mpl_toolkits.mplot3d.axes3d import Axes3D

from pbd.calibration.mount import fit_pivot
from pbd.calibration.points import fit_points
from pbd.calibration.registration import observe_points
from pbd.calibration.rests import find_rests
from pbd.calibration.sensor import calibrate_sensor
from pbd.data import GRAVITY
from pbd.errors import PbdWarning
from pbd.pipeline import track
from pbd.pose import Array, quat_to_matrix
from pbd.simulation.calibration_tasks import SIDES, pivoting, sides
from pbd.simulation.simulate import EARTH, simulate
from pbd.tracking.keyframes import find_keyframes
from tests.calibration.device_errors import BAD
from tests.calibration.touched_points import touching

HERE = Path(__file__).parent
X, Y, Z, INK, GREY = "#d55e00", "#009e73", "#0072b2", "#222222", "#8a8a8a"
"""x, y, z; told apart by everyone."""


def main() -> None:
    """Write calibration-*.png beside this file."""
    warnings.simplefilter("ignore", PbdWarning)
    plt.rcParams.update({"font.size": 10, "axes.spines.top": False, "axes.spines.right": False})
    for draw in (dock, points, start, mount, sensor):
        _save(draw)
    with tempfile.TemporaryDirectory() as folder:
        for words in (
            "calibrate dock bench --position 0.45 -0.15 0.25",
            f"calibrate show bench pouring --save {HERE / 'calibration-show.png'}",
        ):
            subprocess.run(
                [sys.executable, "-m", "pbd", *words.split()], cwd=folder, check=True, stdout=subprocess.DEVNULL
            )


def _save(draw: Callable[[], Figure]) -> None:
    figure = draw()
    figure.savefig(HERE / f"calibration-{draw.__name__}.png", dpi=110, bbox_inches="tight", facecolor="white")
    plt.close(figure)


def dock() -> Figure:
    """The dock from above and from the side."""
    figure, (above, beside) = plt.subplots(1, 2, figsize=(9.0, 3.6), width_ratios=(1.25, 1.0))
    for ax, vertical, height in ((above, "y", -0.15), (beside, "z", 0.25)):
        colour = Y if vertical == "y" else Z
        _arrow(ax, (0.0, 0.0), (0.12, 0.0), X)
        _arrow(ax, (0.0, 0.0), (0.0, 0.12), colour)
        ax.text(-0.02, -0.02, "base", ha="right", va="top")
        ax.plot([0.45, 0.45], [0.0, height], "--", color=GREY, linewidth=0.9)
        ax.plot([0.0, 0.45], [0.0, 0.0], "--", color=GREY, linewidth=0.9)
        ax.text(0.24, 0.01, "X = 0.45 m", ha="center", va="bottom", color=X)
        name, value = vertical.upper(), f"{height:.2f}"
        ax.text(0.46, 0.5 * height, f"{name} = {value} m", va="center", color=colour)
        yaw = np.radians(30.0) if vertical == "y" else 0.0
        c, s = np.cos(yaw), np.sin(yaw)
        half = np.array([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]]) * (1.0, 1.0 if yaw else 0.4)
        box = half @ np.array([[c, s], [-s, c]]) + (0.45, height)
        ax.add_patch(Polygon(box, facecolor="#dddddd", edgecolor=INK, zorder=3))
        _arrow(ax, (0.45, height), (0.45 + 0.1 * c, height + 0.1 * s), X)
        _arrow(ax, (0.45, height), (0.45 - 0.07 * s, height + 0.07 * c), colour)
        ax.set_aspect("equal")
        ax.set_axis_off()
    above.add_patch(Arc((0.45, -0.15), 0.15, 0.15, theta1=0.0, theta2=30.0, color=INK))
    above.plot([0.45, 0.55], [-0.15, -0.15], ":", color=GREY)
    above.text(0.535, -0.135, "yaw", va="center", fontsize=9)
    above.text(0.42, -0.19, "the sensor at its first rest", ha="right", va="top")
    above.set_title("from above")
    beside.set_title("from the side")
    above.set(xlim=(-0.1, 0.68), ylim=(-0.25, 0.16))
    beside.set(xlim=(-0.1, 0.68), ylim=(-0.06, 0.34))
    return figure


def points() -> Figure:
    """Six points, the hand's way from one to the next as tracked, and a point that is wrong."""
    touched = touching(7, 6)
    given = touched.points.copy()
    given[2] += (0.08, -0.06, 0.0)
    hand = track(touched.demo.recording)
    found = observe_points(find_keyframes(hand), hand.covariance, np.zeros(3)).only(range(1, 7))
    fit = fit_points(found, given)
    tips, origin = fit.T_base_nav.act(found.p_nav_sensor), fit.T_base_nav
    R = quat_to_matrix(origin.wxyz)
    figure, ax = plt.subplots(figsize=(8.4, 5.6))
    way = origin.act(hand.p_nav_sensor)
    ax.plot(way[:, 0], way[:, 1], color=GREY, linewidth=0.8, zorder=1)
    centre = given[:, :2].mean(axis=0)
    for k, name in enumerate("ABCDEF"):
        cov = (R @ found.cov[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] @ R.T)[:2, :2]
        size, axes = np.linalg.eigh(cov)
        angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
        width, height = 4.0 * np.sqrt(size[::-1])
        ax.add_patch(Ellipse(tuple(tips[k, :2]), width, height, angle=angle, facecolor=Z, alpha=0.2))
        good = fit.used[k]
        ax.plot(*given[k, :2], "s", color=Y if good else X, markersize=9, fillstyle="none", markeredgewidth=1.8)
        ax.plot(*tips[k, :2], "o", color=Z, markersize=4)
        if not good:
            ax.plot(*np.transpose([tips[k, :2], given[k, :2]]), ":", color=X)
        out = given[k, :2] - centre
        ax.annotate(
            name if good else f"{name}: {100.0 * np.linalg.norm(fit.left_out[k]):.0f} cm off, left out",
            tuple(given[k, :2]),
            tuple(16.0 * out / np.linalg.norm(out)),
            textcoords="offset points",
            ha="right" if out[0] < 0.0 else "left",
            va="center",
            color=INK if good else X,
        )
    for axis, colour, name in zip(np.eye(3)[:2], (X, Y), ("east", "north"), strict=True):
        tip = tuple(origin.act(0.09 * axis)[:2])
        _arrow(ax, tuple(origin.p[:2]), tip, colour)
        ax.annotate(name, tuple(origin.act(0.1 * axis)[:2]), ha="center", va="center", color=colour, fontsize=9)
    ax.annotate("nav: the first rest", tuple(origin.p[:2]), (-6.0, -12.0), textcoords="offset points", ha="right")
    ax.plot([], [], "s", color=Y, fillstyle="none", markeredgewidth=1.8, label="the points, as measured in base")
    ax.plot([], [], "o", color=Z, label="where the tip stopped, and its 2 sigma")
    ax.plot([], [], color=GREY, linewidth=0.8, label="its way")
    ax.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    ax.margins(0.16)
    ax.set(xlabel="x in base (m)", ylabel="y in base (m)", aspect="equal")
    return figure


def start() -> Figure:
    """How a later demonstration may begin: with a dock in the same pose, with nav at the same point."""
    figure, panels = plt.subplots(1, 2, figsize=(9.0, 3.4))
    for ax, title, turns, colours in (
        (panels[0], "[dock]: the same place, turned the same way", (25.0,), (INK,)),
        (panels[1], "[nav]: the same point, turned as you like", (25.0, 95.0, -40.0), (INK, Z, Y)),
    ):
        for k, (turn, colour) in enumerate(zip(turns, colours, strict=True)):
            c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
            half = np.array([[-0.6, -0.4], [0.6, -0.4], [0.6, 0.4], [-0.6, 0.4]])
            box = half @ np.array([[c, s], [-s, c]])
            face = "#dddddd" if k == 0 else "none"
            ax.add_patch(Polygon(box, facecolor=face, edgecolor=colour, linestyle="-" if k == 0 else "--"))
            _arrow(ax, (0.0, 0.0), (1.1 * c, 1.1 * s), X if k == 0 else colour)
        ax.plot(0.0, 0.0, "o", color=INK, markersize=5)
        ax.set(xlim=(-2.4, 2.4), ylim=(-1.3, 1.5), aspect="equal")
        ax.set_title(title, fontsize=10)
        ax.set_axis_off()
    c, s = np.cos(np.radians(25.0)), np.sin(np.radians(25.0))
    corner = np.array([[-0.67, 0.35], [-0.67, -0.47], [0.55, -0.47]]) @ np.array([[c, s], [-s, c]])
    panels[0].plot(*corner.T, color=Y, linewidth=4.0, alpha=0.5)
    panels[0].text(-0.6, -0.95, "a corner of tape", ha="center", va="center", color=Y)
    panels[0].text(1.15, 0.55, "x of the sensor", color=X, fontsize=9)
    panels[1].text(0.0, -1.15, "the compass tells how it is turned", ha="center", va="center")
    _arrow(panels[1], (1.9, -0.5), (1.9, 0.7), INK)
    panels[1].text(1.9, 0.85, "magnetic north", ha="center", fontsize=9)
    return figure


def mount() -> Figure:
    """A tip that stands on a point while the hand tilts; and the tool's axes, with the turns that are positive."""
    tip = np.array((0.03, -0.02, -0.0933))
    hand = track(simulate(pivoting(1, tuple(tip.tolist())), "modern", 1).recording)
    keyframes = find_keyframes(hand)
    fit = fit_pivot(keyframes, hand.covariance)
    figure = plt.figure(figsize=(9.0, 4.2))
    ax = figure.add_subplot(1, 2, 1, projection="3d")
    assert isinstance(ax, Axes3D)
    place = keyframes[0].T_nav_sensor.act(fit.p_sensor_tip)
    for keyframe in keyframes:
        p, end = keyframe.T_nav_sensor.p, keyframe.T_nav_sensor.act(fit.p_sensor_tip)
        ax.plot(*np.transpose([p, end]), color=GREY, linewidth=1.2)
        ax.plot(*np.transpose([p]), "s", color=Z, markersize=7)
    ax.plot(*np.transpose([place]), "o", color=X, markersize=7)
    x, y, z = place
    ax.text(x, y, z - 0.016, "the tip, on a point that holds it", ha="center", color=X, fontsize=9)
    x, y, z = np.mean([keyframe.T_nav_sensor.p for keyframe in keyframes], axis=0)
    ax.text(x, y, z + 0.035, "the sensor, at each rest", ha="center", color=Z, fontsize=9)
    ax.set_title("--pivot: the tip stays, the sensor goes round it", fontsize=10)
    ax.set_axis_off()
    ax.view_init(12, -60)
    ax.set_aspect("equal")
    ax.set_box_aspect(None, zoom=1.2)
    axes = figure.add_subplot(1, 2, 2, projection="3d")
    assert isinstance(axes, Axes3D)
    for along, colour, name in (
        ((1.0, 0.0, 0.0), X, "x: jaws"),
        ((0.0, 1.0, 0.0), Y, "y"),
        ((0.0, 0.0, -1.0), Z, "z: approach"),
    ):
        axes.quiver(0, 0, 0, *along, color=colour, linewidth=2.2, arrow_length_ratio=0.12)
        tip = 1.2 * np.array(along)
        axes.text(tip[0], tip[1], tip[2] - 0.12, name, ha="center", fontsize=9, color=colour)
    for axis, colour in (((1.0, 0.0, 0.0), X), ((0.0, 0.0, -1.0), Z)):
        _turn_about(axes, np.array(axis), colour)
    for jaw in (-0.35, 0.35):
        axes.plot([jaw, jaw], [0.0, 0.0], [0.5, 0.0], color=INK, linewidth=4.0)
    axes.plot([-0.35, 0.35], [0.0, 0.0], [0.5, 0.5], color=INK, linewidth=4.0)
    axes.plot([0.0, 0.0], [0.0, 0.0], [0.5, 0.9], color=INK, linewidth=4.0)
    axes.set_title("--turns x,z: each about an axis of the tool", fontsize=10)
    axes.set(xlim=(-0.9, 0.9), ylim=(-0.9, 0.9), zlim=(-1.0, 0.8))
    axes.set_axis_off()
    axes.view_init(18, -68)
    axes.set_box_aspect(None, zoom=1.0)
    return figure


def _turn_about(axes: Axes3D, axis: Array, colour: str) -> None:
    """An arc round an axis, by the right hand's rule."""
    across = np.array((0.0, 1.0, 0.0))
    other = np.cross(axis, across)
    angles = np.radians(np.linspace(-60.0, 200.0, 40))
    arc = 0.72 * axis + 0.2 * (np.outer(np.cos(angles), across) + np.outer(np.sin(angles), other))
    axes.plot(*arc.T, color=colour, linewidth=1.4)
    axes.quiver(*arc[-2], *(arc[-1] - arc[-2]), color=colour, linewidth=1.4, length=3.0, arrow_length_ratio=1.0)


def sensor() -> Figure:
    """Twelve ways to put a sensor down, and what the norm of specific force is in each, before and after."""
    recording = simulate(sides(4), BAD, 4).recording
    fit = calibrate_sensor(recording, gravity=EARTH.gravity)
    rests, acc = find_rests(recording), fit.errors.acc
    assert acc is not None
    figure = plt.figure(figsize=(9.0, 4.0))
    ax = figure.add_subplot(1, 2, 1, projection="3d")
    assert isinstance(ax, Axes3D)
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * (0.5, 0.4, 0.2)
    for a in corners:
        for b in corners:
            if np.count_nonzero(a != b) == 1:
                ax.plot(*np.transpose([a, b]), color=GREY, linewidth=0.8)
    for k, up in enumerate(SIDES):
        ax.quiver(*(0.55 * up), *(0.5 * up), color=Z if k < 6 else Y, linewidth=1.6, arrow_length_ratio=0.25)
        ax.text(*(1.2 * up), str(k + 1), ha="center", va="center", fontsize=9)
    ax.set_axis_off()
    ax.set(xlim=(-1.1, 1.1), ylim=(-1.1, 1.1), zlim=(-1.1, 1.1))
    ax.set_box_aspect((1.0, 1.0, 1.0), zoom=1.05)
    ax.view_init(22, -55)
    ax.set_title("up in turn: six sides (blue), six edges (green)", fontsize=10, y=1.05)
    bars = figure.add_axes((0.60, 0.14, 0.37, 0.70))
    number = np.arange(1, len(rests) + 1)
    for norm, colour, name in (
        (np.linalg.norm(rests.acc, axis=1), X, "as read"),
        (np.linalg.norm(acc.correct(rests.acc), axis=1), Z, "calibrated"),
    ):
        bars.plot(number, 1e3 / GRAVITY * (norm - EARTH.gravity), "o-", color=colour, label=name, linewidth=1.2)
    bars.axhline(0.0, color=GREY, linewidth=0.8)
    bars.legend(frameon=False)
    bars.set_xticks(number)
    bars.set(xlabel="orientation", ylabel="|specific force| minus gravity (mg)")
    return figure


def _arrow(ax: Axes, start: tuple[float, float], end: tuple[float, float], colour: str) -> None:
    ax.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 2.0})


if __name__ == "__main__":
    main()
