"""The live tracker: the same in any pieces, as good as the batch tracker run causally, and soon enough."""

from __future__ import annotations

import tracemalloc
from dataclasses import fields, replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from vqf import VQF

from pbd.data import GRAVITY, Attitude, Keyframe, Recording
from pbd.errors import TrackingError
from pbd.pipeline import track
from pbd.pose import Array, quat_canonical, quat_inverse, quat_log, quat_multiply, quat_rotate
from pbd.sensors.simulate import TASKS, random_task, simulate
from pbd.sensors.simulated_hand import Waypoint
from pbd.sensors.simulated_tasks import Task
from pbd.tracking.gravity import motion_acceleration
from pbd.tracking.integration import EDGE_S, integrate_move
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.live import DataFlaw, LiveEvent, LiveTracker, RestFound, StopBegan, StopEnded
from pbd.tracking.live_attitude import turn_between_middles
from pbd.tracking.live_doubt import Doubt
from pbd.tracking.live_move import error_on_the_way
from pbd.tracking.live_stops import CONFIRM_S
from pbd.tracking.orientation import TAU_ACC_S
from tests.benchmarks.trials import read_broad
from tests.scenarios import pour, truth_at, uncalibrated, with_hole, with_rows

LATEST_S = 0.3
"""A stop is announced within this of its start."""


def fed(recording: Recording, sizes: list[int] | None = None) -> tuple[LiveTracker, list[LiveEvent]]:
    """Feed a recording whole, or in pieces of these sizes (again and again)."""
    tracker, start = LiveTracker(), 0
    events: list[LiveEvent] = []
    while start < len(recording):
        size = len(recording) if sizes is None else sizes[start % len(sizes)]
        rows = slice(start, start + size)
        part = with_rows(recording, rows)
        events += tracker.feed(part.t, part.acc, part.gyr, part.mag, part.device_rpy)
        start += size
    return tracker, events


@cache
def plain_pour() -> tuple[LiveTracker, list[LiveEvent]]:
    """The everyday task with nothing wrong."""
    return fed(pour().recording)


def began(events: list[LiveEvent]) -> list[StopBegan]:
    return [event for event in events if isinstance(event, StopBegan)]


def flat(value: object) -> object:
    """A value as nested tuples that compare to the bit."""
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if hasattr(value, "__dataclass_fields__"):
        return (type(value).__name__, *(flat(getattr(value, field.name)) for field in fields(value)))  # type: ignore[arg-type]
    return tuple(map(flat, value)) if isinstance(value, tuple | list) else value


def state(tracker: LiveTracker) -> object:
    """All that can be read from a tracker."""
    names = [name for name in vars(LiveTracker) if isinstance(getattr(LiveTracker, name), property)]
    return [(name, flat(getattr(tracker, name))) for name in names]


def damaged(recording: Recording) -> Recording:
    """With rows lost, repeated, without numbers, out of order, and a hole."""
    recording = with_hole(recording, 9.0, 9.3)
    acc, t = recording.acc.copy(), recording.t.copy()
    acc[[150, 400, 401]], acc[1200, 1] = np.nan, 1e30
    t[700], t[900], t[1300] = np.nan, t[898], t[1300] + 1e4
    rows = np.sort(np.append(np.delete(np.arange(len(t), dtype=np.intp), [300, 301, 500]), [800, 800]))
    return with_rows(replace(recording, acc=acc, t=t), rows)


@cache
def to_be_cut(bad: bool) -> tuple[Recording, LiveTracker, list[LiveEvent]]:
    """A recording of 15 s and what becomes of it in one piece."""
    recording = with_rows(pour().recording, slice(0, 1500))
    recording = damaged(recording) if bad else recording
    return recording, *fed(recording)


@settings(max_examples=5, deadline=None)
@given(sizes=st.lists(st.integers(1, 400), min_size=1, max_size=20))
@pytest.mark.parametrize("bad", [False, True])
def test_any_pieces_give_the_same_to_the_bit(bad: bool, sizes: list[int]) -> None:
    recording, whole, events = to_be_cut(bad)
    pieces, events_in_pieces = fed(recording, sizes)
    assert flat(events_in_pieces) == flat(events)
    assert state(pieces) == state(whole)


def test_what_is_read_on_the_way_does_not_depend_on_the_pieces_either() -> None:
    recording = pour().recording
    one, other = LiveTracker(), LiveTracker()
    for start in range(0, 900, 90):
        part = with_rows(recording, slice(start, start + 90))
        one.feed(part.t, part.acc, part.gyr, part.mag)
        for k in range(90):
            assert part.gyr is not None
            assert part.mag is not None
            other.feed(float(part.t[k]), part.acc[k], part.gyr[k], part.mag[k])
            assert other.sigma_now >= 0.0  # reading changes nothing
        assert state(one) == state(other)


def causal_attitude(recording: Recording, rest: slice, bias: Array) -> Array:
    """Online VQF over a whole recording at once, begun as the live tracker begins it."""
    interval = float(np.median(np.diff(recording.t[rest])))  # to the bit: VQF counts samples against time constants
    assert recording.gyr is not None
    rates = np.vstack((recording.gyr[:1], recording.gyr[:1], recording.gyr))
    edges = np.vstack((np.zeros((1, 3)), np.cumsum(rates * interval, axis=0)))
    # Of the cubic through four edges, what lies between the middles of the last two of its three intervals.
    turn = (2.0 * edges[:-3] - 14.0 * edges[1:-2] + 6.0 * edges[2:-1] + 6.0 * edges[3:]) / 16.0
    turn += interval**2 / 12.0 * np.cross(rates[1:-1], rates[2:])
    vqf, still = VQF(interval, tauAcc=TAU_ACC_S), round(TAU_ACC_S / interval)
    vqf.updateBatch(np.tile(bias, (still, 1)), np.tile(recording.acc[rest].mean(axis=0), (still, 1)))
    mag = None if recording.mag is None else np.array(recording.mag)
    result = vqf.updateBatch(turn / interval, np.array(recording.acc), mag)
    return quat_canonical(result["quat9D"])


@pytest.mark.parametrize(
    ("sensor", "seed", "rate_hz"), [("modern", 0, 100.0), ("wt901", 1, 100.0), ("modern", 2, 40.0)]
)
def test_at_the_end_of_each_move_it_agrees_with_the_batch_tracker_run_causally(
    sensor: str, seed: int, rate_hz: float
) -> None:
    recording = simulate("pour", sensor, seed, rate_hz=rate_hz).recording
    t = np.arange(len(recording)) / rate_hz
    recording = replace(recording, t=t)
    tracker, events = fed(recording)
    (found,) = (event for event in events if isinstance(event, RestFound))
    rest = slice(found.rest.start, found.rest.stop)
    wxyz = causal_attitude(recording, rest, np.array(found.rest.gyro_bias))
    edge, kept = round(EDGE_S * rate_hz), round(CONFIRM_S * rate_hz)
    p = np.zeros(3)
    assert len(tracker.stops) == 11
    for (before, after), event in zip(pairwise(tracker.stops), began(events)[1:], strict=True):
        known = slice(before.stop - 1 - kept, round(event.announced_t * rate_hz) + 1)
        move = slice(kept - edge, after.start + edge + 1 - known.start)
        attitude = Attitude(wxyz[known], np.zeros_like(recording.acc[known]))
        a_nav = motion_acceleration(with_rows(recording, known), attitude, found.rest.gravity)
        error = error_on_the_way(t[known], wxyz[known], a_nav, move)
        p = p + integrate_move(t[known], a_nav - error, rows=move).p_nav[-1]
        assert event.keyframe.T_nav_sensor.p == pytest.approx(p, abs=1e-9)


@uncalibrated
@pytest.mark.filterwarnings("ignore:.*end of the range:pbd.errors.PbdWarning")  # the roll clips the gyro
@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("sensor", ["modern", "wt901", "os5000"])
def test_its_keyframes_are_those_of_the_batch_tracker_and_of_the_truth(task: str, sensor: str) -> None:
    for seed in range(1 if task == "pour" else 2):
        demo = simulate(task, sensor, seed)
        live, batch = fed(demo.recording)[0].keyframes, find_keyframes(track(demo.recording))
        assert len(live) == len(batch)
        assert demo.truth is not None
        for ours, theirs in zip(live, batch, strict=True):
            turn = quat_log(quat_multiply(ours.T_nav_sensor.wxyz, quat_inverse(theirs.T_nav_sensor.wxyz)))
            assert distance_in_sigmas(turn, ours.cov[3:, 3:] + theirs.cov[3:, 3:]) < 4.0
            off_batch = ours.T_nav_sensor.p - theirs.T_nav_sensor.p
            assert distance_in_sigmas(off_batch, ours.cov[:3, :3] + theirs.cov[:3, :3]) < 4.0
            if sensor != "wt901":  # whose bias tilts both paths by a degree
                assert distance_in_sigmas(ours.T_nav_sensor.p - truth_at(demo.truth, ours.t), ours.cov[:3, :3]) < 4.0


def distance_in_sigmas(off: Array, cov: Array) -> float:
    """Of three axes together; 4 is as seldom as 3 of one axis."""
    return float(np.sqrt(off @ np.linalg.solve(cov + 1e-8 * np.eye(3), off)))


def stop_starts(task: Task) -> Array:
    """When the hand comes to rest, s."""
    ends = np.cumsum([w.move_s + w.rest_s for w in task.waypoints])
    return np.array([end - w.rest_s for end, w in zip(ends, task.waypoints, strict=True)])


@pytest.mark.parametrize(
    ("sensor", "rate_hz"), [("modern", 40.0), ("os5000", 40.0), ("wt901", 100.0), ("os5000", 286.0)]
)
def test_a_stop_is_announced_in_time_and_nothing_else_is(sensor: str, rate_hz: float) -> None:
    for task in (*TASKS.values(), random_task(5)):
        _, events = fed(simulate(task, sensor, 3, rate_hz=rate_hz).recording)
        announced = np.array([event.announced_t for event in began(events)[1:]])
        late = announced - stop_starts(task)[1:]  # which fails where their numbers differ
        assert late.max() <= LATEST_S
        assert late.min() > 0.0
        assert max(event.announced_t - event.t for event in began(events)[1:]) <= LATEST_S


def test_a_smooth_move_is_not_rest_where_its_acceleration_passes_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    waypoints = [Waypoint(((k % 2) * 0.3, 0.0, 0.0), move_s=1.8 if k else 0.0, rest_s=1.5) for k in range(5)]
    recording = simulate(Task("slow", tuple(waypoints)), "modern", 1).recording
    assert len(fed(recording)[0].stops) == 5
    monkeypatch.setattr(Doubt, "finds_plausible", lambda *_: True)
    assert len(fed(recording)[0].stops) > 5


def test_what_an_accelerometers_bias_does_is_taken_back() -> None:
    """A bias turns with the sensor: half-way through a turn its error is half-way between those at the rests."""
    t = np.arange(100) / 100.0
    angle = np.clip(t - 0.2, 0.0, 0.6)
    wxyz = np.column_stack((np.cos(0.5 * angle), np.sin(0.5 * angle), 0.0 * t, 0.0 * t))
    error = quat_rotate(wxyz, (0.1, -0.2, 0.3))
    estimate = error_on_the_way(t, wxyz, error, slice(15, 86))
    assert np.abs(estimate - error).max() < 0.1 * np.abs(error[0] - error[-1]).max()


def test_the_turn_between_middles_is_exact_for_a_cubic_angle() -> None:
    cubic = np.polynomial.Polynomial([0.3, -1.0, 2.0, 5.0])
    dt = 0.025
    rates = [np.array((0.0, 0.0, (cubic(k * dt + dt) - cubic(k * dt)) / dt)) for k in range(3)]
    turn = turn_between_middles(dt, *rates)
    assert turn == pytest.approx((0.0, 0.0, cubic(2.5 * dt) - cubic(1.5 * dt)), abs=1e-12)


def test_the_hand_is_seen_on_its_way() -> None:
    demo = pour()
    recording, truth = demo.recording, demo.truth
    assert truth is not None
    speed = np.gradient(truth.p_nav_sensor, truth.t, axis=0)
    tracker, sigmas = LiveTracker(), []
    for k in range(950):
        part = with_rows(recording, slice(k, k + 1))
        tracker.feed(part.t, part.acc, part.gyr, part.mag)
        sigmas.append((tracker.sigma_of_move, tracker.sigma_now))
        assert tracker.p_nav_sensor == pytest.approx(truth_at(truth, part.t[0]), abs=0.03)
        assert tracker.v_nav_sensor == pytest.approx(speed[k], abs=0.05)
        if np.linalg.norm(speed[k]) > 0.1:
            assert tracker.moving
        cosine = abs(float(tracker.wxyz_nav_sensor @ truth.wxyz_nav_sensor[k]))
        assert k < 150 or cosine > np.cos(np.radians(1.0))
    of_move, now = np.array(sigmas).T
    assert (now >= of_move).all()
    still = np.interp(recording.t[:950], truth.t, np.linalg.norm(speed, axis=1)) == 0.0
    assert of_move[200] == 0.0
    (move,) = [k for k in range(250, 349) if of_move[k] == 0.0 and of_move[k + 1] > 0.0]
    assert (np.diff(of_move[move + 1 : 340]) > 0.0).all()  # it grows as the move goes on
    assert still[200]
    sigma = np.sqrt(tracker.keyframes[1].cov[0, 0])
    assert 0.5 * sigma < of_move[355] < 2.0 * sigma  # and foretells that of the keyframe


def test_stops_end_and_keyframes_become_final() -> None:
    tracker, events = plain_pour()
    ended = [event for event in events if isinstance(event, StopEnded)]
    assert [event.index for event in began(events)] == list(range(11))
    assert [event.index for event in ended] == list(range(10))
    assert flat([event.keyframe for event in ended]) == flat(tracker.keyframes[:-1])
    for event, stop, keyframe in zip(began(events), tracker.stops, tracker.keyframes, strict=True):
        assert flat(event.keyframe.T_nav_sensor.p) == flat(keyframe.T_nav_sensor.p)
        assert keyframe.dwell_s == stop.dwell_s
        assert keyframe.dwell_s > event.keyframe.dwell_s


def test_a_sensor_put_down_that_bounces_makes_one_stop() -> None:
    up, down = (0.0, 0.0, 0.15), (0.2, 0.0, 0.0)
    bounce = (Waypoint(down, move_s=0.8, rest_s=0.3), Waypoint((0.2, 0.0, 0.012), move_s=0.2, rest_s=1.0))
    task = Task("bounce", (Waypoint(rest_s=2.0), Waypoint(up, move_s=0.8, rest_s=0.8), *bounce))
    demo = simulate(task, "modern", 2)
    tracker, events = fed(demo.recording)
    assert [event.index for event in began(events)] == [0, 1, 2, 2]
    assert len(tracker.keyframes) == 3
    assert demo.truth is not None
    last = tracker.keyframes[-1]
    assert last.T_nav_sensor.p == pytest.approx(truth_at(demo.truth, last.t), abs=0.01)


def test_a_jolt_does_not_end_a_stop() -> None:
    recording = pour().recording
    acc = recording.acc.copy()
    acc[180:184] += (3.0, -2.0, 1.0)
    tracker, _ = fed(replace(recording, acc=acc))
    assert len(tracker.stops) == 11


def test_short_holes_are_bridged_and_counted() -> None:
    recording = pour().recording
    whole, _ = plain_pour()
    holed = with_hole(with_hole(recording, 2.9, 2.93), 5.1, 5.13)
    tracker, events = fed(holed)
    assert not [event for event in events if isinstance(event, DataFlaw)]
    assert tracker.lost == 6
    for ours, theirs in zip(tracker.keyframes, whole.keyframes, strict=True):
        assert ours.T_nav_sensor.distance(theirs.T_nav_sensor)[0] < 0.005
    assert tracker.keyframes[1].cov[0, 0] > whole.keyframes[1].cov[0, 0]


def test_a_long_hole_in_a_move_is_told_and_makes_its_keyframe_unsure() -> None:
    recording = pour().recording
    whole, _ = plain_pour()
    tracker, events = fed(with_hole(recording, 2.9, 3.2))
    (flaw,) = (event for event in events if isinstance(event, DataFlaw))
    assert flaw.message == "300 ms of data are missing before row 320 (t = 3.20 s)"
    assert flaw.t == pytest.approx(2.89)
    told = [event.flaws for event in began(events)]
    assert told[1] == (flaw.message,)
    assert not any(told[2:])
    assert len(tracker.keyframes) == 11
    assert sigma(tracker.keyframes[1]) > 2.0 * sigma(whole.keyframes[1])


def sigma(keyframe: Keyframe) -> float:
    return float(np.sqrt(keyframe.cov[0, 0]))


def test_a_long_hole_in_a_rest_changes_nothing_but_is_told() -> None:
    recording = pour().recording
    tracker, events = fed(with_hole(recording, 1.3, 2.2))
    assert [event.message[:6] for event in events if isinstance(event, DataFlaw)] == ["900 ms"]
    whole, _ = plain_pour()
    assert len(tracker.stops) == 11
    for ours, theirs in zip(tracker.keyframes, whole.keyframes, strict=True):
        assert ours.T_nav_sensor.distance(theirs.T_nav_sensor)[0] < 0.01


def test_rows_with_impossible_times_are_left_out_and_told_once() -> None:
    recording = pour().recording
    t = recording.t.copy()
    t[500:510] -= 3.0
    t[700:705] += 1e6
    t[900] = np.nan
    tracker, events = fed(replace(recording, t=t))
    told = [event.message for event in events if isinstance(event, DataFlaw)]
    assert told[0].startswith("time runs backwards from 4.990 s to 2.000 s (row 500); rows are left out")
    assert any(message.startswith("time jumps from 6.990 s to 1000007.000 s (row 700)") for message in told)
    assert "the time of row 900 is not a number; the row is left out" in told
    assert len(told) <= 4  # and that 100 ms are missing after the first
    assert len(tracker.stops) == 11
    assert np.isfinite(tracker.keyframes[-1].T_nav_sensor.p).all()


def test_it_waits_for_a_rest_and_says_why() -> None:
    recording = pour().recording
    tracker = LiveTracker()
    assert tracker.waiting == "waiting for 1 s of rest"
    shaking = recording.acc + 3.0 * np.sin(40.0 * recording.t)[:, None]
    tracker.feed(recording.t, shaking, recording.gyr)
    assert tracker.waiting.startswith("hold still for 1 s: the hand shakes with 3.")
    assert tracker.rest is None
    assert not tracker.stops
    assert not tracker.keyframes
    assert not tracker.moving
    later = recording.t[-1] + 0.01 + recording.t
    events = list(tracker.feed(later, recording.acc, recording.gyr))
    assert isinstance(events[0], RestFound)
    assert events[0].t == pytest.approx(later[100], abs=0.15)
    assert tracker.waiting == ""
    assert len(tracker.stops) == 11


def test_wrong_units_are_named_while_it_waits() -> None:
    recording = pour().recording
    tracker = LiveTracker()
    tracker.feed(recording.t, recording.acc / GRAVITY, recording.gyr)
    assert "likely in g" in tracker.waiting
    tracker = LiveTracker()
    tracker.feed(1e3 * recording.t, recording.acc, recording.gyr)
    assert tracker.waiting.endswith("10 s lie between two samples; the time must be in seconds")


def test_it_learns_from_a_far_quieter_second() -> None:
    recording = pour().recording
    acc = recording.acc.copy()
    acc[:120] += 0.3 * np.random.default_rng(0).standard_normal((120, 3))
    tracker, events = fed(replace(recording, acc=acc))
    (found,) = (event for event in events if isinstance(event, RestFound))
    assert tracker.rest is not None
    assert tracker.rest.acc_rms < 0.1 * found.rest.acc_rms
    assert len(tracker.stops) == 11


def test_it_does_without_a_magnetometer_and_without_a_gyro() -> None:
    demo = simulate("pour", "modern", 1)
    recording = replace(demo.recording, mag=None)
    tracker, _ = fed(recording)
    batch = find_keyframes(track(recording))
    assert len(tracker.keyframes) == len(batch)
    for ours, theirs in zip(tracker.keyframes, batch, strict=True):
        assert ours.T_nav_sensor.distance(theirs.T_nav_sensor)[0] < 0.02
    zeros, _ = fed(replace(demo.recording, mag=np.zeros_like(recording.acc)))
    assert flat(zeros.keyframes) == flat(tracker.keyframes)

    bare = simulate("pick-and-place-stops", "os5000-nogyro", 0)
    assert len(fed(bare.recording)[0].stops) == 5
    with pytest.raises(TrackingError, match="neither a gyro nor the device's own attitude"):
        LiveTracker().feed(0.0, (0.0, 0.0, 9.81))


def test_a_magnetometer_may_be_read_less_often() -> None:
    recording = pour().recording
    assert recording.mag is not None
    mag = recording.mag.copy()
    mag[np.arange(len(mag)) % 10 != 0] = np.nan
    seldom, often = fed(replace(recording, mag=mag))[0].keyframes, plain_pour()[0].keyframes
    for ours, theirs in zip(seldom, often, strict=True):
        metres, radians = ours.T_nav_sensor.distance(theirs.T_nav_sensor)
        assert metres < 0.01
        assert radians < np.radians(2.0)


def test_shifting_time_changes_nothing() -> None:
    recording = pour().recording
    here, later = plain_pour()[0].keyframes, fed(replace(recording, t=recording.t + 100.0))[0].keyframes
    for ours, theirs in zip(later, here, strict=True):
        assert ours.T_nav_sensor.distance(theirs.T_nav_sensor)[0] < 1e-4
        assert ours.t - theirs.t == pytest.approx(100.0)


def test_a_long_rest_takes_no_memory() -> None:
    recording = simulate(Task("still", (Waypoint(rest_s=12.0),)), "modern").recording
    tracker, used = LiveTracker(), []
    tracemalloc.start()
    for rows in (slice(0, 500), slice(500, None)):
        tracker.feed(recording.t[rows], recording.acc[rows], np.asarray(recording.gyr)[rows])
        used.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert used[1] - used[0] < 16 * (len(recording) - 500)  # less than two numbers a row more; a row has seven


def test_stops_of_a_real_hand_agree_with_the_optics(data_folder: Path) -> None:
    (file,) = (data_folder / "broad").glob("14*.npz")
    recorded = read_broad(file)["40"]
    still = np.zeros(len(recorded.moving), dtype=bool)
    for stop in fed(recorded.recording)[0].stops:
        still[stop.start : stop.stop] = True
    assert 2.0 * (still & ~recorded.moving).sum() / (still.sum() + (~recorded.moving).sum()) > 0.985
