"""A hand in the air trembles. Its stops are found all the same, in a recording and live."""

import numpy as np
import pytest

from pbd.pipeline import track
from pbd.pose import lengths, quat_inverse, quat_log, quat_multiply
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import random_task, simulate
from pbd.simulation.tasks import Task
from pbd.tracking.first_rest import find_rest
from pbd.tracking.noise import noise_of
from tests.not_none import not_none
from tests.scenarios import with_rows
from tests.simulation.sway import with_sway
from tests.tracking.fed_tracker import began, fed
from tests.tracking.nees import against
from tests.tracking.trembling import STRONG, STRONGEST, USUAL, trembling, with_tremor

STOPS = 11


@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("rms", [USUAL, STRONG, STRONGEST], ids=["usual", "strong", "strongest"])
@pytest.mark.parametrize("sensor", ["modern", "wt901"])
def test_the_stops_are_found_where_they_are(sensor: str, rms: tuple[float, float], seed: int) -> None:
    demo = trembling(sensor, seed, rms)
    path = track(demo.recording)
    assert len(path.stops) == STOPS
    off = against(path, not_none(demo.truth)).off
    assert lengths(off).max() < (0.008 if sensor == "modern" else 0.03)


@pytest.mark.parametrize("rms", [USUAL, STRONGEST], ids=["usual", "strongest"])
@pytest.mark.parametrize("sensor", ["modern", "wt901"])
def test_live_none_is_lost_or_divided(sensor: str, rms: tuple[float, float]) -> None:
    _, events = fed(trembling(sensor, 2, rms).recording)
    assert len({event.index for event in began(events)}) == STOPS


@pytest.mark.parametrize("seed", [2, 5, 6])
def test_slow_moves_of_a_hand_that_trembles_from_the_start_are_no_rests(seed: int) -> None:
    """Their acceleration is as large as the tremor's. If that were the sensor's noise, nothing would show them."""
    task = random_task(seed, moves=4, move_s=(2.5, 4.0), rest_s=(1.0, 2.0), max_turn=0.0)
    path = track(with_tremor(simulate(task, "wt901", seed), seed, STRONG).recording)
    assert len(path.stops) == 5


@pytest.mark.parametrize("seed", range(2))
def test_the_stop_after_a_long_rest_and_a_slow_move_is_found(seed: int) -> None:
    """The move changes the mean acceleration as little as a hand that is held does."""
    there, up = Waypoint((0.15, 0.0, 0.05), move_s=2.0, rest_s=1.0), Waypoint((0.15, 0.1, 0.15), move_s=2.0, rest_s=1.0)
    task = Task("slow", (Waypoint(rest_s=6.0), there, up, Waypoint((0.3, 0.0, 0.1), move_s=1.0, rest_s=1.0)))
    path = track(with_tremor(simulate(task, "modern", seed), seed, STRONG, since_s=6.0).recording)
    found = [(path.t[stop.start], path.t[stop.stop - 1]) for stop in path.stops]
    assert np.array(found) == pytest.approx(np.array([(0.0, 6.0), (8.0, 9.0), (11.0, 12.0), (13.0, 14.0)]), abs=0.15)


@pytest.mark.parametrize("sensor", ["os5000", "wt901", "modern"])
def test_tremor_is_not_taken_for_the_sensors_noise(sensor: str) -> None:
    demo = simulate("pour", sensor, 1)
    shakes = with_tremor(demo, 1, STRONG).recording
    held, own = (noise_of(each, find_rest(each)) for each in (shakes, demo.recording))
    for name, energy in (("acc_density", "acc_var"), ("gyr_density", "gyr_var")):
        more = getattr(find_rest(shakes), energy) / getattr(find_rest(demo.recording), energy)
        assert more > 8.0
        assert 0.5 < getattr(held, name) / getattr(own, name) < 0.5 * np.sqrt(more)


def test_live_the_noise_stays_that_of_the_rest_when_the_hand_moves() -> None:
    """It was measured anew in the second before each stop's end, and came out three times as large."""
    recording = with_tremor(simulate("pour", "modern", 1), 1, STRONG).recording
    first = noise_of(recording, find_rest(recording))
    tracker, _ = fed(with_rows(recording, slice(800)))
    assert tracker._hand is not None
    assert len(tracker.stops) > 3
    assert tracker._hand._noise.acc_density == pytest.approx(first.acc_density)
    assert tracker._hand._noise.gyr_density == pytest.approx(first.gyr_density)


@pytest.mark.parametrize("seed", range(3))
def test_the_attitude_of_a_stop_that_tremor_divides_follows_the_hands_sway(seed: int) -> None:
    task = with_sway(random_task(seed, moves=5, rest_s=(1.5, 2.5)), 1e-3, seed, turn=np.radians(1.0))
    demo = with_tremor(simulate(task, "modern", seed), seed, STRONG, since_s=2.0)
    path = track(demo.recording)
    for stop in path.stops:
        found, true = (
            quat_multiply(quat_inverse(each[stop.start]), each[stop.start : stop.stop])
            for each in (path.wxyz_nav_sensor, not_none(demo.truth).wxyz_nav_sensor)
        )
        assert np.degrees(lengths(quat_log(quat_multiply(quat_inverse(true), found)))).max() < 0.2
