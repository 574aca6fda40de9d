"""Findings of the summary: present where a problem is, absent where there is none."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbd.data import Demonstration, HandPath, Known, Stop
from pbd.data.covariance import PoseCovariance
from pbd.pipeline import track
from pbd.plots.demo_values import DemoValues, demo_values
from pbd.plots.findings import (
    DRIFT_M_S2,
    FIRST_REST_S,
    SHORT_STOP_S,
    TREMBLE_S,
    UNSURE_MOVE_M,
    Finding,
    find_problems,
    length_text,
    stop_names,
)
from pbd.pose import Array
from pbd.simulation.hand_motion import Waypoint, minimum_jerk
from pbd.simulation.simulate import TASKS, simulate
from pbd.simulation.tasks import Task
from tests.scenarios import pour

HZ = 100.0


def plot_of(demo: Demonstration) -> DemoValues:
    return demo_values(track(demo, known=Known()))


@pytest.fixture(scope="module")
def pouring() -> DemoValues:
    return plot_of(pour())


def findings_of(plot: DemoValues, path: HandPath | None = None, *remarks: str) -> tuple[Finding, ...]:
    path = path or plot.path
    error = None if plot.truth is None else plot.truth.error
    return find_problems(path, stop_names(path, plot.keyframes), plot.tracking.a_nav, error, remarks)


def with_dwells(path: HandPath, **dwells: float) -> HandPath:
    stops = [replace(stop, dwell_s=dwells.get(f"k{k}", stop.dwell_s)) for k, stop in enumerate(path.stops)]
    return replace(path, stops=tuple(stops))


def test_a_good_demonstration_has_no_findings(pouring: DemoValues) -> None:
    assert pouring.findings == ()
    assert findings_of(pouring, None, "told before") == (Finding("told before"),)


def test_short_stops(pouring: DemoValues) -> None:
    stop = pouring.path.stops[3]
    span = (pouring.path.t[stop.start], pouring.path.t[stop.stop - 1])
    (finding,) = findings_of(pouring, with_dwells(pouring.path, k3=0.9 * SHORT_STOP_S))
    assert finding.words.startswith(f"keyframe 3 lasts only 0.27 s, from {span[0]:.1f} s on, so the hand may not")
    assert finding.spans == (span,)
    assert findings_of(pouring, with_dwells(pouring.path, k3=1.1 * SHORT_STOP_S)) == ()
    three = findings_of(pouring, with_dwells(pouring.path, k3=0.2, k5=0.1, k7=0.15))
    assert [finding.words.split(" lasts")[0] for finding in three] == ["keyframe 5", "keyframe 7", "keyframe 3"]
    (four,) = findings_of(pouring, with_dwells(pouring.path, k2=0.1, k3=0.2, k5=0.1, k7=0.15))
    assert four.words.startswith("4 keyframes last less than 0.3 s, so the hand may not have stopped there")
    assert len(four.spans) == 4


def test_stops_have_the_numbers_of_edited_keyframes(pouring: DemoValues) -> None:
    """A person may have removed keyframes and inserted others."""
    path, keyframes = pouring.path, pouring.keyframes
    assert stop_names(path, keyframes) == tuple(map(str, range(11)))
    between = replace(keyframes[7], t=0.5 * (keyframes[7].t + keyframes[8].t))
    edited = (*keyframes[:2], *keyframes[3:8], between, *keyframes[8:-1])
    at = [f"the stop at {path.t[path.stops[k].start]:.1f} s" for k in (2, 10)]
    assert stop_names(path, edited) == ("0", "1", at[0], "2", "3", "4", "5", "6", "8", "9", at[1])
    short = with_dwells(path, k2=0.2, k9=0.1)
    findings = find_problems(short, stop_names(short, edited), pouring.tracking.a_nav, None, ())
    assert [finding.words.split(" lasts")[0] for finding in findings] == ["keyframe 9", at[0]]
    assert short.tracking is not None
    left = replace(short.tracking, demo=replace(short.tracking.demo, keyframes=edited))
    facts = dict(demo_values(replace(short, tracking=left)).facts)
    assert facts["stops"] == "11, the shortest 0.10 s, keyframe 9"


def test_a_short_first_rest(pouring: DemoValues) -> None:
    (finding,) = findings_of(pouring, with_dwells(pouring.path, k0=0.9 * FIRST_REST_S))
    assert finding.words.startswith(
        "the first rest lasts only 0.90 s, but all else is measured from it: hold still for two"
    )
    assert finding.spans[0][0] == pouring.path.t[pouring.path.stops[0].start]


@pytest.mark.parametrize("moves", [0, 4])
def test_a_hand_that_never_moved_or_never_stopped_again(moves: int) -> None:
    arc = (Waypoint((0.1 * np.cos(k), 0.1 * np.sin(k), 0.0), move_s=1.0, rest_s=0.02) for k in range(moves))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "the hand moves when the recording ends")
        *_, finding = plot_of(simulate(Task("once", (Waypoint(rest_s=2.0), *arc)), "modern")).findings
    assert finding == Finding(
        "the hand stops only once: there is nothing to replay; hold still, move, and hold still again"
    )


def test_an_unsure_move(pouring: DemoValues) -> None:
    def words(*unsure: int) -> list[str]:
        cov = np.zeros((len(pouring.path.stops), 6, 6))
        for number, k in enumerate(unsure):
            cov[k + 1 :, :3, :3] += (0.02 + 0.01 * number) ** 2 * np.eye(3)
        path = replace(pouring.path, covariance=PoseCovariance.chained(cov))
        findings = find_problems(path, stop_names(path, pouring.keyframes), pouring.tracking.a_nav, None, ())
        assert all(begin < end for finding in findings for begin, end in finding.spans)
        return [finding.words for finding in findings]

    def lasts(k: int) -> str:
        before, after = pouring.path.stops[k : k + 2]
        return f"{pouring.path.t[after.start] - pouring.path.t[before.stop - 1]:.1f} s"

    advice = ": stop on the way, or move more calmly"
    assert words() == []
    assert words(3, 7) == [
        f"the move from 7 to 8 ({lasts(7)}) adds an uncertainty of 3.0 cm (one sigma){advice}",
        f"the move from 3 to 4 ({lasts(3)}) adds an uncertainty of 2.0 cm (one sigma){advice}",
    ]
    assert words(0, 3, 7, 2) == [
        f"4 moves add an uncertainty of more than 1.0 cm each (one sigma), the worst, from 2 to 3 ({lasts(2)}), 5.0 "
        f"cm{advice}"
    ]


def test_residual_velocity(pouring: DemoValues) -> None:
    before, after = pouring.path.stops[2:4]
    lasts = pouring.path.t[after.start] - pouring.path.t[before.stop - 1]
    for share, count in ((0.9, 0), (1.1, 1)):
        closure = pouring.path.closure.copy()
        closure[2] = (0.0, share * DRIFT_M_S2 * lasts, 0.0)
        findings = findings_of(pouring, replace(pouring.path, closure=closure))
        assert len(findings) == count
    assert f"at keyframe 3, after a move of {lasts:.1f} s, is more than drift" in findings[0].words
    assert findings[0].spans == ((pouring.path.t[before.stop - 1], pouring.path.t[after.start]),)
    # A move with an uncertain end has no second finding.
    cov = np.zeros((len(pouring.path.stops), 6, 6))
    cov[3:, :3, :3] += (2.0 * UNSURE_MOVE_M) ** 2 * np.eye(3)
    (unsure,) = findings_of(pouring, replace(pouring.path, closure=closure, covariance=PoseCovariance.chained(cov)))
    assert unsure.words.startswith("the move from 2 to 3")


@pytest.mark.parametrize(("weight", "count"), [(0.85, 0), (0.6, 1)])
def test_a_stop_that_the_tracker_doubts(pouring: DemoValues, weight: float, count: int) -> None:
    path = pouring.path
    stops = tuple(replace(stop, weight=weight) if k == 3 else stop for k, stop in enumerate(path.stops))
    findings = findings_of(pouring, replace(path, stops=stops))
    assert len(findings) == count
    if findings:
        assert findings[0].words.startswith(
            "keyframe 3 may not be a stop (60 % sure): the hand seems to pass through it"
        )
        assert findings[0].spans == ((path.t[stops[3].start], path.t[stops[3].stop - 1]),)


def test_a_keyframe_far_from_the_truth(pouring: DemoValues) -> None:
    assert pouring.truth is not None
    stop, names = pouring.path.stops[4], stop_names(pouring.path, pouring.keyframes)
    sigma = float(np.sqrt(np.diagonal(pouring.path.cov[4])[:3].max()))
    for sigmas, count in ((3.5, 0), (5.0, 1)):
        error = np.zeros_like(pouring.truth.error)
        error[stop.start : stop.stop, 1] = sigmas * sigma
        findings = find_problems(pouring.path, names, pouring.tracking.a_nav, error, ())
        assert len(findings) == count
    assert findings[0].words == f"keyframe 4 is {length_text(5.0 * sigma)} from the truth, 5 sigma"
    unknown = np.full_like(pouring.truth.error, np.nan)
    assert find_problems(pouring.path, names, pouring.tracking.a_nav, unknown, ()) == ()


# --- a hand that trembles ---


def trembling(swing_m: float) -> Demonstration:
    """Pouring by a hand that swings up and down, five times a second, while it should rest at keyframe 5."""
    waypoints = list(TASKS["pour"].waypoints)
    held = waypoints[5]
    x, y, z = held.p
    swings = [Waypoint((x, y, z + k % 2 * swing_m), move_s=0.1) for k in range(1, 13)]
    waypoints[5:6] = [replace(held, rest_s=0.0), *swings]
    return simulate(replace(TASKS["pour"], waypoints=tuple(waypoints)), "modern")


def test_a_trembling_hand_is_found_where_there_is_no_stop() -> None:
    end = sum(w.move_s + w.rest_s for w in TASKS["pour"].waypoints[:6])
    begin = end - TASKS["pour"].waypoints[5].rest_s
    plot = plot_of(trembling(0.008))
    ((span,),) = (finding.spans for finding in plot.findings if "trembles, so no stop is found" in finding.words)
    assert begin - 0.3 < span[0] < span[1] < end + 0.3
    assert span[1] - span[0] > 0.6 * (end - begin)
    assert not any(
        stop.start < np.searchsorted(plot.path.t, 0.5 * (begin + end)) < stop.stop for stop in plot.path.stops
    )
    assert plot_of(trembling(0.0)).findings == ()


def path_along_x(x: Array, a: Array) -> tuple[HandPath, Array]:
    """A hand that moves along x between stops of one sample each, and its acceleration (n, 3)."""
    t = np.arange(len(x)) / HZ
    zero = np.zeros_like(x)
    stops = tuple(Stop(k, k + 1, 0.0) for k in (0, len(x) - 1))
    moved = HandPath(
        t=t, p_nav_sensor=np.column_stack((x, zero, zero)), v_nav_sensor=np.zeros((len(x), 3)),
        wxyz_nav_sensor=np.tile((1.0, 0.0, 0.0, 0.0), (len(x), 1)), stops=stops, closure=np.zeros((1, 3)),
        covariance=PoseCovariance.chained(np.zeros((2, 6, 6))),
    )  # fmt: skip
    return moved, np.column_stack((a, zero, zero))


@settings(max_examples=60, deadline=None)
@given(st.floats(0.001, 0.6), st.floats(TREMBLE_S, 4.0))
def test_no_move_is_mistaken_for_trembling(length_m: float, move_s: float) -> None:
    u = np.arange(0.0, 1.0 + 1e-9, 1.0 / (HZ * move_s))
    share, _, curved = minimum_jerk(u)
    path, a_nav = path_along_x(length_m * share, length_m * curved / move_s**2)
    assert not [f for f in find_problems(path, "01", a_nav, None, ()) if "trembles" in f.words]


@settings(max_examples=30, deadline=None)
@given(st.floats(0.001, 0.006), st.floats(4.0, 10.0), st.floats(2.0 * TREMBLE_S, 3.0))
def test_every_tremor_is_found(amplitude_m: float, hz: float, lasts_s: float) -> None:
    w, t = 2.0 * np.pi * hz, np.arange(0.0, lasts_s, 1.0 / HZ)
    path, a_nav = path_along_x(amplitude_m * np.sin(w * t), -amplitude_m * w**2 * np.sin(w * t))
    ((span,),) = (
        finding.spans for finding in find_problems(path, "01", a_nav, None, ()) if "trembles" in finding.words
    )
    assert span[1] - span[0] > lasts_s - 0.5 * TREMBLE_S


def test_setting_the_sensor_down_is_not_trembling() -> None:
    x = np.zeros(100)
    a = np.where(np.arange(100) == 60, 8.0, 0.0) - np.where(np.arange(100) == 61, 8.0, 0.0)
    path, a_nav = path_along_x(x, a)
    assert not [finding for finding in find_problems(path, "01", a_nav, None, ()) if "trembles" in finding.words]


@pytest.mark.parametrize(("dwell_s", "count"), [(0.2, 1), (0.6, 0)])
def test_trembling_beside_a_long_stop_is_of_that_stop(dwell_s: float, count: int) -> None:
    t = np.arange(0.0, 2.0, 1.0 / HZ)
    w, rest = 2.0 * np.pi * 5.0, round(dwell_s * HZ)
    x = np.append(0.004 * np.sin(w * t), np.zeros(rest))
    path, a_nav = path_along_x(x, -(w**2) * x)
    stops = path.stops[0], Stop(len(x) - rest, len(x), dwell_s)
    found = find_problems(replace(path, stops=stops), "01", a_nav, None, ())
    assert sum("trembles" in finding.words for finding in found) == count
