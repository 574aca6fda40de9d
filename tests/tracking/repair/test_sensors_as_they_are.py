"""Wild samples, dead channels, gyros in a wrong unit or with wrong axes, wrong gravity: repaired or refused."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pbd.data import GRAVITY, Recording
from pbd.errors import PbdWarning, RecordingError, TrackingError
from pbd.pipeline import track
from pbd.simulation.calibration_tasks import sides
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import TASKS, World, random_task
from pbd.simulation.tasks import Task
from pbd.tracking.repair.channel_faults import frozen_rows, refuse_dead, stuck_axes
from pbd.tracking.repair.gyro_consistency import find_steady, refuse_disagreement
from pbd.tracking.repair.repair_recording import repair_recording
from pbd.tracking.repair.splices import without_wild
from tests.not_none import not_none
from tests.scenarios import keyframes_and_errors, pour, simulate, uncalibrated, with_channel, with_rows
from tests.tracking.repair.real_recordings import real_recordings

pytestmark = pytest.mark.usefixtures("cached_results")

WITH_GYRO = ["os5000", "wt901", "modern", "ideal"]


def with_spike(recording: Recording, channel: str, row: int, axis: int, value: float) -> Recording:
    values = getattr(recording, channel).copy()
    values[row, axis] = value
    return with_channel(recording, channel, values)


@settings(max_examples=10, deadline=None)
@given(
    st.sampled_from(WITH_GYRO),
    st.sampled_from(["pour", "random"]),
    st.sampled_from([("acc", 500.0), ("gyr", 30.0)]),
    st.integers(0, 10**6),
)
@example("os5000", "random", ("gyr", 30.0), 7199)  # the last row but one
def test_a_wild_sample_is_found_wherever_it_is(sensor: str, task: str, spike: tuple[str, float], seed: int) -> None:
    """Except the last sample, as none after it shows that it was wild."""
    recording = simulate(random_task(seed) if task == "random" else task, sensor, seed).recording
    channel, value = spike
    row, axis = seed % (len(recording) - 1), seed % 3
    with pytest.warns(PbdWarning, match="1 impossible sample"):
        mended = without_wild(with_spike(recording, channel, row, axis, value))
    was, now = getattr(recording, channel), getattr(mended, channel)
    assert np.delete(now, row, axis=0) == pytest.approx(np.delete(was, row, axis=0))
    assert np.abs(now[row] - was[row]).max() < 0.1 * value


def test_real_impacts_and_fast_hands_have_no_wild_samples(data_folder: Path) -> None:
    recordings = real_recordings(data_folder)
    assert len(recordings) >= 10
    for recording in recordings.values():
        assert without_wild(recording) is recording
    for sensor in WITH_GYRO:
        for seed in range(2):
            fast = simulate(random_task(seed, move_s=(0.15, 0.3)), sensor, seed).recording
            assert without_wild(fast) is fast


def test_a_tap_is_no_wild_sample() -> None:
    """A tap rings, or lasts longer than a sample."""
    recording = pour().recording
    acc = recording.acc.copy()
    acc[100:106, 2] += (45.0, -25.0, 14.0, -8.0, 5.0, -3.0)
    acc[200:203, 2] += (40.0, 90.0, 35.0)
    tapped = replace(recording, acc=acc)
    assert without_wild(tapped) is tapped


@pytest.mark.parametrize("channel", ["acc", "gyr"])
def test_an_axis_that_is_stuck_for_a_second_within_moves_is_named(channel: str) -> None:
    recording = pour("modern").recording
    values = getattr(recording, channel).copy()
    values[(recording.t >= 3.0) & (recording.t < 4.1), 1] = 0.25
    with pytest.raises(RecordingError, match=r"axis y of the .* is stuck at 0\.25 from 3\.00 s .* to 4\.09 s"):
        track(with_channel(recording, channel, values))


def test_an_axis_whose_noise_is_below_its_resolution_is_not_stuck() -> None:
    """A Razor's rad/s with two decimals, in a turn about one axis."""
    t = np.arange(0.0, 3.0, 0.02)
    gyr = np.outer(np.sin(np.pi / 3.0 * t), (0.0, 0.0, 1.5)) + 0.002 * np.random.default_rng(0).normal(size=(150, 3))
    acc = np.tile((0.0, 0.0, 9.8), (150, 1))
    assert not list(stuck_axes(Recording(t, acc, gyr.round(2))))


@pytest.mark.parametrize("channel", ["acc", "gyr"])
def test_an_axis_that_reads_the_same_before_and_after_a_gap_is_not_stuck(channel: str) -> None:
    """Raw counts often do. The gap itself is told."""
    recording = pour("modern").recording
    kept = (recording.t < 5.0) | (recording.t > 6.2)
    values = getattr(recording, channel)[kept].copy()
    after = int(np.count_nonzero(recording.t < 5.0))
    values[after, 2] = values[after - 1, 2]
    others = {name: getattr(recording, name)[kept] for name in ("t", "acc", "gyr", "mag", "device_rpy")}
    told = pytest.raises(TrackingError, match="1210 ms of data are missing")
    with pytest.warns(PbdWarning, match="121 samples missing"), told:
        track(replace(recording, grip=(), **others | {channel: values}))


@pytest.mark.parametrize("sensor", WITH_GYRO)
def test_a_gyro_that_says_nothing_is_refused(sensor: str) -> None:
    for task in ("pour", "pick-and-place-direct"):  # gravity contradicts it in the first alone
        recording = simulate(task, sensor, 1).recording
        for dead in (0.0, (0.01, -0.02, 0.0)):
            with pytest.raises(RecordingError, match="so it is dead"):
                track(replace(recording, gyr=np.zeros_like(recording.acc) + dead))


@pytest.mark.parametrize("sensor", ["os5000-nogyro", "modern"])
def test_samples_that_never_change_are_refused(sensor: str) -> None:
    recording = pour(sensor).recording
    same = replace(with_rows(recording, np.zeros(len(recording), dtype=np.intp)), t=recording.t)
    with pytest.raises(RecordingError, match="all rows are the same"):
        track(same)


@pytest.mark.parametrize("sensor", ["wt901", "modern"])
def test_an_accelerometer_that_was_divided_by_its_norm_is_refused(sensor: str) -> None:
    """A filter normalised each row in place, and a program wrote it in g with four decimals."""
    recording = pour(sensor).recording
    direction = (recording.acc / np.linalg.norm(recording.acc, axis=1, keepdims=True)).round(4)
    with pytest.raises(RecordingError, match="each row was divided by its norm"):
        track(replace(recording, acc=GRAVITY * direction))


def test_a_norm_that_changes_by_half_a_thousandth_was_not_divided_by() -> None:
    t = np.arange(300) / 100.0
    acc = np.column_stack((np.sin(t), np.zeros(300), np.cos(t))) + np.random.default_rng(0).normal(0.0, 0.02, (300, 3))
    norms = np.linspace(1.0, 1.0005, 300)[:, None]
    acc *= GRAVITY * norms / np.linalg.norm(acc, axis=1, keepdims=True)
    refuse_dead(Recording(t, acc))


def test_a_rest_whose_noise_hardly_changes_the_norm_was_not_divided_by_it() -> None:
    acc = np.random.default_rng(0).normal((0.0, 0.0, GRAVITY), 1e-4, (300, 3))
    refuse_dead(Recording(np.arange(300) / 100.0, acc))


def test_a_sensor_without_noise_that_turns_on_the_spot_was_not_divided_by_its_norm() -> None:
    angle = np.arange(300) / 100.0
    refuse_dead(Recording(angle, GRAVITY * np.column_stack((np.sin(angle), np.zeros(300), np.cos(angle)))))


def test_a_sensor_without_noise_is_not_dead() -> None:
    """It never changes at rest, and an axis without motion never changes."""
    along_z = random_task(0, moves=2, max_turn=0.0)
    along_z = replace(along_z, waypoints=tuple(replace(w, p=(0.0, 0.0, w.p[2])) for w in along_z.waypoints))
    tasks: tuple[str | Task, ...] = ("pour", "pick-and-place-direct", along_z)
    for task in tasks:
        keyframes, errors = keyframes_and_errors(simulate(task, "ideal", world=World(gravity=9.78)))
        assert len(keyframes) >= 2
        assert errors.max() < 0.01


def test_an_axis_across_a_smooth_motion_of_a_sensor_without_noise_is_not_stuck() -> None:
    t = np.arange(300) / 100.0
    refuse_dead(Recording(t, np.column_stack((np.sin(2.0 * t), np.zeros(300), np.full(300, GRAVITY)))))


@uncalibrated
def test_a_gyro_that_says_zero_at_rest_is_not_stuck() -> None:
    """Some sensors subtract their own bias whenever they detect rest."""
    demo = pour("wt901", 1)
    gyr = not_none(demo.recording.gyr)
    still = np.array([np.abs(gyr[max(i - 20, 0) : i + 20]).max() < 0.03 for i in range(len(gyr))])
    assert still.mean() > 0.2
    quiet = replace(demo.recording, gyr=np.where(still[:, None], 0.0, gyr))
    assert len(track(quiet).stops) >= 11


def held(recording: Recording, start: int, stop: int) -> Recording:
    rows = np.arange(len(recording))
    rows[start:stop] = start
    return replace(with_rows(recording, rows), t=recording.t)


def test_a_sensor_that_freezes_in_a_move_is_refused() -> None:
    assert not frozen_rows(held(pour().recording, 280, 285)).any()  # 40 ms
    assert frozen_rows(held(pour().recording, 280, 287)).any()  # 60 ms
    with (
        pytest.warns(PbdWarning, match=r"29 samples frozen \(the reading repeats\), in 1 gap"),
        pytest.raises(TrackingError, match=r"290 ms of data are frozen .* after row 280 .* while the hand moves"),
    ):
        track(held(pour().recording, 280, 310))


def test_nothing_is_frozen_in_a_real_recording(data_folder: Path) -> None:
    """Nor in simulated ones: test_freezes.py."""
    assert not any(frozen_rows(recording).any() for recording in real_recordings(data_folder).values())


def test_a_real_gyro_in_degrees_is_found_out_and_a_good_one_is_not(data_folder: Path) -> None:
    for name, recording in real_recordings(data_folder).items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PbdWarning)  # of lost samples
            good, _ = repair_recording(recording)
        if name.endswith((" 40", " 1")):
            with pytest.raises(RecordingError, match="--unit gyr=deg/s"):
                refuse_disagreement(replace(good, gyr=np.degrees(not_none(good.gyr))))


@settings(max_examples=12, deadline=None)
@given(
    st.sampled_from(WITH_GYRO),
    st.sampled_from([*TASKS, "random", "fast", "wide"]),
    st.sampled_from([None, 25.0, 286.0]),
    st.integers(0, 1000),
)
def test_a_good_gyro_is_never_refused(sensor: str, task: str, rate_hz: float | None, seed: int) -> None:
    what = {
        "random": random_task(seed),
        "fast": random_task(seed, move_s=(0.2, 0.5)),
        "wide": random_task(seed, max_turn=2.5),
    }.get(task, task)
    refuse_disagreement(simulate(what, sensor, seed, rate_hz=rate_hz).recording)


@pytest.mark.parametrize("every", [3, 4])
def test_a_phone_that_saves_power_by_a_lower_rate_is_no_wrong_gyro(every: int) -> None:
    """Its times are right, but a gyro whose readings are added up seems to turn too little."""
    whole = simulate("pour", "modern", 1, rate_hz=200.0).recording
    saving = with_rows(whole, np.flatnonzero((whole.t < 8.0) | (np.arange(len(whole)) % every == 0)))
    assert saving.rate_hz == pytest.approx(200.0)
    refuse_disagreement(saving)
    with pytest.raises(RecordingError, match="--unit gyr=deg/s"):
        refuse_disagreement(replace(saving, gyr=np.degrees(not_none(saving.gyr))))


@pytest.mark.parametrize("seed", [2, 9, 19])
def test_a_turn_about_the_vertical_is_not_taken_for_rest(seed: int) -> None:
    """In it the accelerometer is as quiet as at rest, but the gyro's mean is no bias."""
    recording = simulate(sides(seed), "wt901", seed).recording
    refuse_disagreement(recording)
    bias = find_steady(recording.acc, not_none(recording.gyr), recording.rate_hz).gyro_bias
    assert np.abs(bias).max() < np.radians(2.0)


@pytest.mark.filterwarnings("ignore:.*far more than such a sensor:pbd.errors.PbdWarning")  # one recording in twenty
@settings(max_examples=3, deadline=None)
@given(st.sampled_from(["modern", "ideal"]), st.floats(9.6, 10.0), st.integers(0, 100))
def test_gravity_is_what_the_sensor_shows(sensor: str, gravity: float, seed: int) -> None:
    keyframes, errors = keyframes_and_errors(simulate("pour", sensor, seed, world=World(gravity=gravity)))
    assert len(keyframes) == 11
    assert errors.max() < 0.015


@pytest.mark.parametrize("sensor", ["wt901", "modern"])
def test_a_hand_that_speeds_up_to_one_side_and_down_is_no_dead_gyro(sensor: str) -> None:
    """With 5 m/s2, 15 degrees below horizontal, specific force is steady, has norm g and is 30 degrees off vertical."""
    here, there = Waypoint(move_s=1.0, rest_s=1.0), Waypoint((0.87, 0.0, -0.23), move_s=1.0, rest_s=1.0)
    waypoints = [Waypoint(rest_s=1.0), *(4 * [there, here])]
    refuse_disagreement(simulate(Task("brisk", tuple(waypoints)), sensor, 1).recording)


@pytest.mark.parametrize(("move_s", "reach_m", "lean_deg"), [(0.8, 0.5, 8.0), (0.9, 0.6, 12.0)])
def test_a_hand_that_speeds_up_for_a_fifth_of_a_second_is_not_taken_for_a_turn(
    move_s: float, reach_m: float, lean_deg: float
) -> None:
    """In both moves specific force is steady for 0.2 s, has norm g and is over 20 degrees off vertical."""
    lean = float(np.radians(lean_deg))
    there = Waypoint((reach_m, 0.0, -0.1), (0.0, lean, 0.0), move_s=move_s, rest_s=0.8)
    back = Waypoint(turn=(0.0, -lean, 0.0), move_s=move_s, rest_s=0.8)
    task = Task("brisk", (Waypoint(rest_s=1.5), there, back), start_rpy=(0.0, 0.0, 0.0))
    refuse_disagreement(replace(simulate(task, "modern", 1).recording, mag=None, device_rpy=None))
