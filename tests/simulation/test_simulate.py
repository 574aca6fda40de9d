"""The simulator as a whole: what a perfect sensor feels agrees with the truth, and turning the world turns nothing."""

from dataclasses import replace
from math import cos, radians, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbd.data import Demonstration, Truth
from pbd.errors import SensorError, UsageError
from pbd.pose import Array, quat_about_z, quat_from_rpy, quat_inverse, quat_log, quat_multiply, quat_rotate
from pbd.simulation.hand_motion import HandMotion, Waypoint
from pbd.simulation.sensor_model import SensorModel
from pbd.simulation.simulate import EARTH, SENSOR_MODELS, TASKS, World, random_task, simulate
from pbd.simulation.tasks import Task
from tests.near import assert_near
from tests.not_none import not_none

seeds = st.integers(0, 2**32 - 1)
UP = np.array([0.0, 0.0, EARTH.gravity])
NO_MAG = SensorModel("no-mag", 100.0, mag=None)


def ideal(task: str | Task, rate_hz: float = 100.0, world: World = EARTH) -> tuple[Array, Array, Array, Truth]:
    demo = simulate(task, "ideal", rate_hz=rate_hz, world=world)
    return demo.recording.acc, not_none(demo.recording.gyr), not_none(demo.recording.mag), not_none(demo.truth)


@given(st.tuples(*3 * [st.floats(-1.5, 1.5)]), st.floats(9.7, 9.9))
def test_at_rest_it_feels_gravity_and_the_field_and_no_rate(rpy: tuple[float, float, float], gravity: float) -> None:
    world = World(gravity, (0.0, 20.0, -43.0))
    acc, gyr, mag, truth = ideal(Task("still", (Waypoint(rest_s=0.2),), start_rpy=rpy), world=world)
    sensor_from_world = quat_inverse(quat_from_rpy(rpy))
    assert_near(acc, np.tile(quat_rotate(sensor_from_world, (0, 0, gravity)), (len(acc), 1)), 1e-9)
    assert_near(mag, np.tile(quat_rotate(sensor_from_world, world.field), (len(mag), 1)), 1e-9)
    assert not gyr.any()
    assert not truth.p_nav_sensor.any()


@pytest.mark.parametrize("rate_hz", [40.0, 97.0, 400.0])
def test_gyro_integrates_to_the_true_attitude(rate_hz: float) -> None:
    """Each move turns about one axis, so the mean rate is the turn: exact but where a sample spans rest and move."""
    for task in (*TASKS.values(), random_task(1), random_task(2)):
        _, gyr, _, truth = ideal(task, rate_hz)
        borders = (np.arange(len(truth.t) + 1) - 0.5) / rate_hz
        q = HandMotion(task.waypoints, task.start_rpy).at(borders).wxyz
        turn = quat_log(quat_multiply(quat_inverse(q[:-1]), q[1:]))
        assert_near(gyr / rate_hz, turn, 1e-9)


@given(seeds)
@settings(max_examples=5)
def test_acceleration_integrates_to_the_true_position(seed: int) -> None:
    acc, _, _, truth = ideal(random_task(seed, moves=2), 1000.0)
    v = np.cumsum((quat_rotate(truth.wxyz_nav_sensor, acc) - UP) / 1000.0, axis=0)  # at the end of each interval
    p = np.cumsum(v[:-1] / 1000.0, axis=0)  # in the middle of the next one
    assert_near(p, truth.p_nav_sensor[1:], 2e-4)


@pytest.mark.parametrize(("name", "rate_hz"), [("pour", 40.0), ("pick-and-place-stops", 73.0)])
def test_samples_are_means_over_the_interval_around_t(name: str, rate_hz: float) -> None:
    acc, gyr, mag, truth = ideal(name, rate_hz)
    task, fine = TASKS[name], 400
    motion = HandMotion(task.waypoints, task.start_rpy)
    offsets = (np.arange(fine) + 0.5) / fine - 0.5
    hand = motion.at((truth.t[:, None] + offsets / rate_hz).ravel())
    sensor_from_world = quat_inverse(hand.wxyz)
    for read, felt in (
        (acc, quat_rotate(sensor_from_world, hand.a + UP)),
        (gyr, hand.w),
        (mag, quat_rotate(sensor_from_world, EARTH.field)),
    ):
        assert_near(read, felt.reshape(len(read), fine, 3).mean(axis=1), 2e-4)


@given(seeds, st.floats(-3.0, 3.0))
@settings(max_examples=5)
def test_turning_hand_and_field_changes_nothing(seed: int, yaw: float) -> None:
    """Nav is defined by gravity and field, so the sensor can't tell, and neither can the truth."""
    task, (x, y, z) = random_task(seed), EARTH.field
    world = World(EARTH.gravity, (cos(yaw) * x - sin(yaw) * y, sin(yaw) * x + cos(yaw) * y, z))
    here, there = ideal(task), ideal(task.rotated(yaw), world=world)
    for a, b in zip(here[:3], there[:3], strict=True):
        assert_near(b, a, 1e-9)
    assert_same_truth(here[3], there[3])


def test_a_device_keeps_its_errors_and_not_its_noise() -> None:
    """At rest the difference of two recordings is noise alone, which averages out."""
    first, second = (simulate("sides", "wt901", seed, device=7).recording.acc[:150] for seed in (1, 2))
    other = simulate("sides", "wt901", 1, device=8).recording.acc[:150]
    assert np.abs(first - second).max() > 0.0
    assert np.abs((first - second).mean(axis=0)).max() < 0.005 < np.abs((first - other).mean(axis=0)).max()


@given(seeds, st.floats(-3.0, 3.0))
@settings(max_examples=5)
def test_turning_the_hand_turns_only_the_field(seed: int, yaw: float) -> None:
    task = random_task(seed)
    here, there = ideal(task), ideal(task.rotated(yaw))
    assert_near(there[0], here[0], 1e-9)
    assert_near(there[1], here[1], 1e-9)
    assert_near(there[3].p_nav_sensor, quat_rotate(quat_about_z(yaw), here[3].p_nav_sensor), 1e-9)


@given(seeds, st.floats(-3.0, 3.0))
@settings(max_examples=5)
def test_without_a_magnetometer_no_heading_is_seen(seed: int, yaw: float) -> None:
    task = random_task(seed)
    here, there = simulate(task, NO_MAG), simulate(task.rotated(yaw), NO_MAG)
    assert here.recording.mag is None
    assert_near(there.recording.acc, here.recording.acc, 1e-9)
    assert_same_truth(not_none(here.truth), not_none(there.truth))


def assert_same_truth(a: Truth, b: Truth) -> None:
    assert_near(b.p_nav_sensor, a.p_nav_sensor, 1e-9)
    turn = quat_log(quat_multiply(quat_inverse(a.wxyz_nav_sensor), b.wxyz_nav_sensor))
    assert_near(turn, 0.0, 1e-7)


@pytest.mark.parametrize(
    ("rpy_deg", "axis"), [((10, 20, 130), 0), ((0, 59, -40), 0), ((0, 61, -40), 1), ((35, -80, 77), 1), ((0, 90, 5), 1)]
)
def test_nav_without_a_magnetometer(rpy_deg: tuple[float, float, float], axis: int) -> None:
    """x of nav is the sensor's x axis laid level, or its y axis where x is within 30 degrees of vertical."""
    roll, pitch, yaw = np.radians(rpy_deg).tolist()
    truth = not_none(simulate(Task("still", (Waypoint(rest_s=0.1),), start_rpy=(roll, pitch, yaw)), NO_MAG).truth)
    ahead = quat_rotate(truth.wxyz_nav_sensor[0], np.eye(3)[axis])
    assert ahead[1] == pytest.approx(0.0, abs=1e-9)
    assert ahead[0] > 0.0
    # and level is level: the sensor's own z stands as it was declared
    up = quat_rotate(quat_inverse(truth.wxyz_nav_sensor[0]), (0.0, 0.0, 1.0))
    assert up == pytest.approx(quat_rotate(quat_inverse(quat_from_rpy((roll, pitch, yaw))), (0.0, 0.0, 1.0)))


def test_nav_with_a_magnetometer_has_the_field_in_its_north() -> None:
    _, _, mag, truth = ideal("pour", world=World(field=(7.0, 18.0, -44.0)))
    mag_nav = quat_rotate(truth.wxyz_nav_sensor[0], mag[0])
    assert mag_nav == pytest.approx([0.0, np.hypot(7.0, 18.0), -44.0], abs=1e-9)


def test_truth_counts_from_the_first_rest() -> None:
    shifted = Task("shifted", (Waypoint((5.0, -3.0, 1.0), rest_s=0.5), Waypoint((5.1, -3.0, 1.0), move_s=1.0)))
    truth = ideal(shifted)[3]
    assert truth.p_nav_sensor[0] == pytest.approx(0.0, abs=0.0)
    assert truth.p_nav_sensor[-1] == pytest.approx([0.1, 0.0, 0.0])


def as_bytes(demo: Demonstration) -> bytes:
    r, truth = demo.recording, demo.truth
    assert truth is not None
    arrays = (r.t, r.acc, r.gyr, r.mag, r.device_rpy, truth.t, truth.p_nav_sensor, truth.wxyz_nav_sensor)
    return b"".join(array.tobytes() for array in arrays if array is not None)


@pytest.mark.parametrize("sensor", SENSOR_MODELS)
def test_same_seed_same_bytes(sensor: str) -> None:
    once, again, other = (as_bytes(simulate("pour", sensor, seed)) for seed in (5, 5, 6))
    assert once == again
    assert (once != other) == (sensor != "ideal")


def test_a_part_less_errs_the_same_in_the_others() -> None:
    gyro, no_gyro = (simulate("pour", name, 3).recording for name in ("os5000", "os5000-nogyro"))
    assert no_gyro.gyr is None
    assert np.array_equal(gyro.acc, no_gyro.acc)
    assert np.array_equal(not_none(gyro.mag), not_none(no_gyro.mag))


@pytest.mark.parametrize("name", TASKS)
def test_demonstration_says_what_it_is(name: str) -> None:
    demo = simulate(name, "wt901", 7)
    assert demo.recording.info.name == name
    assert demo.recording.info.sensor == "simulated wt901"
    assert demo.recording.info.rate_hz == 100.0
    assert demo.notes.startswith("Simulated (sensor model wt901, seed 7). ")
    assert demo.closed == (name == "pour")
    assert demo.grasped is not None
    assert demo.recording.grip == TASKS[name].grip
    assert demo.truth is not None
    assert np.array_equal(demo.truth.t, demo.recording.t)
    assert (demo.truth.wxyz_nav_sensor[:, 0] >= 0.0).all()


@pytest.mark.parametrize("rate_hz", [10.0, 40.0, 286.0, 1000.0])
def test_rate_overrides_the_models_own(rate_hz: float) -> None:
    recording = simulate("pour", "modern", rate_hz=rate_hz).recording
    assert recording.rate_hz == pytest.approx(rate_hz)
    assert recording.info.rate_hz == rate_hz
    assert recording.t[-1] == pytest.approx(TASKS["pour"].duration_s, abs=1.0 / rate_hz)


def test_unknown_names_list_the_valid_ones() -> None:
    with pytest.raises(UsageError, match="no task is called 'tea'; choose one of pick-and-place-stops,"):
        simulate("tea")
    with pytest.raises(UsageError, match=r"no sensor model is called 'nokia'; choose one of os5000, .*ideal"):
        simulate("pour", "nokia")
    with pytest.raises(SensorError, match="negative"):
        simulate("pour", seed=-1)
    with pytest.raises(SensorError, match="give one above 0"):
        simulate("pour", rate_hz=0.0)


def test_own_models_and_tasks_are_taken() -> None:
    model = replace(SENSOR_MODELS["modern"], name="half-blind", gyr=None, attitude=None)
    recording = simulate(random_task(3), model).recording
    assert recording.gyr is None
    assert recording.device_rpy is None
    assert recording.info.sensor == "simulated half-blind"
    assert recording.info.name == "random-3"


def test_heading_of_the_default_is_not_zero() -> None:
    """The device's own yaw is the angle of its x axis from east toward magnetic north."""
    rpy = not_none(simulate("pour", "os5000").recording.device_rpy)
    assert rpy[0] == pytest.approx([0.0, 0.0, radians(30.0)], abs=radians(0.06))
