"""Values that a program builds itself: wrong ones are refused where they are made, and nothing is shared."""

import pickle
import re
import subprocess
import sys
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Barrier
from typing import Any, cast

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import pbd
from pbd.calibration.dock import dock_at
from pbd.calibration.mount import fit_turns
from pbd.calibration.points import fit_points
from pbd.calibration.registration import observe_points
from pbd.calibration.sensor import calibrate_sensor
from pbd.check_demos import DemoCheck
from pbd.data import Calibration, GraspedObject, GripEvent, JointLimits, Keyframe, Obstacle, Recording
from pbd.data.covariance import PoseCovariance
from pbd.errors import (
    CalibrationError,
    PbdError,
    PbdWarning,
    RobotError,
    UsageError,
    WrongTypeError,
    WrongValueError,
    collected_warnings,
    warn,
)
from pbd.lazy import cached_property
from pbd.planning import PlanOptions, plan_keyframes, plan_path
from pbd.pose import Pose

HERE = Pose.identity()
ONES = np.ones(2)
LIMITS = JointLimits(-ONES, ONES, ONES, ONES, ONES, source="")
STILL = Recording(np.arange(300) / 100.0, np.tile((0.0, 0.0, 9.81), (300, 1)), np.zeros((300, 3)))


def at(t: float, x: float = 0.0, dwell_s: float = 0.5, grip: Any = None) -> Keyframe:
    return Keyframe(t, dwell_s, Pose(np.array((x, 0.0, 0.0)), HERE.wxyz), np.zeros((6, 6)), grip)


def box(shape: str = "box", size: Any = (0.1, 0.1, 0.1), where: Any = HERE) -> Obstacle:
    return Obstacle("post", shape, size, where)


WRONG_VALUES: dict[str, Callable[[], object]] = {
    "Obstacle.size must be above 0 and finite, got (0.1, -0.1, 0.1)": lambda: box(size=(0.1, -0.1, 0.1)),
    "Obstacle.size must be above 0 and finite, got (0.1, nan, 0.1)": lambda: box(size=(0.1, np.nan, 0.1)),
    "Obstacle.size has 100 m, beyond any arm's reach; give metres, not cm or mm": lambda: box(size=(100, 1, 1)),
    "Obstacle.size of a sphere must have 1 number, got (0.1, 0.1, 0.1)": lambda: box("sphere"),
    "Obstacle.shape must be one of box, cylinder, sphere, got 'cube'": lambda: box("cube"),
    "GraspedObject.mass must be above 0 and finite, got -1": lambda: GraspedObject("sphere", (0.1,), -1),
    "Calibration.scale must be above 0 and finite, got -1": lambda: Calibration("x", scale=-1),
    "Calibration.scale must be above 0 and finite, got 0": lambda: Calibration("x", scale=0),
    "Calibration.table_height must be finite, got nan": lambda: Calibration("x", table_height=np.nan),
    "Calibration.table_height has -20 m, beyond any arm's reach; give metres, not cm or mm": lambda: Calibration(
        "x", table_height=-20
    ),
    "Calibration.T_base_dock has 500 m, beyond any arm's reach; give metres, not cm or mm": lambda: Calibration(
        "x", Pose(np.array((500.0, 0.0, 0.0)), HERE.wxyz)
    ),
    "JointLimits.velocity must be above 0 and finite, got array([-1., -1.])": lambda: replace(LIMITS, velocity=-ONES),
    "JointLimits.jerk must be above 0 and finite, got array([inf, inf])": lambda: replace(LIMITS, jerk=np.inf * ONES),
    "JointLimits.lower must be below upper, [-1. -1.], got array([-1., -1.])": lambda: replace(LIMITS, upper=-ONES),
    "Keyframe.t must be finite, got nan": lambda: at(np.nan),
    "Keyframe.dwell_s must be 0 or above, s, got -0.5": lambda: at(0.0, dwell_s=-0.5),
    "Keyframe.dwell_s must be finite, got nan": lambda: at(0.0, dwell_s=np.nan),
    "a pose takes a (4, 4) matrix, got one of (3, 3)": lambda: Pose.from_matrix(np.eye(3)),
    "observe_points takes all 3 keyframes of the path, got 2; choose among its result, with .only([1, 2])": lambda: (
        observe_points([at(0.0), at(1.0)], PoseCovariance.chained(np.zeros((3, 6, 6))), np.zeros(3))
    ),
}

WRONG_TYPES: dict[str, Callable[[], object]] = {
    "Obstacle.size must be a tuple of float, got 0.1": lambda: box("sphere", 0.1),
    "Obstacle.T_base_obstacle must be Pose, got (0, 0, 0)": lambda: box(where=(0, 0, 0)),
    "Calibration.T_base_dock must be Pose or None, got (0, 0, 0)": lambda: Calibration("x", cast(Pose, (0, 0, 0))),
    "Calibration.robots must be a tuple of str, got 'panda'": lambda: Calibration("x", robots=cast(Any, "panda")),
    "Calibration.table_height must be a number, got '0'": lambda: Calibration("x", table_height=cast(Any, "0")),
    "Keyframe.t must be a number, got None": lambda: at(cast(float, None)),
    "Keyframe.t must be a number, got array([1.])": lambda: at(cast(float, np.ones(1))),
    "Keyframe.tolerance_rad must be a number, got '1'": lambda: replace(at(0.0), tolerance_rad=cast(float, "1")),
    "the right side of @ must be a Pose (T.act moves points), got array([1., 1.])": lambda: HERE @ cast(Pose, ONES),
    "Keyframe.dwell_s must be a number, got '1 s'": lambda: at(0.0, dwell_s=cast(float, "1 s")),
    "Calibration.scale must be a number, got None": lambda: Calibration("x", scale=cast(float, None)),
    "Keyframe.grip must be bool or None, got 'open'": lambda: at(0.0, grip="open"),
    "GripEvent.closed must be bool, got 'open'": lambda: GripEvent(1.0, cast(bool, "open")),
    "Recording.grip must be a tuple of GripEvent, got [(1.0, True)]": lambda: replace(
        STILL, grip=cast(Any, [(1.0, True)])
    ),
    "Recording.info must be RecordingInfo, got 'tea'": lambda: replace(STILL, info=cast(Any, "tea")),
    "Recording.t must be an array of numbers, got array([0.+1.j])": lambda: replace(STILL, t=cast(Any, np.array([1j]))),
    "recording must be a Recording, got 'tea'": lambda: calibrate_sensor(cast(Recording, "tea")),
    "covariance must be that of a HandPath, got 'tea'": lambda: observe_points([], cast(Any, "tea"), np.zeros(3)),
    "points must be (1, 3) numbers, one row for each touch, got array([[nan, nan, nan]])": lambda: fit_points(
        observe_points([at(0.0)], PoseCovariance.chained(np.zeros((1, 6, 6))), np.zeros(3)), np.full((1, 3), np.nan)
    ),
}

WRONG_OPTIONS: dict[str, Callable[[], object]] = {
    "only must be a tuple of some of gyr, acc, mag, got ['accel']": lambda: calibrate_sensor(STILL, only=["accel"]),
    "only must be a tuple of some of gyr, acc, mag, got 'acc'": lambda: calibrate_sensor(STILL, only="acc"),
    "gravity must be from 9.7 to 9.9 m/s2, got 1": lambda: calibrate_sensor(STILL, gravity=1.0),
    "a turn is about one of x, y, z, -x, -y, -z, got 'w'": lambda: fit_turns([at(0.0), at(1.0)], ["w"]),
    "the keyframe must be from 0 to 0, got 9": lambda: dock_at([at(0.0)], 9, Calibration("x", HERE)),
    "no method 'fast'; known are default, paper": lambda: pbd.track(STILL, method="fast"),
}


@pytest.mark.parametrize("message", WRONG_VALUES)
def test_a_value_that_can_not_be_is_refused_where_it_is_made(message: str) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011 (the message is compared)
        WRONG_VALUES[message]()
    assert isinstance(caught.value, WrongValueError | PbdError)
    assert str(caught.value) == message


@pytest.mark.parametrize("message", WRONG_TYPES)
def test_a_value_of_another_type_is_refused_where_it_is_given(message: str) -> None:
    with pytest.raises(WrongTypeError) as caught:
        WRONG_TYPES[message]()
    assert str(caught.value) == message


@pytest.mark.parametrize("message", WRONG_OPTIONS)
def test_an_unknown_choice_is_refused(message: str) -> None:
    with pytest.raises(UsageError) as caught:
        WRONG_OPTIONS[message]()
    assert str(caught.value) == message


@pytest.mark.parametrize("matrix", [np.diag((1.0, 1.0, -1.0, 1.0)), np.diag((2.0, 2.0, 2.0, 1.0)), 2.0 * np.eye(4)])
def test_a_matrix_that_is_no_rotation_makes_no_pose(matrix: Any) -> None:
    with pytest.raises(WrongValueError, match=r"^the matrix of a pose must have a rotation and a last row of"):
        Pose.from_matrix(matrix)
    rounded = np.round(Pose.exp((1.0, 2.0, 3.0, 0.3, 0.4, 0.5)).matrix(), 3)
    assert Pose.from_matrix(rounded).distance(Pose.exp((1.0, 2.0, 3.0, 0.3, 0.4, 0.5)))[1] < 1e-3


def test_a_masked_reading_is_a_missing_one() -> None:
    acc = np.ma.masked_greater(np.where(np.arange(300)[:, None] == 7, 500.0, STILL.acc), 100.0)
    recording = Recording(STILL.t, acc, STILL.gyr)
    assert np.isnan(recording.acc[7]).all()
    assert np.isfinite(np.delete(recording.acc, 7, axis=0)).all()


def test_a_sensor_is_not_calibrated_with_missing_readings() -> None:
    with pytest.raises(CalibrationError, match=r"^'recording' lacks readings of acc; fill them"):
        calibrate_sensor(replace(STILL, acc=np.where(np.arange(300)[:, None] == 7, np.nan, STILL.acc)))


def test_lists_become_tuples_that_nobody_else_can_change() -> None:
    obstacles, start = [box()], np.zeros(7)
    calibration, options = Calibration("x", obstacles=cast(Any, obstacles)), PlanOptions(start=cast(Any, start))
    obstacles.clear()
    start[0] = 9.0
    assert len(calibration.obstacles) == 1
    assert options == PlanOptions(start=(0.0,) * 7)
    assert hash(options)


@pytest.mark.parametrize("cov", [-np.eye(6), np.triu(np.ones((6, 6))), np.full((6, 6), np.nan)])
def test_what_is_no_covariance_is_refused(cov: Any) -> None:
    with pytest.raises(WrongValueError, match=r"^Keyframe\.cov must be "):
        replace(at(0.0), cov=cov)
    with pytest.raises(WrongValueError, match=r"^Calibration\.cov_base must be "):
        Calibration("x", cov_base=cov)


def test_covariances_are_read_only() -> None:
    covariance = PoseCovariance.chained(np.ones((3, 6, 6)))
    for array in (covariance.of_each, pickle.loads(pickle.dumps(covariance)).of_moves):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_keyframes_are_planned_in_the_order_of_their_times() -> None:
    robot = pbd.load_robot("panda")
    with pytest.raises(WrongValueError, match=r"^a keyframe must be later than the one before \(3 s\), got t = 1 s$"):
        plan_keyframes([at(3.0), at(1.0, 0.1)], cast(Calibration, robot.dock), robot)


def test_limits_above_the_urdfs_are_refused_also_without_a_file() -> None:
    from pbd.arm.model import load_model

    robot = pbd.load_robot("panda")
    in_degrees = replace(robot.limits, velocity=np.degrees(robot.limits.velocity))
    with pytest.raises(
        RobotError, match=r"^panda: the limits give panda_joint1 a velocity of 124\.\d+, but .* 2\.\d+; "
    ):
        load_model(replace(robot, limits=in_degrees))


@pytest.mark.parametrize("rate_hz", [0.0, -5.0, np.nan, np.inf])
def test_a_rate_must_be_above_zero(rate_hz: float) -> None:
    from tests.test_data import trajectory

    motion = trajectory(3, [0.1, 0.2])
    with pytest.raises(UsageError, match=r"^rate_hz must be above 0 and finite, got "):
        motion.sample(rate_hz)
    with pytest.raises(WrongTypeError, match=r"^t must be one instant or a row of them \(n,\), got "):
        motion.at(np.zeros((2, 2)))


def test_threads_do_not_silence_each_others_warnings() -> None:
    """Python's own filters are shared by all threads, so swapping them for a while loses warnings for good."""
    before, shown = list(warnings.filters), warnings.showwarning

    def collect(k: int) -> list[str]:
        with collected_warnings() as outer:
            for _ in range(50):
                with collected_warnings() as inner:
                    warn(f"inside {k}")
                assert inner == [f"inside {k}"]
            warn(f"outside {k}")
        return outer

    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(collect, range(40))) == [[f"outside {k}"] for k in range(40)]
    assert (warnings.filters, warnings.showwarning) == (before, shown)
    with pytest.warns(PbdWarning, match="seen"):
        warn("seen")


def test_each_thread_plans_with_an_arm_of_its_own() -> None:
    """Threads that shared pinocchio's buffers got other motions now and then."""
    from pbd.planning import arm_of

    robot = pbd.load_robot("panda")
    with ThreadPoolExecutor(2) as pool:
        theirs = pool.submit(arm_of, robot).result()
    assert theirs is not arm_of(robot)
    assert arm_of(robot) is arm_of(robot)


def test_threads_do_not_wait_for_each_others_values() -> None:
    """A process forked while a thread held the one lock of functools' property in Python 3.11 never ended."""
    both = Barrier(2, timeout=10.0)

    class Value:
        @cached_property
        def computed(self) -> int:
            return both.wait()

    with ThreadPoolExecutor(2) as pool:
        assert sorted(pool.map(lambda value: value.computed, (Value(), Value()))) == [0, 1]


def test_a_warning_names_the_line_of_the_program_that_called_pbd() -> None:
    noise = 1e-3 * np.random.default_rng(0).standard_normal((300, 3))
    with pytest.warns(PbdWarning, match="upside down") as caught:
        pbd.track(Recording(STILL.t, noise - STILL.acc, noise))
    assert {warning.filename for warning in caught} == {__file__}


@pytest.mark.parametrize("name", ["data.Recording", "errors.PbdError", "planning.plan_path", "pose.Pose"])
def test_modules_are_there_after_import_pbd_alone(name: str) -> None:
    subprocess.run([sys.executable, "-c", f"import pbd; pbd.{name}"], check=True)


@pytest.mark.usefixtures("cached_results")
def test_results_print_in_one_short_line() -> None:
    robot = pbd.load_robot("panda")
    path = pbd.track(pbd.load_demo("pouring"))
    plan = plan_path(path, cast(Calibration, robot.dock), robot)
    assert re.fullmatch(r"<SensorEstimate: gyr bias \(.*\) rad/s, acc bias \(.*\) m/s2, lag .* ms>", repr(path.sensor))
    assert re.fullmatch(r"<Segment: straight, 1 row, .* mm off the line>", repr(plan.segments[1]))
    assert repr(DemoCheck("tea", p_dock_sensor=np.zeros((99, 3)))) == "<DemoCheck 'tea': nothing to remark>"
    assert repr(DemoCheck("tea", why="no samples", findings=("x",))) == "<DemoCheck 'tea': no samples>"


@pytest.mark.usefixtures("cached_results")
def test_a_page_is_written_from_python(tmp_path: Path) -> None:
    from pbd.replay import replay_scene
    from pbd.view.page import write_page

    robot = pbd.load_robot("panda")
    plan = plan_path(pbd.track(pbd.load_demo("pouring")), cast(Calibration, robot.dock), robot)
    write_page(replay_scene(plan), str(tmp_path / "page.html"))
    assert (tmp_path / "page.html").read_text(encoding="utf-8").startswith("<!")
    with pytest.raises(
        WrongTypeError, match=r"^replay_scene takes a Plan, got <JointTrajectory: .*plan_path returns one"
    ):
        replay_scene(cast(Any, plan.trajectory))
    assert_array_equal(pickle.loads(pickle.dumps(plan.trajectory)).q, plan.trajectory.q)
