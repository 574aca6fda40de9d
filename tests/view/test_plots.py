"""Plots show what was tracked, legibly: the data of their lines, their labels, and that nothing lies on anything."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D

import pbd.view
from pbd.data import Calibration, Demonstration, Linear, SensorErrors, Truth
from pbd.pipeline import track
from pbd.plotting.demo import demo_plot
from pbd.pose import Array, quat_about_z, quat_multiply, quat_rotate, quat_to_rpy
from pbd.simulation.hand import Waypoint
from pbd.simulation.simulate import random_task, simulate
from pbd.simulation.tasks import Task
from pbd.tracking.paper import LAMBDA_V, paper_path
from pbd.tracking.preintegration import integral_of_means
from pbd.view import plots
from pbd.view.plot_style import _joined, write
from pbd.view.plot_values import DemoPlot, Finding
from tests.scenarios import pour, uncalibrated
from tests.view.drawn import Drawn, overlaps, texts

HOSTILE = r"a $\frac{1}{ _^ b.csv 茶 " + "\n\x07" + "very long " * 20
"""Names are a person's: mathematics, signs that the font lacks, control characters, more than there is room for."""


def plot_of(demo: Demonstration, method: str = "default") -> DemoPlot:
    return demo_plot(track(demo, method))


def with_truth(plot: DemoPlot, truth: Truth) -> DemoPlot:
    """The same path, with another truth to compare it with."""
    tracking = plot.path.tracking
    assert tracking is not None
    return demo_plot(replace(plot.path, tracking=replace(tracking, demo=replace(tracking.demo, truth=truth))))


@pytest.fixture(scope="module")
def pouring() -> DemoPlot:
    """Everything at once: grip, magnetometer, truth, a known place."""
    return plot_of(pour())


@pytest.fixture(scope="module")
def paper() -> DemoPlot:
    with pytest.warns(match="at the end of the range"):  # the hand rolls faster than this gyro can tell
        return plot_of(simulate("pick-and-place-stops", "os5000"), "paper")


@pytest.fixture(scope="module")
def calibrated() -> DemoPlot:
    """A sensor that reads 4 % too little, with a calibration that knows it."""
    demo = pour()
    light = replace(demo, recording=replace(demo.recording, acc=0.96 * demo.recording.acc))
    acc = Linear(np.zeros(3), np.eye(3) / 0.96, np.zeros(3))
    return demo_plot(track(light, calibration=Calibration("bench", sensor=SensorErrors("unknown", acc=acc))))


@pytest.fixture(scope="module")
def still() -> DemoPlot:
    """One stop, no magnetometer, no truth, a name that nothing must trip over."""
    demo = simulate(Task("still", (Waypoint(rest_s=1.3),)), "modern")
    info = replace(demo.recording.info, name=HOSTILE, sensor=HOSTILE)
    return plot_of(replace(demo, recording=replace(demo.recording, mag=None, info=info), truth=None))


@pytest.fixture(scope="module")
def many() -> DemoPlot:
    """More stops than numbers have room for, more findings than the sheet."""
    plot = plot_of(simulate(random_task(3, moves=40), "wt901"))
    return replace(plot, findings=tuple(Finding(f"finding {i}: {HOSTILE}", ((i, i + 1.5),)) for i in range(9)))


@pytest.fixture(scope="module")
def sheets(pouring: DemoPlot) -> dict[str, tuple[Figure, list[Drawn]]]:
    """All figures of `pouring`, and what was written into each."""
    figures = {name: plots.draw(name, pouring) for name in plots.names(pouring)}
    return {name: (figure, texts(figure)) for name, figure in figures.items()}


def lines(ax: Axes) -> dict[str, Array]:
    """The points (n, 2) of an axes' lines, by their labels."""
    return {str(line.get_label()): np.asarray(line.get_xydata()) for line in ax.get_lines()}


def axes_of(figure: Figure) -> list[Axes]:
    return [ax for ax in figure.axes if not isinstance(ax, Axes3D)]


# --- the values ---


def test_what_is_drawn_is_calibrated(pouring: DemoPlot, calibrated: DemoPlot) -> None:
    assert calibrated.gravity == pytest.approx(pouring.gravity)
    assert calibrated.acc_sensor == pytest.approx(pouring.acc_sensor)
    assert calibrated.a_nav == pytest.approx(pouring.a_nav, abs=0.02)  # m/s2: what may be wrong with it is less


@pytest.mark.parametrize("name", ["pouring", "paper", "calibrated"])
def test_the_acceleration_is_the_one_that_was_integrated(name: str, request: pytest.FixtureRequest) -> None:
    plot: DemoPlot = request.getfixturevalue(name)
    path = plot.path
    if plot.method == "paper":
        _, v_nav, closure = paper_path(path.t, plot.a_nav, path.stops)
        assert v_nav == pytest.approx(path.v_nav_sensor, abs=1e-12)
    else:
        v = integral_of_means(path.t, plot.a_nav)
        closure = np.array([v[after.start] - v[before.stop - 1] for before, after in pairwise(path.stops)])
    assert closure == pytest.approx(path.closure, abs=1e-12)


def test_equations_7_to_9(paper: DemoPlot) -> None:
    resulting = [float(np.sqrt(a @ a)) for a in paper.a_nav]
    assert paper.resulting == pytest.approx(resulting)
    pairs = [np.var([before, own]) for before, own in zip([resulting[0], *resulting], resulting, strict=False)]
    assert paper.variance == pytest.approx(pairs)
    assert paper.paper_stops == paper.path.stops


def test_sigma_is_that_of_each_stop_and_grows_in_between(pouring: DemoPlot) -> None:
    path = replace(pouring.path, claims=())
    for k, stop in enumerate(path.stops):
        rows = slice(stop.start, stop.stop)
        expected = np.sqrt(np.diagonal(path.cov[k]))
        sigma = np.hstack((pouring.sigma_p[rows], pouring.sigma_turn[rows]))
        assert sigma == pytest.approx(np.tile(expected, (stop.stop - stop.start, 1)), abs=1e-12)
    first, second = path.stops[:2]
    assert (np.diff(pouring.sigma_p[first.stop : second.start, 0]) > 0.0).all()


def test_nothing_is_claimed_before_the_first_stop_and_after_the_last() -> None:
    demo = simulate(Task("cut", (Waypoint(rest_s=2.0), Waypoint((0.2, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, 1.5))), "modern")
    short = demo.recording.t < 2.9  # the move is cut off
    recording = replace(
        demo.recording, t=demo.recording.t[short], acc=demo.recording.acc[short], gyr=None, mag=None,
        device_rpy=np.zeros((int(np.count_nonzero(short)), 3)),
    )  # fmt: skip
    with pytest.warns(match="the hand moves when the recording ends"):
        plot = plot_of(replace(demo, recording=recording))
    end = plot.path.stops[-1].stop
    assert end < len(recording)
    assert np.isnan(plot.sigma_p[end:]).all()
    assert np.isfinite(plot.sigma_p[plot.tracked]).all()


@pytest.mark.parametrize("yaw", [0.0, 2.0, -3.0])
def test_the_truth_is_laid_on_the_first_stop_wherever_it_was_measured(pouring: DemoPlot, yaw: float) -> None:
    demo = pour()
    assert demo.truth is not None
    assert pouring.truth is not None
    turn, shift = quat_about_z(yaw), np.array([3.0, -2.0, 1.0])
    elsewhere = Truth(
        demo.truth.t,
        quat_rotate(turn, demo.truth.p_nav_sensor) + shift,
        quat_multiply(turn, demo.truth.wxyz_nav_sensor),
    )
    moved = with_truth(pouring, elsewhere).truth
    assert moved is not None
    for field in ("p_nav_sensor", "v_nav_sensor", "rpy_nav_sensor", "error"):
        assert getattr(moved, field) == pytest.approx(getattr(pouring.truth, field), abs=1e-9)
    assert np.linalg.norm(moved.error, axis=1).max() < 0.01
    assert np.degrees(np.abs(moved.rpy_nav_sensor - pouring.rpy_nav_sensor)).max() < 2.0


def test_a_truth_with_holes_leaves_holes(pouring: DemoPlot) -> None:
    demo = pour()
    assert demo.truth is not None
    hole = (demo.truth.t > 6.0) & (demo.truth.t < 7.0)
    p, wxyz = demo.truth.p_nav_sensor.copy(), demo.truth.wxyz_nav_sensor.copy()
    p[hole], wxyz[hole] = np.nan, np.nan
    truth = with_truth(pouring, replace(demo.truth, p_nav_sensor=p, wxyz_nav_sensor=wxyz)).truth
    assert truth is not None
    assert pouring.truth is not None
    assert np.isnan(truth.error[hole]).all()
    away = np.isfinite(truth.error).all(axis=1)
    assert np.mean(away) > 0.9
    assert truth.error[away] == pytest.approx(pouring.truth.error[away])


def test_a_truth_that_does_not_know_the_first_stop_is_left_out(pouring: DemoPlot) -> None:
    demo = pour()
    assert demo.truth is not None
    late = demo.truth.t > 5.0
    truth = Truth(demo.truth.t[late], demo.truth.p_nav_sensor[late], demo.truth.wxyz_nav_sensor[late])
    assert with_truth(pouring, truth).truth is None


def test_a_magnet_near_the_hand_shows_in_the_field() -> None:
    demo = pour("ideal")
    assert demo.recording.mag is not None
    mag = demo.recording.mag.copy()
    near = (demo.recording.t > 12.0) & (demo.recording.t < 12.5)
    mag[near] *= 1.1
    plot = plot_of(replace(demo, recording=replace(demo.recording, mag=mag)))
    assert plot.field is not None
    assert plot.field.strength[near] == pytest.approx(1.1 * plot.field.rest_strength, rel=1e-3)
    assert plot.field.strength[~near] == pytest.approx(plot.field.rest_strength, rel=1e-3)
    assert np.degrees(plot.field.rest_dip) == pytest.approx(66.1, abs=0.1)  # of the simulated world: atan(44 / 19.5)
    assert dict(plot.facts)["magnetic field"].startswith("48 µT ± 10 %, dip")


@pytest.mark.parametrize("rate_hz", [40.0, 286.0])
def test_the_true_velocity_is_no_noise_of_the_optics(pouring: DemoPlot, rate_hz: float) -> None:
    """Half a millimetre of noise, 286 times a second, is 10 cm/s from one sample to the next."""
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 20.0, 1.0 / rate_hz) + 1e-3 * rng.uniform(size=round(20.0 * rate_hz))
    straight = np.outer(t, (0.3, -0.2, 0.1))
    for noise, bound in ((0.0, 1e-9), (0.0005, 0.03)):
        p = straight + noise * rng.normal(size=straight.shape)
        truth = Truth(t, p, np.tile((1.0, 0.0, 0.0, 0.0), (len(t), 1)))
        plot = with_truth(pouring, truth)
        assert plot.truth is not None
        speed = np.linalg.norm(plot.truth.v_nav_sensor, axis=1)
        assert np.sqrt(np.mean((speed - np.linalg.norm((0.3, -0.2, 0.1))) ** 2)) < bound


# --- the figures show them ---


def test_lines_are_the_trackers_values(pouring: DemoPlot) -> None:
    path, rows = pouring.path, pouring.tracked
    (ax,) = axes_of(plots.draw("position", pouring))
    for axis, name in enumerate("xyz"):
        assert lines(ax)[name] == pytest.approx(np.column_stack((path.t, 100.0 * path.p_nav_sensor[:, axis]))[rows])
    (ax,) = axes_of(plots.draw("attitude", pouring))
    rpy = np.degrees(quat_to_rpy(path.wxyz_nav_sensor))  # no angle of this task comes near a half turn
    for axis, name in enumerate(("roll", "pitch", "yaw")):
        assert lines(ax)[name][:, 1] == pytest.approx(rpy[:, axis])
    upper, lower = axes_of(plots.draw("velocity", pouring))
    assert lines(upper)["y"][:, 1] == pytest.approx(100.0 * path.v_nav_sensor[rows, 1])
    assert lines(lower)["z"][:, 1] == pytest.approx(1e3 * path.closure[:, 2])
    upper, lower = axes_of(plots.draw("gravity", pouring))
    assert lines(upper)["z"][:, 1] == pytest.approx(pour().recording.acc[:, 2])
    assert lines(lower)["x"][:, 1] == pytest.approx(pouring.a_nav[:, 0])
    (ax,) = axes_of(plots.draw("resulting-acceleration", pouring))
    assert lines(ax)["resulting\nacceleration"][:, 1] == pytest.approx(pouring.resulting)
    (ax,) = axes_of(plots.draw("variance", pouring))
    assert lines(ax)["$\\lambda_v$ = 0.01"][:, 1] == pytest.approx(LAMBDA_V)


def test_the_path_in_space_and_its_triads(pouring: DemoPlot) -> None:
    figure = plots.draw("path", pouring)
    (ax,) = figure.axes
    assert isinstance(ax, Axes3D)
    drawn = [np.column_stack(line.get_data_3d()) for line in ax.get_lines()]
    path = 100.0 * pouring.path.p_nav_sensor[pouring.tracked]
    assert any(line.shape == path.shape and np.allclose(line, path) for line in drawn)
    keyframe = pouring.keyframes[5]  # the hand is rolled there
    origin = 100.0 * keyframe.T_nav_sensor.p
    strokes = {str(line.get_label()): np.column_stack(line.get_data_3d()) for line in ax.get_lines()}
    length = np.linalg.norm(np.diff(strokes["sensor's z"][:2], axis=0))
    for k, name in enumerate("xyz"):
        begins, ends, gaps = strokes[f"sensor's {name}"].reshape(-1, 3, 3).swapaxes(0, 1)
        assert np.isnan(gaps).all()
        assert len(begins) == len(pouring.keyframes)
        assert begins[5] == pytest.approx(origin)
        assert ends[5] - begins[5] == pytest.approx(length * quat_rotate(keyframe.T_nav_sensor.wxyz, np.eye(3)[k]))


@pytest.mark.parametrize(("name", "across", "up"), [("view-yx", 1, 0), ("view-yz", 1, 2)])
def test_views_have_one_scale_and_are_no_mirror_image(pouring: DemoPlot, name: str, across: int, up: int) -> None:
    (ax,) = axes_of(plots.draw(name, pouring))
    path = 100.0 * pouring.path.p_nav_sensor[pouring.tracked]
    assert lines(ax)["path"] == pytest.approx(path[:, [across, up]])
    per_unit = ax.transData.transform([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    right, upwards = per_unit[1] - per_unit[0], per_unit[2] - per_unit[0]
    assert right == pytest.approx((-upwards[1], 0.0))  # y to the left, as large as what is up
    assert upwards[1] > 0.0


def test_every_keyframe_is_numbered(pouring: DemoPlot, sheets: dict[str, tuple[Figure, list[Drawn]]]) -> None:
    numbers = {str(k) for k in range(len(pouring.keyframes))}
    assert numbers <= {drawn.words for drawn in sheets["velocity"][1]}
    for name in ("path", "view-yx", "view-yz"):
        labels = [drawn.words for drawn in sheets[name][1] if re.fullmatch(r"[\d–, ]+", drawn.words)]
        spans = [span.split("–") for label in labels for span in label.split(", ")]
        assert numbers <= {str(k) for span in spans for k in range(int(span[0]), int(span[-1]) + 1)}


def test_rests_and_grip_are_marked(pouring: DemoPlot) -> None:
    (ax,) = axes_of(plots.draw("position", pouring))
    boxes = [path.get_extents().intervalx for path in ax.collections[0].get_paths()]
    t = pouring.path.t
    assert np.array(boxes) == pytest.approx(np.array([(t[s.start], t[s.stop - 1]) for s in pouring.path.stops]))
    shown = {text.get_text() for text in ax.get_legend().get_texts()}  # type: ignore[union-attr]
    assert shown == {"x", "y", "z", "truth", "at rest", "grip closes", "grip opens", "known place"}


def test_findings_are_highlighted_once(pouring: DemoPlot) -> None:
    spans = ((2.0, 5.0), (4.0, 6.0), (9.0, 9.0))
    plot = replace(pouring, findings=(Finding("one", spans[:2]), Finding("two", spans[2:]), Finding("no time")))
    (ax,) = axes_of(plots.draw("position", plot))
    begin, end = np.array([path.get_extents().intervalx for path in ax.collections[1].get_paths()]).T
    assert begin == pytest.approx([2.0, 9.0], abs=0.1)
    assert end == pytest.approx([6.0, 9.0], abs=0.1)
    assert end[1] - begin[1] > 0.05  # wide enough to be seen
    shown = {text.get_text() for text in ax.get_legend().get_texts()}  # type: ignore[union-attr]
    assert "check" in shown


@pytest.mark.parametrize("name", ["view-yx", "view-yz"])
@pytest.mark.parametrize(("sigma_m", "label"), [(0.01, "2 σ"), (5.0, "2 σ, some\nbeyond the edge")])
def test_what_is_not_known_does_not_hide_what_is(pouring: DemoPlot, name: str, sigma_m: float, label: str) -> None:
    keyframes = tuple(replace(keyframe, cov=sigma_m**2 * np.eye(6)) for keyframe in pouring.keyframes)
    (ax,) = axes_of(plots.draw(name, replace(pouring, keyframes=keyframes)))
    path = lines(ax)["path"]
    seen = np.array([ax.get_xlim(), ax.get_ylim()])
    assert np.ptp(path, axis=0).max() > 0.3 * np.abs(np.diff(seen, axis=1)).min()
    assert label in lines(ax)


@settings(max_examples=50)
@given(st.lists(st.tuples(st.floats(0.0, 9.0), st.floats(0.0, 5.0)), max_size=8), st.floats(0.0, 14.0))
def test_joined_spans_cover_the_same_once(pieces: list[tuple[float, float]], at: float) -> None:
    spans = [(begin, begin + lasts) for begin, lasts in pieces]
    joined = _joined(spans)
    assert any(a <= at <= b for a, b in joined) == any(a <= at <= b for a, b in spans)
    assert all(one[1] < other[0] for one, other in pairwise(joined))


def test_the_papers_figures_are_named(paper: DemoPlot) -> None:
    wanted = {f"(as the paper's figure {number})" for number in range(5, 11)}
    titles = " ".join(plots.draw(name, paper).texts[0].get_text() for name in plots.names(paper) if name != "summary")
    assert wanted == set(re.findall(r"\(as the paper's figure \d+\)", titles))


# --- how they look ---

UNIT = re.compile(r"\((mm|cm|m|(mm|cm|m)/s|m/s²|\(m/s²\)²|°|µT|s|ms)\)$")
WITHOUT_UNIT = {"moves, by", "samples"}


def test_figures_are_legible(sheets: dict[str, tuple[Figure, list[Drawn]]]) -> None:
    for name, (figure, drawn) in sheets.items():
        assert overlaps(figure, drawn) == [], name
        flat = axes_of(figure)
        for ax in flat:
            label = ax.get_ylabel()
            assert UNIT.search(label) or label in WITHOUT_UNIT, (name, label)
        assert all(UNIT.search(ax.get_xlabel()) for ax in flat if ax.xaxis.get_tick_params()["labelbottom"]), name
        for ax in figure.axes:
            if isinstance(ax, Axes3D):
                said = {text.get_text() for text in ax.texts}
                assert sum(bool(UNIT.search(text)) for text in said) == 3


@pytest.mark.parametrize("figure_name", ["summary", "path", "view-yz", "motion", "gravity", "velocity"])
def test_a_single_stop_is_legible(still: DemoPlot, figure_name: str) -> None:
    assert overlaps(plots.draw(figure_name, still)) == []


@pytest.mark.parametrize("figure_name", ["path", "motion"])
def test_the_papers_method_is_legible(paper: DemoPlot, figure_name: str) -> None:
    assert overlaps(plots.draw(figure_name, paper)) == []


@uncalibrated
@pytest.mark.parametrize("figure_name", ["summary", "path", "view-yx"])
def test_a_crowd_is_legible(many: DemoPlot, figure_name: str) -> None:
    assert len(many.keyframes) > 35
    assert overlaps(plots.draw(figure_name, many)) == []


def test_the_field_is_drawn_where_there_is_a_magnetometer(pouring: DemoPlot, still: DemoPlot) -> None:
    assert set(plots.names(pouring)) - set(plots.names(still)) == {"field"}


def test_a_name_is_no_mathematics(still: DemoPlot) -> None:
    words = texts(plots.draw("position", still))
    (subtitle,) = (drawn.words for drawn in words if drawn.words.startswith("a $"))
    assert subtitle.startswith(r"a $\frac{1}{ _^ b.csv ? ??very long")


Written = Callable[[str], bytes]


@pytest.fixture
def written(pouring: DemoPlot) -> Written:
    def write_one(format_name: str) -> bytes:
        stream = io.BytesIO()
        write(plots.draw("position", pouring), stream, format_name)
        return stream.getvalue()

    return write_one


@pytest.mark.parametrize(("format_name", "begin"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_the_same_plot_gives_the_same_bytes(written: Written, format_name: str, begin: bytes) -> None:
    first = written(format_name)
    assert first.startswith(begin)
    assert first == written(format_name)


def test_a_users_own_style_is_left_alone(pouring: DemoPlot) -> None:
    with matplotlib.rc_context({"font.size": 30.0, "lines.linewidth": 9.0}):
        figure = plots.draw("position", pouring)
        assert matplotlib.rcParams["font.size"] == 30.0
        assert overlaps(figure) == []
        assert {line.get_linewidth() for line in figure.axes[0].get_lines() if str(line.get_label()) in "xyz"} == {1.1}


def test_no_window_can_open() -> None:
    folder = Path(str(pbd.view.__file__)).parent
    assert not [
        file.name for file in folder.glob("*plot*.py") if "pyplot" in file.read_text().replace("without pyplot", "")
    ]
