"""Nav and tool in base: touching frames cancel; the dock gives yaw and position; a tilt gives a warning only."""

import warnings
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from pbd.calibration.dock import dock_at, dock_tilt, nav_in_base, place_in_base, refuse_tilted
from pbd.calibration.tool_poses import KeyframesInBase, pointing_down, tool_poses
from pbd.data import Calibration, Keyframe
from pbd.data.calibration import TOOL_DOWN
from pbd.errors import CalibrationError, PbdWarning
from pbd.pose import Array, Pose, quat_about_z, quat_exp, quat_from_rpy, quat_multiply, quat_rotate

Z = np.array([0.0, 0.0, 1.0])

yaws = st.floats(-np.pi, np.pi)
small = st.floats(-1.0, 1.0)
vectors = st.tuples(small, small, small).map(np.array)
poses = st.builds(lambda p, turn: Pose(p, quat_exp(3.0 * turn)), vectors, vectors)
paths = st.lists(poses, min_size=2, max_size=4)


def keyframes(T_nav_sensor: list[Pose]) -> list[Keyframe]:
    return [Keyframe(float(t), 0.5, pose, np.eye(6)) for t, pose in enumerate(T_nav_sensor)]


def dock(p: Array, wxyz: Array, any_attitude: bool = False) -> Calibration:
    return Calibration("mine", T_base_dock=Pose(p, wxyz), any_attitude=any_attitude)


@pytest.mark.parametrize(("degrees", "told"), [(0.2, False), (0.3, True)])
def test_a_base_may_be_tilted_by_a_quarter_of_a_degree(degrees: float, told: bool) -> None:
    """At a reach of 0.7 m that is 3 mm."""
    tilt = quat_exp(np.radians((0.6 * degrees, 0.8 * degrees, 0.0)))
    with pytest.raises(CalibrationError, match="a dock has no tilt") if told else nullcontext():
        refuse_tilted(Pose(np.zeros(3), quat_multiply(tilt, quat_about_z(1.0))))


# --- nav_in_base ------------------------------------------------------------------------------------------------------


def test_a_registration_is_used_unchanged() -> None:
    T_base_nav = Pose.from_rpy((1.0, 2.0, 3.0), (0.1, 0.2, 0.3))
    assert nav_in_base(Calibration("x", T_base_nav=T_base_nav), quat_exp((1.0, 0.0, 0.0))) is T_base_nav


@settings(max_examples=30)
@given(vectors, yaws, yaws, st.floats(-1.4, 1.4), yaws)
def test_the_declared_heading_becomes_the_measured_one(
    p: Array, declared: float, measured: float, pitch: float, roll: float
) -> None:
    """In any attitude: if only the heading differs from the declared one, the dock's pose is met exactly."""
    calibration = dock(p, quat_from_rpy((roll, pitch, declared)))
    wxyz_nav_sensor = quat_from_rpy((roll, pitch, measured))
    T_base_nav = nav_in_base(calibration, wxyz_nav_sensor)
    T_base_sensor = T_base_nav @ Pose(np.zeros(3), wxyz_nav_sensor)
    assert calibration.T_base_dock is not None
    metres, rad = T_base_sensor.distance(calibration.T_base_dock)
    assert metres == 0.0
    assert rad < 1e-12


@pytest.mark.parametrize("rpy_deg", [(30.0, 0.0, 0.0), (0.0, -20.0, 0.0), (10.0, 10.0, 70.0), (140.0, 0.0, 0.0)])
def test_tilt_gives_a_warning_and_is_never_corrected(rpy_deg: tuple[float, float, float]) -> None:
    """Whatever the sensor's tilt at the dock, a level path in nav is level in base."""
    calibration = dock(np.array([0.4, 0.1, 0.3]), quat_about_z(0.5))
    wxyz_nav_sensor = quat_from_rpy(np.radians(rpy_deg))
    with pytest.warns(PbdWarning, match=r"tilted by .* from the dock of 'mine'; .* correct rpy_deg in \[dock\] and in"):
        T_base_nav = nav_in_base(calibration, wxyz_nav_sensor)
    assert_allclose(quat_rotate(T_base_nav.wxyz, Z), Z, atol=1e-15)
    level = T_base_nav.act([(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-2.0, 3.0, 0.0)])
    assert_allclose(level[:, 2], 0.3, atol=1e-15)


@pytest.mark.parametrize(("tilt_deg", "warned"), [(0.0, False), (4.9, False), (5.1, True), (90.0, True)])
def test_tilt_above_5_degrees_gives_a_warning(tilt_deg: float, warned: bool) -> None:
    """The warning has the tilt, whatever the heading."""
    calibration = dock(np.zeros(3), quat_from_rpy((0.1, 0.2, 0.3)))
    tilted = quat_multiply(quat_exp((np.radians(tilt_deg), 0.0, 0.0)), quat_from_rpy((0.1, 0.2, 0.3)))
    wxyz_nav_sensor = quat_multiply(quat_about_z(2.0), tilted)
    assert calibration.T_base_dock is not None
    assert np.degrees(dock_tilt(calibration.T_base_dock, wxyz_nav_sensor)) == pytest.approx(tilt_deg, abs=1e-9)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        nav_in_base(calibration, wxyz_nav_sensor)
    assert [f"tilted by {tilt_deg:.0f} degrees" in str(warning.message) for warning in caught] == [True] * warned


@settings(max_examples=30)
@given(yaws, yaws)
def test_any_attitude_gives_no_warning_of_tilt(declared: float, measured: float) -> None:
    """In the tests every warning is an error."""
    wxyz_nav_sensor = quat_multiply(quat_about_z(measured), quat_exp((0.7, 0.0, 0.0)))
    T_base_nav = nav_in_base(dock(np.zeros(3), quat_about_z(declared), any_attitude=True), wxyz_nav_sensor)
    metres, rad = T_base_nav.distance(Pose(np.zeros(3), quat_about_z(declared - measured)))
    assert metres == 0.0
    assert rad < 1e-12


# --- tool_poses -------------------------------------------------------------------------------------------------------


@settings(max_examples=30)
@given(paths, poses, poses)
def test_touching_frames_cancel(path: list[Pose], T_base_nav: Pose, T_sensor_tool: Pose) -> None:
    """Homogeneous matrices as the oracle."""
    calibration = Calibration("x", T_base_nav=T_base_nav, T_sensor_tool=T_sensor_tool)
    for T_base_tool, T_nav_sensor in zip(
        tool_poses(KeyframesInBase(keyframes(path), T_base_nav, calibration)), path, strict=True
    ):
        expected = T_base_nav.matrix() @ T_nav_sensor.matrix() @ T_sensor_tool.matrix()
        assert_allclose(T_base_tool.matrix(), expected, atol=1e-13)


def test_a_level_sensor_makes_a_gripper_that_points_down() -> None:
    """By default. Its jaws open along the sensor's x axis, and rolling the hand pours."""
    calibration = Calibration("x", T_base_nav=Pose.identity())
    shown = keyframes([Pose.identity(), Pose.from_rpy((0, 0, 0), (np.pi / 2, 0, 0))])
    level, rolled = tool_poses(KeyframesInBase(shown, Pose.identity(), calibration))
    assert_allclose(level.matrix()[:3, :3], np.diag((1.0, -1.0, -1.0)), atol=1e-15)
    assert_allclose(quat_rotate(rolled.wxyz, Z), (0.0, 1.0, 0.0), atol=1e-15)


def test_a_dock_at_a_keyframe_has_a_sure_tilt() -> None:
    ways = (Pose.identity(), Pose(np.array([0.1, 0.0, 0.0]), quat_about_z(0.2)))
    level = [Keyframe(2.0 * k, 1.0, T_nav_sensor, 1e-4 * np.eye(6)) for k, T_nav_sensor in enumerate(ways)]
    _, cov = dock_at(level, 1, dock(np.zeros(3), quat_about_z(0.0)))
    assert (np.diagonal(cov) > 0.0).tolist() == [True, True, True, False, False, True]


@pytest.mark.parametrize("orientation", ["demo", "fixed"])
@settings(max_examples=30)
@given(path=paths, T_base_nav=poses, T_sensor_tool=poses)
def test_scale_multiplies_only_the_hands_path(
    orientation: str, path: list[Pose], T_base_nav: Pose, T_sensor_tool: Pose
) -> None:
    """Not the dock, the lever from sensor to tool or the rotations. The calibration's own scale counts too."""
    path = [Pose(np.zeros(3), path[0].wxyz), *path[1:]]  # the first rest is nav's origin
    calibration = Calibration("x", T_base_nav=T_base_nav, T_sensor_tool=T_sensor_tool)
    placed = KeyframesInBase(keyframes(path), T_base_nav, calibration, orientation=orientation)
    once = tool_poses(placed)
    twice = tool_poses(replace(placed, calibration=replace(calibration, scale=5.0), scale=0.4))
    assert_allclose(twice[0].matrix(), once[0].matrix(), atol=1e-13)
    for before, after, T_nav_sensor in zip(once, twice, path, strict=True):
        assert_allclose(after.wxyz, before.wxyz, atol=1e-13)
        assert_allclose(after.p - before.p, quat_rotate(T_base_nav.wxyz, T_nav_sensor.p), atol=1e-13)


@settings(max_examples=30)
@given(paths, yaws, vectors)
def test_orientation_fixed(path: list[Pose], yaw: float, lever: Array) -> None:
    """The tool starts as in the demonstration, follows the hand's path and never turns."""
    T_base_nav = Pose(np.array([0.4, 0.0, 0.2]), quat_about_z(yaw))
    calibration = Calibration("x", T_base_nav=T_base_nav, T_sensor_tool=Pose(lever, quat_exp((np.pi, 0, 0))))
    placed = KeyframesInBase(keyframes(path), T_base_nav, calibration)
    demo, fixed = tool_poses(placed), tool_poses(replace(placed, orientation="fixed"))
    assert_allclose(fixed[0].p, demo[0].p, atol=1e-13)
    for T_base_tool, T_nav_sensor in zip(fixed, path, strict=True):
        assert_allclose(quat_rotate(T_base_tool.wxyz, Z), -Z, atol=1e-13)
        assert_allclose(T_base_tool.wxyz, fixed[0].wxyz, atol=0.0)
        carried = quat_rotate(T_base_nav.wxyz, T_nav_sensor.p - path[0].p)
        assert_allclose(T_base_tool.p - fixed[0].p, carried, atol=1e-13)


@settings(max_examples=10)
@given(poses)
def test_pointing_down_is_the_nearest_such_rotation(tool: Pose) -> None:
    def left_over(wxyz: Array) -> float:
        return tool.distance(Pose(tool.p, wxyz))[1]

    down = quat_exp((np.pi, 0.0, 0.0))
    nearest = pointing_down(tool.wxyz)
    assert_allclose(quat_rotate(nearest, Z), -Z, atol=1e-14)
    grid = [left_over(quat_multiply(quat_about_z(yaw), down)) for yaw in np.linspace(-np.pi, np.pi, 61)]
    assert left_over(nearest) <= min(grid) + 1e-7


def test_a_tool_that_points_up_has_no_heading_to_keep() -> None:
    no_mount = Calibration("mine", T_base_nav=Pose.identity(), T_sensor_tool=Pose.identity())
    up = keyframes([Pose.from_rpy((0, 0, 0), (0.4, 0, 0.3))])
    place_in_base(up, no_mount)
    with pytest.raises(CalibrationError, match="the tool points up at the first keyframe, so with z straight down"):
        place_in_base(up, no_mount, orientation="fixed")
    place_in_base(up, replace(no_mount, T_sensor_tool=TOOL_DOWN), orientation="fixed")
    level = Pose(np.zeros(3), quat_exp((0.5 * np.pi, 0.0, 0.0)))
    place_in_base(up, replace(no_mount, T_sensor_tool=level), orientation="fixed")


@pytest.mark.parametrize("any_attitude", [False, True])
def test_an_upside_down_sensor_is_refused_with_its_likely_cause(any_attitude: bool) -> None:
    """With any attitude too: near half a turn of tilt, the nearest yaw is that of the noise."""
    upside_down = dock(np.zeros(3), quat_about_z(0.0), any_attitude)
    with pytest.raises(CalibrationError, match=r"upside down .* if the accelerometer reads -g along the axis"):
        nav_in_base(upside_down, quat_from_rpy((np.pi, 0.0, 0.3)))


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.3, -0.2, 1.0)])
def test_what_is_advised_for_a_sensor_that_is_mounted_upside_down_brings_the_tool_to_the_same_poses(
    turn: tuple[float, float, float],
) -> None:
    """Its axes are the level sensor's, turned by half a turn about x."""
    half_turn = Pose.from_rpy((0, 0, 0), (np.pi, 0, 0))
    level = keyframes([Pose.identity(), Pose.from_rpy((0.1, 0.2, 0.3), turn)])
    turned = keyframes([each.T_nav_sensor @ half_turn for each in level])
    usual = Calibration("usual", T_base_dock=Pose.identity(), T_sensor_tool=TOOL_DOWN)
    advised = Calibration("advised", T_base_dock=half_turn, T_sensor_tool=Pose.identity())
    both = tool_poses(place_in_base(turned, advised)), tool_poses(place_in_base(level, usual))
    for ours, theirs in zip(*both, strict=True):
        assert_allclose(ours.matrix(), theirs.matrix(), atol=1e-12)
