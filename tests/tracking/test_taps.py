"""Two taps mark the grip: found where they are and nowhere else, and they split no stop."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pbd.data import GRAVITY, GripEvent, Recording
from pbd.files.importers import import_file
from pbd.pipeline import track
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import TASKS
from pbd.simulation.tasks import Task
from pbd.tracking.taps import TapDetector, grip_by_taps
from tests.scenarios import simulate
from tests.tracking.tapping import tapped

pytestmark = pytest.mark.usefixtures("cached_results")

HELD = Task("held", (Waypoint(rest_s=12.0),))
FIRST = np.arange(1.5, 11.0, 1.5)


def held(rate_hz: float, seed: int = 0) -> Recording:
    return simulate(HELD, "phone", seed, rate_hz=rate_hz).recording


def pairs(seed: int, softest: float) -> list[tuple[float, float]]:
    rng = np.random.default_rng(seed)
    return [(float(at + k * rng.uniform(0.15, 0.4)), float(rng.uniform(softest, 60.0))) for at in FIRST for k in (0, 1)]


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 400.0])
def test_each_pair_is_found_when_it_began(rate_hz: float) -> None:
    found = grip_by_taps(tapped(held(rate_hz), pairs(1, 35.0)))
    assert [event.t for event in found] == pytest.approx(FIRST, abs=0.02)
    assert [event.closed for event in found] == [True, False] * 3 + [True] * (len(FIRST) % 2)


def test_they_are_told_a_quarter_of_a_second_after_the_second() -> None:
    recording, detector = tapped(held(200.0), [(2.0, 40.0), (2.25, 40.0)]), TapDetector()
    told = [t for t, acc in zip(recording.t, recording.acc, strict=True) if detector.feed(float(t), acc) is not None]
    assert told == pytest.approx([2.25 + 0.26], abs=0.02)


@pytest.mark.parametrize(
    "blows",
    [
        [(2.0, 40.0)],
        [(2.0, 40.0), (2.2, 40.0), (2.4, 40.0)],
        [(2.0, 40.0), (2.8, 40.0)],
        [(2.0, 40.0), (2.05, 40.0)],
        [(2.0, 4.0), (2.25, 4.0)],
    ],
    ids=["one", "three", "far apart", "one that bounced", "too soft"],
)
def test_what_is_no_pair_of_taps(blows: list[tuple[float, float]]) -> None:
    assert grip_by_taps(tapped(held(200.0), blows)) == ()


@pytest.mark.parametrize(("lost_s", "found"), [(2.12, 0), (1.0, 1)])
def test_a_lost_sample_between_two_taps_parts_them(lost_s: float, found: int) -> None:
    """The hand may have moved there."""
    recording = tapped(held(200.0), [(2.0, 40.0), (2.25, 40.0)])
    lost = np.abs(recording.t - lost_s) < 0.003
    acc = np.where(lost[:, None], np.nan, recording.acc)
    assert len(grip_by_taps(replace(recording, acc=acc))) == found


def test_a_knock_from_the_side_is_none() -> None:
    assert grip_by_taps(tapped(held(200.0), [(2.0, 40.0), (2.25, 40.0)], lean=1.5)) == ()


def test_a_lone_tap_does_not_hide_the_pair_after_it() -> None:
    (grip,) = grip_by_taps(tapped(held(200.0), [(2.0, 40.0), (4.0, 40.0), (4.25, 40.0)]))
    assert grip.t == pytest.approx(4.0, abs=0.02)


@pytest.mark.parametrize(("axis", "found"), [(2, 1), (0, 0)])
def test_a_knock_from_the_side_makes_no_pair_with_a_tap_though_one_sample_shows_it(axis: int, found: int) -> None:
    t, acc = np.arange(600) / 200.0, np.tile((0.0, 0.0, GRAVITY), (600, 1))
    acc[200, axis] += 40.0
    acc[250, 2] += 40.0
    detector = TapDetector()
    assert sum(detector.feed(*row) is not None for row in zip(t.tolist(), acc.tolist(), strict=True)) == found


def test_a_tap_makes_no_pair_with_a_knock_from_the_side() -> None:
    recording = tapped(tapped(held(200.0), [(2.0, 40.0)]), [(2.25, 25.0)], lean=1.5)
    assert grip_by_taps(recording) == ()


@pytest.mark.parametrize("task", TASKS)
def test_none_is_found_in_simulated_demonstrations(task: str) -> None:
    for model, rate_hz in (("phone", 100.0), ("phone", 400.0), ("wt901", 200.0)):
        assert grip_by_taps(simulate(task, model, 1, rate_hz=rate_hz).recording) == ()


def test_none_is_found_in_recorded_hands_strides_and_walks(data_folder: Path) -> None:
    trials = [
        *sorted((data_folder / "broad").glob("*.npz")),
        data_folder / "strides" / "left.npz",
        data_folder / "walks" / "short_walk.csv",
    ]
    assert len(trials) == 6
    for trial in trials:
        assert grip_by_taps(import_file(trial).recording) == (), trial.name


def test_a_stop_in_which_the_grip_is_tapped_stays_one() -> None:
    demo = simulate("pour", "modern", 1, rate_hz=200.0)
    blows = [(event.t + late, 40.0) for event in demo.recording.grip for late in (0.0, 0.3)]
    shaken = tapped(demo.recording, blows)
    marks = grip_by_taps(shaken)
    assert [event.t for event in marks] == pytest.approx([event.t for event in demo.recording.grip], abs=0.02)
    stops = len(track(demo).stops)
    for grip in (marks, (GripEvent(1.0, True),)):  # the hand never leaves its place, so it needs no mark
        assert len(track(replace(demo, recording=replace(shaken, grip=grip))).stops) == stops


@pytest.mark.parametrize(("degrees", "found"), [(2.0, 1), (4.0, 0)])
def test_a_hand_that_turns_by_more_than_three_degrees_between_does_not_tap(degrees: float, found: int) -> None:
    recording = tapped(held(200.0), [(2.0, 40.0), (2.25, 40.0)])
    acc = recording.acc.copy()
    acc[recording.t > 2.12, 1] += GRAVITY * np.sin(np.radians(degrees))
    assert len(grip_by_taps(replace(recording, acc=acc))) == found


@pytest.mark.parametrize(("away_m", "move_s"), [(0.01, 0.1), (0.02, 0.06)])
def test_a_knock_after_which_the_hand_is_where_it_was_divides_no_stop(away_m: float, move_s: float) -> None:
    there, onward = Waypoint((0.2, 0.0, 0.1), move_s=1.0, rest_s=1.0), Waypoint((0.4, 0.0, 0.1), move_s=1.0, rest_s=1.0)
    out, back = Waypoint((0.2 + away_m, 0.0, 0.1), move_s=move_s), replace(there, move_s=move_s)
    task = Task("knock", (Waypoint(rest_s=2.0), there, out, back, onward))
    assert len(track(simulate(task, "modern", 0)).stops) == 3


@pytest.mark.parametrize(("away_s", "stops"), [(0.7, 2), (0.9, 3)])
def test_a_hand_that_comes_back_at_once_only_gripped(away_s: float, stops: int) -> None:
    """A grip is marked in the gap; 0.8 s still count as a grip, more is a move out and back."""
    there, back = Waypoint((0.0, 0.0, 0.1), move_s=0.5 * away_s), Waypoint(move_s=0.5 * away_s, rest_s=1.0)
    onward = Waypoint((0.2, 0.0, 0.0), move_s=1.0, rest_s=1.0)
    recording = simulate(Task("away", (Waypoint(rest_s=2.0), there, back, onward)), "modern", 1).recording
    marked = replace(recording, grip=(GripEvent(2.0 + 0.5 * away_s, True),))
    path = track(marked)
    assert len(path.stops) == stops
    assert path.stops[0].start == 0
    assert path.t[path.stops[-2].stop] > 3.0 + away_s - 0.2  # nothing is lost of the rest after


def test_a_move_of_a_centimetre_beside_a_grip_is_kept() -> None:
    """Pulling off what was just let go: the mark is half a second before the move."""
    there = Waypoint((0.2, 0.0, 0.0), move_s=1.0, rest_s=0.9, grip=True)
    off, onward = Waypoint((0.2, 0.0, 0.01), move_s=0.5, rest_s=0.7), Waypoint((0.0, 0.0, 0.1), move_s=1.0, rest_s=1.0)
    assert len(track(simulate(Task("off", (Waypoint(rest_s=2.0), there, off, onward)), "modern", 1)).stops) == 4
