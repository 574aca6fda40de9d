"""Physics that holds for every tracking method."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pbd.data import Recording, Stop
from pbd.pipeline import track
from pbd.pose import lengths, quat_about_z, quat_inverse, quat_rotate, yaw_toward
from pbd.simulation.hand_motion import HandMotion, Waypoint
from pbd.simulation.sensor_model import AttitudeOutput, SensorModel
from pbd.simulation.simulate import SENSOR_MODELS, random_task
from pbd.simulation.tasks import Task
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.paper import paper_path
from tests.not_none import not_none
from tests.scenarios import simulate, uncalibrated, with_rows
from tests.tracking.perfect_sensor import (
    PERFECT,
    RATE_HZ,
    STANDS_M,
    bound,
    hand,
    keyframe_errors,
    largest_angle,
    middle,
    perfect,
    with_and_without_north,
)
from tests.tracking.track_or_refuse import every_method

pytestmark = pytest.mark.usefixtures("cached_results")


@pytest.mark.filterwarnings("ignore:--method paper finds:pbd.errors.PbdWarning")
@every_method
@with_and_without_north
@pytest.mark.parametrize("rpy", [(0.4, -0.3, 2.0), (-2.5, 0.2, 1.0)])
def test_a_hand_that_never_moves_stays_where_it_is(
    method: str, sensor: SensorModel, rpy: tuple[float, float, float]
) -> None:
    recording = simulate(Task("still", (Waypoint(rest_s=4.0),), start_rpy=rpy), sensor).recording
    # Rows that are alike to the last bit are refused as a stuck sensor's.
    acc = recording.acc + 1e-12 * np.random.default_rng(0).normal(size=(len(recording), 3))
    path = track(replace(recording, acc=acc), method)
    assert len(path.stops) == 1
    assert path.p_nav_sensor == pytest.approx(0.0, abs=1e-9)
    assert not path.v_nav_sensor.any()
    assert largest_angle(path.wxyz_nav_sensor, path.wxyz_nav_sensor[:1]) < 1e-6


@pytest.mark.parametrize(("pitch_deg", "axis"), [(55.0, (1.0, 0.0, 0.0)), (65.0, (0.0, 1.0, 0.0))])
def test_without_north_navs_x_is_an_axis_of_the_sensor_laid_level(
    pitch_deg: float, axis: tuple[float, float, float]
) -> None:
    """It is the sensor's y where its x is within 30 degrees of the vertical."""
    task = Task("still", (Waypoint(rest_s=4.0),), start_rpy=(0.2, np.radians(pitch_deg), 1.0))
    recording = replace(simulate(task, "modern", 0).recording, mag=None)
    x, y, _ = quat_rotate(track(recording).wxyz_nav_sensor[0], axis)
    assert abs(np.arctan2(y, x)) < 1e-3


def test_nav_points_to_the_north_that_the_compass_shows_at_the_first_rest() -> None:
    """A room's field points 10 degrees elsewhere from 10 cm away from there on."""
    demo = simulate(random_task(1), "modern")
    truth, recording = not_none(demo.truth), demo.recording
    away = np.minimum(lengths(truth.p_nav_sensor) / 0.1, 1.0)
    field = quat_rotate(
        quat_about_z(np.radians(10.0) * away), quat_rotate(truth.wxyz_nav_sensor, not_none(recording.mag))
    )
    path = track(replace(recording, mag=quat_rotate(quat_inverse(truth.wxyz_nav_sensor), field)))
    row = middle(path.stops[0])
    assert abs(np.degrees(yaw_toward(truth.wxyz_nav_sensor[row], path.wxyz_nav_sensor[row]))) < 0.5


@every_method
@pytest.mark.parametrize("seed", range(2))
def test_a_perfect_sensor_gives_the_truth(method: str, seed: int) -> None:
    task = hand(method, seed, turns=method == "default")  # a device's attitude is its own, not the tracker's
    path, truth = perfect(method, task)
    assert len(path.stops) == 5
    assert np.linalg.norm(keyframe_errors(path, truth), axis=1).max() < bound(method, task)


@pytest.mark.parametrize("seed", [22, 49])
def test_a_perfect_sensor_gives_the_truth_of_moves_that_begin_slowly(seed: int) -> None:
    """Each of these tasks has a move of 5 to 9 cm that takes 1.3 to 1.5 s. Its acceleration is below a hand's tremor
    for 60 to 80 ms at either end, and the stop seems to last as much longer."""
    path, truth = perfect("default", random_task(seed))
    assert len(path.stops) == 7
    assert np.linalg.norm(keyframe_errors(path, truth), axis=1).max() < STANDS_M


@pytest.mark.parametrize("seed", range(2))
def test_resampling_converges(seed: int) -> None:
    """The faster an ideal sensor samples, the nearer the path is to the truth, down to the creep of a still hand."""
    errors = []
    for rate_hz in (50.0, 100.0, 200.0, 400.0):
        demo = simulate(random_task(seed, moves=4), "ideal", rate_hz=rate_hz)
        path = track(demo.recording)
        assert len(path.stops) == 5
        errors.append(float(np.linalg.norm(keyframe_errors(path, not_none(demo.truth)), axis=1).max()))
    assert all(finer < max(coarser, STANDS_M) for coarser, finer in pairwise(errors))


def test_the_papers_sums_converge_where_its_stops_are_given() -> None:
    """Algorithm 1 itself does not converge: its threshold is on the step between two samples, which a higher rate makes
    smaller. With given rests, the rectangular sums of interval means converge with the rate."""
    task = hand("paper", 0, turns=False)
    motion = HandMotion(task.waypoints, task.start_rpy)
    begin, end = motion.knots.reshape(-1, 2).T
    errors = []
    for rate_hz in (20.0, 40.0, 80.0, 160.0):
        demo = simulate(task, PERFECT, rate_hz=rate_hz)
        t, truth = demo.recording.t, not_none(demo.truth)
        a_nav = quat_rotate(truth.wxyz_nav_sensor, demo.recording.acc) - (0.0, 0.0, 9.81)
        first = np.searchsorted(t, np.append(t[0], end) + 0.5 / rate_hz)
        last = np.searchsorted(t, np.append(begin, t[-1] + 1.0) - 0.5 / rate_hz)
        stops = tuple(Stop(int(i), int(j), float(t[j - 1] - t[i])) for i, j in zip(first, last, strict=True))
        p, _, closure = paper_path(t, a_nav, stops)
        assert closure == pytest.approx(0.0, abs=1e-9)
        errors.append(float(np.abs((p - truth.p_nav_sensor)[[middle(stop) for stop in stops]]).max()))
    assert all(finer < 0.5 * coarser for coarser, finer in pairwise(errors))


@every_method
@pytest.mark.parametrize(("sensor", "axis"), [("ideal", 0), ("modern", 2)])
def test_a_gyros_constant_bias_is_found_in_two_seconds_of_rest(method: str, sensor: str, axis: int) -> None:
    model = replace(SENSOR_MODELS[sensor], attitude=AttitudeOutput())
    recording = simulate(hand(method, 6), model, 1, rate_hz=RATE_HZ[method]).recording
    biased = replace(recording, gyr=not_none(recording.gyr) + np.radians(0.5) * np.eye(3)[axis])
    places, others = ([k.T_nav_sensor.p for k in find_keyframes(track(r, method))] for r in (recording, biased))
    assert np.linalg.norm(np.subtract(others, places), axis=1).max() < 1e-3


@every_method
@pytest.mark.parametrize("seed", range(2))
def test_two_halves_cut_at_a_rest_chain_to_the_whole(method: str, seed: int) -> None:
    task = hand(method, seed)
    long = replace(task.waypoints[2], rest_s=4.0)
    task = replace(task, waypoints=(*task.waypoints[:2], long, *task.waypoints[3:]))
    recording = simulate(task, "modern", seed, rate_hz=RATE_HZ[method]).recording
    whole = track(recording, method)
    cut = middle(max(whole.stops[1:], key=lambda stop: stop.dwell_s))
    halves = [track(half, method) for half in cut_at(recording, cut)]
    gone = sum(np.asarray(half.p_nav_sensor[half.stops[-1].start]) for half in halves)
    sigmas = [np.sqrt(np.trace(path.cov[-1, :3, :3])) for path in (whole, *halves)]
    assert sum(len(half.stops) for half in halves) == len(whole.stops) + 1
    assert np.linalg.norm(gone - whole.p_nav_sensor[whole.stops[-1].start]) < sum(sigmas)


def cut_at(recording: Recording, row: int) -> tuple[Recording, Recording]:
    later = with_rows(recording, slice(row, None))
    return with_rows(recording, slice(0, row)), replace(later, t=later.t - later.t[0])


@every_method
def test_velocity_is_the_derivative_of_position_and_zero_in_stops(method: str) -> None:
    """By the mean value theorem: the mean velocity between two samples lies between those at them. (Where velocity
    peaks between them it is up to dt^2 / 8 of the jerk above, which in these moves is up to 60 D / T^3. The paper's
    sums know nothing of that.)"""
    rate_hz, task = RATE_HZ[method], hand(method, 7)
    path = track(simulate(task, "modern", rate_hz=rate_hz).recording, method)
    for stop in path.stops:
        assert not path.v_nav_sensor[stop.start : stop.stop].any()
        assert not np.ptp(path.p_nav_sensor[stop.start : stop.stop], axis=0).any()
    moves = pairwise(task.waypoints)
    jerk = max(60.0 * float(np.linalg.norm(np.subtract(b.p, a.p))) / b.move_s**3 for a, b in moves)
    bend = jerk / 8.0 / rate_hz**2 if method == "default" else 1e-12
    for before, after in pairwise(path.stops):
        move = slice(before.stop - 1, after.start + 1)  # from the last row at rest to the next one
        p, v = path.p_nav_sensor[move], path.v_nav_sensor[move]
        mean = np.diff(p, axis=0) / np.diff(path.t[move])[:, None]
        assert (mean < np.maximum(v[1:], v[:-1]) + bend).all()
        assert (mean > np.minimum(v[1:], v[:-1]) - bend).all()
        assert np.abs(v).max() > 100.0 * bend


@uncalibrated
@every_method
@pytest.mark.parametrize(("sensor", "seed"), [("modern", 0), ("wt901", 1)])
def test_the_joint_covariance_is_symmetric_and_positive(method: str, sensor: str, seed: int) -> None:
    """The joint covariance of all poses relative to the first."""
    path = track(simulate(hand(method, seed), sensor, seed, rate_hz=RATE_HZ[method]).recording, method)
    assert len(path.stops) > 2
    joint = path.covariance.joint()
    assert np.array_equal(joint, joint.T)
    assert np.linalg.eigvalsh(joint).min() > -1e-9 * np.linalg.eigvalsh(joint).max()
    cov = path.cov
    assert cov == pytest.approx(np.array([joint[k : k + 6, k : k + 6] for k in range(0, len(joint), 6)]))
    assert not cov[0, :3, :3].any()
    assert np.linalg.eigvalsh(cov[1:, :3, :3]).min() > 0.0
