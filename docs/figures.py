"""Make the figures of docs/tracking.md: python docs/figures.py [--data DIR] (the second one needs the recordings)."""

import sys
import warnings
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D
from numpy.typing import ArrayLike

import pbd
from pbd.calibration.dock import nav_in_base
from pbd.errors import PbdWarning
from pbd.files.calibration import load_calibration
from pbd.pose import Pose
from pbd.tracking.keyframes import find_keyframes
from tests.benchmarks.report import add_data, arguments
from tests.benchmarks.trials import at_sensor, fit_lever, kind_of, read_broad
from tests.benchmarks.windows import motion_of, window_errors

HERE = Path(__file__).parent
AXES_RGB = ("#d55e00", "#009e73", "#0072b2")
"""x, y, z; told apart by everyone."""
KIND_RGB = {"slow_translation": "#0072b2", "slow_rotation": "#009e73", "fast_translation": "#d55e00"}
LENGTHS_S = (0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0)


def main() -> None:
    """Write frames.png and, where the recordings are, error-growth.png beside this file."""
    parser = arguments(str(__doc__))
    add_data(parser)
    args = parser.parse_args()
    warnings.simplefilter("ignore", PbdWarning)
    plt.rcParams.update({"font.size": 10, "axes.spines.top": False, "axes.spines.right": False})
    _save(frames, "frames")
    if (args.data / "broad").is_dir():
        _save(lambda: error_growth(args.data), "error-growth")


def _save(draw: Callable[[], Figure], name: str) -> None:
    figure = draw()
    figure.savefig(HERE / f"{name}.png", dpi=110, bbox_inches="tight", facecolor="white")
    plt.close(figure)


def frames() -> Figure:
    """The bundled demonstration over its table, with all frames."""
    demo = pbd.load_demo("pouring")
    path, calibration = pbd.track(demo.recording), load_calibration("default")
    keyframes = find_keyframes(path)
    T_base_nav = nav_in_base(calibration, keyframes[0].T_nav_sensor.wxyz)
    figure = plt.figure(figsize=(8.5, 5.2))
    ax = figure.add_subplot(projection="3d", computed_zorder=False)
    assert isinstance(ax, Axes3D)
    table = np.array([[-0.12, -0.22, 0.0], [0.68, -0.22, 0.0], [0.68, 0.3, 0.0], [-0.12, 0.3, 0.0]])
    ax.add_collection3d(Poly3DCollection([table], facecolor="0.94", edgecolor="0.8", zorder=0))
    ax.plot(*T_base_nav.act(path.p_nav_sensor).T, color="0.55", linewidth=1.5)
    triad(ax, Pose.identity(), 0.14)
    say(ax, (0.0, 0.0, 0.15), "base")
    triad(ax, T_base_nav, 0.12, linestyle="--")
    say(ax, T_base_nav.act((0.0, 0.0, 0.13)), "nav")
    for k, keyframe in enumerate(keyframes):
        T_base_sensor = T_base_nav @ keyframe.T_nav_sensor
        if k == 2:
            triad(ax, T_base_sensor @ calibration.T_sensor_tool, 0.08)
            say(ax, T_base_sensor.act((0.13, 0.0, 0.0)), "tool")
        else:
            triad(ax, T_base_sensor, 0.06)
        if k == 5:
            say(ax, T_base_sensor.act((0.15, 0.0, 0.0)), "sensor")
    ax.set_axis_off()
    ax.set(xlim=(-0.12, 0.68), ylim=(-0.22, 0.3), zlim=(-0.06, 0.42))
    ax.set_box_aspect((0.8, 0.52, 0.48), zoom=1.05)
    ax.view_init(22, -62)
    return figure


def triad(ax: Axes3D, pose: Pose, size: float, linestyle: str = "-") -> None:
    """Draw a pose's axes."""
    for axis, colour in zip(np.eye(3), AXES_RGB, strict=True):
        ax.plot(*np.transpose([pose.p, pose.act(size * axis)]), color=colour, linewidth=2.2, linestyle=linestyle)


def say(ax: Axes3D, place: ArrayLike, what: str) -> None:
    """Name a frame."""
    x, y, z = np.asarray(place)
    ax.text(x, y, z, what, ha="center", fontsize=12)


def error_growth(data: Path) -> Figure:
    """Error of a move against its length, on real recordings, beside the tracker's own sigma."""
    figure, ax = plt.subplots(figsize=(7.0, 4.6))
    errors: dict[str, dict[float, list[float]]] = {}
    sigmas: dict[str, dict[float, list[float]]] = {}
    for file in sorted((data / "broad").glob("*.npz")):
        trial = read_broad(file)["40"]
        motion = motion_of(trial, LENGTHS_S)
        lever = fit_lever(trial, window_errors(trial, motion, (1.0,)))
        for length in LENGTHS_S:
            for window in window_errors(at_sensor(trial, lever), motion, (length,)):
                error = float(np.linalg.norm(window.error))
                sigma = float(np.linalg.norm(window.error / window.z))
                errors.setdefault(kind_of(file.stem), {}).setdefault(length, []).append(error)
                sigmas.setdefault(kind_of(file.stem), {}).setdefault(length, []).append(sigma)
    for kind, by_length in sorted(errors.items()):
        colour = KIND_RGB.get(kind, "0.4")
        median = [100.0 * np.median(by_length[length]) for length in LENGTHS_S]
        p95 = [100.0 * np.percentile(by_length[length], 95) for length in LENGTHS_S]
        own = [100.0 * np.median(sigmas[kind][length]) for length in LENGTHS_S]
        ax.fill_between(LENGTHS_S, median, p95, color=colour, alpha=0.15, linewidth=0)
        ax.plot(LENGTHS_S, median, color=colour, marker="o", label=kind.replace("_", " "))
        ax.plot(LENGTHS_S, own, color=colour, linestyle=":")
    ax.plot([], [], color="0.3", linestyle=":", label="the tracker's own sigma")
    ax.set(xscale="log", yscale="log", xlabel="length of the move, s", ylabel="error of its displacement, cm")
    ax.set_xticks(LENGTHS_S, [f"{length:g}" for length in LENGTHS_S])
    ax.set_yticks([0.1, 0.3, 1, 3, 10, 30, 100], ["0.1", "0.3", "1", "3", "10", "30", "100"])
    ax.minorticks_off()
    ax.grid(alpha=0.25)
    ax.legend(frameon=False)
    ax.set_title("Median, and up to the 95th percentile (shaded), at 40 Hz", fontsize=10, loc="left")
    return figure


if __name__ == "__main__":
    main()
