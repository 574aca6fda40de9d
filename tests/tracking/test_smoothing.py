"""Legs between stops, and attitude and acceleration made to agree with the stops: what is put in comes out again."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pbd.data import Attitude, Demonstration, Stop
from pbd.pipeline import track
from pbd.pose import (
    Array,
    quat_exp,
    quat_multiply,
)
from pbd.sensors.simulate import SENSOR_MODELS, random_task, simulate
from pbd.sensors.simulated_sensor import SensorModel, Triad
from pbd.tracking.gravity import motion_acceleration
from pbd.tracking.integration import (
    integrate_path,
)
from pbd.tracking.legs import find_legs, inside
from pbd.tracking.rest import find_rest
from pbd.tracking.smoothing import smooth_motion
from tests.tracking.hands import largest_angle, middle


def simulated(seed: int, sensor: str | SensorModel = "ideal", turn: float = 60.0) -> Demonstration:
    return simulate(random_task(seed, moves=4, max_turn=np.radians(turn)), sensor, seed, rate_hz=100.0)


def stops_of(demo: Demonstration) -> tuple[Stop, ...]:
    stops = track(demo.recording).stops
    assert len(stops) == 5
    return stops


def true_attitude(demo: Demonstration) -> Attitude:
    assert demo.truth is not None
    return Attitude(demo.truth.wxyz_nav_sensor, np.zeros((len(demo.recording), 3)))


def smoothed(demo: Demonstration, attitude: Attitude) -> tuple[Attitude, Array, Array]:
    """Attitude and acceleration after smoothing, and how far the keyframes are from the truth, (k,) m."""
    assert demo.truth is not None
    recording, stops = demo.recording, stops_of(demo)
    rest = find_rest(recording)
    a_nav = motion_acceleration(recording, attitude, rest.gravity)
    attitude, a_nav = smooth_motion(recording, attitude, a_nav, stops, rest)
    p, _, _ = integrate_path(recording.t, a_nav, stops)
    rows = [middle(stop) for stop in stops]
    errors: Array = np.linalg.norm(p[rows] - demo.truth.p_nav_sensor[rows], axis=1)
    return attitude, a_nav, errors


@pytest.mark.parametrize("seed", range(4))
def test_legs_join_in_the_stops_and_share_from_nothing_to_all(seed: int) -> None:
    demo = simulated(seed, "modern")
    recording, stops, attitude = demo.recording, stops_of(demo), true_attitude(demo)
    rest = find_rest(recording)
    legs = find_legs(recording, attitude, motion_acceleration(recording, attitude, rest.gravity), stops, rest)
    assert len(legs.middles) == len(stops)
    assert all(stop.start <= row < stop.stop for stop, row in zip(stops, legs.middles, strict=True))
    for k, (start, end) in enumerate(pairwise(legs.middles)):
        assert (legs.of_row[start:end] == k).all()
        assert legs.share[start] == pytest.approx(0.0, abs=1e-12)
        assert (np.diff(legs.share[start:end]) >= 0.0).all()
        assert 0.99 < legs.share[end - 1] <= 1.0
        turned = legs.turned[end] - legs.turned[start]
        way = largest_angle(attitude.wxyz_nav_sensor[start], attitude.wxyz_nav_sensor[end])
        assert turned == pytest.approx(way, abs=np.radians(2.0))  # each move turns about one axis
    assert (legs.gyro > 0.0).all()
    assert (legs.vqf > 0.0).all()
    assert (legs.speed > 0.0).all()


@pytest.mark.parametrize("seed", range(4))
def test_smoothing_changes_nothing_of_a_perfect_sensor(seed: int) -> None:
    demo = simulated(seed)
    given_attitude = true_attitude(demo)
    attitude, _, errors = smoothed(demo, given_attitude)
    assert largest_angle(given_attitude.wxyz_nav_sensor, attitude.wxyz_nav_sensor) < np.radians(0.002)
    assert errors.max() < 1e-4


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("tilt_deg", [(0.5, 0.0), (-0.3, 0.6)])
def test_a_constant_tilt_is_found(seed: int, tilt_deg: tuple[float, float]) -> None:
    demo = simulated(seed)
    true = true_attitude(demo)
    tilt = quat_exp((*np.radians(tilt_deg), 0.0))
    tilted = replace(true, wxyz_nav_sensor=quat_multiply(tilt, true.wxyz_nav_sensor))
    attitude, _, errors = smoothed(demo, tilted)
    given_off = largest_angle(true.wxyz_nav_sensor, tilted.wxyz_nav_sensor)
    assert largest_angle(true.wxyz_nav_sensor, attitude.wxyz_nav_sensor) < 0.1 * given_off
    assert errors.max() < 1e-3


@pytest.mark.parametrize("seed", range(4))
def test_an_accelerometers_bias_is_taken_out_at_the_stops_and_between(seed: int) -> None:
    biased = replace(SENSOR_MODELS["ideal"], acc=Triad(bias=0.05))
    demo = simulated(seed, biased)
    true, rest, stops = true_attitude(demo), find_rest(demo.recording), stops_of(demo)
    assert demo.truth is not None
    a_plain = motion_acceleration(demo.recording, true, rest.gravity)
    p_plain, _, _ = integrate_path(demo.recording.t, a_plain, stops)
    rows = [middle(stop) for stop in stops]
    plain = np.linalg.norm(p_plain[rows] - demo.truth.p_nav_sensor[rows], axis=1)
    _, a_nav, errors = smoothed(demo, true)
    shown = [np.abs(a_nav[inside(stop, demo.recording.t)].mean(axis=0)).max() for stop in stops]
    shown_plain = [np.abs(a_plain[inside(stop, demo.recording.t)].mean(axis=0)).max() for stop in stops]
    assert max(shown) < 0.02 * max(shown_plain)
    assert errors.max() < plain.max()
