"""The whole tracker on simulated recordings with truth."""

from dataclasses import replace

import numpy as np
import pytest

from pbd.data import GRAVITY, Calibration, LinearErrors, SensorErrors
from pbd.data.units import MG
from pbd.errors import PbdWarning, RecordingError, TrackingError
from pbd.pipeline import track
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.tasks import TASKS, Task
from pbd.tracking.keyframes import find_segments
from pbd.tracking.noise import noise_of
from pbd.tracking.online.tracker import LiveTracker
from pbd.tracking.white_noise import steps_of
from tests.not_none import not_none
from tests.scenarios import keyframes_and_errors, pour, simulate, uncalibrated, with_rows
from tests.tracking.tapping import tapped

pytestmark = pytest.mark.usefixtures("cached_results")

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
@pytest.mark.parametrize("seed", range(2))
def test_segments_print_the_papers_table_1(seed: int) -> None:
    segments = find_segments(track(simulate("pick-and-place-stops", "os5000", seed).recording))
    assert [s.description for s in segments] == [description for _, _, description in TABLE_1]
    bounds = [(s.start, s.stop - 1) for s in segments]
    assert np.abs(np.array(bounds) - [(first, last) for first, last, _ in TABLE_1]).max() <= 2
    assert segments[0].ms == pytest.approx(2150.0, abs=50.0)
    assert [s.kind for s in segments] == ["rest", "move"] * 4 + ["rest"]


@pytest.mark.filterwarnings("ignore:.*end of the range:pbd.errors.PbdWarning")  # the roll clips the gyro
def test_final_keyframe_of_test_1_is_within_a_centimetre_in_the_median() -> None:
    errors = [keyframes_and_errors(simulate("pick-and-place-stops", "os5000", seed))[1][-1] for seed in range(10)]
    assert np.median(errors) < 0.010


@pytest.mark.parametrize("sensor", ["modern", "os5000"])
@pytest.mark.parametrize("seed", range(2))
def test_every_stop_of_an_everyday_task_is_found_and_nothing_else(sensor: str, seed: int) -> None:
    keyframes, errors = keyframes_and_errors(pour(sensor, seed))
    assert len(keyframes) == 11
    assert errors.max() < 0.05
    assert [(i, k.grip) for i, k in enumerate(keyframes) if k.grip is not None] == [(2, True), (8, False)]


@pytest.mark.parametrize(("apart_m", "turned_deg", "stops"), [(0.015, 8.0, 3), (0.025, 0.0, 4), (0.015, 13.0, 4)])
def test_a_put_down_that_bounces_by_less_than_2_cm_and_10_degrees_is_one_stop(
    apart_m: float, turned_deg: float, stops: int
) -> None:
    up, down, beside = (0.0, 0.0, 0.15), (0.2, 0.0, 0.0), (0.2, 0.0, apart_m)
    turn = (0.0, np.radians(turned_deg), 0.0)
    lands = Waypoint(down, move_s=0.8, rest_s=0.25), Waypoint(beside, turn, move_s=0.2, rest_s=1.0)
    task = Task("bounce", (Waypoint(rest_s=2.0), Waypoint(up, move_s=0.8, rest_s=0.8), *lands))
    assert len(track(simulate(task, "modern", 2)).stops) == stops


@pytest.mark.parametrize("peak", [20.0, 120.0])
def test_a_knock_on_a_hand_that_rests_makes_no_second_stop(peak: float) -> None:
    recording = pour().recording
    rests = [stop for stop in track(recording).stops if stop.dwell_s > 0.9]
    knocked = tapped(recording, [(float(recording.t[(stop.start + stop.stop) // 2]), peak) for stop in rests])
    assert rests
    assert len(track(knocked).stops) == 11


def test_sigma_grows_along_the_path() -> None:
    cov = track(pour().recording).cov
    sigma = np.sqrt(np.trace(cov[:, :3, :3], axis1=1, axis2=2))
    assert sigma[0] == 0.0
    assert (np.diff(sigma) > 0.0).all()
    assert (np.linalg.eigvalsh(cov) >= -1e-12).all()


def test_without_any_attitude_it_is_refused() -> None:
    with pytest.raises(TrackingError, match="neither a gyro nor the device's own attitude"):
        track(replace(simulate("pour", "modern").recording, gyr=None, device_rpy=None))


def test_a_wrong_unit_is_refused_and_named() -> None:
    recording = pour().recording
    with pytest.raises(RecordingError, match=r"likely in g: import the file with --unit acc=g"):
        track(replace(recording, acc=recording.acc / GRAVITY))
    for count, unit in ((16384, "0.00006103515625g"), (8500, "0.0001220703125g"), (2048, "0.00048828125g")):
        with pytest.raises(
            RecordingError, match=rf"likely raw counts: import the file with --unit acc={unit}, and a gyro"
        ):
            track(replace(recording, acc=count * recording.acc / GRAVITY))
    with pytest.raises(RecordingError, match=r"likely in mm/s2: "):
        track(replace(recording, acc=1e3 * recording.acc))
    with pytest.raises(RecordingError, match="likely in mg: "):
        track(replace(recording, acc=1e3 * recording.acc / GRAVITY))
    with pytest.raises(RecordingError, match="likely in m/s2: import the file with --unit acc=m/s2"):
        track(replace(recording, acc=GRAVITY * recording.acc))
    with pytest.raises(RecordingError, match="gravity seems to have been removed"):
        track(replace(recording, acc=recording.acc - recording.acc[0] + 0.1))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_accelerometer_that_is_off_by_a_fifth_is_to_be_calibrated(sign: float) -> None:
    recording = pour().recording
    with pytest.raises(TrackingError, match=r"; if the unit is right, .* pbd calibrate sensor, and give that --calibr"):
        track(replace(recording, acc=(1.0 + 0.2 * sign) * recording.acc))
    with pytest.raises(RecordingError, match="check the unit of the columns ax, ay, az"):
        track(replace(recording, acc=(1.0 + 0.4 * sign) * recording.acc))


def test_time_running_backwards_is_refused() -> None:
    recording = pour().recording
    t = recording.t.copy()
    t[1000:] -= 5.0
    with pytest.raises(RecordingError, match=r"time runs backwards from 9\.990 s \(row 999\) to 5\.000 s \(row 1000\)"):
        track(replace(recording, t=t))


@pytest.mark.parametrize("z", [0.0, 9.81])
def test_a_dead_accelerometer_is_refused(z: float) -> None:
    """The gyro, which contradicts it, is not blamed."""
    recording = pour().recording
    with pytest.raises(RecordingError, match="the accelerometer always reads the same, though the hand turns"):
        track(replace(recording, acc=np.full_like(recording.acc, (0.0, 0.0, z))))


def test_motion_at_either_end_is_told() -> None:
    recording = pour().recording
    with pytest.warns(PbdWarning, match="the hand moves when the recording ends: the last 0"):
        track(with_rows(recording, slice(0, 700)))
    later = with_rows(recording, slice(290, None))
    with pytest.warns(PbdWarning, match="the hand moves when the recording starts"):
        track(replace(later, t=later.t - later.t[0]))


@pytest.mark.filterwarnings("ignore:no motion between the stops:pbd.errors.PbdWarning")  # samples alias what shakes
@pytest.mark.parametrize(("rest_too", "vibration_hz"), [(True, 137.0), (False, 228.0)])
def test_what_vibrates_takes_the_hand_nowhere(rest_too: bool, vibration_hz: float) -> None:
    """A motor or a phone beside the sensor, with 4 m/s2: always, or every other 2 s. 228 Hz is sampled as 58 Hz."""
    demo = simulate(replace(TASKS["pour"], waypoints=TASKS["pour"].waypoints[:4]), "modern", 0, rate_hz=286.0)
    t, gyr = demo.recording.t, demo.recording.gyr
    assert gyr is not None
    runs_up = np.clip(10.0 * np.minimum(t % 4.0 - 2.0, 4.0 - t % 4.0), 0.0, 1.0)
    wave = ((1.0 if rest_too else runs_up) * np.sin(2.0 * np.pi * vibration_hz * t))[:, None]
    shaken = replace(demo.recording, acc=demo.recording.acc + 4.0 * wave * (0.6, 0.2, 0.77), gyr=gyr + 0.1 * wave)
    calm, shaking = track(demo), track(replace(demo, recording=shaken))
    assert len(calm.stops) == len(shaking.stops)
    ends, ends_shaking = ([(stop.start, stop.stop) for stop in path.stops] for path in (calm, shaking))
    np.testing.assert_allclose(ends_shaking, ends, atol=0.05 * 286.0)
    np.testing.assert_allclose(shaking.p_nav_sensor[-1], calm.p_nav_sensor[-1], atol=0.01)
    live = LiveTracker("modern")
    live.feed(t, shaken.acc, shaken.gyr, shaken.mag)
    assert len(live.keyframes) == len(calm.stops)
    off = live.keyframes[-1].T_nav_sensor.p - calm.p_nav_sensor[-1]
    assert np.linalg.norm(off) < min(0.03, 3.0 * np.sqrt(np.diag(live.keyframes[-1].cov)[:3].max()))


@uncalibrated
@pytest.mark.filterwarnings("ignore:.*end of the range:pbd.errors.PbdWarning")  # the roll clips the gyro
@pytest.mark.parametrize("sensor", ["modern", "os5000", "wt901"])
def test_a_slow_smooth_hand_stops_where_it_stops(sensor: str) -> None:
    """Half-way through such a move the sensor is as quiet as at a stop."""
    waypoints = tuple(replace(waypoint, move_s=2.0 * waypoint.move_s) for waypoint in TASKS["pour"].waypoints)
    _, errors = keyframes_and_errors(simulate(replace(TASKS["pour"], waypoints=waypoints), sensor, 0))
    assert len(errors) == len(waypoints)
    assert errors.max() < 0.07


def test_a_coarse_sensor_is_as_unsure_whether_or_not_its_calibration_mixes_the_axes() -> None:
    """The readings show how coarse it is: corrected values have no step, and seemed free of rounding errors."""
    recording, step = simulate("pour").recording, 16.0 * MG
    coarse = replace(recording, acc=step * np.round(recording.acc / step))
    sigmas = []
    for mixed in (0.0, 1e-3):
        acc = LinearErrors(np.zeros(3), np.eye(3) + mixed, np.full(3, 0.02), 1e-3)
        path = track(coarse, calibration=Calibration("bench", sensor=SensorErrors(recording.info.sensor, acc=acc)))
        sigmas.append(np.sqrt(np.diagonal(path.cov[5])[:3]))
    np.testing.assert_allclose(sigmas[1], sigmas[0], rtol=0.02)


@pytest.mark.filterwarnings("ignore::pbd.errors.PbdWarning")
def test_guessed_values_hide_no_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those beyond the range lie between the readings, and made the sensor seem nine times as fine."""
    recording, seen = simulate("pour", "wt901").recording, list[object]()
    clipped = replace(recording, gyr=np.clip(not_none(recording.gyr), -2.0, 2.0))
    monkeypatch.setattr("pbd.track_recording.noise_of", lambda *args: (seen.append(args[3]), noise_of(*args))[1])  # type: ignore[func-returns-value]
    track(clipped)
    assert seen == [steps_of(clipped)]
