"""Jittering and coarse time stamps, lost and repeated samples: the path stays that of the clean recording."""

import re
import warnings
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pbd.data import Demonstration, Recording
from pbd.errors import PbdWarning, RecordingError
from pbd.pipeline import track
from pbd.pose import Array
from pbd.simulation.simulate import SENSOR_MODELS
from pbd.timestamps.even_times import batched_interval
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.online.sample_repair import JUDGED_ROWS
from pbd.tracking.repair.clock import even_stamps, with_checked_times
from pbd.tracking.repair.repair_recording import repair_recording
from tests.not_none import not_none
from tests.scenarios import simulate, truth_at, uncalibrated, with_rows

pytestmark = pytest.mark.usefixtures("cached_results")

RATES = [("os5000", None), ("modern", None), ("modern", 95.0), ("wt901", 41.0), ("modern", 286.0)]


def worst(demo: Demonstration, recording: Recording) -> float:
    """Largest error of a keyframe, m, of a recording of the demonstration. All stops must be found."""
    keyframes = find_keyframes(track(recording))
    assert len(keyframes) == 11
    return max(float(np.linalg.norm(k.T_nav_sensor.p - truth_at(not_none(demo.truth), k.t))) for k in keyframes)


def said(recording: Recording) -> str:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warnings.filterwarnings("ignore", "at rest the accelerometer reads", PbdWarning)  # wt901's bias
        track(recording)
    return "\n".join(str(warning.message) for warning in caught)


def unnamed(recording: Recording) -> Recording:
    """The recording without its nominal rate."""
    return replace(recording, info=replace(recording.info, rate_hz=None))


def test_two_times_of_many_rows_tell_no_rate() -> None:
    recording = unnamed(with_rows(simulate("pour", "modern", 1).recording, slice(0, 300)))
    t = np.repeat((0.0, 100.0), 150)
    assert (even_stamps(replace(recording, t=t)) == t).all()


@uncalibrated
@pytest.mark.parametrize(("sensor", "rate_hz"), RATES[::4])
@pytest.mark.parametrize("has_clock", [True, False], ids=["true stamps", "even stamps"])
def test_jittering_samples_do_no_harm(sensor: str, rate_hz: float | None, has_clock: bool) -> None:
    """Jitter of a fifth of the interval, with or without time stamps that show it."""
    model = SENSOR_MODELS[sensor]
    model = replace(model, rate_hz=rate_hz or model.rate_hz)
    clean = simulate("pour", model, 1)
    demo = simulate("pour", replace(model, jitter_s=0.2 / model.rate_hz, has_clock=has_clock), 1)
    assert re.fullmatch(
        r"(the time stamps jitter; evenly spaced times at \d+ Hz are used instead)?", said(demo.recording)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PbdWarning)
        assert worst(demo, demo.recording) < worst(clean, clean.recording) + 0.006


@uncalibrated
@pytest.mark.parametrize(("sensor", "rate_hz"), RATES[::2])
def test_jittering_stamps_are_replaced_and_hide_no_sample(sensor: str, rate_hz: float | None) -> None:
    demo = simulate("pour", sensor, 1, rate_hz=rate_hz)
    interval = 1.0 / demo.recording.rate_hz
    late = 0.2 * interval * np.random.default_rng(0).normal(size=len(demo.recording))
    jittered = replace(demo.recording, t=demo.recording.t + np.clip(late, -0.45 * interval, 0.45 * interval))
    with pytest.warns(PbdWarning, match="jitter; evenly spaced") as said:
        assert np.diff(even_stamps(jittered)) == pytest.approx(interval, rel=1e-3)
    assert len(said) == 1


@pytest.mark.parametrize(
    ("sensor", "rate_hz", "step_s"),
    [*((*each, 1.0 / 64.0) for each in RATES[::2]), ("modern", 286.0, 1e-3), ("modern", 95.0, 1e-2)],
)
def test_coarse_stamps_do_no_harm(sensor: str, rate_hz: float | None, step_s: float) -> None:
    demo = simulate("pour", sensor, 1, rate_hz=rate_hz)
    coarse = replace(demo.recording, t=np.floor(demo.recording.t / step_s + 1e-9) * step_s)
    message = said(coarse)
    assert "gap" not in message
    assert "Hz, but" not in message
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PbdWarning)
        assert worst(demo, coarse) < worst(demo, demo.recording) + 0.006


def off_beat(rate_hz: float, step_s: float, kept: Array, nominal: bool) -> tuple[Array, str]:
    """Errors (n,) of the corrected stamps of the `kept` samples, in intervals; and the warnings."""
    true = np.flatnonzero(kept) / rate_hz
    stamps = np.floor(true / step_s + 1e-9) * step_s
    noise = np.random.default_rng(0).normal(size=(len(true), 3))
    recording = Recording(stamps, noise)
    if nominal:
        recording = replace(recording, info=replace(recording.info, rate_hz=rate_hz))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        off = (even_stamps(recording) - true) * rate_hz
    return off - np.median(off), "".join(str(warning.message) for warning in caught)


@pytest.mark.filterwarnings("ignore:the time stamps come in batches")
def test_a_clock_of_two_rates_has_an_interval() -> None:
    """The median of its spans is between two of them, far from both."""
    t = np.cumsum([0.0, *20 * (0.1,), *21 * (10.0,)])
    steps = np.diff(even_stamps(Recording(t, np.random.default_rng(0).normal(size=(len(t), 3)))))
    assert 0.09 < steps.min() <= steps.max() < 10.1


@pytest.mark.parametrize(("shortest_ms", "longest_ms"), [(9, 11), (8, 12), (4, 16), (5, 25), (2, 30), (18, 22)])
@pytest.mark.parametrize("lost", [0.0, 0.02])
def test_true_stamps_of_uneven_samples_are_kept(shortest_ms: int, longest_ms: int, lost: float) -> None:
    """A program polls the sensor between other work, and stamps the samples in whole ms."""
    rng = np.random.default_rng(0)
    t: Array = np.cumsum(rng.integers(shortest_ms, longest_ms + 1, 2000)) / 1000.0
    t = t[rng.random(2000) >= lost]
    recording = Recording(t, rng.normal(size=(len(t), 3)))
    assert even_stamps(recording) is recording.t


@pytest.mark.parametrize("mean_ms", [2.0, 5.0])
@pytest.mark.parametrize("lost", [0.0, 0.005])
def test_arrival_times_of_a_busy_host_are_replaced(mean_ms: float, lost: float) -> None:
    """A program stamps samples of 100 Hz when it reads them. In fast motion attitude was off by 3 degrees instead of
    0.3."""
    rng = np.random.default_rng(0)
    true = 0.01 * np.flatnonzero(rng.random(4000) >= lost)
    arrived = np.maximum.accumulate(true + 1e-3 * rng.exponential(mean_ms, len(true)))
    with pytest.warns(PbdWarning, match="evenly spaced times"):
        off = even_stamps(Recording(arrived - arrived[0], rng.normal(size=(len(true), 3)))) - true
    assert np.std(off) < 0.5e-3 * mean_ms


@pytest.mark.parametrize(("lasts", "uneven"), [(0.6, False), (0.85, True)])
@pytest.mark.parametrize("rows", [JUDGED_ROWS, 2000])  # as many as the live tracker judges again; a recording
def test_delays_that_wander_show_that_the_samples_were_taken_at_uneven_times(
    rows: int, lasts: float, uneven: bool
) -> None:
    """A delay keeps this share from sample to sample: its mean square difference is 2 (1 - share) of its variance."""
    rng, late = np.random.default_rng(0), np.zeros(rows)
    for k in range(1, rows):
        late[k] = lasts * late[k - 1] + np.sqrt(1.0 - lasts**2) * rng.normal()
    recording = Recording(0.01 * np.arange(rows) + 1e-3 * late, rng.normal(size=(rows, 3)))
    with nullcontext() if uneven else pytest.warns(PbdWarning, match="jitter; evenly spaced"):
        assert (even_stamps(recording) is recording.t) == uneven


@pytest.mark.parametrize("rate_hz", [57.0, 100.0])
def test_samples_that_a_program_reads_now_once_now_twice_are_interpolated(rate_hz: float) -> None:
    """Of a sensor of 40 Hz. A reading is up to half an interval older than its stamp, so the mean age matters not."""
    t = np.arange(2000) / rate_hz
    taken = np.floor(t * 40.0) / 40.0

    def motion(t: Array) -> Array:
        turns: Array = np.sin(np.outer(t, (2.0, 3.0, 5.0)))
        return turns

    with pytest.warns(PbdWarning, match=r"\d\d% of the rows repeat .* the sensor gives only 40 a second"):
        mended = with_checked_times(Recording(t, motion(taken)))
    late = np.linspace(0.0, 0.05, 51)
    off = [np.abs(mended.acc[50:-50] - motion(t[50:-50] - each)).max() for each in late]
    held = [np.abs(motion(taken[50:-50]) - motion(t[50:-50] - each)).max() for each in late]
    assert min(off) < 0.2 * min(held)


@pytest.mark.parametrize("shared_rate_hz", [57.0, 100.0])
def test_readings_of_a_coarse_sensor_that_stay_for_an_interval_are_samples(shared_rate_hz: float) -> None:
    """Of 40 Hz, which changes in four of five samples."""
    t = np.arange(4000) / shared_rate_hz
    acc = 0.2 * np.round(5.0 * np.sin(np.outer(np.floor(t * 40.0) / 40.0, (3.0, 5.0, 7.0))))
    with pytest.warns(PbdWarning, match=r"the sensor gives only (39\.\d*|40|40\.\d*) a second"):
        with_checked_times(Recording(t, acc))


@settings(max_examples=40, deadline=None)
@given(st.floats(20.0, 400.0), st.sampled_from([1e-3, 5e-3, 1e-2, 1.0 / 64.0]), st.integers(0, 10**6))
def test_a_known_rate_puts_coarse_stamps_where_they_were(rate_hz: float, step_s: float, seed: int) -> None:
    kept = np.ones(int(12.0 * rate_hz) + seed % 50, dtype=np.float64)
    off, message = off_beat(rate_hz, step_s, kept, nominal=True)
    coarse = step_s * rate_hz
    assert np.abs(off).max() < (0.5 * coarse if message else coarse) + 0.1
    slow_beat = abs(2.0 * coarse - round(2.0 * coarse)) < 2.0 * step_s  # of ticks and samples: over 0.5 s, like a drift
    if message and not slow_beat:
        assert np.sqrt(np.mean(off**2)) < 0.1 * coarse + 0.05


@settings(max_examples=40, deadline=None)
@given(st.sampled_from([1e-3, 5e-3]), st.floats(30.0, 130.0), st.integers(0, 1000))
@example(5e-3, 56.9375, 269)
def test_lost_samples_stay_lost_where_stamps_are_coarse(step_s: float, rate_hz: float, seed: int) -> None:
    if step_s * rate_hz > 0.45:
        return  # coarser than that, and a lost sample can't be told for certain
    kept = (np.random.default_rng(seed).random(int(15.0 * rate_hz)) > 0.01).astype(np.float64)
    off, _ = off_beat(rate_hz, step_s, kept, nominal=False)
    end = round(0.5 * rate_hz)  # nearer to an end, the stamps beyond a lost sample are too few to tell it
    assert (np.abs(off[end:-end]) > 0.6).mean() < 0.02


def test_a_sensor_that_is_slower_than_its_nominal_rate_by_more_than_one_in_a_hundred_loses_samples() -> None:
    kept = np.ones(6000)
    kept[60:-60:65] = 0.0
    off, message = off_beat(100.0, 1.0 / 640.0, kept, nominal=True)
    assert "evenly spaced" in message
    assert (np.abs(off[60:-60]) > 0.6).mean() < 0.02


@pytest.mark.parametrize(("rate_hz", "tick"), [(100.0, 0.016), (150.0, 0.01), (120.0, 0.016), (400.0, 0.01)])
def test_stamps_rounded_to_the_nearest_tick_lose_nothing(rate_hz: float, tick: float) -> None:
    """The interval was off by up to 25 %, and one to a thousand samples seemed to be lost."""
    t: Array = np.arange(int(20.0 * rate_hz)) / rate_hz
    with pytest.warns(PbdWarning, match="evenly spaced times"):
        even = even_stamps(Recording(tick * np.rint(t / tick), np.random.default_rng(0).normal(size=(len(t), 3))))
    np.testing.assert_allclose(even, t, atol=0.6 * tick)


@pytest.mark.parametrize(("off", "told"), [(8, False), (12, True)])
def test_coarse_stamps_are_replaced_where_more_than_two_in_a_hundred_steps_are_off(off: int, told: bool) -> None:
    """A stamp that is off by a tick makes two such steps."""
    t: Array = 0.01 * np.arange(1000.0)
    t[np.linspace(20.0, 980.0, off).astype(np.intp)] += 0.001
    recording = Recording(t, np.random.default_rng(0).normal(size=(len(t), 3)))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        even_stamps(recording)
    assert bool(said) == told


def test_batches_of_very_different_sizes_lose_nothing() -> None:
    """Each has the time of its last sample. The rate was 5 % too high, and a hundred samples seemed to be lost."""
    rng = np.random.default_rng(0)
    last = np.cumsum(rng.integers(10, 31, 100)) - 1
    t = 0.01 * np.arange(last[-1] + 1)
    batched = Recording(t[last[np.searchsorted(last, np.arange(len(t)))]], rng.normal(size=(len(t), 3)))
    with pytest.warns(PbdWarning, match="come in batches"):
        assert np.diff(even_stamps(batched)) == pytest.approx(0.01, rel=0.005)


@pytest.mark.filterwarnings("ignore:the time stamps come in batches")
def test_more_than_half_of_the_samples_may_come_at_once() -> None:
    t = np.arange(1200.0) / 100.0
    t[400:1100] = t[1100]
    steps = np.diff(even_stamps(Recording(t, np.random.default_rng(0).normal(size=(len(t), 3)))))
    assert 0.009 < steps.min() <= steps.max() < 0.012


@pytest.mark.parametrize("stamped", ["first", "last"])
def test_a_batchs_time_may_be_that_of_its_first_sample_or_of_its_last(stamped: str) -> None:
    """Ten or eleven samples, or thirty: most steps are three times as short as others."""
    end = np.cumsum(np.random.default_rng(0).choice((10, 11, 30), 300))
    batch = np.searchsorted(end, np.arange(end[-1]), side="right")
    row = {"first": np.append(0, end[:-1]), "last": end - 1}[stamped]
    assert batched_interval(0.01 * row[batch]) == pytest.approx(0.01, rel=0.005)


def test_a_gap_between_batches_does_not_count() -> None:
    """At once come ten samples of 100 Hz; 15 are lost."""
    assert batched_interval(np.repeat((0.0, 0.1, 0.2, 0.45, 0.55, 0.65), 10)) == pytest.approx(0.01)


def test_batches_in_ms_are_told_by_their_unit() -> None:
    """They were refused as jumps of the clock."""
    t = np.asarray(10.0 * (np.arange(500) // 25 * 25), dtype=np.float64)
    with pytest.raises(RecordingError, match="the time is likely in ms: import the file with --unit t=ms"):
        with_checked_times(Recording(t, np.random.default_rng(0).normal(size=(500, 3))))


@pytest.mark.parametrize("batch", [2, 6, 7, 10, 15, 20])
def test_samples_stamped_in_batches_are_spread(batch: int) -> None:
    demo = simulate("pour", "modern", 1)
    n = len(demo.recording) // batch * batch
    recording = with_rows(demo.recording, slice(0, n))
    stamps = np.repeat(recording.t[batch - 1 :: batch], batch) + 1e-4 * np.tile(np.arange(batch), n // batch)
    batched = unnamed(replace(recording, t=stamps - stamps[0]))
    with pytest.warns(PbdWarning, match="come in batches; evenly spaced times at 100 Hz are used"):
        assert worst(demo, batched) < worst(demo, demo.recording) + 0.01


@pytest.mark.parametrize(("rate_hz", "batch"), [(100.0, 10), (100.0, 75), (50.0, 150), (200.0, 20)])
@pytest.mark.parametrize("seed", range(3))
def test_late_and_large_batches_lose_nothing(rate_hz: float, batch: int, seed: int) -> None:
    """As a phone's app flushes them. They were up to 0.8 s off at the end, and up to 57 samples seemed to be lost."""
    t = np.arange(int(25.0 * rate_hz)) / rate_hz
    last = np.minimum(np.arange(len(t)) // batch * batch + batch - 1, len(t) - 1)
    rng = np.random.default_rng(seed)
    stamps = t[last] + rng.uniform(0.0, 0.02, len(t))[last]
    with pytest.warns(PbdWarning, match="come in batches"):
        even = even_stamps(Recording(stamps - stamps[0], rng.normal(size=(len(t), 3))))
    off = even - t
    assert np.abs(off - np.median(off)).max() < 0.02


@pytest.mark.parametrize(("seconds", "told"), [(2.9, True), (3.9, False)])
@pytest.mark.filterwarnings("ignore:the time stamps come in batches")
def test_few_times_in_whole_seconds_tell_no_rate(seconds: float, told: bool) -> None:
    """They told one of 5e14 Hz."""
    rows = np.arange(int(100.0 * seconds))
    recording = Recording(np.floor(rows / 100.0), np.random.default_rng(0).normal(size=(len(rows), 3)))
    message = "its 290 rows have only 3 different times, too coarse to tell the rate; import it with --rate HZ"
    with pytest.raises(RecordingError, match=message) if told else nullcontext():
        assert with_checked_times(recording).rate_hz == pytest.approx(100.0, rel=1e-6)


@pytest.mark.filterwarnings("ignore:the time stamps come in batches")
@pytest.mark.parametrize("batch_s", [0.064, 0.128])
def test_a_batched_recordings_own_rate_changes_nothing(batch_s: float) -> None:
    """`pbd import` stores the rate: 0.128 s at once could then not be read again, and less came at uneven times."""
    recording = unnamed(simulate("pour", "modern", 1).recording)
    late = np.random.default_rng(1).exponential(0.002, len(recording))
    arrived = np.maximum.accumulate(batch_s * np.ceil(recording.t / batch_s) + late)
    batched = replace(recording, t=arrived - arrived[0])
    even = with_checked_times(batched)
    stored = replace(batched, info=replace(batched.info, rate_hz=even.rate_hz))
    np.testing.assert_allclose(with_checked_times(stored).t, even.t, atol=1e-3)
    assert np.ptp(np.diff(with_checked_times(stored).t)) < 1e-9


@pytest.mark.parametrize(("rate_hz", "tick"), [(100.0, 0.1), (100.0, 1.0), (104.3, 1.0)])
@pytest.mark.filterwarnings("ignore:the time stamps come in batches")
def test_stamps_of_many_rows_have_the_rate_of_rows_per_time(rate_hz: float, tick: float) -> None:
    t, rng = np.arange(1370) / rate_hz, np.random.default_rng(0)
    coarse = Recording(tick * np.floor(t / tick), rng.normal(size=(1370, 3)), rng.normal(size=(1370, 3)))
    assert coarse.rate_hz == pytest.approx(rate_hz, rel=0.005)
    steps = np.diff(even_stamps(coarse))
    assert [steps.min(), steps.max()] == pytest.approx([1.0 / rate_hz] * 2, rel=0.005)
    assert len(with_checked_times(coarse)) == 1370  # one stamp a second is no rate of 1 Hz


@pytest.mark.parametrize(
    ("interval", "wrong"),
    [
        (1.0 / 3.0, "record faster, 4 a second at least; if the time is in ms, "),
        (1.0 / 5.0, ""),
        (1.0 / 3500.0, ""),
        (1.0 / 4500.0, "closer than any"),
    ],
)
def test_a_rate_that_no_sensor_has_is_refused(interval: float, wrong: str) -> None:
    still = Recording(np.arange(2000) * np.float64(interval), np.random.default_rng(0).normal(size=(2000, 3)))
    with pytest.raises(RecordingError, match=wrong) if wrong else nullcontext():
        with_checked_times(still)


@pytest.mark.parametrize(("seconds", "told"), [(50.0, False), (70.0, True)])
def test_a_minute_without_a_sample_is_a_jump_of_the_clock(seconds: float, told: bool) -> None:
    t = 0.01 * np.arange(200) + seconds * (np.arange(200) > 100)
    still = Recording(t, np.random.default_rng(0).normal(size=(200, 3)))
    with pytest.raises(RecordingError, match=r"time jumps from 1\.000") if told else nullcontext():
        with_checked_times(still)


@pytest.mark.parametrize("share", [0.01, 0.05])
def test_lost_samples_are_bridged_and_told(share: float) -> None:
    demo = simulate("pour", "modern", 1)
    kept = np.flatnonzero(np.random.default_rng(1).random(len(demo.recording)) > share)
    with pytest.warns(PbdWarning, match="samples missing, in") as caught:
        assert worst(demo, with_rows(demo.recording, kept)) < worst(demo, demo.recording) + 0.005
    lost = int(str(caught[0].message).split()[0])
    ends = kept[0] + len(demo.recording) - 1 - kept[-1]
    assert lost == len(demo.recording) - len(kept) - ends


def test_a_rate_other_than_the_nominal_one_is_told() -> None:
    recording = simulate("pour", "modern", 1).recording
    slow = replace(recording, t=recording.t / 0.94)
    with (
        pytest.warns(PbdWarning, match=r"the gyro's turns are 6 % too large for how gravity turns"),
        pytest.warns(
            PbdWarning,
            match=r"set to 100 Hz, but .* come at 94 Hz; if the time stamps are wrong, every distance comes out 1\.13",
        ),
    ):
        track(slow)
    assert "set to" not in said(replace(recording, t=recording.t / 0.97))
    assert "6 % too large for how gravity turns" in said(unnamed(slow))


@pytest.mark.parametrize(("lost", "long"), [(5, 0), (6, 1)])
def test_a_gap_of_fifty_milliseconds_is_the_longest_that_is_bridged(lost: int, long: int) -> None:
    recording = simulate("pour", "modern", 1).recording
    with pytest.warns(PbdWarning, match=f"{lost} samples missing, in 1 gap"):
        _, gaps = repair_recording(with_rows(recording, np.delete(np.arange(len(recording)), slice(500, 500 + lost))))
    assert len(gaps) == long


def test_a_second_of_samples_taken_at_uneven_times_shows_that_they_are() -> None:
    """The live tracker has no more when it begins."""
    recording, kept = with_rows(simulate("pour", "modern", 1, rate_hz=40.0).recording, slice(0, 41)), 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        taken = replace(unnamed(recording), t=np.cumsum(rng.uniform(0.015, 0.035, 41)))
        kept += even_stamps(taken) is taken.t
        with pytest.warns(PbdWarning, match="evenly spaced times"):
            even_stamps(replace(taken, t=recording.t + rng.uniform(0.0, 0.01, 41)))
    assert kept >= 18
