"""Several demonstrations of one task: aligned, their keyframes matched, the spread computed and shown."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from pbd.data import FusedTake, Fusion, HandPath, Keyframe
from pbd.data.covariance import PoseCovariance
from pbd.pipeline import track
from pbd.plots.compare import Comparison, Tracked, compare, spread_rows, spread_table
from pbd.plots.compare_figures import COMPARISONS, FUSION_FIGURES, MAX_NAMED, _legend_entries, _line
from pbd.plots.style import INK, style
from pbd.pose import Array, Pose, quat_about_z, quat_multiply, quat_rotate, quat_to_matrix
from pbd.tracking.keyframes import find_keyframes
from pbd.view.units import Units, parse_units
from tests.plots.drawn_texts import overlaps
from tests.scenarios import pour, uncalibrated

pytestmark = uncalibrated


@pytest.fixture(scope="module")
def tracked() -> list[Tracked]:
    found: list[Tracked] = []
    for seed in range(3):
        path = track(pour("wt901", seed).recording)
        found.append((f"tea {seed}", path, find_keyframes(path)))
    return found


def elsewhere(tracked: Tracked, yaw: float, shift: Array) -> Tracked:
    """The same demonstration in another nav."""
    name, path, keyframes = tracked
    T = Pose(shift, quat_about_z(yaw))
    R6 = np.kron(np.eye(2), quat_to_matrix(T.wxyz))
    moved = replace(
        path,
        p_nav_sensor=T.act(path.p_nav_sensor),
        v_nav_sensor=quat_rotate(T.wxyz, path.v_nav_sensor),
        wxyz_nav_sensor=quat_multiply(T.wxyz, path.wxyz_nav_sensor),
        covariance=PoseCovariance.chained(R6 @ path.cov @ R6.T),
    )
    turned = [replace(k, T_nav_sensor=T @ k.T_nav_sensor, cov=R6 @ k.cov @ R6.T) for k in keyframes]
    return name, moved, turned


def without(tracked: Tracked, *numbers: int) -> Tracked:
    """The same demonstration without some of its keyframes."""
    name, path, keyframes = tracked
    return name, path, [keyframe for k, keyframe in enumerate(keyframes) if k not in numbers]


# --- aligned ---


def test_a_demonstration_in_another_nav_is_aligned_with_itself(tracked: list[Tracked]) -> None:
    plot = compare([tracked[0], elsewhere(tracked[0], 2.5, np.array([1.0, -2.0, 0.5]))])
    one, other = plot.demos
    assert other.p == pytest.approx(one.p, abs=1e-9)
    for keyframe in plot.keyframes:
        assert keyframe.spread == pytest.approx(0.0, abs=1e-9)
        assert keyframe.turn == pytest.approx(0.0, abs=1e-7)


def test_spread_is_the_standard_deviation(tracked: list[Tracked]) -> None:
    plot = compare(tracked)
    assert plot.by_order
    assert plot.remarks == ()
    at = np.array([plot.positions(demo) for demo in range(3)])
    for k, keyframe in enumerate(plot.keyframes):
        assert keyframe.p == pytest.approx(at[:, k].mean(axis=0))
        assert keyframe.spread == pytest.approx(np.std(at[:, k], axis=0, ddof=1))
        away = np.linalg.norm(at[:, k] - keyframe.p, axis=1)
        assert keyframe.furthest_m == pytest.approx(away.max())
        assert keyframe.furthest_m == pytest.approx(away[keyframe.furthest])
    assert plot.keyframes[0].spread == pytest.approx(0.0, abs=1e-12)


def test_a_turned_hand_gives_the_spread_of_the_attitude(tracked: list[Tracked]) -> None:
    name, path, keyframes = tracked[0]
    turn = np.radians(10.0)
    rolled = [*keyframes]
    rolled[4] = replace(keyframes[4], T_nav_sensor=keyframes[4].T_nav_sensor @ Pose.from_rpy(np.zeros(3), (turn, 0, 0)))
    plot = compare([tracked[0], (name, path, rolled)])
    # Two attitudes 10 degrees apart: each is 5 from the mean, divided by n - 1 = 1.
    assert np.degrees(plot.keyframes[4].turn) == pytest.approx(np.sqrt(2.0) * 5.0, rel=1e-6)
    assert plot.keyframes[5].turn == pytest.approx(0.0, abs=1e-7)


def test_progress_counts_keyframes(tracked: list[Tracked]) -> None:
    plot = compare(tracked)
    for (_, path, keyframes), demo in zip(tracked, plot.demos, strict=True):
        t = path.t[path.stops[0].start : path.stops[-1].stop]
        for k, keyframe in enumerate(keyframes):
            assert demo.progress[np.argmin(np.abs(t - keyframe.t))] == pytest.approx(k)
        inside = demo.progress[np.isfinite(demo.progress)]
        assert len(inside) >= len(t) - 2
        assert (np.diff(inside) >= 0.0).all()


# --- matched ---


def test_a_missing_and_an_extra_stop_are_reported(tracked: list[Tracked]) -> None:
    plot = compare([tracked[0], without(tracked[1], 4), tracked[2]])
    assert not plot.by_order
    assert len(plot.keyframes) == 11
    assert [keyframe.own[1] for keyframe in plot.keyframes] == [0, 1, 2, 3, None, 4, 5, 6, 7, 8, 9]
    at = tracked[0][2][4].t
    assert plot.remarks == (f"tea 1 has no keyframe 4 ({at:.1f} s in tea 0)",)
    assert plot.keyframes[4].count == 2
    assert np.isnan(plot.positions(1)[4]).all()

    plot = compare([tracked[0], without(tracked[1], 4), without(tracked[2], 4)])
    assert len(plot.keyframes) == 10  # the most frequent number
    assert plot.remarks == (f"tea 0 has one more stop, its keyframe 4 ({at:.1f} s): left out",)
    plot = compare([*(without(each, 4, 6) for each in tracked[:2]), tracked[2]])
    assert re.fullmatch(
        r"tea 2 has 2 more stops, its keyframes 4 \([\d.]+ s\), 6 \([\d.]+ s\): left out", plot.remarks[0]
    )


def test_a_sensor_turned_in_the_hand_is_said(tracked: list[Tracked]) -> None:
    name, path, keyframes = tracked[1]
    quarter = Pose.from_rpy(np.zeros(3), (0.0, 0.0, 0.5 * np.pi))
    turned = name, path, [replace(each, T_nav_sensor=each.T_nav_sensor @ quarter) for each in keyframes]
    assert compare(tracked).remarks == ()
    (remark,) = compare([tracked[0], turned, tracked[2]]).remarks
    assert "turned in the hand: tea 1 by 90 degrees;" in remark


# --- shown ---


@pytest.fixture(scope="module")
def compared(tracked: list[Tracked]) -> Comparison:
    """Equal and overlong names, more demonstrations than colours, one of them without a stop."""
    names = ("tea", "a $ name that is longer than any legend", "茶")
    more: Sequence[tuple[str, HandPath, Sequence[Keyframe]]] = [
        (names[k % 3], *without(tracked[k % 3], *([4] if k == 3 else []))[1:]) for k in range(8)
    ]
    return compare(more)


def draw_comparison(name: str, comparison: Comparison) -> Figure:
    with style():
        return COMPARISONS[name](comparison)


@pytest.mark.parametrize("name", COMPARISONS)
def test_comparisons_are_legible(compared: Comparison, name: str) -> None:
    figure = draw_comparison(name, compared)
    assert overlaps(figure) == []
    for ax in figure.axes:
        if name != "paths":
            assert ax.get_ylabel().endswith(")")


@pytest.mark.parametrize("name", [name for name in COMPARISONS if name != "spread"])
def test_the_legend_names_each_demonstration(tracked: list[Tracked], name: str) -> None:
    (legend,) = draw_comparison(name, compare(tracked)).legends
    assert {text.get_text() for text in legend.get_texts()} >= {"tea 0", "tea 1", "tea 2"}


def test_paths_are_drawn_as_they_are(tracked: list[Tracked]) -> None:
    plot = compare(tracked)
    axes = draw_comparison("positions", plot).axes
    for axis, ax in enumerate(axes):
        for demo, drawn in zip(plot.demos, ax.get_lines()[::2], strict=True):
            assert np.asarray(drawn.get_xydata()) == pytest.approx(
                np.column_stack((demo.progress, 100.0 * demo.p[:, axis])), nan_ok=True
            )
    spread = draw_comparison("spread", plot).axes[0]
    bars, unit = spread.patches, 1e3 if "(mm)" in spread.get_ylabel() else 100.0
    heights = np.array([bar.get_height() for bar in bars]).reshape(3, -1)  # type: ignore[attr-defined]
    spreads = unit * np.array([keyframe.spread for keyframe in plot.keyframes]).T
    assert heights == pytest.approx(spreads.round(6))  # as they are drawn
    middles = np.array([bar.get_x() + 0.5 * bar.get_width() for bar in bars])  # type: ignore[attr-defined]
    assert middles.reshape(3, -1).mean(axis=0) == pytest.approx(np.arange(len(plot.keyframes)))


def test_the_table_and_the_rows_say_the_same(compared: Comparison) -> None:
    rows = spread_rows(compared)
    for unit, scale, half in (("cm", 100.0, 0.0051), ("mm", 1000.0, 0.051), ("m", 1.0, 0.000051)):
        table = spread_table(compared, parse_units(unit))
        assert table.row_count == len(rows) == 11
        cells = {str(column.header): list(column.cells) for column in table.columns}
        assert cells["in (of 8)"][4] == "7"
        for k, row in enumerate(rows):
            for i, axis in enumerate("xyz"):
                assert float(str(cells[f"{axis} ({unit})"][k])) == pytest.approx(
                    scale * row["position_m"][i], abs=10.0 * half
                )
                spread = float(str(cells[f"spread {axis} ({unit})"][k]))
                assert spread == pytest.approx(scale * row["spread_m"][i], abs=half)
            assert float(str(cells["spread (°)"][k])) == pytest.approx(row["spread_deg"], abs=0.051)
            assert float(str(cells[f"σ ({unit})"][k])) == pytest.approx(scale * max(row["sigma_m"]), abs=half)
            if row["furthest_m"] > 0.0:
                assert cells["which"][k] == row["furthest"]
                assert float(str(cells[f"furthest ({unit})"][k])) == pytest.approx(scale * row["furthest_m"], abs=half)


def test_a_single_demonstration_has_no_spread(tracked: list[Tracked]) -> None:
    # Ten keyframes are the most frequent number of three demonstrations; of two, the larger number counts.
    short = [without(tracked[k], 4) for k in (0, 1)]
    plot = compare([*short, tracked[2]])
    assert len(plot.keyframes) == 10
    plot = compare([short[0], tracked[2]])
    assert plot.keyframes[4].count == 1
    assert np.isnan(spread_rows(plot)[4]["spread_m"]).all()
    assert spread_rows(plot)[4]["keyframes"] == [None, 4]
    cells = [str(list(column.cells)[4]) for column in spread_table(plot, Units()).columns]
    assert cells[1] == "1"
    assert [cell == "" for cell in cells[5:]] == [True, True, True, True, False, True, True]  # only sigma is known
    assert overlaps(draw_comparison("spread", plot)) == []
    ellipses = [sum(line.get_color() == INK for line in ax.lines) for ax in draw_comparison("views", plot).axes[:2]]
    assert ellipses == [sum(keyframe.count > 1 for keyframe in plot.keyframes)] * 2


def test_a_crowd_of_demonstrations_is_counted(tracked: list[Tracked]) -> None:
    plot = compare([tracked[0]] * (MAX_NAMED + 3))
    assert [label.get_label() for label in _legend_entries(plot)][-2:] == [plot.demos[MAX_NAMED - 1].name, "and 3 more"]


def test_ten_takes_look_different() -> None:
    """There are six colours: from the seventh take on the marker tells them apart."""
    takes = tuple(FusedTake(f"run{i}", (0, 1), np.zeros((2, 3)), np.zeros(2)) for i in range(10))
    fusion = Fusion(takes, np.zeros((2, 3)), np.zeros(2), np.zeros((2, 4)), (0.0, 0.0), (0.0, 0.0))
    figure = FUSION_FIGURES["match"](fusion)
    looks = {(line.get_color(), line.get_marker()) for line in figure.axes[0].lines if line.get_marker() != "x"}
    assert len(looks) == 10
    assert {float(tick) % 1.0 for tick in figure.axes[-1].get_xticks()} == {0.0}


def test_demonstrations_look_different_and_a_few_do_in_grey() -> None:
    looks = [_line(k) for k in range(30)]
    assert len({str(look) for look in looks}) == 30
    assert len({str(look["linestyle"]) for look in looks[:5]}) == 5
