"""The live tracker: independent of how rows are cut, in agreement with the smoother and the truth, and fast enough."""

import tracemalloc
from dataclasses import fields, replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbd.data import GRAVITY, Demonstration, Keyframe, LinearErrors, Recording, SensorErrors
from pbd.errors import TrackingError
from pbd.pose import (
    Array,
    matrix_log,
    quat_about_z,
    quat_exp,
    quat_inverse,
    quat_log,
    quat_multiply,
    quat_rotate,
    quat_to_matrix,
    yaw_toward,
)
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import TASKS, random_task
from pbd.simulation.tasks import HEADING, Task
from pbd.timestamps.sample_clock import SampleClock
from pbd.tracking.estimate import estimate
from pbd.tracking.first_rest import find_rest
from pbd.tracking.noise import FACTORY, Noise, densities, noise_of
from pbd.tracking.online.filter import (
    IDENTITY,
    KNOT_POS,
    KNOT_ROT,
    NORTH_ROW,
    SENSOR_ERRORS,
    STATES,
    UP,
    ErrorStateFilter,
)
from pbd.tracking.online.sample_repair import RepairedSample, SampleRepair
from pbd.tracking.online.strapdown import Leg, Strapdown
from pbd.tracking.online.sway import sway_of
from pbd.tracking.online.tracker import DataFlaw, LiveEvent, LiveTracker, RestFound, StopBegan, StopEnded
from pbd.tracking.smoother.factors import compass_heading
from pbd.tracking.smoother.preintegration import (
    ACC_BIAS,
    ACC_MATRIX,
    ERRORS,
    GYR_BIAS,
    GYR_MATRIX,
    LAG,
    POS,
    ROT,
    VEL,
    GyroFrame,
    gyro_frame,
    preintegrate,
)
from tests.benchmarks.trials import read_broad, with_drift
from tests.near import assert_near
from tests.not_none import not_none
from tests.scenarios import pour, simulate, truth_at, uncalibrated, with_hole, with_rows
from tests.simulation.sway import with_sway
from tests.tracking.fed_tracker import began, fed

SENSORS = ("modern", "os5000", "wt901")
SEEDS = (2, 3)

WHITE = Noise(0.1, 1.0, FACTORY, gyr_turn=0.0, acc_motion=0.0, acc_bend=0.0)

LATEST_S = 0.3
"""s: a stop is announced within this time of its start."""


@cache
def half_poured(sensor: str, seed: int) -> Demonstration:
    """The everyday task up to its seventh stop."""
    return simulate(replace(TASKS["pour"], waypoints=TASKS["pour"].waypoints[:7]), sensor, seed)


@cache
def poured(sensor: str, seed: int) -> tuple[LiveTracker, list[LiveEvent]]:
    return fed(half_poured(sensor, seed).recording)


@cache
def poured_at_first() -> Recording:
    """The first 7.8 s of the everyday task: 4 of its 11 stops."""
    return with_rows(pour().recording, slice(0, 780))


@cache
def plain() -> tuple[LiveTracker, list[LiveEvent]]:
    """They without faults."""
    return fed(poured_at_first())


def flat(value: object) -> object:
    """A value as nested tuples, which compare bit by bit."""
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
    """Rows are lost, repeated, without numbers and out of order, and there is a hole."""
    recording = with_hole(recording, 5.0, 5.3)
    acc, t = recording.acc.copy(), recording.t.copy()
    acc[[150, 400, 401]], acc[590, 1] = np.nan, 1e30
    t[560], t[620], t[680] = np.nan, t[618], t[680] + 1e4
    rows = np.sort(np.append(np.delete(np.arange(len(t), dtype=np.intp), [300, 301, 480]), [650, 650]))
    return with_rows(replace(recording, acc=acc, t=t), rows)


@cache
def to_be_cut() -> tuple[Recording, LiveTracker, list[LiveEvent]]:
    """A damaged recording of 7 s, and the result of feeding it as a whole."""
    recording = damaged(with_rows(pour().recording, slice(0, 700)))
    return recording, *fed(recording)


@settings(max_examples=3, deadline=None)
@given(sizes=st.lists(st.integers(1, 200), min_size=1, max_size=20))
def test_any_pieces_give_the_same_to_the_bit(sizes: list[int]) -> None:
    recording, whole, events = to_be_cut()
    pieces, events_in_pieces = fed(recording, sizes)
    assert flat(events_in_pieces) == flat(events)
    assert state(pieces) == state(whole)


def test_what_is_read_on_the_way_does_not_depend_on_the_pieces_either() -> None:
    recording = pour().recording
    one, other = LiveTracker(), LiveTracker()
    for start in range(0, 540, 90):
        part = with_rows(recording, slice(start, start + 90))
        one.feed(part.t, part.acc, part.gyr, part.mag)
        for k in range(90):
            other.feed(float(part.t[k]), part.acc[k], not_none(part.gyr)[k], not_none(part.mag)[k])
            assert other.sigma_now >= 0.0  # reading changes nothing
        assert state(one) == state(other)


def at_the_end(sensor: str, seed: int) -> tuple[Keyframe, Array, Array]:
    """The live tracker's last keyframe; the smoother's position of it (3,) m, with covariance (3, 3) m2."""
    recording, live = half_poured(sensor, seed).recording, poured(sensor, seed)[0].keyframes
    rest = find_rest(recording)
    batch = estimate(recording, rest, noise_of(recording, rest))
    assert len(live) == len(batch.stops)
    first, last = ((stop.start + stop.stop - 1) // 2 for stop in (batch.stops[0], batch.stops[-1]))
    # Each has a heading of its own at the first stop.
    yaw = yaw_toward(batch.path.wxyz[first], live[0].T_nav_sensor.wxyz)
    return live[-1], quat_rotate(quat_about_z(yaw), batch.path.p[last]), batch.covariance.of_each[-1][:3, :3]


@uncalibrated
@pytest.mark.parametrize("sensor", SENSORS)
def test_at_the_last_stop_it_agrees_with_the_batch_smoother(sensor: str) -> None:
    """Both used the same data, so they differ by less than their errors: here by less than three sigma."""
    live, p_batch, cov_batch = at_the_end(sensor, SEEDS[0])
    assert distance_in_sigmas(live.T_nav_sensor.p - p_batch, live.cov[:3, :3]) < 3.0
    assert np.trace(live.cov[:3, :3]) > 0.5 * np.trace(cov_batch)  # it can't be surer


@uncalibrated
@pytest.mark.parametrize("sensor", SENSORS)
def test_the_truth_lies_within_its_sigma(sensor: str) -> None:
    """Of normal errors 95 % lie within two sigma; here 36 each in position and in rotation."""
    scaled: list[Array] = []
    for seed in SEEDS:
        demo = half_poured(sensor, seed)
        truth, keyframes = not_none(demo.truth), poured(sensor, seed)[0].keyframes
        assert len(keyframes) == 7
        true = [truth.wxyz_nav_sensor[int(np.searchsorted(truth.t, keyframe.t))] for keyframe in keyframes]
        yaw = yaw_toward(keyframes[0].T_nav_sensor.wxyz, true[0]) * UP  # sigma is relative to the first stop
        for keyframe, wxyz in zip(keyframes[1:], true[1:], strict=True):
            p = keyframe.T_nav_sensor.p
            off = p + np.cross(yaw, p) - truth_at(truth, keyframe.t)
            turn = quat_log(quat_multiply(keyframe.T_nav_sensor.wxyz, quat_inverse(wxyz))) + yaw
            scaled.append(np.concatenate((off, turn)) / np.sqrt(np.diagonal(keyframe.cov)))
    z = np.abs(scaled)
    for part in (z[:, :3], z[:, 3:]):
        assert 0.85 <= (part < 2.0).mean() <= 1.0
        assert np.sqrt((part**2).mean()) > 0.2  # nor is it five times too wide


@uncalibrated
@pytest.mark.parametrize("sensor", ["modern", "wt901"])
def test_the_heading_of_a_hand_that_sways_in_its_first_rest_lies_within_its_sigma(sensor: str) -> None:
    """Such a hand turns as steadily as the gyro's bias would: the heading was off by three sigma."""
    scaled = []
    for seed in (0, 1):
        task = replace(TASKS["pour"], waypoints=TASKS["pour"].waypoints[:7])
        swaying = with_sway(task, Noise.still_speed, seed, turn=Noise.still_speed / Noise.pivot_distance)
        demo = simulate(swaying, sensor, seed)
        truth, keyframes = not_none(demo.truth), fed(replace(demo.recording, mag=None))[0].keyframes
        true = [truth.wxyz_nav_sensor[int(np.searchsorted(truth.t, keyframe.t))] for keyframe in keyframes]
        headings = [
            yaw_toward(each, keyframe.T_nav_sensor.wxyz) for each, keyframe in zip(true, keyframes, strict=True)
        ]
        sigmas = [np.sqrt(keyframe.cov[5, 5]) for keyframe in keyframes[1:]]
        scaled.append((np.array(headings[1:]) - headings[0]) / sigmas)
        assert len(keyframes) == 7
    assert 0.2 < np.sqrt(np.mean(np.square(scaled))) < 1.5


def test_a_steady_turn_is_no_sway_however_long_it_is_seen() -> None:
    t = np.linspace(3.0, 4.0, 101)
    swing = 0.002 * np.sin(2.0 * np.pi * (t - 3.0))[:, None] * (0.0, 1.0, 0.0)
    assert sway_of(t, t[:, None] * np.array((0.5, 0.0, -0.3))) == pytest.approx(0.0, abs=1e-12)
    assert sway_of(t, swing + t[:, None]) == pytest.approx(2.0 * 0.002, rel=1e-3)
    assert sway_of(4.0 * t, swing) == pytest.approx(0.002, rel=1e-3)
    assert sway_of(t[:1], swing[:1]) == 0.0


def distance_in_sigmas(off: Array, cov: Array) -> float:
    """Mahalanobis distance over three axes; 4 is as rare as 3 along one axis."""
    return float(np.sqrt(off @ np.linalg.solve(cov + 1e-8 * np.eye(3), off)))


def from_rest_to_rest(wobble: float, up_to: int = 120) -> tuple[Strapdown, list[Leg], GyroFrame]:
    """A move as the live tracker and the smoother integrate it, with a wobble in rad/s about three axes.

    The live tracker stops before row `up_to`. Returned are its legs, and what it integrated after them.
    """
    recording = pour("modern", 1).recording
    part = slice(240, 360)
    t, acc = recording.t[part], recording.acc[part]
    phase = 2.0 * np.pi * 4.0 * t[:, None]
    moving = (np.abs(t - 3.0) < 0.25)[:, None]
    gyr = not_none(recording.gyr)[part] + wobble * moving * np.cos(phase + np.arange(3.0))
    samples = [RepairedSample(k, *row) for k, row in enumerate(zip(t.tolist(), acc, gyr, strict=True))]
    strapdown = Strapdown(samples[0], 0.01, WHITE, np.zeros(3), no_gyro=False)
    legs = []
    for sample in samples[1:up_to]:
        strapdown.push(sample)
        if up_to < len(samples) and strapdown.count == strapdown.block:
            legs.append(strapdown.leg(GRAVITY * UP))
    return strapdown, legs, gyro_frame(t[:up_to], gyr[:up_to], acc[:up_to], 0.01)


def test_a_wobble_turns_it_as_it_turns_the_batch() -> None:
    """Coning: the hand turns by more than the sum of its rates."""
    strapdown, _, frame = from_rest_to_rest(wobble=3.0)
    np.testing.assert_allclose(strapdown.C, quat_to_matrix(frame.wxyz[-1]), rtol=0.0, atol=1e-5)


def test_a_force_that_grows_evenly_is_integrated_exactly() -> None:
    growth, none = np.array([0.0, 3.0, -2.0]), np.zeros(3)
    samples = [RepairedSample(k, 0.1 * k, GRAVITY * UP + 0.1 * k * growth, none) for k in range(10)]
    strapdown = Strapdown(samples[0], 0.1, WHITE, none, no_gyro=False)
    for sample in samples[1:4]:  # before the first samples the force did not grow
        strapdown.push(sample)
    u, U, P, T = strapdown.u, strapdown.U, strapdown.P, 0.6
    for sample in samples[4:]:
        strapdown.push(sample)
    assert_near(strapdown.U, U + T * u + T**2 / 2.0 * growth, 1e-12)
    assert_near(strapdown.P, P + T * U + T**2 / 2.0 * u + T**3 / 6.0 * growth, 1e-12)


def test_each_error_of_the_sensor_adds_as_much_as_in_the_batch() -> None:
    _, legs, frame = from_rest_to_rest(wobble=3.0, up_to=61)
    rows, density = np.array([0, 56, 60]), np.ones((3, len(frame.t)))
    batch = preintegrate(frame, rows, (density, density)).J[-1]
    for block, errors in product((ROT, VEL, POS), (LAG, GYR_MATRIX, ACC_MATRIX, GYR_BIAS, ACC_BIAS)):
        size = float(np.abs(batch[block, errors]).max())
        np.testing.assert_allclose(legs[-1].J[block, errors], batch[block, errors], rtol=0.0, atol=0.02 * size)


def test_its_noise_is_that_of_the_batch() -> None:
    _, legs, frame = from_rest_to_rest(wobble=3.0, up_to=61)
    density = densities(WHITE, frame.gyr, frame.u, 0.01, frame.u.mean(axis=0))
    batch = preintegrate(frame, np.array([0, 56, 60]), density).parts.sum(axis=0)[-1]
    sigma = np.sqrt(np.diagonal(batch))
    np.testing.assert_allclose(legs[-1].Q / np.outer(sigma, sigma), batch / np.outer(sigma, sigma), atol=0.01)


def test_its_integrals_are_those_of_the_batch() -> None:
    """Its cubics use past samples only. They differ in a step from the smoother's, and agree once the hand rests."""
    strapdown, _, frame = from_rest_to_rest(wobble=0.0)
    assert np.linalg.norm(frame.wxyz[60] - frame.wxyz[0]) > 0.0
    np.testing.assert_allclose(strapdown.C, quat_to_matrix(frame.wxyz[-1]), rtol=0.0, atol=2e-6)
    leg = strapdown.leg(GRAVITY * UP)
    assert leg.dU == pytest.approx(frame.U[-1], abs=1e-4)
    assert leg.dP == pytest.approx(frame.UU[-1], abs=1e-4)


@pytest.mark.parametrize("end", [4.0, -4.0])
@pytest.mark.parametrize("rows", [1, 2, 3, 6])
def test_a_gyro_at_the_end_of_its_range_may_have_lost_a_fifth_of_it(end: float, rows: int) -> None:
    """All to one side, so sigma grows as the duration. Two equal readings are chance."""

    def seen(step: float) -> tuple[str, float]:
        rates = np.concatenate(([0.0, 0.5 * end], np.linspace(end, end + step, rows)))
        strapdown = Strapdown(RepairedSample(0, 0.0, GRAVITY * UP, 0.0 * UP), 0.01, WHITE, np.zeros(3), no_gyro=False)
        for k, rate in enumerate(rates):
            noise = 0.001 * (k % 2) * np.eye(3)[0]  # shows the step; and what is read twice does not count
            strapdown.push(RepairedSample(k, 0.01 * (k + 1), GRAVITY * UP, rate * UP + noise))
        return strapdown.clipped, float(strapdown.leg(GRAVITY * UP).Q[2, 2])

    (clipped, variance), (_, usual) = seen(0.0), seen(0.1)
    lost = 0.2 * abs(end) * 0.01 * np.sqrt(max(rows**2 - 2**2, 0))
    assert clipped == ("gyro" if lost > 0.0 else "")
    assert np.sqrt(max(variance - usual, 0.0)) == pytest.approx(lost, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize(("steps", "told"), [(260, True), (240, False)])
def test_a_rounded_peak_may_repeat_its_top(steps: int, told: bool) -> None:
    """Three equal readings are a clipped peak's if its side falls by more than 250 steps in two readings."""
    strapdown = Strapdown(RepairedSample(0, 0.0, GRAVITY * UP, 0.0 * UP), 0.01, WHITE, np.zeros(3), no_gyro=False)
    for k, fall in enumerate((steps, steps - 1, 0, 0, 0)):
        acc = (20.0 - 0.01 * fall) * UP
        strapdown.push(RepairedSample(k, 0.01 * (k + 1), acc, 0.001 * k * UP))
    assert strapdown.clipped == ("accelerometer" if told else "")


def flaws_before_stops(events: list[LiveEvent]) -> list[list[str]]:
    """What is told of the data before each stop."""
    told: list[list[str]] = [[]]
    for event in events:
        if isinstance(event, DataFlaw):
            told[-1].append(event.message)
        elif isinstance(event, StopBegan):
            told.append([])
    return told[:-1]


def test_a_clipped_move_loses_no_stop_and_is_told_with_it() -> None:
    recording = simulate("pick-and-place-stops", "modern", 0).recording
    end = "was at the end of its range; move slower, or set a larger range"
    turn = replace(recording, gyr=np.clip(not_none(recording.gyr), -10.0, 10.0))
    assert flaws_before_stops(fed(turn)[1]) == [*4 * [[]], [f"the gyro {end}"]]
    shift = replace(recording, acc=np.clip(recording.acc, -12.0, 12.0))
    assert flaws_before_stops(fed(shift)[1]) == [[], [f"the accelerometer {end}"], *3 * [[]]]


def test_what_was_clipped_is_told_with_one_stop_however_soon_the_hand_leaves_it() -> None:
    recording = simulate("pick-and-place-stops", "modern", 0).recording
    gyr, tracker = np.clip(not_none(recording.gyr), -10.0, 10.0), LiveTracker()
    for t, acc, each in zip(recording.t, recording.acc, gyr, strict=True):
        if any(isinstance(event, DataFlaw) for event in tracker.feed(t, acc, each)):
            break
    assert not_none(tracker._hand)._strapdown.clipped == ""


def test_what_was_clipped_in_a_stop_is_not_told_of_the_move_after_it() -> None:
    tracker, _ = fed(with_rows(poured_at_first(), slice(0, 150)))
    not_none(tracker._hand)._strapdown.clipped = "gyro"
    after = with_rows(poured_at_first(), slice(150, None))
    events = tracker.feed(after.t, after.acc, after.gyr, after.mag)
    assert began(list(events))
    assert not [event for event in events if isinstance(event, DataFlaw)]


def test_a_knock_or_a_wrong_turn_at_an_unknown_time_leaves_its_motion_uncertain() -> None:
    rest, since = find_rest(poured_at_first()), np.linspace(0.0, 0.6, 1001)
    kalman = ErrorStateFilter(noise_of(poured_at_first(), rest), rest, np.eye(3), None, no_gyro=False)
    before, g = kalman.P, kalman.gravity
    kalman.add_knock_or_wrong_turn(0.6, 0.2)
    added = (kalman.P - before)[:9, :9]
    turn = np.sqrt(added[0, 0]) * np.vstack((since**0, -g * since, -g * since**2 / 2))  # about x: it falls along -y
    knock = 0.2 * np.vstack((0.0 * since, since**0, since))
    by_knock, by_turn = (error @ error.T / 1001 for error in (knock, turn))
    assert by_turn[1, 1] == pytest.approx(0.2**2, rel=2e-3)  # either explains the velocity
    x_y, upright = np.ix_((0, 4, 7), (0, 4, 7)), np.ix_((2, 5, 8), (2, 5, 8))
    np.testing.assert_allclose(added[x_y], by_knock + by_turn, atol=1e-4)
    np.testing.assert_allclose(added[upright], by_knock + np.diag((added[0, 0], 0.0, 0.0)), atol=1e-4)


@pytest.mark.parametrize(("sensor", "at_s", "by"), [("modern", 3.3, 0.5), ("wt901", 7.3, 0.2)])
def test_after_a_wrong_turn_a_hand_that_holds_still_has_stopped(sensor: str, at_s: float, by: float) -> None:
    """The filter took a part of gravity for motion from then on, and never found a stop again.

    Nor does the stop before give way to those after it: it lasted longer than any coasting.
    """
    stops = tuple(replace(waypoint, rest_s=3.0) for waypoint in TASKS["pour"].waypoints[:4])
    recording = simulate(replace(TASKS["pour"], waypoints=stops), sensor, 2).recording
    gyr, wrong = not_none(recording.gyr).copy(), (recording.t > at_s) & (recording.t < at_s + 0.1)
    gyr[wrong] += by * np.array((1.0, -1.0, 0.4))  # rad/s
    tracker, events = fed(replace(recording, gyr=gyr))
    assert len(tracker.stops) == 4
    (flaw,) = (event for event in events if isinstance(event, DataFlaw))
    assert flaw.message.startswith("no motion fits the data from ")


@pytest.mark.parametrize("stronger", [1.0, 1.1])
def test_a_compass_counts_as_much_as_it_lasts_and_less_in_a_disturbed_field(stronger: float) -> None:
    rest, field = find_rest(poured_at_first()), np.array((3.0, 20.0, -45.0))
    noise = noise_of(poured_at_first(), rest)
    kalman, north = ErrorStateFilter(noise, rest, np.eye(3), field, no_gyro=False), IDENTITY[NORTH_ROW]
    kalman.P = noise.compass_heading**2 * np.outer(north, north)  # nothing else is unsure
    seen = stronger * quat_rotate(quat_about_z(0.002), kalman.E @ field)
    dip = np.arctan2(seen[2], np.hypot(seen[0], seen[1]))
    trust = float(compass_heading(seen[None], float(np.linalg.norm(field)), dip, noise)[2][0])
    kalman.update_compass(kalman.E.T @ seen, 3.0)
    left = 1.0 / (1.0 + 3.0 * trust)
    assert (left == pytest.approx(0.25, rel=1e-3)) == (stronger == 1.0)
    assert kalman.north == pytest.approx((1.0 - left) * 0.002, rel=1e-3)
    assert kalman.P[NORTH_ROW, NORTH_ROW] == pytest.approx(left * noise.compass_heading**2, rel=1e-3)
    kalman.update_compass(kalman.E.T @ (0.0, 0.0, -50.0), 3.0)  # straight down, it shows no north
    assert kalman.P[NORTH_ROW, NORTH_ROW] == pytest.approx(left * noise.compass_heading**2, rel=1e-3)


def test_the_further_away_a_hand_is_the_less_its_reach_pulls_it_back() -> None:
    rest, unsure = find_rest(poured_at_first()), np.zeros(STATES)
    noise = replace(noise_of(poured_at_first(), rest), reach=3.0)
    kalman = ErrorStateFilter(noise, rest, np.eye(3), None, no_gyro=False)
    unsure[POS] = (3.0**2 + 5.0**2) / 2.0  # as the reach is at 5 m, over 2 s
    kalman.p, kalman.P = np.array((4.0, 3.0, 0.0)), np.diag(unsure)
    kalman.update_reach(2.0)
    assert kalman.p == pytest.approx((2.0, 1.5, 0.0))


def test_the_devices_own_attitude_tells_nothing_new_until_it_turns() -> None:
    rest, off = find_rest(poured_at_first()), np.array((0.002, -0.003, 0.004))
    noise = replace(noise_of(poured_at_first(), rest), device_attitude=0.03)
    kalman, unsure = ErrorStateFilter(noise, rest, np.eye(3), None, no_gyro=True), np.zeros(STATES)
    unsure[ROT] = 1.0
    kalman.E, kalman.P = quat_to_matrix(quat_exp(off)), np.diag(2.0 * 0.03**2 * unsure)
    kalman.update_device_attitude(0.0)
    np.testing.assert_allclose(matrix_log(kalman.E), off, atol=1e-9)
    kalman.update_device_attitude(1.0)  # 1 rad: as good as what was known
    np.testing.assert_allclose(matrix_log(kalman.E), 0.5 * off, atol=2e-5)


def test_without_a_gyro_the_lag_is_undone_from_the_first_turn_on() -> None:
    demo = simulate("pour", "os5000-nogyro", 0)
    keyframes = fed(demo.recording)[0].keyframes
    assert len(keyframes) == 11
    for keyframe in keyframes:
        assert keyframe.T_nav_sensor.p == pytest.approx(truth_at(not_none(demo.truth), keyframe.t), abs=0.03)


def test_the_first_stop_is_the_origin_and_gives_the_heading() -> None:
    first = plain()[0].keyframes[0]
    assert not first.T_nav_sensor.p.any()
    assert not first.cov[[0, 1, 2, 5]].any()
    assert (np.diagonal(first.cov)[3:5] > 0.0).all()


def stop_starts(task: Task) -> Array:
    """Times at which the hand comes to rest, s."""
    ends = np.cumsum([w.move_s + w.rest_s for w in task.waypoints])
    return np.array([end - w.rest_s for end, w in zip(ends, task.waypoints, strict=True)])


@pytest.mark.parametrize(("sensor", "rate_hz"), [("modern", 40.0), ("wt901", 100.0), ("os5000", 143.0)])
def test_a_stop_is_announced_in_time_and_nothing_else_is(sensor: str, rate_hz: float) -> None:
    for task in (TASKS["pick-and-place-stops"], random_task(5, moves=4)):
        _, events = fed(simulate(task, sensor, 3, rate_hz=rate_hz).recording)
        announced = np.array([event.announced_t for event in began(events)[1:]])
        late = announced - stop_starts(task)[1:]  # which fails where their numbers differ
        assert late.max() <= LATEST_S
        assert late.min() > 0.0
        assert max(event.announced_t - event.t for event in began(events)[1:]) <= LATEST_S


def test_a_hand_that_comes_back_to_its_place_makes_another_stop() -> None:
    away, back = Waypoint((0.1, 0.0, 0.0), move_s=0.8, rest_s=0.0), Waypoint(move_s=0.8, rest_s=1.0)
    tracker, _ = fed(simulate(Task("back", (Waypoint(rest_s=2.0), away, back)), "ideal", 0).recording)
    assert len(tracker.stops) == 2


def test_ten_samples_a_second_show_all_stops() -> None:
    tracker, _ = fed(simulate("pour", "modern", 0, rate_hz=10.0).recording)
    assert len(tracker.stops) == len(TASKS["pour"].waypoints)


@uncalibrated
def test_a_slow_hand_stops_where_it_does_and_nowhere_else() -> None:
    """Half-way, where acceleration is zero, a smooth move is as quiet as a rest."""
    waypoints = tuple(replace(waypoint, move_s=3.0 * waypoint.move_s) for waypoint in TASKS["pour"].waypoints[:5])
    task = replace(TASKS["pour"], waypoints=waypoints)
    starts = stop_starts(task)
    ends = starts + [waypoint.rest_s for waypoint in waypoints]
    demo = simulate(task, "wt901", 6)
    assert demo.truth is not None
    announced = np.array([event.announced_t for event in began(fed(demo.recording)[1])])
    assert len(announced) == len(starts)
    assert (announced < ends).all()
    speed = np.linalg.norm(np.gradient(demo.truth.p_nav_sensor, demo.truth.t, axis=0), axis=1)
    assert np.interp(announced, demo.truth.t, speed).max() < 0.02


def turns(sensor: str, move_s: float) -> tuple[Task, Recording]:
    """A hand that turns back three times, then stops twice."""
    there, back = Waypoint((0.05, 0.0, 0.0), move_s=move_s), Waypoint(move_s=move_s)
    away = Waypoint((0.2, 0.0, 0.1), move_s=1.0, rest_s=1.0), Waypoint((0.2, 0.2, 0.1), move_s=1.0, rest_s=1.0)
    task = Task("turns", (Waypoint(rest_s=2.0), there, back, there, back, *away))
    return task, simulate(task, sensor, 0).recording


@uncalibrated
@pytest.mark.parametrize(("sensor", "move_s"), [("wt901", 1.0), ("ideal", 1.6)])
def test_a_turn_back_that_seemed_a_stop_gives_way_to_the_stop_after_it(sensor: str, move_s: float) -> None:
    task, recording = turns(sensor, move_s)
    tracker, events = fed(recording)
    assert len(began(events)) > 3  # a turn was taken for a stop
    rests = stop_starts(task)[-2:]
    assert [keyframe.t for keyframe in tracker.keyframes[1:]] == pytest.approx(rests + 0.5, abs=0.1)


@uncalibrated
def test_each_hypothesis_has_a_filter_of_its_own() -> None:
    """One filter under two of them would move on by each leg twice."""
    recording, tracker = turns("wt901", 1.0)[1], LiveTracker()
    for k in range(len(recording)):
        row = with_rows(recording, slice(k, k + 1))
        tracker.feed(row.t, row.acc, row.gyr, row.mag)
        filters = [] if tracker._hand is None else tracker._hand._filters()
        assert len(set(map(id, filters))) == len(filters)


def test_the_hand_is_seen_on_its_way() -> None:
    demo = pour()
    recording, truth = demo.recording, demo.truth
    assert truth is not None
    speed = np.gradient(truth.p_nav_sensor, truth.t, axis=0)
    tracker, sigmas = LiveTracker(), []
    for k in range(520):
        part = with_rows(recording, slice(k, k + 1))
        tracker.feed(part.t, part.acc, part.gyr, part.mag)
        sigmas.append((tracker.sigma_of_move, tracker.sigma_now))
        assert tracker.p_nav_sensor == pytest.approx(truth_at(truth, part.t[0]), abs=0.01)
        assert tracker.v_nav_sensor == pytest.approx(speed[k], abs=0.05)
        if np.linalg.norm(speed[k]) > 0.1:
            assert tracker.moving
        cosine = abs(float(tracker.wxyz_nav_sensor @ truth.wxyz_nav_sensor[k]))
        assert k < 150 or cosine > np.cos(np.radians(1.0))
    of_move, now = np.array(sigmas).T
    assert (now >= of_move).all()
    still = np.interp(recording.t[:520], truth.t, np.linalg.norm(speed, axis=1)) == 0.0
    assert of_move[200] == 0.0
    (move,) = [k for k in range(250, 349) if of_move[k] == 0.0 and of_move[k + 1] > 0.0]
    assert (np.diff(of_move[move + 1 : 340 : 4]) > 0.0).all()  # it grows as the move goes on, block by block
    assert still[200]
    sigma = np.sqrt(tracker.keyframes[1].cov[0, 0])
    assert 0.5 * sigma < of_move[355] < 2.0 * sigma  # and foretells that of the keyframe


def test_stops_end_and_keyframes_become_final() -> None:
    tracker, events = poured("modern", SEEDS[0])
    ended = [event for event in events if isinstance(event, StopEnded)]
    assert [event.index for event in began(events)] == list(range(7))
    assert [event.index for event in ended] == list(range(6))
    assert flat([event.keyframe for event in ended]) == flat(tracker.keyframes[:-1])
    for event, stop, keyframe in zip(began(events), tracker.stops, tracker.keyframes, strict=True):
        assert event.keyframe.T_nav_sensor.distance(keyframe.T_nav_sensor)[0] < 2e-3  # the rest of the stop tells more
        assert keyframe.dwell_s == stop.dwell_s
        assert keyframe.dwell_s > event.keyframe.dwell_s


def test_the_keyframe_of_a_stop_is_made_once() -> None:
    """A recording asks for all of them ten times a second or more: after 70 stops that took 15 % of its time."""
    tracker, _ = poured("modern", SEEDS[0])
    assert all(again is keyframe for again, keyframe in zip(tracker.keyframes, tracker.keyframes, strict=True))


def test_a_stops_rows_last_as_long_as_it_does() -> None:
    tracker, _ = fed(poured_at_first())
    stop, t = tracker.stops[0], poured_at_first().t
    assert t[stop.stop - 1] - t[stop.start] == pytest.approx(stop.dwell_s)


def test_a_sensor_put_down_that_bounces_makes_one_stop() -> None:
    up, down = (0.0, 0.0, 0.15), (0.2, 0.0, 0.0)
    bounce = (Waypoint(down, move_s=0.8, rest_s=0.3), Waypoint((0.2, 0.0, 0.012), move_s=0.2, rest_s=1.0))
    task = Task("bounce", (Waypoint(rest_s=2.0), Waypoint(up, move_s=0.8, rest_s=0.8), *bounce))
    demo = simulate(task, "modern", 2)
    tracker, events = fed(demo.recording)
    assert [event.index for event in began(events)] == [0, 1, 2, 2]
    assert len(tracker.keyframes) == 3
    last = tracker.keyframes[-1]
    assert last.T_nav_sensor.p == pytest.approx(truth_at(not_none(demo.truth), last.t), abs=0.01)
    assert demo.recording.t[tracker.stops[-1].start] == pytest.approx(4.9, abs=0.1)  # not from where it bounced


@pytest.mark.parametrize(("pause_s", "late_s"), [(0.28, 0.0), (1.0, 0.03)])
def test_a_quick_turn_on_the_spot_is_neither_a_bounce_nor_a_jolt(pause_s: float, late_s: float) -> None:
    """A late gyro leaves a velocity after it, as after a jolt."""
    pause = Waypoint((0.2, 0.0, 0.0), move_s=0.8, rest_s=pause_s)
    turn = Waypoint((0.2, 0.0, 0.0), (0.6, 0.0, 0.0), move_s=0.15, rest_s=1.0)
    demo = simulate(Task("turn", (Waypoint(rest_s=2.0), pause, turn)), "modern", 2, rate_hz=100.0)
    recording = demo.recording
    late = np.column_stack([np.interp(recording.t - late_s, recording.t, axis) for axis in not_none(recording.gyr).T])
    tracker, events = fed(replace(recording, gyr=late))
    assert [event.index for event in began(events)] == [0, 1, 2]
    last = tracker.keyframes[-1]
    assert last.T_nav_sensor.p == pytest.approx(truth_at(not_none(demo.truth), last.t), abs=0.01)


def test_a_quick_move_of_fifteen_millimetres_between_two_rests_is_no_bounce() -> None:
    rest = Waypoint((0.2, 0.0, 0.0), move_s=0.8, rest_s=1.0)
    task = Task("quick", (Waypoint(rest_s=2.0), rest, Waypoint((0.215, 0.0, 0.0), move_s=0.15, rest_s=1.0)))
    events = fed(simulate(task, "modern", 2).recording)[1]
    assert [event.index for event in began(events)] == [0, 1, 2]


@pytest.mark.parametrize("sensor", ["modern", "phone"])
def test_a_calm_move_of_three_centimetres_is_no_jolt(sensor: str) -> None:
    """In its middle the hand hardly accelerates, as at rest."""
    moves = (Waypoint((0.03 * ((k + 1) % 2), 0.0, 0.0), move_s=1.0, rest_s=0.5) for k in range(4))
    tracker, events = fed(simulate(Task("calm", (Waypoint(rest_s=2.0), *moves)), sensor, 0, rate_hz=100.0).recording)
    assert [event.index for event in began(events)] == list(range(5))
    assert len(tracker.keyframes) == 5


@pytest.mark.parametrize(("rows", "push", "turn"), [(4, 3.0, 0.0), (12, 1.0, 0.0), (12, 3.0, 0.5)])
def test_a_jolt_does_not_end_a_stop(rows: int, push: float, turn: float) -> None:
    """Of m/s2, to and fro, and of rad/s; the last one leaves a velocity that is not zero."""
    recording = with_rows(poured_at_first(), slice(0, 240))
    assert recording.gyr is not None
    acc, gyr, wave = recording.acc.copy(), recording.gyr.copy(), np.sin(np.linspace(0.0, 2.0 * np.pi, rows + 1)[:rows])
    acc[145 : 145 + rows] += push * wave[:, None] * (1.0, -0.6, 0.4)
    gyr[145 : 145 + rows, 0] += turn * wave
    assert len(fed(replace(recording, acc=acc, gyr=gyr))[0].stops) == 1


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_knock_after_which_the_hand_is_where_it_was_divides_no_stop(sensor: str) -> None:
    """Both ends of a knock of 0.28 s are seen up to a block too far away."""
    there, onward = Waypoint((0.2, 0.0, 0.1), move_s=1.0, rest_s=1.0), Waypoint((0.4, 0.0, 0.1), move_s=1.0, rest_s=1.0)
    out, back = Waypoint((0.22, 0.0, 0.1), move_s=0.14), replace(there, move_s=0.14)
    demo = simulate(Task("knock", (Waypoint(rest_s=2.0), there, out, back, onward)), sensor, 0)
    assert len(fed(demo.recording)[0].stops) == 3


def test_rows_without_numbers_before_the_first_sample_are_left_out() -> None:
    tracker, none = LiveTracker(), (np.nan, np.nan, np.nan)
    assert [event for k in range(3) for event in tracker.feed(0.01 * k, none, none)] == []
    for k in range(3, 400):
        tracker.feed(0.01 * k, (0.0, 0.0, GRAVITY), (0.0, 0.0, 0.0))
    assert len(tracker.stops) == 1


@pytest.mark.parametrize("device_rpy", [None, (0.1, 0.2, 0.3)])
def test_a_gyro_that_falls_silent_is_reported_once(device_rpy: tuple[float, float, float] | None) -> None:
    """Its rows are left out; with the device's attitude beside they were read as a gyro that reads zero."""
    recording = poured_at_first()
    assert recording.gyr is not None
    tracker, flaws = LiveTracker(), []
    for k, t in enumerate(recording.t[:900]):
        gyr = recording.gyr[k] if k < 300 else None
        events = tracker.feed(t, recording.acc[k], gyr, device_rpy=device_rpy)
        flaws += [event for event in events if isinstance(event, DataFlaw)]
    assert [(flaw.t, flaw.message) for flaw in flaws] == [
        (2.99, "the rows since 2.990 s lack numbers in gyr; the hand is not tracked until they come again")
    ]
    assert tracker.stops[-1].stop <= 300


def test_without_a_gyro_its_known_bias_turns_nothing() -> None:
    recording = simulate("pour", "os5000").recording
    biased = LinearErrors(np.full(3, 0.05), np.eye(3), np.full(3, 0.01), 1e-3)
    plain, known = (LiveTracker("os5000", SensorErrors("os5000", gyr=each)) for each in (None, biased))
    for tracker in (plain, known):
        tracker.feed(recording.t, recording.acc, None, recording.mag, recording.device_rpy)
    assert state(known) == state(plain)


def test_short_holes_are_bridged() -> None:
    recording = poured_at_first()
    whole, _ = plain()
    holed = with_hole(with_hole(recording, 2.9, 2.93), 5.1, 5.13)
    tracker, events = fed(holed)
    assert not [event for event in events if isinstance(event, DataFlaw)]
    repair = SampleRepair()
    repair.interval = 0.01
    assert recording.gyr is not None
    assert holed.gyr is not None
    rows = zip(holed.t.tolist(), holed.acc, holed.gyr, strict=True)
    bridged = [sample for t, acc, gyr in rows for sample in repair.take(t, acc, gyr, None, None)[0]]
    assert_near(np.array([sample.t for sample in bridged]), recording.t, 1e-9)
    good = np.isfinite(holed.acc).all(axis=1)
    for name, values in (("acc", holed.acc), ("gyr", holed.gyr)):
        between = [np.interp(recording.t, holed.t[good], axis[good]) for axis in values.T]
        assert_near(np.array([getattr(sample, name) for sample in bridged]), np.transpose(between), 1e-12)
    assert np.isnan(holed.acc).any(axis=1).sum() == 6
    for ours, theirs in zip(tracker.keyframes, whole.keyframes, strict=True):
        assert ours.T_nav_sensor.distance(theirs.T_nav_sensor)[0] < 0.005
    assert tracker.keyframes[1].cov[0, 0] > whole.keyframes[1].cov[0, 0]


def test_a_long_hole_in_a_move_is_told_and_makes_its_keyframe_unsure() -> None:
    recording = poured_at_first()
    whole, _ = plain()
    tracker, events = fed(with_hole(recording, 2.9, 3.2))
    (flaw,) = (event for event in events if isinstance(event, DataFlaw))
    assert flaw.message == "300 ms of data are missing before row 320 (t = 3.20 s): if the hand moved, record again"
    assert flaw.t == pytest.approx(2.89)
    assert flaws_before_stops(events) == [[], [flaw.message], [], []]
    assert len(tracker.keyframes) == 4
    assert sigma(tracker.keyframes[1]) > 2.0 * sigma(whole.keyframes[1])


def sigma(keyframe: Keyframe) -> float:
    return float(np.sqrt(keyframe.cov[0, 0]))


def test_a_long_hole_in_a_rest_changes_nothing_but_is_told() -> None:
    recording = poured_at_first()
    tracker, events = fed(with_hole(recording, 1.2, 2.4))
    assert [event.message[:7] for event in events if isinstance(event, DataFlaw)] == ["1200 ms"]
    whole, _ = plain()
    assert len(tracker.stops) == 4
    assert not_none(tracker.rest).start == 0  # what is interpolated in the hole is no quieter rest
    for ours, theirs in zip(tracker.keyframes, whole.keyframes, strict=True):
        assert ours.T_nav_sensor.distance(theirs.T_nav_sensor)[0] < 0.01


def test_a_hole_from_one_rest_to_another_attitude_ends_the_stop() -> None:
    """What is interpolated there is as calm as a rest."""
    waypoints = (Waypoint(rest_s=2.0), Waypoint(turn=(0.2, 0.0, 0.0), move_s=1.5, rest_s=1.5))
    recording = simulate(Task("turn", waypoints), "modern", 3).recording
    tracker, _ = fed(with_hole(recording, 1.6, 4.6))
    assert tracker.stops[0].dwell_s == pytest.approx(1.6, abs=0.05)


def test_a_long_rest_says_nothing_of_the_scales() -> None:
    """Noise times its own noise is positive, and pulled each scale by a sigma in two minutes."""
    recording = simulate(Task("rest", (Waypoint(rest_s=30.0),)), "wt901", 3, rate_hz=20.0).recording
    hand = not_none(fed(recording)[0]._hand)
    assert np.abs(hand._filter.x[GYR_MATRIX]).max() < 0.001
    assert np.abs(hand._filter.x[ACC_MATRIX]).max() < 0.005


@pytest.mark.parametrize(("after_s", "bounded"), [(0.9, False), (1.1, True)])
def test_the_reach_bounds_the_position_only_in_a_long_move(
    after_s: float, bounded: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nearer than half a stride (1 s) to a stop, the stop bounds the motion, as in the smoother."""
    hand = not_none(fed(simulate(Task("rest", (Waypoint(rest_s=3.0),)), "modern", 3).recording)[0]._hand)
    asked: list[float] = []
    monkeypatch.setattr(ErrorStateFilter, "update_reach", lambda _, lasted: asked.append(lasted))
    hand._update_between_knots(replace(hand._window[-1][0], t=hand._t_knot + after_s))
    assert bool(asked) == bounded


def test_a_gyro_that_warms_up_loses_no_stop() -> None:
    """By 0.08 deg/s each second: after 20 s more than the rate at which a hand counts as turning."""
    waypoints = (
        Waypoint(rest_s=20.0),
        *(Waypoint((0.1 * (k % 2), 0.0, 0.0), move_s=1.0, rest_s=1.0) for k in range(1, 4)),
    )
    recording = simulate(Task("warm", waypoints), "os5000", 3).recording
    warm = not_none(recording.gyr) + np.radians(0.08) * recording.t[:, None] * (0.6, 0.0, 0.8)
    tracker, _ = fed(replace(recording, gyr=warm))
    assert len(tracker.stops) == 4


def test_minutes_without_a_stop_end_in_a_stop_with_a_gyro_that_drifts(data_folder: Path) -> None:
    """Its bias walks three times as far as assumed. In such a move only the hand's reach tells where is down."""
    (file,) = (data_folder / "broad").glob("10*.npz")
    recording = with_drift(with_rows(read_broad(file)["40"].recording, slice(1300, None)), 3.0, seed=1)
    tracker, _ = fed(recording)
    assert len(tracker.stops) == 2
    assert np.abs(tracker.p_nav_sensor).max() < 5.0  # it was 20 km


def test_rows_with_impossible_times_are_left_out_and_told_once() -> None:
    recording = poured_at_first()
    t = recording.t.copy()
    t[500:510] -= 3.0
    t[600:605] += 1e6
    t[700] = np.nan
    tracker, events = fed(replace(recording, t=t))
    told = [event.message for event in events if isinstance(event, DataFlaw)]
    assert told[0].startswith("time runs backwards from 4.990 s to 2.000 s (row 500); rows are left out")
    assert any(message.startswith("time jumps from 5.990 s to 1000006.000 s (row 600)") for message in told)
    assert "the time of row 700 is not a number; the row is left out" in told
    assert len(told) <= 4  # and that 100 ms are missing after the first
    assert len(tracker.stops) == 4
    assert np.isfinite(tracker.keyframes[-1].T_nav_sensor.p).all()


def test_it_waits_for_a_rest_and_says_why() -> None:
    recording = poured_at_first()
    tracker = LiveTracker()
    assert tracker.waiting == "waiting for 1 s of rest"
    shaking = recording.acc + 3.0 * np.sin(40.0 * recording.t)[:, None]
    tracker.feed(recording.t, shaking, recording.gyr)
    assert tracker.waiting.startswith("hold still for 1 s: the hand shakes with 3.")
    dead = LiveTracker()
    dead.feed(recording.t, np.zeros_like(recording.acc), recording.gyr)
    assert dead.waiting == "the accelerometer reads zero while at rest, so it is dead or in free fall; check the sensor"
    assert tracker.rest is None
    assert not tracker.stops
    assert not tracker.keyframes
    assert not tracker.moving
    assert tracker.wxyz_nav_sensor.tolist() == [1.0, 0.0, 0.0, 0.0]
    later = recording.t[-1] + 0.01 + recording.t
    events = list(tracker.feed(later, recording.acc, recording.gyr))
    assert isinstance(events[0], RestFound)
    assert events[0].t == pytest.approx(later[100], abs=0.15)
    assert tracker.waiting == ""
    assert len(tracker.stops) == 4


@pytest.mark.parametrize(("sensor", "seed", "rest_s"), [("os5000", 3, 0.3), ("modern", 3, 0.5), ("wt901", 4, 0.3)])
def test_the_end_of_a_move_is_no_stop_before_the_first_rest(sensor: str, seed: int, rest_s: float) -> None:
    """A second that begins in the end of a move can be quiet on average."""
    move = Waypoint((0.2, 0.0, 0.1), (0.3, 0.0, 0.0), move_s=0.7, rest_s=1.3)
    waypoints = (Waypoint(rest_s=rest_s), move, Waypoint(move_s=0.8, rest_s=1.0))
    tracker, _ = fed(simulate(Task("early", waypoints), sensor, seed).recording)
    assert [stop.dwell_s > 0.9 for stop in tracker.stops] == [True, True]


def fastest_in_rest(tracker: LiveTracker, demo: Demonstration) -> float:
    """The hand's largest true speed, m/s, in what the tracker took for the rest."""
    assert demo.truth is not None
    assert tracker.rest is not None
    speed = np.linalg.norm(np.gradient(demo.truth.p_nav_sensor, demo.truth.t, axis=0), axis=1)
    return float(speed[tracker.rest.start : tracker.rest.stop].max())


def test_a_calm_move_is_no_first_rest() -> None:
    """A hand that slows down shakes less than one that is unsteady, but it certainly moves."""
    moves = (Waypoint((0.15 * ((k + 1) % 2), 0.0, 0.0), move_s=1.4, rest_s=1.3) for k in range(4))
    demo = simulate(Task("late", (Waypoint(rest_s=0.0), *moves)), "wt901", 0, rate_hz=50.0)
    tracker, events = fed(demo.recording)
    assert fastest_in_rest(tracker, demo) < 0.05
    assert [event.index for event in began(events)] == list(range(4))


def test_the_end_of_a_calm_move_and_the_rest_after_it_are_no_first_rest() -> None:
    """Of that second the hand moves in a part, at 9 cm/s."""
    moves = (Waypoint((0.06, 0.0, 0.0), move_s=1.23, rest_s=0.78), Waypoint((0.0, 0.02, 0.0), move_s=1.14, rest_s=1.0))
    demo = simulate(Task("early", (Waypoint(rest_s=0.0), *moves)), "modern", 0, rate_hz=50.0)
    tracker, _ = fed(demo.recording)
    assert fastest_in_rest(tracker, demo) < 0.05


def test_wrong_units_are_named_while_it_waits() -> None:
    recording = pour().recording
    tracker = LiveTracker()
    tracker.feed(recording.t, recording.acc / GRAVITY, recording.gyr)
    assert "likely in g" in tracker.waiting
    tracker = LiveTracker()
    assert recording.gyr is not None
    tracker.feed(recording.t[:200], recording.acc[:200], 1e3 * recording.gyr[:200])
    assert tracker.waiting.startswith("hold still for 1 s: the hand turns with ")
    assert tracker.waiting.endswith("end the recording, and give the gyro's unit: --unit gyr=...")
    tracker = LiveTracker()
    tracker.feed(1e3 * recording.t, recording.acc, recording.gyr)
    assert tracker.waiting.endswith(
        "10 s lie between two samples; the time must be in seconds, or its unit given (--unit t=ms)"
    )


def test_it_learns_from_a_far_quieter_second() -> None:
    recording = poured_at_first()
    acc = recording.acc.copy()
    acc[:120] += 0.3 * np.random.default_rng(0).standard_normal((120, 3))
    tracker, events = fed(replace(recording, acc=acc))
    (found,) = (event for event in events if isinstance(event, RestFound))
    assert recording.t[found.rest.stop - 1] == found.t
    assert not_none(tracker.rest).acc_var < 0.01 * found.rest.acc_var
    assert len(tracker.stops) == 4


def test_a_coarse_sensor_shows_its_step_once_it_moves() -> None:
    """At rest all its readings are the same. Taken for a sensor without noise, it never came to a stop again."""
    recording, step = poured_at_first(), np.radians(2.0)
    assert recording.gyr is not None
    coarse = replace(recording, acc=0.15 * np.round(recording.acc / 0.15), gyr=step * np.round(recording.gyr / step))
    assert len(fed(coarse)[0].keyframes) == 4


def test_an_accelerometer_slower_than_its_gyro_is_late_and_loses_no_stop() -> None:
    """Read in every third row, it is 10 ms behind: a stop after a turn seemed to have a velocity, and was lost."""
    demo = half_poured("modern", SEEDS[0])
    late = demo.recording.acc[np.arange(len(demo.recording)) // 3 * 3]
    keyframes = fed(replace(demo.recording, acc=late))[0].keyframes
    assert len(keyframes) == 7
    for keyframe in keyframes:
        assert keyframe.T_nav_sensor.p == pytest.approx(truth_at(not_none(demo.truth), keyframe.t), abs=0.015)


def test_a_prior_of_the_lag_that_is_widened_late_gives_what_a_wide_one_gives() -> None:
    """From the start: the filter is linear in the lag."""
    rest = find_rest(poured_at_first())
    noise, J = noise_of(poured_at_first(), rest), np.zeros((9, ERRORS))
    J[VEL, LAG] = np.array([[0.3], [-0.2], [0.1]])

    def moved(lag_sigma: float) -> ErrorStateFilter:
        kalman = ErrorStateFilter(replace(noise, lag_sigma=lag_sigma), rest, np.eye(3), None, no_gyro=False)
        kalman.propagate(Leg(0.05, 0.05 * GRAVITY * UP, np.zeros(3), J, 1e-6 * np.eye(9), np.eye(3), np.zeros(3)))
        kalman.update_zero_velocity(0.01, np.array((0.002, 0.0, 0.0)), robust=False)
        return kalman

    late, wide = moved(noise.lag_sigma), moved(noise.wide_lag_sigma)
    late._free_lag()
    np.testing.assert_allclose(late.P, wide.P, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(np.concatenate((late.x, late.v)), np.concatenate((wide.x, wide.v)), rtol=0.0, atol=1e-7)


def test_the_pose_within_a_leg_is_the_one_that_the_filter_has_once_the_leg_ends() -> None:
    rest = find_rest(poured_at_first())
    kalman = ErrorStateFilter(noise_of(poured_at_first(), rest), rest, np.eye(3), None, no_gyro=False)
    kalman.v, kalman.x = np.array([0.3, -0.2, 0.1]), np.zeros(ERRORS)
    force, rate = GRAVITY * UP + np.array([2.0, 1.0, -3.0]), np.array([0.5, -1.0, 2.0])
    samples = [RepairedSample(k, 0.01 * k, force, rate) for k in range(6)]
    strapdown = Strapdown(samples[0], 0.01, WHITE, np.zeros(3), no_gyro=False)
    for sample in samples[1:]:
        strapdown.push(sample)
    wxyz, p, v = kalman.predict(strapdown)
    kalman.propagate(strapdown.leg(GRAVITY * UP))
    assert_near(p, kalman.p, 1e-12)
    assert_near(v, kalman.v, 1e-12)
    assert_near(quat_to_matrix(wxyz), kalman.E @ kalman.C, 1e-12)


def test_a_bias_that_rounding_hid_has_tilted_the_vertical_too() -> None:
    """So at the same attitude a rest goes on to fit, however large that bias may be."""
    rest = find_rest(poured_at_first())
    noise = noise_of(poured_at_first(), rest)
    kalman = ErrorStateFilter(noise, rest, quat_to_matrix(quat_exp(np.array((0.5, -0.3, 0.2)))), None, no_gyro=False)
    kalman.P = np.zeros((STATES, STATES))
    kalman.use_noise(replace(noise, sensor=replace(noise.sensor, acc_walk=0.04)))
    assert np.diagonal(kalman.P)[SENSOR_ERRORS][ACC_BIAS] == pytest.approx(0.04**2 - noise.sensor.acc_walk**2)
    np.testing.assert_array_equal(kalman.P[KNOT_ROT], kalman.P[ROT])  # the last knot is as far off
    T, J = 0.05, np.zeros((9, ERRORS))
    J[VEL, ACC_BIAS] = -T * kalman.C
    up = kalman.E.T @ UP * kalman.gravity
    kalman.propagate(Leg(T, T * up, 0.5 * T**2 * up, J, np.zeros((9, 9)), kalman.C, np.zeros(3)))
    assert np.abs(kalman.P[VEL, VEL]).max() < 1e-12


def test_where_the_last_knot_is_as_unsure_the_way_from_there_is_surer_than_the_place() -> None:
    rest = find_rest(poured_at_first())
    kalman = ErrorStateFilter(noise_of(poured_at_first(), rest), rest, np.eye(3), None, no_gyro=False)
    kalman.P = np.zeros((STATES, STATES))
    kalman.P[POS, POS] = 0.05**2 * np.eye(3)
    kalman.P[POS, KNOT_POS] = kalman.P[KNOT_POS, POS] = kalman.P[KNOT_POS, KNOT_POS] = 0.04**2 * np.eye(3)
    assert kalman.sigma_if_stopped(0.001) == pytest.approx((0.05, 0.03))


def test_it_does_without_a_magnetometer_and_without_a_gyro() -> None:
    demo = pour("modern", 1)
    recording = with_rows(replace(demo.recording, mag=None), slice(0, 780))
    tracker, _ = fed(recording)
    assert demo.truth is not None
    assert len(tracker.keyframes) == 4
    yaw = quat_about_z(-HEADING)  # nav's x is the sensor's own at the first rest
    for keyframe in tracker.keyframes:
        assert keyframe.T_nav_sensor.p == pytest.approx(quat_rotate(yaw, truth_at(demo.truth, keyframe.t)), abs=0.01)
    zeros, _ = fed(replace(recording, mag=np.zeros_like(recording.acc)))
    assert flat(zeros.keyframes) == flat(tracker.keyframes)

    bare = simulate("pick-and-place-stops", "os5000-nogyro", 0)
    keyframes = fed(bare.recording)[0].keyframes
    assert len(keyframes) == 5
    for keyframe, within in zip(
        keyframes, (0.05, 0.05, 0.05, 0.05, 0.1), strict=True
    ):  # the lag shows in the last move
        assert keyframe.T_nav_sensor.p == pytest.approx(truth_at(not_none(bare.truth), keyframe.t), abs=within)
    with pytest.raises(TrackingError, match="neither a gyro nor the device's own attitude"):
        LiveTracker().feed(0.0, (0.0, 0.0, 9.81))


def test_without_a_gyro_a_doubtful_stop_is_no_flaw_of_the_data() -> None:
    """Of this pouring the first one is: the device's own attitude lags, and the first turn shows how much."""
    assert flaws_before_stops(fed(simulate("pour", "os5000-nogyro", 2).recording)[1]) == [[] for _ in range(11)]


def test_a_calm_move_without_a_gyro_is_no_stop() -> None:
    """At 40 samples/s its acceleration changes as little as at rest; only its velocity tells."""
    moves = (Waypoint((0.17 * ((k + 1) % 2), 0.0, 0.0), move_s=1.4, rest_s=0.8) for k in range(4))
    demo = simulate(Task("calm", (Waypoint(rest_s=2.0), *moves)), "os5000-nogyro", 0)
    tracker, events = fed(demo.recording)
    assert [event.index for event in began(events)] == list(range(5))
    for keyframe in tracker.keyframes[1:]:
        off = keyframe.T_nav_sensor.p - truth_at(not_none(demo.truth), keyframe.t)
        assert distance_in_sigmas(off, keyframe.cov[:3, :3]) < 4.0


def test_a_magnetometer_may_be_read_less_often() -> None:
    recording = poured_at_first()
    mag = not_none(recording.mag).copy()
    mag[np.arange(len(mag)) % 10 != 0] = np.nan
    seldom, often = fed(replace(recording, mag=mag))[0].keyframes, plain()[0].keyframes
    for ours, theirs in zip(seldom, often, strict=True):
        metres, radians = ours.T_nav_sensor.distance(theirs.T_nav_sensor)
        assert metres < 0.01
        assert radians < np.radians(2.0)


def arrivals(recording: Recording, kind: str) -> Recording:
    """The recording with arrival times: delayed at random by an interval on average, or four rows at one time."""
    t, rows = recording.t, np.arange(len(recording))
    late = np.random.default_rng(0).exponential(1.0 / recording.rate_hz, len(t))
    arrived = np.maximum.accumulate(t + late) if kind == "random" else t[np.minimum(rows // 4 * 4 + 3, rows[-1])]
    return replace(recording, t=arrived)


@pytest.mark.parametrize("kind", ["random", "fours"])
@pytest.mark.parametrize("rate_hz", [40.0, 95.0])
def test_arrival_times_lose_no_stop(kind: str, rate_hz: float) -> None:
    """As they were, stops were missed, and keyframes were off by up to 70 cm."""
    demo = simulate("pick-and-place-stops", "modern", 1, rate_hz=rate_hz)
    tracker, events = fed(arrivals(demo.recording, kind))
    (flaw,) = (event for event in events if isinstance(event, DataFlaw))
    assert "evenly spaced times at" in flaw.message
    keyframes = tracker.keyframes
    assert len(keyframes) == 5
    for keyframe in keyframes:
        assert keyframe.T_nav_sensor.p == pytest.approx(truth_at(not_none(demo.truth), keyframe.t), abs=0.02)


def test_a_row_that_is_lost_among_arrival_times_leaves_the_motion_unknown() -> None:
    """Which row was the first to be late is not sure: rate and acceleration of 1 rad/s and 2 m/s2, one sigma, are
    missed."""
    repair = SampleRepair(straightened=True)
    repair.interval = 0.01
    acc, gyr = np.array((0.1, 0.2, 9.8)), np.array((0.1, 0.0, 0.0))
    for t in (0.0, 0.02):
        samples, _ = repair.take(t, acc, gyr, None, None)
    assert [sample.t for sample in samples] == pytest.approx([0.01, 0.02])
    assert samples[-1].gap_noise == pytest.approx((0.02, 0.08))


@pytest.mark.parametrize("kind", ["random", "fours"])
def test_a_link_whose_times_begin_to_jitter_in_a_move_is_noticed(kind: str) -> None:
    """Those of 128 rows tell. As they were, a stop was missed, and of batches of four rows only one counted."""
    recording = simulate("pick-and-place-stops", "modern", 1, rate_hz=100.0).recording
    began_at = 2.5
    late = np.maximum.accumulate(np.where(recording.t > began_at, arrivals(recording, kind).t, recording.t))
    tracker, events = fed(replace(recording, t=late))
    (flaw,) = (event for event in events if isinstance(event, DataFlaw) and "evenly spaced times at" in event.message)
    assert began_at < flaw.t < began_at + 2 * 1.28
    assert len(tracker.keyframes) == 5


@pytest.mark.parametrize("rate_hz", [40.0, 286.0])
def test_samples_that_are_lost_among_arrival_times_lose_no_stop(rate_hz: float) -> None:
    """Of a sensor without a clock, 1.5 % lost; half of the stops were missed."""
    recording = simulate("pick-and-place-stops", "modern", 0, rate_hz=rate_hz).recording
    rows = np.flatnonzero(np.random.default_rng(0).random(len(recording)) > 0.015)
    clock = SampleClock[int]()
    stamped = [each for row in rows.tolist() for each in clock.take(row, None, float(recording.t[row]))]
    tracker = LiveTracker()
    events: list[LiveEvent] = []
    for t, row in stamped:
        events += tracker.feed(t, recording.acc[row], not_none(recording.gyr)[row])
    assert [event.index for event in began(events)] == list(range(5))
    assert not [event for event in events if isinstance(event, DataFlaw)]


def test_shifting_time_changes_nothing() -> None:
    recording = poured_at_first()
    here, later = plain()[0].keyframes, fed(replace(recording, t=recording.t + 100.0))[0].keyframes
    for ours, theirs in zip(later, here, strict=True):
        assert ours.T_nav_sensor.distance(theirs.T_nav_sensor)[0] < 1e-4
        assert ours.t - theirs.t == pytest.approx(100.0)


def test_a_long_rest_takes_no_memory() -> None:
    recording = simulate(Task("still", (Waypoint(rest_s=4.0),)), "modern").recording
    tracker, used = LiveTracker(), []
    tracemalloc.start()
    for rows in (slice(0, 200), slice(200, None)):
        tracker.feed(recording.t[rows], recording.acc[rows], np.asarray(recording.gyr)[rows])
        used.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert used[1] - used[0] < 16 * (len(recording) - 200)  # less than two numbers a row more; a row has seven


def test_stops_of_a_real_hand_agree_with_the_optics(data_folder: Path) -> None:
    """In 60 s of the recording: two rests, each with the move after it."""
    (file,) = (data_folder / "broad").glob("14*.npz")
    recorded = read_broad(file)["40"]
    rows = slice(1500, 3957)
    moving = recorded.moving[rows]
    still = np.zeros(len(moving), dtype=bool)
    for stop in fed(with_rows(recorded.recording, rows))[0].stops:
        still[stop.start : stop.stop] = True
    assert 2.0 * (still & ~moving).sum() / (still.sum() + (~moving).sum()) > 0.99


def test_between_the_neighbours_of_lost_samples_motion_may_be_anything() -> None:
    """Its noise: the variance of a uniform distribution between the two, summed over axes, times the gap's duration."""
    repair, between = SampleRepair(), np.linspace(0.0, 1.0, 10_001)[:, None]
    repair.interval = 0.01
    gyr, acc = np.array((0.1, -0.2, 0.3)), np.array((1.0, 2.0, -0.5))
    for t in (-1.0, 0.0):  # a second is judged before it is given
        repair.take(t, 0.5 * acc, 0.5 * gyr, None, None)
    samples, _ = repair.take(0.03, acc, gyr, None, None)
    assert len(samples) == 3
    wanted = [0.03 * (between * 0.5 * change).var(axis=0).sum() for change in (gyr, acc)]
    assert samples[-1].gap_noise == pytest.approx(wanted, rel=1e-3)
