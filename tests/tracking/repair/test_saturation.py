"""Clipped axes are found, repaired as far as possible, and widen sigma; nothing else is taken for clipping."""

import warnings
from dataclasses import replace
from functools import cache
from math import inf
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbd.data import GRAVITY, Demonstration, Recording
from pbd.errors import PbdWarning, TrackingError
from pbd.files.importers import import_file
from pbd.pipeline import track
from pbd.pose import quat_inverse, quat_log, quat_multiply
from pbd.simulation.sensor_model import SensorModel
from pbd.simulation.simulate import SENSOR_MODELS, TASKS, random_task
from pbd.simulation.tasks import Task
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.repair.saturation import Clip, clips_of, declip, find_clips
from tests.benchmarks.tracking import stride_errors
from tests.benchmarks.trials import read_broad
from tests.near import assert_near
from tests.not_none import not_none
from tests.scenarios import simulate, truth_at, with_rows

clipping = pytest.mark.filterwarnings("ignore:.*end of the range:pbd.errors.PbdWarning")


def limited(sensor: str, gyr_deg: float = inf, acc: float = inf) -> SensorModel:
    model = SENSOR_MODELS[sensor]
    gyr = None if model.gyr is None else replace(model.gyr, limit=np.radians(gyr_deg))
    return replace(model, gyr=gyr, acc=replace(model.acc, limit=acc))


def fast(seed: int) -> Task:
    return random_task(seed, move_s=(0.2, 0.5), max_turn=1.5)


def errors_in_m_and_sigma(demo: Demonstration) -> tuple[float, list[float]]:
    """The largest error of a keyframe, m; and all errors along each axis in the tracker's own sigmas."""
    keyframes = find_keyframes(track(demo.recording))
    off = np.array([k.T_nav_sensor.p - truth_at(not_none(demo.truth), k.t) for k in keyframes])
    sigma = np.sqrt([np.diagonal(k.cov)[:3] for k in keyframes])
    return float(np.linalg.norm(off, axis=1).max()), (off[1:] / sigma[1:]).ravel().tolist()


@cache
def error_unclipped(sensor: str, seed: int) -> float:
    """The largest error of a keyframe of a fast task without clipping, m."""
    return errors_in_m_and_sigma(simulate(fast(seed), limited(sensor), seed))[0]


def flat(demo: Demonstration, monkeypatch: pytest.MonkeyPatch) -> float:
    """The largest error if clipped samples are used as they are, m."""
    with monkeypatch.context() as patched, warnings.catch_warnings():
        warnings.simplefilter("ignore", PbdWarning)  # the field seems to turn, as the attitude is wrong
        patched.setattr("pbd.track_recording.find_clips", lambda recording: ())
        try:
            return errors_in_m_and_sigma(demo)[0]
        except TrackingError:
            return inf


def marked(clips: tuple[Clip, ...], sensor: str, n: int) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    mask = np.zeros((n, 3), dtype=bool)
    for clip in clips:
        if clip.sensor == sensor:
            mask[clip.start : clip.stop, clip.axis] = True
    return mask


@clipping
@pytest.mark.parametrize("sensor", ["os5000", "wt901", "modern", "ideal"])
@pytest.mark.parametrize("seed", range(2))
def test_exactly_the_clipped_samples_of_a_long_clip_are_marked(sensor: str, seed: int) -> None:
    limit = np.radians(150.0)
    clipped = simulate(fast(seed), limited(sensor, gyr_deg=150.0), seed).recording
    free = simulate(fast(seed), limited(sensor), seed).recording
    assert free.gyr is not None
    beyond = np.abs(free.gyr) > limit * (1.0 + 1e-3)
    found = marked(find_clips(clipped), "gyr", len(clipped))
    assert beyond.any()
    # What clips an axis for three samples nowhere is not found; anything else is, and no sample that isn't clipped.
    assert not (found & (np.abs(free.gyr) < limit * (1.0 - 1e-3))).any()
    assert (found & beyond).sum() > 0.95 * beyond.sum()


def test_one_line_says_how_many_which_axis_where_and_what_to_do() -> None:
    with pytest.warns(PbdWarning) as caught:
        track(simulate("pick-and-place-stops", "os5000").recording)
    assert [str(warning.message) for warning in caught] == [
        "3 samples of the gyro's x axis are at the end of the range (500 deg/s), the first at t = 4.70 s: values "
        "above it are guessed; move slower and without knocks, or set a larger range"
    ]


def test_each_sensors_end_is_named() -> None:
    recording = simulate("pour", "modern", 0).recording
    ends = {"gyr": np.radians(31.25), "acc": 1.2 * GRAVITY}
    acc = np.clip(1.6 * recording.acc, -ends["acc"], ends["acc"])
    clipped = replace(recording, gyr=np.clip(not_none(recording.gyr), -ends["gyr"], ends["gyr"]), acc=acc)
    with pytest.warns(
        PbdWarning, match=r"accelerometer's .*z axes and the gyro's x axis are at .* \(1\.2 g and 31 deg/s\)"
    ):
        find_clips(clipped)


def test_the_end_of_the_range_is_read_from_the_axis_that_clips_first() -> None:
    t = np.arange(400) / 100.0
    turn = np.zeros((400, 3))
    for axis, at in ((2, 1.0), (0, 2.5)):
        turn[:, axis] = 3.0 * np.exp(-(((t - at) / 0.3) ** 2))
    recording = Recording(t, np.tile((0.0, 0.0, GRAVITY), (400, 1)), gyr=np.minimum(turn, 1.0))
    with pytest.warns(PbdWarning, match=r"gyro's x, z axes are at the end of the range \(57 deg/s\)"):
        find_clips(recording)


@pytest.mark.parametrize("rate_hz", [25.0, 250.0])
@pytest.mark.parametrize("sensor", ["os5000-nogyro", "wt901", "modern", "ideal"])
def test_nothing_is_found_where_nothing_clips(sensor: str, rate_hz: float) -> None:
    tasks: tuple[str | Task, ...] = (*TASKS, random_task(0), fast(0), fast(1))
    for task in tasks:
        assert clips_of(simulate(task, limited(sensor), 1, rate_hz=rate_hz).recording) == ()


@settings(deadline=None, max_examples=15)
@given(
    st.sampled_from(["os5000", "wt901", "modern"]),
    st.floats(0.1, 30.0),
    st.floats(0.01, 1.0),
    st.integers(0, 2**32 - 1),
    st.sampled_from([25.0, 40.0, 100.0, 250.0]),
)
def test_nothing_is_found_however_coarse_the_sensor(
    sensor: str, acc_mg: float, gyr_deg: float, seed: int, rate_hz: float
) -> None:
    model = limited(sensor)
    acc = replace(model.acc, step=1e-3 * GRAVITY * acc_mg)
    coarse = replace(model, acc=acc, gyr=replace(not_none(model.gyr), step=np.radians(gyr_deg)))
    assert clips_of(simulate(fast(seed), coarse, seed, rate_hz=rate_hz).recording) == ()


def test_nothing_is_found_in_real_recordings(data_folder: Path) -> None:
    """The strides' impacts clip at 16 g, but were then corrected for misalignment, so no two are equal."""
    recordings = [
        trial.recording for file in (data_folder / "broad").glob("*.npz") for trial in read_broad(file).values()
    ]
    recordings += [import_file(file).recording for file in (data_folder / "strides").glob("*.npz")]
    recordings += [import_file(file).recording for file in (data_folder / "walks").glob("*.csv")]
    assert recordings
    assert all(find_clips(recording) == () for recording in recordings)


def test_a_row_that_is_repeated_at_a_peak_is_no_flat_top() -> None:
    recording = simulate("pour", "modern").recording
    assert recording.gyr is not None
    peak = int(np.argmax(recording.gyr[:, 0]))
    rows = np.clip(np.arange(len(recording) + 4) - np.clip(np.arange(len(recording) + 4) - peak, 0, 4), 0, None)
    held = Recording(np.arange(len(rows)) / 100.0, recording.acc[rows], recording.gyr[rows])
    assert (np.diff(held.gyr[peak : peak + 5, 0]) == 0.0).all() if held.gyr is not None else False
    assert find_clips(held) == ()


def test_a_slow_accelerometer_beside_a_faster_gyro_has_no_flat_top() -> None:
    recording = simulate("pick-and-place-stops", "modern").recording
    acc = np.repeat(recording.acc[::4], 4, axis=0)[: len(recording)]
    assert find_clips(replace(recording, acc=acc)) == ()


def test_a_clipped_parabola_is_continued_and_as_unsure_as_the_continuation() -> None:
    t = np.arange(400.0)
    x = 30.0 * np.clip(1.0 - ((t - 200.0) / 20.0) ** 2, 0.0, 1.0) + 1e-3 * np.sin(7.0 * t)
    acc = np.column_stack((np.minimum(x, 20.0), 0.1 * np.sin(t), np.full(400, 9.8)))
    clipped = Recording(0.01 * t, acc)
    clips = clips_of(clipped)
    assert [(clip.sensor, clip.axis, clip.start, clip.stop) for clip in clips] == [("acc", 0, 189, 212)]
    restored, lost_motion = declip(clipped, clips)
    assert restored.acc[189:212, 0] == pytest.approx(x[189:212], rel=0.016)
    lost = 0.01 * ((restored.acc - acc)[:, 0].sum() + 0.1 * 20.0 * 23 + 20.0 - min(x[188], x[212]))
    assert np.sqrt(sum(impulse.dv @ impulse.dv for impulse in lost_motion)) == pytest.approx(lost)
    assert [impulse.row for impulse in lost_motion] == [189 + 5, 212 - 5]


@pytest.mark.parametrize(("equal", "lower", "clips"), [(3, 0, False), (4, 0, True), (4, 1, False)])
def test_impacts_are_clipped_if_four_have_the_same_top(equal: int, lower: int, clips: bool) -> None:
    """If 30 steps are as likely, four of four are in the top one with a chance of 1 / 30^3, of five with four times it:
    below and above 1e-4."""
    acc = np.column_stack((0.01 * np.round(10.0 * np.sin(np.arange(400.0))), np.zeros(400), np.full(400, 9.8)))
    acc[50 : 50 + 20 * equal : 20, 0] = 39.2
    acc[250 : 250 + 20 * lower : 20, 0] = 39.0
    found = clips_of(Recording(0.01 * np.arange(400.0), acc))
    assert [clip.start for clip in found] == [50 + 20 * k for k in range(equal)] * clips


@pytest.mark.parametrize(("first", "beside"), [(0, 10), (390, 389)])
def test_a_clip_at_an_end_of_the_recording_is_left_as_it_is_and_unsure(first: int, beside: int) -> None:
    acc = 0.01 * np.round(10.0 * np.sin(np.arange(1200.0).reshape(400, 3))) + (0.0, 0.0, 9.8)
    acc[first : first + 10, 0] = 39.2
    recording = Recording(0.01 * np.arange(400.0), acc)
    restored, lost = declip(recording, clips_of(recording))
    np.testing.assert_array_equal(restored.acc, acc)
    assert np.sqrt(sum(each.dv @ each.dv for each in lost)) == pytest.approx(
        0.01 * (0.1 * 39.2 * 10 + 39.2 - acc[beside, 0])
    )


def test_equal_tops_among_many_as_high_ones_are_no_clips() -> None:
    acc = np.column_stack((np.zeros(400), np.zeros(400), np.full(400, 9.8)))
    acc[20:380:5, 0] = 39.0 + 0.01 * (np.arange(72) % 20)  # four in each of twenty steps
    assert clips_of(Recording(0.01 * np.arange(400.0), acc)) == ()


@pytest.mark.filterwarnings("ignore::pbd.errors.PbdWarning")
def test_the_velocity_that_real_impacts_lose_is_regained(data_folder: Path) -> None:
    """A foot's impacts of 6 g and more, clipped at 4 g, are one or two samples long."""
    (file,) = (data_folder / "strides").glob("*.npz")
    demo = import_file(file)
    acc = np.clip(demo.recording.acc, -4.0 * GRAVITY, 4.0 * GRAVITY)
    clipped = replace(demo, recording=replace(demo.recording, acc=acc))
    whole, lost = (float(np.median(stride_errors(each)[0])) for each in (demo, clipped))
    assert lost < 1.3 * whole


@pytest.mark.parametrize(("sensor", "top"), [("acc", 36.0), ("gyr", 18.0)])
def test_two_thirds_of_a_peak_are_continued_of_an_accelerometer_but_not_of_a_gyro(sensor: str, top: float) -> None:
    t = np.arange(400.0)
    x = 36.0 * np.clip(1.0 - ((t - 200.0) / 20.0) ** 2, 0.0, 1.0) + 1e-3 * np.sin(7.0 * t)
    peak = np.column_stack((np.minimum(x, 12.0), 0.1 * np.sin(t), np.cos(t)))
    quiet = np.column_stack((np.sin(t), np.cos(t), np.full(400, 9.8)))
    clipped = Recording(0.01 * t, *((peak, quiet) if sensor == "acc" else (quiet, peak)))
    restored, _ = declip(clipped, [clip for clip in clips_of(clipped) if clip.sensor == sensor])
    assert getattr(restored, sensor)[:, 0].max() == pytest.approx(top, rel=0.025)


@given(st.floats(0.0, 1.0))
def test_a_peak_backwards_is_continued_backwards(at: float) -> None:
    """It clips where its flanks still steepen."""
    t = np.arange(60.0)
    acc = np.zeros((60, 3))
    acc[:, 0] = np.minimum(36.0 * np.exp(-(((t - 30.0 - at) / 3.0) ** 2)), 12.0)
    first, last = np.flatnonzero(acc[:, 0] == 12.0)[[0, -1]].tolist()
    there, _ = declip(Recording(0.01 * t, acc), [Clip("acc", 0, 1.0, first, last + 1)])
    back, _ = declip(Recording(0.01 * t, acc[::-1]), [Clip("acc", 0, 1.0, 59 - last, 60 - first)])
    assert there.acc.max() > 12.5
    assert_near(back.acc[::-1], there.acc, 1e-12)


@clipping
def test_the_roll_of_test_1_is_put_back_by_gravity() -> None:
    """Its peak of 640 deg/s clips at 500 deg/s, which loses about five degrees."""
    lost, tilt = [], []
    for seed in range(3):
        clipped = simulate("pick-and-place-stops", "os5000", seed)
        free = simulate("pick-and-place-stops", limited("os5000"), seed).recording
        lost.append(np.degrees((not_none(free.gyr) - not_none(clipped.recording.gyr))[:, 0].sum() / 40.0))
        path = track(clipped.recording)
        turn = quat_log(
            quat_multiply(path.wxyz_nav_sensor[-1], quat_inverse(not_none(clipped.truth).wxyz_nav_sensor[-1]))
        )
        tilt.append(np.degrees(np.hypot(turn[0], turn[1])))
    assert np.median(lost) > 4.0
    assert np.median(tilt) < 1.0


# A lost turn about the vertical looks like a disturbed field; that is a warning too many, and no other harm.
@pytest.mark.filterwarnings("ignore::pbd.errors.PbdWarning")
@pytest.mark.parametrize(
    ("sensor", "gyr_deg", "acc", "seeds"),
    [("modern", 200.0, inf, 4), ("modern", inf, 12.0, 3)],
)
def test_a_clipped_recording_is_tracked_far_better_than_it_was_sampled(
    sensor: str, gyr_deg: float, acc: float, seeds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    free, restored, as_it_is, scaled = [], [], [], []
    for seed in range(seeds):
        demo = simulate(fast(seed), limited(sensor, gyr_deg, acc), seed)
        error, in_sigma = errors_in_m_and_sigma(demo)
        restored.append(error)
        scaled += in_sigma
        as_it_is.append(flat(demo, monkeypatch))
        free.append(error_unclipped(sensor, seed))
    # Some of the recordings are tracked as well without it. A refusal counts as 10 cm.
    assert np.minimum(restored, 0.1).mean() < 0.35 * np.minimum(as_it_is, 0.1).mean()
    assert np.median(restored) < np.median(free) + 0.008
    assert max(restored) < max(as_it_is)
    # Sigma is honest about what was guessed: no narrower than a normal error's would be by a tenth.
    assert np.mean(np.abs(scaled) < 1.0) > 0.58
    assert np.mean(np.abs(scaled) < 2.0) > 0.85


@pytest.mark.filterwarnings("ignore::pbd.errors.PbdWarning")
@pytest.mark.parametrize(("gyr_deg", "acc"), [(150.0, inf), (inf, 12.0)])
def test_sigma_widens_in_the_move_that_clips_and_not_before(gyr_deg: float, acc: float) -> None:
    grown = []
    for seed in range(3):
        recording = simulate(fast(seed), limited("modern", gyr_deg, acc), seed).recording
        clipped, free = track(recording), track(simulate(fast(seed), limited("modern"), seed).recording)
        assert len(clipped.stops) == len(free.stops)
        start = find_clips(recording)[0].start
        first = next(k for k, stop in enumerate(clipped.stops) if stop.start > start)
        wide, narrow = (np.trace(path.cov[:, :3, :3], axis1=1, axis2=2) for path in (clipped, free))
        assert wide[:first] == pytest.approx(narrow[:first], rel=0.6)  # in sigma, a quarter
        grown.append((wide[first] - wide[first - 1]) / (narrow[first] - narrow[first - 1]))
    assert np.median(grown) > 1.1


@pytest.mark.filterwarnings("ignore::pbd.errors.PbdWarning")
def test_a_clipped_turn_about_the_vertical_is_put_back_by_the_move_around_it() -> None:
    """Gravity does not show the lost turn. The hand's velocity does: it would not end at zero."""
    off, sigmas = [], []
    for seed in range(4):
        demo = simulate(random_task(3, moves=4), limited("modern", 60.0), seed)
        path = track(replace(demo.recording, mag=None))
        at = [(stop.start + stop.stop) // 2 for stop in path.stops]
        true = quat_inverse(not_none(demo.truth).wxyz_nav_sensor[at])
        heading = quat_log(quat_multiply(path.wxyz_nav_sensor[at], true))[:, 2]
        off += (heading[1:] - heading[0]).tolist()
        sigmas += np.sqrt(path.cov[1:, 5, 5]).tolist()
    assert np.degrees(np.median(np.abs(off))) < 0.3
    assert np.mean(np.abs(off) < 2.0 * np.array(sigmas)) > 0.9


@clipping
def test_a_recording_that_ends_in_a_clip_is_tracked() -> None:
    recording = simulate(fast(0), limited("modern", 150.0, 15.0), 0).recording
    ended = with_rows(recording, slice(0, clips_of(recording)[-1].start + 3))
    assert clips_of(ended)[-1].stop == len(ended)
    assert len(track(ended).stops) == sum(stop.stop <= len(ended) for stop in track(recording).stops)


@clipping
def test_the_papers_method_is_told_and_left_alone() -> None:
    recording = simulate("pick-and-place-stops", "os5000").recording
    with pytest.warns(PbdWarning, match="end of the range"):
        track(recording, "paper")
