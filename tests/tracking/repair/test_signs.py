"""Specific force with flipped signs: refused if the device's own attitude shows it, else a warning at rest."""

import re
import warnings
from dataclasses import replace
from itertools import permutations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pbd.data import GRAVITY, Demonstration, Recording
from pbd.data.source_columns import Column, SourceColumns
from pbd.errors import PbdWarning, RecordingError
from pbd.files.demo import write_demo
from pbd.files.importers import import_file
from pbd.pipeline import track
from pbd.pose import Array, quat_exp, quat_from_rpy, quat_rotate, quat_to_matrix, quat_to_rpy
from pbd.simulation.calibration_tasks import sides
from pbd.simulation.hand_motion import Waypoint
from pbd.simulation.simulate import SENSOR_MODELS, TASKS, random_task
from pbd.simulation.tasks import Task
from pbd.tracking.repair.axes import Contradiction, Witness, find_axis_error
from pbd.tracking.repair.axis_mappings import AxisMapping
from pbd.tracking.repair.gyro_consistency import (
    _pairs,
    refuse_disagreement,
    refuse_flipped_signs,
    up_in_sensor,
    warn_upside_down,
)
from tests.not_none import not_none
from tests.scenarios import simulate, with_rows

WITH_ATTITUDE = ("os5000", "os5000-nogyro", "wt901", "modern")


@pytest.mark.parametrize(
    ("order", "signs", "causes"),
    [
        ((0, 1, 2), (1, 1, 1), 0),
        ((0, 1, 2), (1, -1, 1), 1),
        ((0, 1, 2), (-1, -1, -1), 1),
        ((1, 0, 2), (1, 1, 1), 1),
        ((1, 2, 0), (1, 1, 1), 2),
        ((1, 0, 2), (1, -1, -1), 3),
    ],
)
def test_the_mistakes_that_explain_a_mapping_are_counted(
    order: tuple[int, ...], signs: tuple[int, ...], causes: int
) -> None:
    assert AxisMapping(order, signs).causes == causes


def turned(recording: Recording, *signs: float) -> Recording:
    return replace(recording, acc=recording.acc * np.array(signs))


@pytest.mark.parametrize("sensor", WITH_ATTITUDE)
@pytest.mark.parametrize("task", ["pour", "pick-and-place-stops", "random"])
def test_the_devices_attitude_tells_all_three(sensor: str, task: str) -> None:
    recording = simulate(random_task(4) if task == "random" else task, sensor, 1).recording
    with pytest.raises(
        RecordingError, match=r"the accelerometer's x, y, z have the wrong sign: .* with --unit acc=-g"
    ) as caught:
        refuse_flipped_signs(turned(recording, -1.0, -1.0, -1.0))
    assert caught.value.fields["axes"] == "xyz"


@pytest.mark.parametrize("sensor", WITH_ATTITUDE)
def test_the_devices_attitude_tells_one_where_the_hand_turns(sensor: str) -> None:
    recording = simulate("pour", sensor, 1).recording
    with pytest.raises(RecordingError, match=r"the accelerometer's z has the wrong sign: .* with --column az=-az$"):
        refuse_flipped_signs(turned(recording, 1.0, 1.0, -1.0))


def test_a_level_axis_is_the_gyros_to_tell_where_there_is_one() -> None:
    """Without a gyro the attitude, which removes gravity, has to agree."""
    recording = turned(simulate(sides(1), "os5000", 1).recording, 1.0, -1.0, 1.0)
    refuse_flipped_signs(recording)
    with pytest.raises(RecordingError, match=r"the accelerometer's y has the wrong sign: .* with --column ay=-ay$"):
        refuse_flipped_signs(replace(recording, gyr=None))


@pytest.mark.parametrize(("acc_deg", "attitude_deg"), [(-4.0, 4.0), (0.0, 40.0)])
def test_a_small_tilt_or_one_that_no_sign_explains_is_no_wrong_sign(acc_deg: float, attitude_deg: float) -> None:
    """If y had the other sign, the first would be none at all."""
    rolls = np.radians((acc_deg, attitude_deg))
    acc, rpy = GRAVITY * up_in_sensor(quat_from_rpy((rolls[0], 0.0, 0.0))), (rolls[1], 0.0, 0.0)
    at_rest = Recording(np.arange(100) / 100.0, np.tile(acc, (100, 1)), device_rpy=np.tile(rpy, (100, 1)))
    refuse_flipped_signs(at_rest)


def test_nothing_is_said_of_less_than_half_a_second() -> None:
    refuse_disagreement(with_rows(simulate("pour", "modern", 0).recording, slice(0, 40)))


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(sorted(SENSOR_MODELS)), st.sampled_from([*TASKS, "random", "wide", "sides"]), st.integers(0, 1000)
)
def test_what_is_right_is_never_refused(sensor: str, task: str, seed: int) -> None:
    made = {"random": random_task(seed), "wide": random_task(seed, max_turn=2.5), "sides": sides(seed)}
    what = made.get(task, task)
    refuse_flipped_signs(simulate(what, sensor, seed).recording)


def test_a_real_recording_is_never_refused(data_folder: Path) -> None:
    """None has the device's own attitude. With the optical one instead, only flipped signs are refused."""
    for file in sorted((data_folder / "broad").glob("*.npz")):
        demo = import_file(file)
        assert demo.truth is not None
        known = np.isfinite(demo.truth.wxyz_nav_sensor).all(axis=1) & np.isfinite(demo.recording.acc).all(axis=1)
        rows = np.flatnonzero(known)
        seen = replace(
            demo.recording,
            t=np.arange(len(rows)) / demo.recording.rate_hz,
            acc=demo.recording.acc[rows],
            gyr=None,
            mag=None,
            device_rpy=quat_to_rpy(demo.truth.wxyz_nav_sensor[rows]),
        )
        refuse_flipped_signs(seen)
        with pytest.raises(RecordingError, match="the accelerometer's x, y, z have the wrong sign"):
            refuse_flipped_signs(turned(seen, -1.0, -1.0, -1.0))


@pytest.mark.parametrize("sensor", ["wt901", "modern", "os5000"])
@pytest.mark.parametrize(
    ("channel", "mended_by"),
    [
        ("acc", "--column ax=ay --column ay=ax"),
        ("acc", "--column ax=-ax"),
        ("gyr", "--column gx=-gx --column gy=-gy --column gz=-gz"),
        ("gyr", "--column gx=gy --column gy=gx"),
        ("mag", "--column mx=my --column my=mx"),
    ],
)
def test_a_hand_that_turns_tells_which_axes_are_wrong(sensor: str, channel: str, mended_by: str) -> None:
    """If it turns about several axes, only the wrong one is named, at once, and never blamed on magnets."""
    recording = simulate(random_task(2, max_turn=1.8, moves=20), sensor, 2).recording
    with pytest.raises(RecordingError) as caught:
        refuse_disagreement(spoilt(replace(recording, device_rpy=None), channel, mended_by))
    assert caught.value.message.endswith(f": import the file with {mended_by}")


@pytest.mark.parametrize("seed", [0, 1])
def test_a_wrong_rate_of_a_file_without_times_is_told_where_it_explains_the_turns_best(seed: int) -> None:
    """At half its rate all turns come out twice as large. A unit that fits by chance was named."""
    columns = tuple(Column(name, name, 1.0, "rad/s", "its name", "its name") for name in ("gx", "gy", "gz"))
    right = replace(simulate("pick-and-place-direct", "modern", seed).recording, mag=None, device_rpy=None)
    right = replace(right, info=replace(right.info, source=SourceColumns(columns)))
    with pytest.raises(
        RecordingError, match=r"the rate is likely wrong, and the true one about (1\.9|2) times as high"
    ):
        refuse_disagreement(replace(right, t=2.0 * right.t))
    refuse_disagreement(right)
    with pytest.raises(RecordingError, match="import the file with --column gx=gy --column gy=gx"):
        refuse_disagreement(spoilt(right, "gyr", "--column gx=gy --column gy=gx"))


def test_a_gyros_bias_hides_no_wrong_axis() -> None:
    """With a bias of 15 degrees/s left in, no reading of the axes would fit."""
    mended_by = "--column gx=gy --column gy=gx"
    recording = replace(simulate(random_task(2, max_turn=1.8, moves=20), "modern", 2).recording, device_rpy=None)
    wrong = spoilt(recording, "gyr", mended_by)
    with pytest.raises(RecordingError, match=f"import the file with {mended_by}$"):
        refuse_disagreement(replace(wrong, gyr=not_none(wrong.gyr) + np.radians((15.0, -15.0, 15.0))))


def test_left_handed_axes_of_both_sensors_are_offered() -> None:
    recording = replace(simulate(random_task(2, max_turn=1.8, moves=20), "ideal", 2).recording, mag=None)
    mirrored = spoilt(spoilt(replace(recording, device_rpy=None), "acc", "--column ay=-ay"), "gyr", "--column gy=-gy")
    with pytest.raises(RecordingError, match=r"left-handed axes \(then --column ay=-ay --column gy=-gy; "):
        refuse_disagreement(mirrored)


@pytest.mark.parametrize(
    ("task", "slower"),
    [*product(["pick-and-place-stops", "pick-and-place-direct"], [0.8, 1.25, 2.0]), ("pick-and-place-stops", 0.5)],
)
def test_times_in_a_wrong_scale_are_refused_where_the_hand_turns(task: str, slower: float) -> None:
    """Twice the time makes every distance four times as long. A turn that a gyro's range cut off is no such case."""
    recording = simulate(task, "wt901", 1).recording
    recording = replace(recording, t=slower * recording.t, mag=None, device_rpy=None)
    if 0.5 < slower < 2.0:
        refuse_disagreement(recording)
        return
    with pytest.raises(RecordingError, match=r"it turns about (\S+) times as far: .*--unit gyr=.*--rate") as caught:
        refuse_disagreement(recording)
    found = not_none(re.search(r"about (\S+) times", caught.value.message))
    assert float(found[1]) == pytest.approx(slower, rel=0.1)


@pytest.mark.parametrize("move_s", [1.0, 1.3])
def test_a_level_hand_that_is_pushed_hard_does_not_tilt(move_s: float) -> None:
    """At the peak of its acceleration the accelerometer is as steady as at rest, and gravity seems to tilt."""
    size = 0.2 * move_s**2
    right = Waypoint((size, 0.5 * size, 0.0), (0.0, 0.0, np.radians(20.0)), move_s, 0.8)
    left = Waypoint((0.0, 1.5 * size, 0.0), (0.0, 0.0, np.radians(-20.0)), move_s, 0.8)
    task = Task("level", (Waypoint(rest_s=2.5), right, left, right, left))
    refuse_disagreement(simulate(task, "modern", 0).recording)


def test_two_wrong_units_are_named_at_once() -> None:
    recording = replace(simulate("pour", "modern", 1).recording, device_rpy=None)
    wrong = replace(recording, acc=recording.acc / GRAVITY, gyr=np.degrees(not_none(recording.gyr)))
    with pytest.raises(RecordingError, match=r"import the file with --unit gyr=deg/s; with --unit acc=g too$"):
        refuse_disagreement(wrong)


def spoilt(recording: Recording, channel: str, mended_by: str) -> Recording:
    """Columns in another order or with other signs, which these options of `pbd import` would correct."""
    values = np.array(getattr(recording, channel))
    wrong = values.copy()
    for ours, sign, its in re.findall(r"--column \w(\w)=(-?)\w(\w)", mended_by):
        wrong[:, "xyz".index(its)] = values[:, "xyz".index(ours)] * (-1.0 if sign else 1.0)
    changed: dict[str, Any] = {channel: wrong}
    return replace(recording, **changed)


@pytest.mark.parametrize("order", list(permutations(range(3))))
@pytest.mark.parametrize("seed", [0, 3])
def test_what_it_says_of_the_gyro_mends_it(order: tuple[int, ...], seed: int, tmp_path: Path) -> None:
    """Axes in any order, with any signs: the named options restore the gyro."""
    recording = simulate(random_task(seed, max_turn=1.8, moves=20), "ideal", seed, rate_hz=50.0).recording
    assert recording.gyr is not None
    signs = np.random.default_rng([seed, *order]).choice((-1.0, 1.0), 3)
    wrong = replace(recording, gyr=recording.gyr[:, list(order)] * signs, device_rpy=None)
    try:
        refuse_disagreement(wrong)
    except RecordingError as error:
        said = error.message
    else:
        assert order == (0, 1, 2)
        assert (signs > 0.0).all()
        return
    columns = dict(re.findall(r"--column (g[xyz])=(-?g[xyz])", said))
    write_demo(Demonstration(wrong), tmp_path / "wrong")
    mended = import_file(tmp_path / "wrong" / "imu.csv", columns)
    np.testing.assert_allclose(not_none(mended.recording.gyr), recording.gyr, atol=1e-6)


def test_of_three_the_gyro_says_nothing() -> None:
    """It rotates the vertical and its opposite alike; so tracking warns, once."""
    recording = replace(simulate("pour", "modern", 0).recording, device_rpy=None)
    flipped = turned(recording, -1.0, -1.0, -1.0)
    refuse_disagreement(flipped)
    with pytest.warns(PbdWarning) as caught:
        track(flipped)
    assert ["lies upside down" in str(warning.message) for warning in caught].count(True) == 1


@given(st.floats(-np.pi, np.pi), st.floats(-1.5, 1.5), st.floats(-np.pi, np.pi))
def test_upside_down_is_said_where_z_points_down(roll: float, pitch: float, yaw: float) -> None:
    recording = Recording(t=np.array((0.0, 0.1)), acc=np.zeros((2, 3)))
    up_sensor = up_in_sensor(quat_from_rpy((roll, pitch, yaw)))
    assert up_sensor[2] == pytest.approx(np.cos(roll) * np.cos(pitch), abs=1e-9)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_upside_down(recording, up_sensor, 0, 2)
    assert [warning.category for warning in caught] == ([PbdWarning] if up_sensor[2] <= -0.9 else [])


@pytest.mark.parametrize(("field_z", "told"), [(40.0, False), (-40.0, True), (-10.0, False)])
def test_a_field_that_points_up_is_a_second_witness(field_z: float, told: bool) -> None:
    """In the northern hemisphere the field points down, along +z of a sensor that is upside down."""
    field = np.array([[20.0, 0.0, field_z]] * 2)
    recording = Recording(t=np.array((0.0, 0.1)), acc=np.zeros((2, 3)), mag=field)
    with pytest.warns(PbdWarning, match="lies upside down") as caught:
        warn_upside_down(recording, np.array([0.0, 0.0, -1.0]), 0, 2)
    assert ("south of the equator" in str(caught[0].message)) == told


def test_steady_moments_more_than_five_seconds_apart_are_no_pair() -> None:
    first, second = _pairs(np.array([0, 240, 600]), 50.0)
    assert (first.tolist(), second.tolist()) == ([0], [1])


def test_a_drones_axes_are_another_way_to_be_upside_down() -> None:
    """ArduPilot's and PX4's x, y, z are forward, right, down: all signs of the accelerometer would mirror them."""
    recording = Recording(t=np.array((0.0, 0.1)), acc=np.zeros((2, 3)), gyr=np.zeros((2, 3)))
    turned = "--column ay=-ay --column az=-az --column gy=-gy --column gz=-gz"
    with pytest.warns(PbdWarning, match=f"forward, right and down, as a drone's, with {turned}$"):
        warn_upside_down(recording, np.array([0.0, 0.0, -1.0]), 0, 2)


def directions(count: int) -> Array:
    """Unit vectors (count, 3) that point anywhere."""
    drawn = np.random.default_rng(0).normal(size=(count, 3))
    return np.asarray(drawn / np.linalg.norm(drawn, axis=1)[:, None])


def found_by_gravity(up: Array, turns: Array, gyro: Array) -> Contradiction | None:
    """What is wrong with a gyro that shows `gyro` (n, 3) rad while the sensor turns by `turns`: `up` tells."""
    witness = Witness("a", up, quat_rotate(quat_exp(turns), up))
    return find_axis_error([witness], lambda factor: quat_to_matrix(quat_exp(factor * gyro)))


@pytest.mark.parametrize(("degrees", "told"), [(5.0, False), (9.0, True)])
def test_a_wrong_sign_is_told_where_gravity_contradicts_it_by_more_than_a_moving_hand(
    degrees: float, told: bool
) -> None:
    """With these turns about z, gravity is 9 or 15 degrees (median) from where the wrong gyro predicts it."""
    tilts = np.random.default_rng(0).uniform(-60.0, 60.0, (20, 2))
    turns = np.radians(np.column_stack((tilts, np.full(20, degrees))))
    found = found_by_gravity(directions(20), turns, turns * (1.0, 1.0, -1.0))
    assert [each.message[:22] for each in (found,) if each] == ["gz has the wrong sign:"] * told


def test_a_gyro_in_another_order_is_not_taken_for_another_unit_where_gravity_did_not_turn() -> None:
    """A hand that only yaws, with gx and gz swapped: in deg/s the gyro would not turn at all, and so would fit."""
    up = np.tile((0.0, 0.0, 1.0), (20, 1))
    gyro = np.radians(np.linspace(30.0, 60.0, 20))[:, None] * (1.0, 0.0, 0.0)
    found = not_none(found_by_gravity(up, np.zeros((20, 3)), gyro))
    assert found.message.startswith("gx, gy, gz are in another order (gravity turns too little to tell), or its values")


def test_a_hand_that_mostly_yaws_shows_by_its_few_tilts_which_axes_are_swapped() -> None:
    """Where gravity stays, any reading fits that turns about it, and any unit in which the gyro hardly turns."""
    rng = np.random.default_rng(0)
    up, angle, heading = np.tile((0.0, 0.0, 1.0), (20, 1)), rng.uniform(0.5, 1.0, 20), rng.uniform(0.0, 6.0, 20)
    tilts = np.arange(20) < 8
    axes = np.column_stack((tilts * np.cos(heading), tilts * np.sin(heading), ~tilts))
    turns = angle[:, None] * axes
    found = not_none(found_by_gravity(up, turns, turns[:, [2, 1, 0]] + 0.01))
    assert found.message.startswith("gx and gz are swapped: import the file with --column gx=gz --column gz=gx")


def test_the_few_larger_turns_of_a_calm_hand_show_what_is_wrong() -> None:
    """Of all turns, by gravity, field or gyro, most are so small that they hardly contradict."""
    calm = simulate(random_task(1, moves=4, max_turn=np.radians(15.0)), "wt901", 1, rate_hz=100.0).recording
    with pytest.raises(RecordingError, match="mx and my are swapped"):
        refuse_disagreement(spoilt(calm, "mag", "--column mx=my --column my=mx"))
    calm = simulate(random_task(2, moves=5, max_turn=np.radians(25.0)), "wt901", 2, rate_hz=100.0).recording
    with pytest.raises(RecordingError, match=r"turns about 2\.9 times as far"):
        refuse_disagreement(replace(calm, gyr=3.0 * not_none(calm.gyr), mag=None, device_rpy=None))


@pytest.mark.parametrize(
    ("per_rad", "advice"), [(180.0 / np.pi, "deg/s"), (180e3 / np.pi, "mdeg/s"), (np.pi / 180.0, "rad/s")]
)
def test_the_unit_of_the_gyro_is_named(per_rad: float, advice: str) -> None:
    turns = np.random.default_rng(0).uniform(-0.8, 0.8, (20, 3))
    found = not_none(found_by_gravity(np.tile((0.0, 0.0, 1.0), (20, 1)), turns, per_rad * turns))
    assert found.message.endswith(f"; import the file with --unit gyr={advice}")


def test_the_unit_that_was_given_is_not_advised() -> None:
    """A walk at half its rate, with --unit gyr=deg/s, was told to give --unit gyr=deg/s."""
    up, turns = np.tile((0.0, 0.0, 1.0), (20, 1)), np.random.default_rng(0).uniform(-0.8, 0.8, (20, 3))
    columns = tuple(Column(f"gyr_{axis}", f"g{axis}", 1.0, "deg/s", "its name", "--unit") for axis in "xyz")
    witness = Witness("a", up, quat_rotate(quat_exp(turns), up))
    by_gyro = np.degrees(turns)
    found = find_axis_error([witness], lambda k: quat_to_matrix(quat_exp(k * by_gyro)), SourceColumns(columns))
    assert found is None or "gyr=deg/s" not in found.message


@pytest.mark.parametrize(("factor", "told"), [(1.4, False), (1.6, True), (1.0 / 1.4, False), (1.0 / 1.6, True)])
def test_a_gyro_that_turns_half_as_far_again_may_have_been_cut_off(factor: float, told: bool) -> None:
    turns = np.random.default_rng(0).uniform(-1.5, 1.5, (20, 3))
    found = found_by_gravity(directions(20), turns, factor * turns)
    assert ["times as far" in each.message for each in (found,) if each] == [True] * told


@pytest.mark.parametrize(("turned", "told"), [(2, False), (3, True)])
def test_of_two_turns_no_unit_is_told(turned: int, told: bool) -> None:
    turns = np.array([[0.5, 0.0, 0.0], [0.0, 0.7, 0.0], [-0.6, 0.4, 0.0]])[:turned]
    found = found_by_gravity(np.tile((0.0, 0.0, 1.0), (turned, 1)), turns, np.degrees(turns))
    assert (found is not None) == told


def test_five_turns_tell_of_one_wrong_sign_with_the_first_pair_of_moments_that_shows_it() -> None:
    turns = np.vstack((np.zeros((2, 3)), np.random.default_rng(1).uniform(-1.0, 1.0, (5, 3))))
    found = not_none(found_by_gravity(directions(7), turns, turns * (-1.0, 1.0, 1.0)))
    assert found.message.startswith("gx has the wrong sign: import the file with --column gx=-gx")
    assert found.pair == 2


def test_an_axis_that_a_third_of_the_turns_is_about_is_not_hidden_by_the_others() -> None:
    turns = 0.5 * np.eye(3)[[0] * 8 + [1] * 16]
    found = not_none(found_by_gravity(np.tile((0.0, 0.0, 1.0), (24, 1)), turns, turns * (-1.0, 1.0, 1.0)))
    assert "gx has the wrong sign: import the file with --column gx=-gx" in found.message


def test_a_bent_field_hides_no_wrong_axis() -> None:
    """The field points anywhere, as beside iron. Gravity alone shows that gx and gy are swapped."""
    rng = np.random.default_rng(0)
    up, field, bent = rng.normal(size=(3, 20, 3))
    up, field, bent = (each / np.linalg.norm(each, axis=1)[:, None] for each in (up, field, bent))
    turns = rng.uniform(-0.8, 0.8, (20, 3))
    witnesses = [Witness("a", up, quat_rotate(quat_exp(turns), up)), Witness("m", field, bent)]
    found = not_none(find_axis_error(witnesses, lambda factor: quat_to_matrix(quat_exp(factor * turns[:, [1, 0, 2]]))))
    assert found.message == "gx and gy are swapped: import the file with --column gx=gy --column gy=gx"


@pytest.mark.parametrize("seed", [1, 49, 55])
def test_a_magnet_beside_the_sensor_is_no_wrong_axis(seed: int) -> None:
    """It is as strong as the Earth's field. The sum then seems to turn by far more than the gyro."""
    calm = simulate(random_task(2, moves=5, max_turn=np.radians(25.0)), "wt901", 2, rate_hz=100.0).recording
    rng = np.random.default_rng(seed)
    way = rng.normal(size=3)
    magnet = rng.uniform(30.0, 60.0) * way / np.linalg.norm(way)
    refuse_disagreement(replace(calm, mag=not_none(calm.mag) + magnet))


@pytest.mark.parametrize("axes", [1, 3])
def test_a_single_remedy_is_doubted_after_turns_about_one_axis(axes: int) -> None:
    """Columns gx and gy are swapped. About x alone, columns that moved in a ring fit as well."""
    rng = np.random.default_rng(1)
    turns = np.radians(rng.uniform(20.0, 60.0, (20, 1))) * (rng.normal(size=(20, 3)) if axes == 3 else (1.0, 0.0, 0.0))
    found = found_by_gravity(directions(20), turns, turns[:, [1, 0, 2]])
    doubt = " (the hand turned too little to be sure)" if axes == 1 else ""
    assert (
        not_none(found).message == f"gx and gy are swapped: import the file with --column gx=gy --column gy=gx{doubt}"
    )
