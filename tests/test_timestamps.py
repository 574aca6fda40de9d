"""Time stamps by the device's clock and by arrival times: wrong times, bursts, stalls and losses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd.data.streams import Stream, joined
from pbd.errors import PbdWarning
from pbd.pose import Array
from pbd.timestamps.doubled_packets import came_twice
from pbd.timestamps.even_times import batched_interval
from pbd.timestamps.sample_clock import SampleClock, count_missing
from pbd.timestamps.stamper import Stamper
from pbd.timestamps.straighten import _drift, straighten
from tests.not_none import not_none

HZ = 100.0


def taken(times: list[float | None], arrivals: list[float] | None = None) -> tuple[list[float], SampleClock[int]]:
    """The stamped times of samples with these device times; they arrive at HZ, or at `arrivals`."""
    clock, out = SampleClock[int](), []
    for k, at in enumerate(times):
        arrival = 50.0 + (k / HZ if arrivals is None else arrivals[k])
        out += [t for t, _ in clock.take(k, at, arrival)]
    return out, clock


def steady(n: int, start: float = 7.0) -> list[float | None]:
    return [start + k / HZ for k in range(n)]


@given(st.integers(0, 49), st.floats(-100.0, 1e6).filter(lambda wrong: abs(wrong) > 1e-9))
def test_one_false_time_costs_itself_and_shifts_nothing(row: int, wrong: float) -> None:
    """One wrong time costs one sample; after a small jump forward also the samples that seem to come before it."""
    times = steady(60)
    times[row] = 7.0 + row / HZ + wrong
    got, clock = taken(times)
    zero = times[0] if row == 0 and got[1] - got[0] < 2.0 / HZ else 7.0
    assert zero is not None
    true = {round(k, 6) for k in (7.0 + np.arange(60) / HZ - zero)}
    false = [t for t in got[:-1] if round(t, 6) not in true]
    assert len(false) <= (60 if row == 0 else 1)
    assert (np.diff(got) > 0.0).all()
    assert len(got) + clock.doubted >= 59
    assert len(got) >= 48
    if row > 10:
        assert got[-1] == pytest.approx(0.59)


def test_a_sample_that_seems_to_come_before_a_believed_jump_forward_is_left_out() -> None:
    times = steady(30)
    times[10] = 7.0 + 11.4 / HZ
    got, clock = taken(times)
    assert [round(t * HZ, 6) for t in got] == [*range(10), 11.4, *range(12, 30)]
    assert clock.doubted == 1


def test_a_device_that_begins_anew_goes_on_by_the_hosts_clock() -> None:
    times = steady(50) + steady(50, start=0.2)
    arrivals = [k / HZ for k in range(50)] + [2.0 + k / HZ for k in range(50)]
    got, _ = taken(times, arrivals)
    assert got == pytest.approx(arrivals)


def test_a_device_that_begins_anew_on_a_busy_host_goes_on_an_interval_later() -> None:
    """All samples arrive at once, so the host's clock shows no time between them."""
    got, _ = taken(steady(50) + steady(50, start=0.2), [1.0] * 100)
    assert np.diff(got) == pytest.approx(1.0 / HZ)


def test_a_clock_that_runs_fast_keeps_its_own_time_over_a_long_gap() -> None:
    """By a twentieth, for 20 s."""
    times = [k / HZ for k in range(50)] + [21.5 + k / HZ for k in range(50)]
    got, clock = taken([*times], [k / HZ for k in range(50)] + [20.5 + k / HZ for k in range(50)])
    assert got == pytest.approx(times)
    assert clock.doubted == 0


def test_times_that_jitter_by_a_third_of_the_interval_cost_no_sample() -> None:
    times = 7.0 + (np.arange(500) + np.random.default_rng(0).uniform(-0.33, 0.33, 500)) / HZ
    got, clock = taken(times.tolist())
    assert len(got) == 500
    assert clock.doubted == 0


def test_a_gap_stays_a_gap() -> None:
    """Also if all samples arrive at once, as on a busy host."""
    times = steady(50) + steady(50, start=9.0)
    expected = [k / HZ for k in range(50)] + [2.0 + k / HZ for k in range(50)]
    for arrivals in (expected, [1.0] * 100):
        got, clock = taken(times, arrivals)
        assert got == pytest.approx(expected)
        assert clock.doubted == 0


@pytest.mark.parametrize("hz", [1.0, 5.0, 2000.0])
def test_slow_and_fast_devices(hz: float) -> None:
    steps = [k / hz for k in range(40)]
    got, clock = taken([3.0 + t for t in steps], steps)
    assert got == pytest.approx(steps)
    assert clock.doubted == 0


def test_the_first_times_of_a_slow_device_may_come_together() -> None:
    got, clock = taken([3.0 + 0.08 * k for k in range(8)], [0.5] * 8)
    assert got == pytest.approx([0.08 * k for k in range(8)])
    assert clock.doubted == 0


def test_a_time_that_is_late_by_most_of_an_interval_does_not_cost_the_next_sample() -> None:
    times = steady(30)
    times[10] = 7.0 + 10.9 / HZ
    got, clock = taken(times)
    assert [round(t * HZ, 6) for t in got] == [*range(10), 10.9, *range(11, 30)]
    assert clock.doubted == 0


def test_a_jump_of_a_few_usual_steps_that_the_host_does_not_confirm_is_left_out() -> None:
    times = steady(30)
    times[10] = 7.0 + 16.0 / HZ
    got, clock = taken(times)
    assert [round(t * HZ, 6) for t in got] == [*range(10), *range(11, 30)]
    assert clock.doubted == 1


def test_two_wrong_times_in_a_row_cost_themselves_only() -> None:
    times = steady(30)
    times[10:12] = 900.0, 300.0
    got, clock = taken(times)
    assert [round(t * HZ, 6) for t in got] == [*range(10), *range(12, 30)]
    assert clock.doubted == 2


def test_a_packet_that_comes_twice_is_one_sample() -> None:
    clock = SampleClock[int]()
    assert len([clock.take(k // 2, 7.0 + (k // 2) / HZ, 50.0 + k / HZ / 2.0) for k in range(60)]) == 60
    assert len(clock.times) == 30
    assert clock.doubted == 29  # of the last one nothing is known yet


@pytest.mark.parametrize("burst_s", [0.0, 0.5])
@pytest.mark.parametrize(("tick_s", "rate_hz"), [(0.001, 1100.0), (0.01, 200.0), (0.1, 50.0), (1.0, 100.0)])
def test_a_clock_coarser_than_the_interval_loses_no_sample(tick_s: float, rate_hz: float, burst_s: float) -> None:
    """As of a sketch that prints `millis() / 1000.0`, with two decimals: all samples of a tick but one were lost."""
    true = np.arange(round(12.0 * rate_hz)) / rate_hz
    arrival = np.ceil(true / burst_s) * burst_s if burst_s else true
    got, clock = taken((tick_s * np.floor(true / tick_s + 1e-6)).tolist(), arrival.tolist())
    got += [t for t, _ in clock.release()]
    clock.count_lost()
    assert (len(got), clock.lost, clock.doubted) == (len(true), 0, 0)
    assert np.diff(not_none(clock.straightened)) == pytest.approx(1.0 / rate_hz, rel=0.01)
    assert np.diff(got[-len(true) // 2 :]) == pytest.approx(1.0 / rate_hz, rel=0.05)


def test_the_first_sample_says_whose_clock_it_is() -> None:
    got, clock = taken([*steady(10), None, *steady(10, start=7.11)])
    assert clock.is_device
    assert len(got) == 20
    assert clock.doubted == 1
    got, clock = taken([None, *steady(10)])
    assert not clock.is_device
    assert len(got + clock.release()) == 11


@given(st.integers(0, 10**6), st.floats(0.0, 0.2), st.sampled_from([40.0, 100.0, 400.0, 1000.0]))
def test_what_is_lost_is_counted(seed: int, share: float, hz: float) -> None:
    rng = np.random.default_rng(seed)
    kept = rng.random(500) >= share
    kept[[0, -1]] = True
    t = (np.arange(500) + rng.uniform(-0.19, 0.19, 500)) / hz
    assert count_missing(t[kept]) == 500 - kept.sum()


def test_a_clock_in_whole_milliseconds_loses_nothing() -> None:
    for hz in (40.0, 100.0, 128.0, 300.0, 400.0, 450.0, 1000.0):
        assert count_missing(np.round(1e3 * np.arange(2000) / hz) / 1e3) == 0


def test_few_samples_are_counted_too() -> None:
    assert count_missing(np.array([0.0, 0.01, 0.02, 0.05, 0.06])) == 2
    assert count_missing(np.array([0.0])) == 0


@pytest.mark.parametrize(("slower", "follows"), [(0.15, True), (-0.15, True), (0.25, False), (-0.25, False)])
def test_a_rate_drifts_by_no_more_than_a_fifth(slower: float, follows: bool) -> None:
    late = slower / HZ * np.maximum(np.arange(4000.0) - 2000.0, 0.0)
    assert np.ptp(_drift(late, 50, 1.0 / HZ)) == pytest.approx(np.ptp(late) * follows, rel=0.05)


def test_short_steps_beside_long_ones_make_up_for_no_loss_but_theirs() -> None:
    assert count_missing(np.cumsum(np.tile((0.5, 1.5), 50)) / HZ) == 0


def test_samples_without_a_time_are_counted_by_their_arrival() -> None:
    arrival = np.delete(np.arange(401), 200) / HZ
    _, clock = taken([None] * 400, arrival.tolist())
    clock.count_lost()
    assert clock.lost == 1
    assert clock.straightened == pytest.approx(arrival)


def arrivals(rate_hz: float, kind: str, seed: int, seconds: float = 40.0) -> tuple[Array, Array, int]:
    """The true times of the samples that arrived, their arrival times, and the number of lost samples."""
    rng = np.random.default_rng(seed)
    n = int(rate_hz * seconds)
    true = np.arange(n) / rate_hz * 1.00003  # no crystal is exact
    came = np.ones(n, dtype=bool)
    if "lost" in kind:
        came[rng.choice(np.arange(n // 8, n - n // 8), 5, replace=False)] = False
        came[n // 2 : n // 2 + 3] = False
    t = true[came]
    arrival = t + 0.003 + rng.exponential(0.0005, len(t))
    if "bursts" in kind:  # a USB frame of 16 ms
        arrival = np.maximum(arrival, np.ceil(t / 0.016) * 0.016 + 0.003 + rng.exponential(0.0003, len(t)))
    for stalled in rng.integers(0, len(t), 5):  # a host that is busy for 0.2 s
        rows = slice(stalled, stalled + int(0.2 * rate_hz))
        arrival[rows] = np.maximum(arrival[rows], arrival[stalled] + 0.2)
    return t, np.maximum.accumulate(arrival), n - int(came.sum())


@pytest.mark.parametrize("kind", ["plain", "bursts", "lost", "lost in bursts"])
@pytest.mark.parametrize("rate_hz", [40.0, 100.0, 400.0])
@pytest.mark.parametrize("seed", range(3))
def test_stamps_are_right_to_a_sample_where_some_are_lost_and_to_a_millisecond_elsewhere(
    rate_hz: float, kind: str, seed: int
) -> None:
    true, arrival, missing = arrivals(rate_hz, kind, seed)
    t, lost = straighten(arrival)
    off = t - true
    off -= np.median(off)
    assert lost == missing
    assert (np.diff(t) > 0.0).all()
    assert np.percentile(np.abs(off), 95) < 0.0015
    assert np.abs(off).max() < 1.05 / rate_hz + 0.001


SLOWS_DOWN = {
    "a battery that sags": lambda x, by: 1.0 - by * x,
    "a program that prints more from then on": lambda x, by: 1.0 - by * (x > 0.45),
    "the other way round": lambda x, by: 1.0 + by * x,
}


@pytest.mark.parametrize("kind", SLOWS_DOWN)
@pytest.mark.parametrize("by", [0.02, 0.05, 0.1])
@pytest.mark.parametrize("frame_s", [0.0, 0.001])
def test_stamps_follow_a_rate_that_changes(kind: str, by: float, frame_s: float) -> None:
    """A straight line is off by 37 to 400 ms there, and the keyframes by centimetres."""
    rate, n, rng = 100.0, 2000, np.random.default_rng(3)
    true = np.cumsum(1.0 / (rate * np.array([SLOWS_DOWN[kind](k / n, by) for k in range(n)])))
    arrival = true + rng.uniform(0.0, 0.002, n)
    if frame_s:
        arrival = np.ceil(arrival / frame_s) * frame_s
    t, lost = straighten(arrival)
    assert lost == 0
    assert np.abs(t - t[0] - (true - true[0])).max() < 0.25 * by * 0.5 + 0.002  # s: half a block of 0.5 s at a corner
    assert (np.diff(t) > 0.0).all()


@pytest.mark.parametrize(
    ("rate_hz", "frame_s", "late_s"), [(62.505, 0.016, 0.0), (100.0, 0.016, 0.0), (100.0, 0.0, 0.1)]
)
def test_neither_a_beat_with_the_adapters_frames_nor_bursts_are_a_change_of_the_rate(
    rate_hz: float, frame_s: float, late_s: float
) -> None:
    rng = np.random.default_rng(4)
    arrival = np.arange(3000) / rate_hz + rng.uniform(0.0, 0.001, 3000)
    if frame_s:
        arrival = np.ceil(arrival / frame_s) * frame_s
    if late_s:  # a radio link that holds samples back for up to this time, now and then
        held = np.flatnonzero(rng.random(3000) < 0.01)
        for row in held:
            until = arrival[row] + rng.uniform(0.0, late_s)
            arrival[row:][arrival[row:] < until] = until
    t, lost = straighten(np.maximum.accumulate(arrival))
    assert lost == 0
    assert np.diff(t) == pytest.approx(1.0 / rate_hz, rel=1e-3)


@pytest.mark.parametrize("seed", range(8))
def test_jitter_is_no_change_of_the_rate(seed: int) -> None:
    """Samples that seem lost in it leave delays that rise and fall slowly, but not far beyond the jitter."""
    arrival = np.arange(2000) / 100.0 + np.random.default_rng(seed).exponential(0.02, 2000)
    t, _ = straighten(np.maximum.accumulate(arrival))
    steps = np.diff(t)
    whole = steps / steps.min()
    assert whole == pytest.approx(np.rint(whole), abs=1e-3)


@pytest.mark.parametrize("batch", [20, 75, 150])
def test_large_batches_that_come_late_lose_nothing(batch: int) -> None:
    """Of 2500 samples up to 3200 seemed to be lost."""
    true, rng = np.arange(2500) / HZ, np.random.default_rng(1)
    last = np.minimum(np.arange(2500) // batch * batch + batch - 1, 2499)
    t, lost = straighten(true[last] + rng.uniform(0.0, 0.02, 2500)[last])
    assert lost == 0
    assert np.diff(t) == pytest.approx(1.0 / HZ, rel=0.002)


def test_few_samples_are_taken_as_they_came() -> None:
    assert straighten(np.array([]))[1] == 0
    t, lost = straighten(np.array([5.0, 5.1]))
    assert t == pytest.approx([0.0, 0.1])
    assert lost == 0


@pytest.mark.parametrize("kind", ["plain", "bursts", "lost", "lost in bursts"])
@pytest.mark.parametrize("rate_hz", [100.0, 400.0])
def test_times_as_samples_come_increase_and_follow(rate_hz: float, kind: str) -> None:
    true, arrival, _ = arrivals(rate_hz, kind, 1)
    stamper = Stamper[None]()
    stamped = [each for at in arrival.tolist() for each in stamper.stamp(None, at)] + stamper.release()
    t = np.array([t for t, _ in stamped])
    assert (np.diff(t) > 0.0).all()
    off = t - true
    assert np.percentile(np.abs(off - np.median(off)), 95) < 0.005


@pytest.mark.parametrize("bursts", [True, False], ids=["bursts in pieces", "a stall at the start"])
def test_two_seconds_between_arrivals_do_not_spread_the_samples(bursts: bool) -> None:
    """They seemed to lie between two samples."""
    k = np.arange(3000)
    arrival = 2.0 * (k // 200 + 1) + 0.004 * (k % 200 // 70)
    if not bursts:
        arrival = np.where(abs(k - 149.5) < 100.0, 2.5, 0.01 * k)
    stamper = Stamper[None]()
    stamped = [each for at in arrival.tolist() for each in stamper.stamp(None, at)]
    assert len(stamped) == len(k)
    assert np.diff([t for t, _ in stamped]) == pytest.approx(0.01, rel=0.01)


@pytest.mark.parametrize("samples_a_frame", [1.005, 1.02, 1.05, 1.1])
def test_a_beat_with_the_adapters_frames_lets_no_time_run_away(samples_a_frame: float) -> None:
    """Of 64 to 69 Hz and frames of 16 ms. Frames with two samples looked wrong, and live times ran 1.5 to 7 % ahead."""
    true = np.arange(4000) * 0.016 / samples_a_frame + 0.0003
    stamper = Stamper[None]()
    stamped = [each for at in np.ceil(true / 0.016) * 0.016 for each in stamper.stamp(None, at)]
    off = np.array([t for t, _ in stamped + stamper.release()]) - true
    assert np.ptp(off) < 0.040


def test_scattered_losses_neither_bias_the_interval_nor_are_noticed_late() -> None:
    """Of samples that come when they are taken 1.5 % are lost. The interval was 1.5 % too long, and no loss seen."""
    rng = np.random.default_rng(0)
    true = np.arange(4000)[rng.random(4000) > 0.015] / HZ
    arrival = true + rng.exponential(0.0003, len(true))
    stamper = Stamper[None]()
    t: list[float] = []
    late: list[float] = []
    for at in arrival.tolist():
        t += [t for t, _ in stamper.stamp(None, at)]
        late.append(at - true[len(t) - 1] if t else 0.0)
    off = (np.array(t) - true[: len(t)])[200:]
    assert np.ptp(off) < 0.001
    assert max(late[200:]) < 0.1
    times, _ = straighten(arrival)
    assert np.median(np.diff(times)) == pytest.approx(1.0 / HZ, rel=1e-4)


def test_losses_one_soon_after_the_other_keep_their_places() -> None:
    """All losses of 0.1 s were put before one sample."""
    true = np.delete(np.arange(1000), [500, 505, 900, 903, 904]) / HZ
    t, lost = straighten(true)
    assert lost == 5
    assert t == pytest.approx(true, abs=1e-6)


def test_a_long_loss_before_the_last_samples_is_seen() -> None:
    """No loss was seen within the last 0.5 s, however long."""
    true = np.delete(np.arange(1200), range(995, 1195)) / HZ
    t, lost = straighten(true)
    assert lost == 200
    assert t == pytest.approx(true, abs=1e-6)


def test_a_backlog_whose_last_sample_waited_too_loses_nothing() -> None:
    """The samples of 1.5 s waited until 30 ms after the last of them. That is one long delay, not 150."""
    true = np.arange(3000) / 100.0
    arrival = true + np.random.default_rng(1).uniform(0.001, 0.009, len(true))
    arrival[1000:1150] = true[1149] + 0.03
    t, lost = straighten(np.maximum.accumulate(arrival))
    assert lost == 0
    assert t == pytest.approx(true, abs=1e-3)


@pytest.mark.parametrize("asleep_s", [3.0, 15.0])
def test_the_backlog_of_a_suspended_host_loses_nothing(asleep_s: float) -> None:
    """It is read in pieces of 4096 bytes. Of 300 samples 178 seemed to be lost, or the rate seemed to change."""
    true = np.arange(round(asleep_s * HZ) + 2000) / HZ
    arrival = np.maximum(true, np.where(true > 10.0, 10.0 + asleep_s, 0.0))
    asleep = arrival > true
    arrival[asleep] += 0.02 * (np.flatnonzero(asleep) // 124 - 8)
    t, lost = straighten(np.maximum.accumulate(arrival))
    assert lost == 0
    assert t == pytest.approx(true, abs=1e-3)


def clocked(values: list[int], arrivals: Array) -> SampleClock[int]:
    """A clock that has taken and counted samples of these values, without a device's time."""
    clock = SampleClock[int]()
    for value, at in zip(values, arrivals.tolist(), strict=True):
        clock.take(value, None, at)
    clock.count_lost()
    return clock


@pytest.mark.parametrize("late_s", [0.0, 0.007])  # at once, or after the time that its bytes take on a slow line
@pytest.mark.parametrize("batch_s", [0.0, 0.2])
@pytest.mark.parametrize("lost", [0, 100])  # soon after the start, as the link was away for a second
def test_a_packet_that_comes_twice_has_the_time_of_the_first(late_s: float, batch_s: float, lost: int) -> None:
    """One in 20 does. Each took an interval: the keyframes were off by metres."""
    rng, true = np.random.default_rng(0), np.delete(np.arange(900 + lost), np.arange(41, 41 + lost))
    sent = np.repeat(true, np.where(rng.random(900) < 0.05, 2, 1))
    again = np.append(False, sent[1:] == sent[:-1])
    arrival = sent / HZ if not batch_s else np.ceil(sent / HZ / batch_s) * batch_s
    clock = clocked(sent.tolist(), arrival + late_s * again)
    assert clock.straightened is not None
    assert clock.straightened - clock.straightened[-1] == pytest.approx((sent - sent[-1]) / HZ, abs=1e-3)
    assert (clock.lost, clock.doubted) == (lost, again.sum())


def test_what_comes_twice_has_the_time_of_the_first_while_it_is_recorded() -> None:
    sent = np.repeat(np.arange(1000), 1 + (np.arange(1000) % 10 == 0))
    clock = SampleClock[int]()
    got = [each for value in sent.tolist() for each in clock.take(value, None, value / HZ)] + clock.release()
    assert [value for _, value in got] == sent.tolist()
    t = np.array([t for t, _ in got])[sent > 700]
    assert t - t[0] == pytest.approx((sent[sent > 700] - 701) / HZ, abs=1e-3)


@pytest.mark.parametrize("batch_s", [0.0, 0.2])
def test_a_reading_that_is_repeated_takes_an_interval(batch_s: float) -> None:
    """A coarse sensor at rest, or one that is read more often than it measures."""
    values = np.cumsum(np.random.default_rng(0).random(2000) < 0.7)
    true = np.arange(2000) / HZ
    clock = clocked(values.tolist(), true if not batch_s else np.ceil(true / batch_s) * batch_s)
    assert clock.straightened == pytest.approx(true, abs=1e-3)
    assert (clock.lost, clock.doubted) == (0, 0)


def test_a_late_packet_beside_a_repeated_reading_does_not_decide_for_good() -> None:
    """It looks as if the second had come twice; later ones tell. The first verdict held, and each lost its interval."""
    true = np.arange(2000) / HZ
    arrival = true.copy()
    arrival[50] = arrival[51]
    repeated = np.arange(2000) % 100 == 51
    clock = clocked(np.cumsum(~repeated).tolist(), arrival)
    assert clock.straightened == pytest.approx(true, abs=1e-3)
    assert (clock.lost, clock.doubted) == (0, 0)


@pytest.mark.parametrize("arrival", [[0.0], [0.0, 0.1], [0.0, 1e-6, 0.1]])
def test_a_single_batch_tells_of_no_packets_that_came_twice(arrival: list[float]) -> None:
    assert not came_twice(np.array(arrival), np.zeros(len(arrival), dtype=bool))


@pytest.mark.parametrize("batch", [1, 20])
def test_a_few_readings_that_happen_to_be_repeated_are_no_packets_that_came_twice(batch: int) -> None:
    """Jitter of a third of the interval may look as if they took no time. A clock asks four times a second."""
    for seed in range(400):
        rng = np.random.default_rng(seed)
        arrival = np.maximum.accumulate(np.arange(300) // batch * batch / HZ + rng.exponential(0.003, 300))
        assert not came_twice(arrival, np.append(False, rng.random(299) < 0.01))


@pytest.mark.parametrize("seed", range(3))
def test_a_loss_in_most_blocks_does_not_lengthen_the_interval(seed: int) -> None:
    """Of 16 samples in turn usually one is lost: the interval was 6 % too long."""
    rng = np.random.default_rng(seed)
    true = np.arange(3000)[rng.random(3000) > 0.06] / HZ
    t, _ = straighten(np.maximum.accumulate(true + rng.exponential(0.001, len(true))))
    assert np.median(np.diff(t)) == pytest.approx(1.0 / HZ, rel=1e-3)


def test_a_sample_that_waits_alone_is_no_loss() -> None:
    """It is held back until the next one, which is on time."""
    arrival = np.arange(300) / HZ
    arrival[200] += 0.009
    stamper = Stamper[int]()
    got = [stamper.stamp(k, at) for k, at in enumerate(arrival.tolist())]
    assert [[k for _, k in each] for each in got[198:203]] == [[198], [199], [], [200, 201], [202]]
    assert [t for each in got for t, _ in each] == pytest.approx(np.arange(300) / HZ, abs=1e-6)


@pytest.mark.parametrize("in_a_piece", [1, 5, 50])
@pytest.mark.parametrize("rate_hz", [40.0, 100.0, 1000.0])
def test_times_of_samples_that_come_together_are_as_even_as_of_those_that_come_alone(
    in_a_piece: int, rate_hz: float
) -> None:
    n = round(20.0 * rate_hz) // in_a_piece * in_a_piece
    arrival = 700.0 + (np.arange(n) // in_a_piece + 1) * in_a_piece / rate_hz
    clock = SampleClock[int]()
    t = np.array([t for at in arrival.tolist() for t, _ in clock.take(0, None, at)] + [t for t, _ in clock.release()])
    assert len(t) == n
    assert t[0] == 0.0
    assert np.diff(t) == pytest.approx(1.0 / rate_hz, rel=0.01)


def test_the_last_samples_of_a_slow_sensor_may_arrive_at_once() -> None:
    """A window of so few samples holds less than one batch on average."""
    t, lost = straighten(np.append(0.2 * np.arange(20.0), np.full(80, 4.0)))
    assert t[:20] == pytest.approx(0.2 * np.arange(20.0))
    assert lost == 0


def test_sensors_whose_arrivals_jitter_are_joined_as_if_they_did_not() -> None:
    """Each of 40 Hz, as a program stamps them. A sample that was late by over an interval seemed to be a gap."""
    rng, t = np.random.default_rng(0), np.arange(4000) / 40.0
    motion = np.sin(np.outer(t, (2.0, 3.0, 5.0)))
    late = [np.maximum.accumulate(t + rng.exponential(0.005, len(t))) for _ in range(2)]
    with pytest.warns(PbdWarning, match="time stamps jitter; evenly spaced times at 40 Hz") as told:
        at, values = joined({"acc": Stream.of(late[0], motion), "gyr": Stream.of(late[1], motion)})
    assert [str(one.message)[:8] for one in told] == ["the acce", "the gyro"]
    assert np.diff(at) == pytest.approx(0.025, rel=1e-3)
    assert np.abs(values["acc"] - values["gyr"]).max() < 0.02


def test_a_single_sample_is_given_its_arrival() -> None:
    """numpy warned of the mean of no steps."""
    stamper = Stamper[None]()
    assert stamper.stamp(None, 7.0) == []
    assert stamper.release() == [(7.0, None)]


def test_a_line_that_is_known_goes_on() -> None:
    """Delays of an interval on average do not move it: the interval is that of the samples that are on time."""
    times = np.arange(200) / 40.0
    late = np.random.default_rng(0).exponential(0.025, 200) * (np.arange(200) > 40)
    stamper = Stamper[None]()
    arrived = np.maximum.accumulate(times + late).tolist()
    t = [t for at in arrived for t, _ in stamper.stamp(None, at)]
    assert np.diff(t) == pytest.approx(0.025, rel=0.02)


def test_times_that_go_to_and_fro_tell_no_interval() -> None:
    assert batched_interval(np.array((0.0, 1.0, 0.0, 1.0, 0.0))) == 0.0
