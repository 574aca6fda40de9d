"""The whole tracker on simulated recordings with truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pbd.data import GRAVITY
from pbd.errors import PbdWarning, RecordingError, TrackingError
from pbd.pipeline import track
from pbd.pose import quat_about_z, quat_multiply, quat_rotate
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import World, random_task, simulate
from pbd.simulation.tasks import TASKS, Task
from pbd.tracking.keyframes import find_keyframes, find_segments
from tests.scenarios import keyframes_and_errors, pour, uncalibrated, with_hole, with_rows

TABLE_1 = [
    (0, 86, "No hand motion occurs"),
    (87, 94, "Vertical motion (mainly along z axis)"),
    (95, 114, "No hand motion occurs"),
    (115, 126, "Horizontal motion (mainly along x axis)"),
    (127, 140, "No hand motion occurs"),
    (141, 155, "Horizontal motion (mainly along y axis)"),
    (156, 185, "No hand motion occurs"),
    (186, 192, "Hand rotation"),
    (193, 250, "No hand motion occurs"),
]


@pytest.mark.filterwarnings("ignore:.*end of the range:pbd.errors.PbdWarning")  # the roll clips the gyro
@pytest.mark.parametrize("seed", range(5))
def test_segments_print_the_papers_table_1(seed: int) -> None:
    segments = find_segments(track(simulate("pick-and-place-stops", "os5000", seed).recording))
    assert [s.description for s in segments] == [description for _, _, description in TABLE_1]
    bounds = [(s.start, s.stop - 1) for s in segments]
    assert np.abs(np.array(bounds) - [(first, last) for first, last, _ in TABLE_1]).max() <= 2
    assert segments[0].ms == pytest.approx(2150.0, abs=50.0)
    assert [s.kind for s in segments] == ["rest", "move"] * 4 + ["rest"]


@pytest.mark.filterwarnings("ignore:.*end of the range:pbd.errors.PbdWarning")  # the roll clips the gyro
def test_final_keyframe_of_test_1_is_within_a_centimetre_in_the_median() -> None:
    errors = [keyframes_and_errors(simulate("pick-and-place-stops", "os5000", seed))[1][-1] for seed in range(20)]
    assert np.median(errors) < 0.010


@pytest.mark.parametrize("rate_hz", [40.0, 100.0])
def test_an_ideal_sensor_is_tracked_to_a_millimetre(rate_hz: float) -> None:
    _, errors = keyframes_and_errors(simulate("pick-and-place-stops", "ideal", rate_hz=rate_hz))
    assert len(errors) == 5
    assert errors[-1] < 0.001


@pytest.mark.parametrize("sensor", ["modern", "os5000"])
@pytest.mark.parametrize("seed", range(4))
def test_every_stop_of_an_everyday_task_is_found_and_nothing_else(sensor: str, seed: int) -> None:
    keyframes, errors = keyframes_and_errors(pour(sensor, seed))
    assert len(keyframes) == 11
    assert errors.max() < 0.05
    assert [(i, k.grip) for i, k in enumerate(keyframes) if k.grip is not None] == [(2, True), (8, False)]


def test_slow_smooth_moves_are_not_mistaken_for_rest() -> None:
    """The acceleration passes zero half-way; the hand does not stop there."""
    far = Waypoint((0.3, 0.0, 0.0), move_s=2.5, rest_s=1.5)
    task = Task("slow", (Waypoint(rest_s=2.0), far, Waypoint((0.0, 0.0, 0.0), move_s=2.5, rest_s=1.5)))
    keyframes, errors = keyframes_and_errors(simulate(task, "modern", 1))
    assert len(keyframes) == 3
    assert errors.max() < 0.05


@pytest.mark.parametrize("seed", range(3))
def test_turning_the_world_turns_the_path(seed: int) -> None:
    """Nav is east and north: the same hand in another heading goes the same way, turned."""
    task = random_task(seed, moves=3)
    world = World()
    plain = track(simulate(task, "ideal", world=world).recording)
    turned = track(simulate(task.turned(1.0), "ideal", world=world).recording)
    assert [(s.start, s.stop) for s in plain.stops] == [(s.start, s.stop) for s in turned.stops]
    expected = quat_rotate(quat_about_z(1.0), plain.p_nav_sensor)
    assert turned.p_nav_sensor == pytest.approx(expected, abs=2e-3)
    cosine = (turned.wxyz_nav_sensor * quat_multiply(quat_about_z(1.0), plain.wxyz_nav_sensor)).sum(axis=1)
    assert np.abs(cosine).min() > np.cos(np.radians(0.25))


def test_shifting_time_changes_nothing() -> None:
    recording = pour().recording
    here, later = track(recording), track(replace(recording, t=recording.t + 100.0))
    assert later.p_nav_sensor == pytest.approx(here.p_nav_sensor, abs=1e-4)


def test_stillness_in_rests_and_a_closed_velocity_after_each_move() -> None:
    path = track(pour().recording)
    for stop in path.stops:
        assert np.ptp(path.p_nav_sensor[stop.start : stop.stop], axis=0) == pytest.approx(0.0)
        assert path.v_nav_sensor[stop.start : stop.stop] == pytest.approx(0.0)
    assert len(path.closure) == len(path.stops) - 1
    assert path.p_nav_sensor[path.stops[0].start] == pytest.approx(0.0)


def test_sigma_grows_along_the_path() -> None:
    cov = track(pour().recording).cov
    sigma = np.sqrt(np.trace(cov[:, :3, :3], axis1=1, axis2=2))
    assert sigma[0] == 0.0
    assert (np.diff(sigma) > 0.0).all()
    assert (np.linalg.eigvalsh(cov) >= -1e-12).all()


def test_without_a_magnetometer_x_is_the_sensors_own() -> None:
    recording = replace(pour().recording, mag=None)
    path = track(recording)
    x_nav = quat_rotate(path.wxyz_nav_sensor[50], (1.0, 0.0, 0.0))
    assert x_nav[1] == pytest.approx(0.0, abs=5e-3)
    assert x_nav[0] > 0.99


def test_without_a_gyro_the_devices_attitude_serves() -> None:
    path = track(simulate("pick-and-place-stops", "os5000-nogyro", 0).recording)
    assert len(path.stops) >= 2
    with pytest.raises(TrackingError, match="neither a gyro nor the device's own attitude"):
        track(replace(simulate("pour", "modern").recording, gyr=None, device_rpy=None))


def test_g_is_refused_as_a_unit_and_named() -> None:
    recording = pour().recording
    with pytest.raises(RecordingError, match=r"likely in g: import the file with --unit acc=g"):
        track(replace(recording, acc=recording.acc / GRAVITY))
    with pytest.raises(RecordingError, match="likely in mg: "):
        track(replace(recording, acc=1e3 * recording.acc / GRAVITY))


def test_gravity_other_than_the_standard_one_is_taken_as_it_is() -> None:
    _, errors = keyframes_and_errors(simulate("pour", "ideal", world=World(gravity=9.78)))
    assert errors.max() < 0.01


def test_a_second_of_nothing_in_a_move_is_refused_with_its_place() -> None:
    with (
        pytest.warns(PbdWarning),
        pytest.raises(TrackingError, match=r"after row \d+ \(t = 2\.\d+ s\), while the hand"),
    ):
        track(with_hole(pour().recording, 2.6, 3.6))


def test_a_short_hole_in_a_move_is_bridged() -> None:
    whole = find_keyframes(track(pour().recording))
    with pytest.warns(PbdWarning, match="missing, in 1 gap"):
        bridged = find_keyframes(track(with_hole(pour().recording, 2.9, 2.93)))
    assert len(bridged) == len(whole)
    assert bridged[-1].T_nav_sensor.distance(whole[-1].T_nav_sensor)[0] < 0.01


def test_lost_rows_are_bridged_too() -> None:
    recording = pour().recording
    rows = np.delete(np.arange(len(recording), dtype=np.intp), [270, 271, 500, 900])
    with pytest.warns(PbdWarning, match="4 samples missing, in 3 gaps"):
        path = track(with_rows(recording, rows))
    assert len(path.stops) == 11


def test_repeated_rows_do_no_harm() -> None:
    recording = pour().recording
    rows = np.sort(np.append(np.arange(len(recording), dtype=np.intp), [300, 300, 700]))
    path = track(with_rows(recording, rows))
    assert len(path.stops) == 11


def test_time_running_backwards_is_refused() -> None:
    recording = pour().recording
    t = recording.t.copy()
    t[1000:] -= 5.0
    with pytest.raises(RecordingError, match=r"time runs backwards from 9\.990 s \(row 999\) to 5\.000 s \(row 1000\)"):
        track(replace(recording, t=t))


def test_a_jumping_clock_is_refused() -> None:
    recording = pour().recording
    t = recording.t.copy()
    t[1000:] += 1e9
    with pytest.raises(RecordingError, match="time jumps from"):
        track(replace(recording, t=t))


def test_a_hand_that_never_rests_is_refused() -> None:
    recording = pour().recording
    shaking = recording.acc + 3.0 * np.sin(40.0 * recording.t)[:, None]
    with pytest.raises(TrackingError, match="never stands still"):
        track(replace(recording, acc=shaking))


def test_a_hand_that_never_moves_has_one_stop() -> None:
    path = track(simulate(Task("still", (Waypoint(rest_s=4.0),)), "modern").recording)
    assert len(path.stops) == 1
    assert path.p_nav_sensor == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("rows", [0, 1])
def test_next_to_no_samples_are_refused(rows: int) -> None:
    with pytest.raises(RecordingError, match=f"the recording has {rows} samples?"):
        track(with_rows(pour().recording, slice(0, rows)))


def test_a_channel_without_a_number_is_refused() -> None:
    recording = pour().recording
    with pytest.raises(RecordingError, match="'gyr' has no number in any row"):
        track(replace(recording, gyr=np.full_like(recording.acc, np.nan)))


def test_a_dead_accelerometer_is_refused() -> None:
    recording = pour().recording
    with pytest.raises(TrackingError, match="reads zero while at rest"):
        track(replace(recording, acc=np.zeros_like(recording.acc)))


def test_milliseconds_are_found_out() -> None:
    recording = pour().recording
    with pytest.raises(RecordingError, match=r"the samples come 10 s apart; .* --unit t=ms"):
        track(replace(recording, t=1e3 * recording.t))


def test_motion_at_either_end_is_told() -> None:
    recording = pour().recording
    with pytest.warns(PbdWarning, match="the hand moves when the recording ends: the last 0"):
        track(with_rows(recording, slice(0, 700)))
    later = with_rows(recording, slice(290, None))
    with pytest.warns(PbdWarning, match="the hand moves when the recording starts"):
        track(replace(later, t=later.t - later.t[0]))


def test_a_cell_that_no_sensor_can_read_holds_no_number() -> None:
    recording = pour().recording
    acc = recording.acc.copy()
    acc[1000] = 1e300
    with pytest.warns(PbdWarning, match="1 sample missing, in 1 gap"):
        assert len(track(replace(recording, acc=acc)).stops) == 11


@uncalibrated
@pytest.mark.filterwarnings("ignore:.*end of the range:pbd.errors.PbdWarning")  # the roll clips the gyro
@pytest.mark.parametrize("sensor", ["modern", "os5000", "wt901"])
@pytest.mark.parametrize("slower", [1.25, 1.5, 2.0])
def test_a_slow_smooth_hand_stops_where_it_stops(sensor: str, slower: float) -> None:
    """Half-way through such a move the hand is as quiet as at a stop."""
    waypoints = tuple(replace(waypoint, move_s=slower * waypoint.move_s) for waypoint in TASKS["pour"].waypoints)
    for seed in range(4):
        _, errors = keyframes_and_errors(simulate(replace(TASKS["pour"], waypoints=waypoints), sensor, seed))
        assert len(errors) == len(waypoints)
        assert errors.max() < 0.07
