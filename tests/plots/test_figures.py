"""Figures show the tracked values and are legible: their data, their labels, and no overlapping texts."""

import io
import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D

import pbd.plots
from pbd.data import GripEvent
from pbd.pipeline import track
from pbd.plots import figures
from pbd.plots.demo_values import DemoValues, demo_values
from pbd.plots.findings import Finding
from pbd.plots.space import fit_view, label_keyframes
from pbd.plots.style import AXES_RGB, DEMOS_RGB, plain_text, write
from pbd.pose import Array, Pose, quat_rotate, quat_to_rpy
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import random_task, simulate
from pbd.simulation.tasks import Task
from pbd.tracking.paper import LAMBDA_V
from tests.near import assert_near
from tests.plots.drawn_texts import Drawn, overlaps, texts
from tests.scenarios import pour, uncalibrated

HOSTILE = r"a $\frac{1}{ _^ b.csv 茶 " + "\n\x07" + "very long " * 20
"""A user's name with mathematics, characters that the font lacks, control characters, and too many of them."""


@pytest.fixture(scope="module")
def pouring() -> DemoValues:
    """Everything at once: grip, magnetometer, truth, a known place, a doubted stop."""
    path = track(pour())
    stops = (replace(stop, weight=0.6) if k == 3 else stop for k, stop in enumerate(path.stops))
    return demo_values(replace(path, stops=tuple(stops)))


@pytest.fixture(scope="module")
def still() -> DemoValues:
    """One stop, no magnetometer, no truth, a hostile name."""
    demo = simulate(Task("still", (Waypoint(rest_s=1.3),)), "modern")
    info = replace(demo.recording.info, name=HOSTILE, sensor=HOSTILE)
    return demo_values(track(replace(demo, recording=replace(demo.recording, mag=None, info=info), truth=None)))


@pytest.fixture(scope="module")
def sheets(pouring: DemoValues) -> dict[str, tuple[Figure, list[Drawn]]]:
    """All figures of `pouring`, and the texts in each."""
    drawn = {name: figures.draw(name, pouring) for name in figures.names(pouring)}
    return {name: (figure, texts(figure)) for name, figure in drawn.items()}


def flat(figure: Figure) -> list[Axes]:
    return [ax for ax in figure.axes if not isinstance(ax, Axes3D)]


def lines(ax: Axes) -> dict[str, Array]:
    """The points (n, 2) of an axes' lines, by their labels."""
    return {str(line.get_label()): np.asarray(line.get_xydata()) for line in ax.get_lines()}


def named(figure: Figure) -> set[str]:
    """The legend's labels."""
    return {text.get_text() for legend in figure.legends for text in legend.get_texts()}


# --- data ---


def test_lines_are_the_trackers_values(pouring: DemoValues, sheets: dict[str, tuple[Figure, list[Drawn]]]) -> None:
    path, rows, tracking = pouring.path, pouring.path.demonstrated, pouring.tracking
    rpy = np.degrees(quat_to_rpy(path.wxyz_nav_sensor))  # no angle of this task comes near a half turn
    for name, panel, label, values in (
        ("position", 0, "y", 100.0 * path.p_nav_sensor[rows, 1]),
        ("attitude", 0, "roll", rpy[:, 0]),
        ("velocity", 0, "y", 100.0 * path.v_nav_sensor[rows, 1]),
        ("velocity", 1, "z", 1e3 * path.closure[:, 2]),
        ("gravity", 0, "z", tracking.recording.acc[:, 2]),
        ("gravity", 1, "x", tracking.a_nav[:, 0]),
        ("resulting-acceleration", 0, "resulting\nacceleration", pouring.resulting),
        ("variance", 0, "λᵥ = 0.01", np.array([LAMBDA_V, LAMBDA_V])),
    ):
        assert_near(lines(flat(sheets[name][0])[panel])[label][:, 1], values, 1e-9)


def test_the_path_in_space_and_its_triads(pouring: DemoValues, sheets: dict[str, tuple[Figure, list[Drawn]]]) -> None:
    (ax,) = sheets["path"][0].axes
    assert isinstance(ax, Axes3D)
    drawn = {str(line.get_label()): np.column_stack(line.get_data_3d()) for line in ax.get_lines()}
    assert drawn["path"] == pytest.approx(100.0 * pouring.path.p_nav_sensor[pouring.path.demonstrated])
    low, high = np.transpose((ax.get_xlim(), ax.get_ylim(), ax.get_zlim()))
    keyframe = pouring.keyframes[5]  # the hand is rolled there
    for k, name in enumerate("xyz"):
        begins, ends, gaps = drawn[f"sensor's {name}"].reshape(-1, 3, 3).swapaxes(0, 1)
        assert np.isnan(gaps).all()
        assert ((ends > low) & (ends < high)).all()
        assert begins[5] == pytest.approx(100.0 * keyframe.T_nav_sensor.p)
        arrow = ends[5] - begins[5]
        assert arrow / np.linalg.norm(arrow) == pytest.approx(quat_rotate(keyframe.T_nav_sensor.wxyz, np.eye(3)[k]))


@pytest.mark.parametrize(("name", "across", "up"), [("view-yx", 1, 0), ("view-yz", 1, 2)])
def test_views_have_one_scale_and_are_no_mirror_image(
    pouring: DemoValues, sheets: dict[str, tuple[Figure, list[Drawn]]], name: str, across: int, up: int
) -> None:
    (ax,) = flat(sheets[name][0])
    path = 100.0 * pouring.path.p_nav_sensor[pouring.path.demonstrated]
    assert lines(ax)["path"] == pytest.approx(path[:, [across, up]])
    assert np.ptp(lines(ax)["truth"], axis=0) == pytest.approx(np.ptp(path[:, [across, up]], axis=0), abs=1.0)  # cm
    per_unit = ax.transData.transform([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    right, upwards = per_unit[1] - per_unit[0], per_unit[2] - per_unit[0]
    assert right == pytest.approx((-upwards[1], 0.0))  # y to the left, as large as what is up
    assert upwards[1] > 0.0


@pytest.mark.parametrize("size_m", [(0.1, 0.4), (0.4, 0.1)])
def test_a_tall_and_a_wide_path_fit_into_their_view(size_m: tuple[float, float]) -> None:
    ax = Figure().add_subplot()
    scale = fit_view(ax, [np.array([(0.0, 0.0, 0.0), (*size_m, 0.0)])], (0, 1))
    shares = scale * np.array(size_m) / np.abs(np.ptp([ax.get_xlim(), ax.get_ylim()], axis=1))
    assert shares.max() == pytest.approx(1.0 / 1.2)


@pytest.mark.parametrize(("sigma_m", "label"), [(0.01, "2 σ"), (5.0, "2 σ, some\nbeyond the edge")])
def test_a_large_sigma_does_not_hide_the_path(pouring: DemoValues, sigma_m: float, label: str) -> None:
    keyframes = tuple(replace(keyframe, cov=sigma_m**2 * np.eye(6)) for keyframe in pouring.keyframes)
    figure = figures.draw("view-yx", replace(pouring, keyframes=keyframes))
    (ax,) = flat(figure)
    seen = np.abs(np.diff([ax.get_xlim(), ax.get_ylim()], axis=1)).min()
    assert np.ptp(lines(ax)["path"], axis=0).max() > 0.3 * seen
    assert label in named(figure)


def test_every_keyframe_is_numbered_and_a_doubted_one_has_a_question_mark(
    pouring: DemoValues, sheets: dict[str, tuple[Figure, list[Drawn]]]
) -> None:
    numbers = [str(k) for k in range(len(pouring.keyframes))]
    on_top = {drawn.words for drawn in sheets["velocity"][1]}
    assert {"3?" if number == "3" else number for number in numbers} <= on_top
    for name in ("path", "view-yx", "view-yz"):
        labels = [drawn.words for drawn in sheets[name][1] if re.fullmatch(r"[\d–, ]+", drawn.words)]
        spans = [span.split("–") for label in labels for span in label.split(", ")]
        assert set(numbers) <= {str(k) for span in spans for k in range(int(span[0]), int(span[-1]) + 1)}


def test_rests_grip_and_findings_are_marked(pouring: DemoValues, sheets: dict[str, tuple[Figure, list[Drawn]]]) -> None:
    figure = sheets["position"][0]
    (ax,) = flat(figure)
    rests, checks = (np.array([path.get_extents().intervalx for path in boxes.get_paths()]) for boxes in ax.collections)
    t, stops = pouring.path.t, pouring.path.stops
    assert rests == pytest.approx(np.array([(t[s.start], t[s.stop - 1]) for s in stops]))
    assert checks == pytest.approx(np.array([(t[stops[3].start], t[stops[3].stop - 1])]))
    marked = {"at rest", "grip closes", "grip opens", "known place", "check"}
    assert named(figure) == {"x", "y", "z", "truth"} | marked


def test_the_papers_figures_are_named(sheets: dict[str, tuple[Figure, list[Drawn]]]) -> None:
    titles = " ".join(drawn.words for _, words in sheets.values() for drawn in words)
    found = re.findall(r"\(as the paper's figure (\d+)\)", titles)
    assert sorted(map(int, found)) == list(range(5, 11))


def test_the_field_is_drawn_where_there_is_a_magnetometer(pouring: DemoValues, still: DemoValues) -> None:
    assert set(figures.names(pouring)) - set(figures.names(still)) == {"field"}


# --- how they look ---

UNIT = re.compile(r"\((mm|cm|m|(mm|cm|m)/s|m/s²|\(m/s²\)²|°|µT|s|ms)\)$")
WITHOUT_UNIT = {"moves, by", "samples"}


def test_figures_are_legible(sheets: dict[str, tuple[Figure, list[Drawn]]]) -> None:
    for name, (figure, drawn) in sheets.items():
        assert overlaps(figure, drawn) == [], name
        for ax in figure.axes:
            label = ax.get_ylabel()
            assert UNIT.search(label) or label in WITHOUT_UNIT, (name, label)
        assert UNIT.search(figure.axes[-1].get_xlabel()), name


@pytest.mark.parametrize("name", ["summary", "path", "view-yz"])
def test_a_single_stop_is_legible(still: DemoValues, name: str) -> None:
    assert overlaps(figures.draw(name, still)) == []


@pytest.mark.filterwarnings("ignore:the grip closed at:pbd.errors.PbdWarning")
def test_a_grip_far_from_the_recording_leaves_the_axes_their_room() -> None:
    """Without room Matplotlib gives a warning, which would be an error here."""
    recording = pour().recording
    figures.draw("summary", demo_values(track(replace(recording, grip=(GripEvent(1000.0, True),)))))


def test_the_summarys_legend_names_the_truth_where_there_is_one(pouring: DemoValues, still: DemoValues) -> None:
    for demo in (pouring, still):
        words = {drawn.words for drawn in texts(figures.draw("summary", demo))}
        assert ({"truth", "error"} <= words) == (demo.truth is not None)


def test_without_a_truth_nothing_is_drawn_as_true(pouring: DemoValues, sheets: dict[str, Any]) -> None:
    for name, drawn in (("velocity", "truth"), ("motion", "truth"), ("sigma", "error")):
        without = figures.draw(name, replace(pouring, truth=None))
        assert named(sheets[name][0]) - named(without) == {drawn}


@uncalibrated
def test_a_crowd_is_legible() -> None:
    plot = demo_values(track(simulate(random_task(3, moves=21), "wt901", rate_hz=40.0)))
    assert len(plot.keyframes) > 20
    many = tuple(Finding(f"finding {i}: {HOSTILE}", ((i, i + 1.5),)) for i in range(9))
    for name in ("summary", "path", "view-yx"):
        assert overlaps(figures.draw(name, replace(plot, findings=many))) == [], name


def test_a_name_is_not_read_as_mathematics(still: DemoValues) -> None:
    (subtitle,) = (drawn.words for drawn in texts(figures.draw("position", still)) if drawn.words.startswith("a "))
    assert subtitle.replace(r"\$", "$").startswith(r"a $\frac{1}{ _^ b.cs…")
    assert plain_text(HOSTILE, 999).startswith(r"a \$\frac{1}{ _^ b.csv ? ??very long")
    assert plain_text("0123456789", 5) == "01…89"


@pytest.mark.parametrize(("format_name", "begin"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_the_same_plot_gives_the_same_bytes(still: DemoValues, format_name: str, begin: bytes) -> None:
    one, other = io.BytesIO(), io.BytesIO()
    for stream in (one, other):
        write(figures.draw("position", still), stream, format_name)
    assert one.getvalue() == other.getvalue()
    assert one.getvalue().startswith(begin)


def test_a_users_own_style_is_left_alone(pouring: DemoValues) -> None:
    with matplotlib.rc_context({"font.size": 30.0, "lines.linewidth": 9.0}):
        figure = figures.draw("position", pouring)
        assert matplotlib.rcParams["font.size"] == 30.0
        assert {line.get_linewidth() for line in figure.axes[0].get_lines() if str(line.get_label()) in "xyz"} == {1.1}


def test_no_window_can_open() -> None:
    for file in Path(str(pbd.plots.__file__)).parent.glob("*.py"):
        assert "import pyplot" not in file.read_text()
        assert "matplotlib.pyplot" not in file.read_text()


# Colours as the colour-blind see them, from Machado, Oliveira and Fernandes, "A Physiologically-based Model for
# Simulation of Color Vision Deficiency" (IEEE TVCG 15(6), 2009), severity 1, on linear RGB.
BLIND = {
    "none": np.eye(3).tolist(),
    "red": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "green": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "blue": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
XYZ_OF_RGB = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.072175], [0.0193339, 0.119192, 0.9503041]])  # fmt: skip # noqa: E501
AT_A_GLANCE = 10.0
"""Least CIE76 difference. 2.3 is just noticeable side by side."""


def lab(colour: str, seen: Array) -> Array:
    srgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    xyz = XYZ_OF_RGB @ np.clip(seen @ linear, 0.0, 1.0) / (0.95047, 1.0, 1.08883)
    f = np.where(xyz > (6.0 / 29.0) ** 3, np.cbrt(xyz), xyz * (29.0 / 6.0) ** 2 / 3.0 + 4.0 / 29.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("kind", BLIND)
def test_the_colour_blind_can_distinguish_all_colours(kind: str) -> None:
    for colours in (AXES_RGB, DEMOS_RGB):
        for one, other in combinations(colours, 2):
            difference = lab(one, np.array(BLIND[kind])) - lab(other, np.array(BLIND[kind]))
            assert np.linalg.norm(difference) > AT_A_GLANCE, (one, other)


def test_the_names_of_the_axes_cover_no_number_of_a_straight_path() -> None:
    waypoints = (Waypoint(rest_s=1.0), *(Waypoint((0.05 * k, 0.0, 0.0), move_s=0.8, rest_s=0.5) for k in range(1, 8)))
    assert overlaps(figures.draw("path", demo_values(track(simulate(Task("straight", waypoints)))))) == []


def test_a_keyframe_that_was_moved_far_is_in_the_view(pouring: DemoValues) -> None:
    *others, last = pouring.keyframes
    away = replace(last, T_nav_sensor=Pose(np.array([0.1, 2.0, 0.5]), last.T_nav_sensor.wxyz))
    ax = figures.draw("view-yx", replace(pouring, keyframes=(*others, away))).axes[0]
    assert ax.get_xlabel() == "y in nav (m)"
    assert max(ax.get_xlim()) > 2.0
    lost = replace(last, cov=1e12 * np.eye(6))  # 40 GB, if followed beyond the view
    assert figures.draw("view-yx", replace(pouring, keyframes=(*others, lost))).axes[0].texts


def test_a_number_stands_beside_a_line_between_two_samples() -> None:
    ax = Figure().subplots()
    label_keyframes(ax, np.array([[0.5, 0.5]]), [np.array([[0.5, 0.5], [1.0, 1.0]])])
    x, y = ax.texts[0].xyann  # type: ignore[attr-defined]
    assert not (x > 0.0 and y > 0.0)


def test_a_number_without_room_is_left_out(pouring: DemoValues) -> None:
    first, second, *rest = pouring.keyframes
    crowded = replace(pouring, keyframes=(first, replace(second, t=first.t + 0.02), *rest))
    shown = [drawn.words for drawn in texts(figures.draw("attitude", crowded))]
    assert "1" not in shown
    assert {"0", "2"} <= {*shown}
    figure = Figure(figsize=(0.4, 0.4))
    ax = figure.subplots()
    label_keyframes(ax, np.array([[0.5, 0.5]]), [np.array([[0.0, 0.0], [1.0, 1.0]])])
    assert len(ax.texts) == 0
