"""Symmetries of every tracking method: heading, mounting, left and right, size, clock."""

from dataclasses import replace

import numpy as np
import pytest

from pbd.data import HandPath, Recording, SensorErrors
from pbd.pipeline import track
from pbd.pose import quat_about_z, quat_from_rpy, quat_inverse, quat_multiply, quat_rotate, quat_to_rpy, yaw_toward
from pbd.simulation.sensor_model import SensorModel
from pbd.simulation.simulate import random_task
from pbd.tracking.first_rest import Rest
from pbd.tracking.keyframes import find_keyframes
from pbd.tracking.noise import Noise, noise_of
from tests.near import assert_near
from tests.not_none import not_none
from tests.scenarios import simulate
from tests.tracking.perfect_sensor import RATE_HZ, bound, hand, largest_angle, middle, perfect, with_and_without_north
from tests.tracking.track_or_refuse import every_method


def wrapped(angle: float) -> float:
    return float(np.arctan2(np.sin(angle), np.cos(angle)))


def same_stops(path: HandPath, other: HandPath) -> bool:
    return [(s.start, s.stop) for s in path.stops] == [(s.start, s.stop) for s in other.stops]


@every_method
@with_and_without_north
def test_turning_the_world_turns_the_result(method: str, sensor: SensorModel) -> None:
    """With a compass nav is east and north, whichever way the hand faces. Without one nav rotates with the hand."""
    task, yaw = hand(method, 0), 1.0
    plain, _ = perfect(method, task, sensor)
    turned, _ = perfect(method, task.rotated(yaw), sensor)
    row = middle(plain.stops[0])
    found = yaw_toward(plain.wxyz_nav_sensor[row], turned.wxyz_nav_sensor[row])
    # A tilt that is wrong while the hand moves turns the steep field, and how far depends on where north is.
    assert wrapped(found - (yaw if sensor.mag else 0.0)) == pytest.approx(0.0, abs=np.radians(0.1))
    turn = quat_about_z(found)
    assert same_stops(turned, plain)
    assert_near(turned.p_nav_sensor, quat_rotate(turn, plain.p_nav_sensor), 1e-5)
    assert_near(turned.v_nav_sensor, quat_rotate(turn, plain.v_nav_sensor), 1e-4)
    assert largest_angle(turned.wxyz_nav_sensor, quat_multiply(turn, plain.wxyz_nav_sensor)) < 1e-5


@every_method
@with_and_without_north
def test_a_mirrored_hand_goes_the_mirrored_way(method: str, sensor: SensorModel) -> None:
    """Mirrored in a vertical plane that keeps nav: the plane of north or, without north, of the sensor's x axis.

    Rates are axial vectors: the component along the mirrored axis stays, the others reverse. The earth's field lies in
    the plane, so it stays.
    """
    task = hand(method, 3)
    if not sensor.mag:
        task = task.rotated(-task.start_rpy[2])
    recording = simulate(task, sensor, rate_hz=RATE_HZ[method]).recording
    polar = np.array((-1.0, 1.0, 1.0)) if sensor.mag else np.array((1.0, -1.0, 1.0))
    axial = np.concatenate(((1.0,), -polar))
    mirrored = replace(
        recording,
        acc=polar * recording.acc,
        gyr=-polar * not_none(recording.gyr),
        mag=None if recording.mag is None else polar * recording.mag,
        device_rpy=quat_to_rpy(axial * quat_from_rpy(not_none(recording.device_rpy))),
    )
    path, other = track(recording, method), track(mirrored, method)
    assert same_stops(other, path)
    assert_near(other.p_nav_sensor, polar * path.p_nav_sensor, 1e-7)
    assert largest_angle(other.wxyz_nav_sensor, axial * path.wxyz_nav_sensor) < 1e-6
    assert np.ptp(path.p_nav_sensor[:, polar < 0.0]) > 0.05


@pytest.mark.filterwarnings("ignore:at the first rest the sensor lies upside down")  # it does, in one of the mountings
@every_method
@with_and_without_north
@pytest.mark.parametrize("rpy", [(0.4, -0.3, 2.0), (np.pi, 0.0, 0.0)])
def test_how_the_sensor_is_mounted_does_not_matter(
    method: str, sensor: SensorModel, rpy: tuple[float, float, float]
) -> None:
    task = hand(method, 4)
    if method == "paper":
        # Its yaw is Euler's, and what it makes of the gyro between two samples depends on how roll and pitch change.
        level = tuple(replace(waypoint, turn=(0.0, 0.0, waypoint.turn[2])) for waypoint in task.waypoints)
        task = replace(task, waypoints=level, start_rpy=(0.0, 0.0, 0.3))
    recording = simulate(task, sensor, rate_hz=RATE_HZ[method]).recording
    mount = quat_from_rpy(rpy)
    remounted = replace(
        recording,
        acc=quat_rotate(quat_inverse(mount), recording.acc),
        gyr=quat_rotate(quat_inverse(mount), not_none(recording.gyr)),
        mag=None if recording.mag is None else quat_rotate(quat_inverse(mount), recording.mag),
        device_rpy=quat_to_rpy(quat_multiply(quat_from_rpy(not_none(recording.device_rpy)), mount)),
    )
    path, other = track(recording, method), track(remounted, method)
    mounted = quat_multiply(path.wxyz_nav_sensor, mount)
    yaw = yaw_toward(other.wxyz_nav_sensor[middle(other.stops[0])], mounted[middle(path.stops[0])])
    assert same_stops(other, path)
    assert_near(quat_rotate(quat_about_z(yaw), other.p_nav_sensor), path.p_nav_sensor, 1e-5)
    assert largest_angle(quat_multiply(quat_about_z(yaw), other.wxyz_nav_sensor), mounted) < 1e-5
    assert sensor.mag is None or abs(wrapped(yaw)) < np.radians(0.1)


@every_method
@pytest.mark.parametrize("seed", range(2))
def test_a_task_twice_as_large_gives_twice_the_path(method: str, seed: int) -> None:
    task = hand(method, seed, turns=method == "default")
    waypoints = [replace(w, p=(2.0 * w.p[0], 2.0 * w.p[1], 2.0 * w.p[2])) for w in task.waypoints]
    larger = replace(task, waypoints=tuple(waypoints))
    path, _ = perfect(method, task)
    double, _ = perfect(method, larger)
    places, twice = (np.array([keyframe.T_nav_sensor.p for keyframe in find_keyframes(x)]) for x in (path, double))
    assert len(twice) == len(places)
    assert np.linalg.norm(twice - 2.0 * places, axis=1).max() < 2.0 * bound(method, task) + bound(method, larger)


@every_method
def test_shifting_time_changes_nothing(method: str) -> None:
    """To the bit, if times stay representable: multiples of 1/128 s, even at 1.7e9 s (since 1970)."""
    recording = simulate(random_task(5, moves=3), "modern", rate_hz=128.0).recording
    here = track(recording, method)
    for shift in (-64.0, 1.7e9):
        grip = tuple(replace(event, t=event.t + shift) for event in recording.grip)
        later = track(replace(recording, t=recording.t + shift, grip=grip), method)
        assert np.array_equal(later.p_nav_sensor, here.p_nav_sensor)
        assert np.array_equal(later.wxyz_nav_sensor, here.wxyz_nav_sensor)
        assert np.array_equal(later.cov, here.cov)
        assert np.array_equal(later.t, here.t + shift)


@every_method
def test_the_wall_clock_changes_nothing(method: str) -> None:
    recording = simulate(random_task(5, moves=2), "modern").recording
    here = track(recording, method)
    later = track(
        replace(recording, info=replace(recording.info, name="later", created="2031-01-01T00:00:00Z")), method
    )
    assert np.array_equal(later.p_nav_sensor, here.p_nav_sensor)


@pytest.mark.parametrize("sensor", ["modern", "os5000"])
def test_a_recording_played_backwards_shows_the_moves_backwards(monkeypatch: pytest.MonkeyPatch, sensor: str) -> None:
    """Both estimates use all samples, so they differ by far less than a sigma, which is that of noise."""
    recording = simulate("pour", sensor, 3).recording
    backwards = replace(
        recording,
        t=recording.t[-1] - recording.t[::-1],
        acc=recording.acc[::-1],
        gyr=-not_none(recording.gyr)[::-1],
        mag=not_none(recording.mag)[::-1],
        device_rpy=None if recording.device_rpy is None else recording.device_rpy[::-1],
    )
    path = track(recording)

    def ahead(recording: Recording, rest: Rest, errors: SensorErrors | None, steps: tuple[float, float]) -> Noise:
        noise = noise_of(recording, rest, errors, steps)
        return replace(noise, lag=-noise.lag)  # what lagged runs ahead

    monkeypatch.setattr("pbd.track_recording.noise_of", ahead)
    other = track(backwards)
    places, back = (np.array([x.p_nav_sensor[middle(stop)] for stop in x.stops]) for x in (path, other))
    sigma_m = max(float(np.sqrt(keyframe.cov[:3, :3].diagonal().max())) for keyframe in find_keyframes(path))
    assert_near(np.diff(back[::-1], axis=0), np.diff(places, axis=0), 0.25 * sigma_m)
