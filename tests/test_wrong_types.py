"""A name instead of the value it names is a WrongTypeError with a clear message."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import pbd
from pbd.data import Calibration, Recording
from pbd.data.constraints import Place
from pbd.data.covariance import PoseCovariance
from pbd.errors import UsageError, WrongTypeError
from pbd.frozen_arrays import numeric
from pbd.planning import plan_keyframes, source_of
from pbd.pose import Array
from pbd.simulation.simulate import random_task, simulate
from pbd.tracking.keyframes import keyframes_of
from pbd.tracking.online.tracker import LiveTracker

STILL = Recording(np.arange(3) / 100.0, np.zeros((3, 3)))
EMPTY: Any = {}
COVARIANCE = PoseCovariance.chained(np.tile(np.eye(6), (2, 1, 1)))

WRONG: dict[str, Callable[[Any], object]] = {
    "track takes a Recording or a Demonstration, got 'tea'; pbd.load_demo returns one": pbd.track,
    "track takes a Calibration, got 'tea'; pbd.load_calibration returns one": lambda name: pbd.track(
        STILL, calibration=name
    ),
    "track takes a Known, got 'tea'; pbd.data.Known returns one": lambda name: pbd.track(STILL, known=name),
    "fuse takes a Demonstration, got 'tea'; pbd.load_demo returns one": lambda name: pbd.fuse([name]),
    "takes must be a list of demonstrations, got 'tea'": pbd.fuse,
    "plan takes a HandPath, got 'tea'; pbd.track returns one": lambda name: pbd.plan(name, name, name),
    "keyframes_of takes a HandPath, got 'tea'; pbd.track returns one": keyframes_of,
    "source_of takes a Plan, got 'tea'; pbd.planning.plan_path returns one": source_of,
    "keyframes must be a sequence of Keyframe, got 'tea'": lambda name: plan_keyframes(name, name, name),
    "export takes a JointTrajectory, got 'tea'; pbd.plan returns one": lambda name: pbd.export(name, name, "csv", "x"),
    "check_all takes a list of demonstrations: check_all(['tea'])": pbd.check_all,
    "demos must be a list of demonstrations' names, got [3]": lambda _: pbd.check_all([cast(str, 3)]),
    "jobs must be a whole number, got 'tea'": lambda name: pbd.check_all([], jobs=name),
    "t must be an array of numbers, got 'tea'": lambda name: LiveTracker().feed(name, STILL.acc[0], STILL.acc[0]),
    "acc must be three numbers for each t, got None": lambda _: LiveTracker().feed(0.0, cast(Array, None), None),
    "gyr must be three numbers for each t, got 'tea'": lambda name: LiveTracker().feed(0.0, STILL.acc[0], name),
    "mag must be three numbers for each t, got [1.0, 2.0]": lambda _: LiveTracker().feed(
        0, STILL.acc[0], mag=[1.0, 2.0]
    ),
    "poses must be a list of numbers from 0 to 1, got 'tea'": COVARIANCE.joint,
    "poses must be a list of numbers from 0 to 1, got 1": lambda _: COVARIANCE.joint(cast(Any, 1)),
    "poses must be a list of numbers from 0 to 1, got [2]": lambda _: COVARIANCE.joint([2]),
    "seed must be a whole number, 0 or more, got 'tea'": random_task,
    "max_turn must be a number, 0 or more, got 'tea'": lambda name: random_task(1, max_turn=name),
    "move_s must be two numbers, the shortest first, got 'tea'": lambda name: random_task(1, move_s=name),
    "rest_s must be two numbers, the shortest first, got (2.0, 1.0)": lambda _: random_task(1, rest_s=(2.0, 1.0)),
    "task must be a task, or the name of one, got {}": lambda _: simulate(EMPTY),
    "sensor must be a sensor model, or the name of one, got {}": lambda _: simulate("pour", EMPTY),
    "seed must be a whole number, got 'tea'": lambda name: simulate("pour", seed=name),
    "the robot must be a name or a path, got None": lambda _: pbd.load_robot(cast(str, None)),
    "Recording.gyr must be an array of numbers, got 'tea'": lambda name: Recording(STILL.t, STILL.acc, name),
    "Recording.acc must be an array of numbers, got None": lambda _: Recording(STILL.t, cast(Array, None)),
    "Place.t must be a tuple of float, got 'tea'": Place,
    "speed must be a number, got 'tea'": lambda name: pbd.PlanOptions(speed=name),
    "speed must be a number, got None": lambda _: pbd.PlanOptions(speed=cast(float, None)),
    "detour must be True or False, got 'tea'": lambda name: pbd.PlanOptions(detour=name),
    "start must be the joints' numbers, got 'tea'": lambda name: pbd.PlanOptions(start=name),
    "p_tool_payload must be three numbers, got {}": lambda _: pbd.PlanOptions(p_tool_payload=EMPTY),
    "at must be a tuple of ThingPlace(name, (x, y, z), turn_rad), got {'cup': (1, 2, 3)}": lambda _: pbd.PlanOptions(
        at=cast(Any, {"cup": (1, 2, 3)})
    ),
    "at must be a tuple of ThingPlace(name, (x, y, z), turn_rad), got ('tea',)": lambda name: pbd.PlanOptions(
        at=(name,)
    ),
}


@pytest.mark.parametrize("message", WRONG)
def test_a_name_is_refused_and_the_function_that_loads_it_is_named(message: str) -> None:
    with pytest.raises(TypeError) as caught:
        WRONG[message]("tea")
    assert isinstance(caught.value, UsageError)
    assert str(caught.value) == message


@pytest.mark.usefixtures("cached_results")
def test_plan_refuses_a_robots_name_and_a_robot_without_a_dock() -> None:
    plan: Callable[..., object] = pbd.plan
    path = pbd.track(pbd.load_demo("pouring"))
    with pytest.raises(WrongTypeError, match=r"^plan takes a Robot, got 'ur5'; pbd\.load_robot returns one$"):
        plan(path, Calibration("x"), "ur5")
    with pytest.raises(
        WrongTypeError, match=r"^plan takes a Calibration, got None; pbd\.load_calibration returns one$"
    ):
        plan(path, None, pbd.load_robot("ur5"))
    with pytest.raises(WrongTypeError, match=r"^plan takes a PlanOptions, got \{\}; pbd\.PlanOptions returns one$"):
        plan(path, Calibration("x"), pbd.load_robot("ur5"), {})  # an empty dict is not "no options"


@pytest.mark.usefixtures("cached_results")
def test_export_refuses_a_robots_name_and_a_rate_in_quotes(tmp_path: Path) -> None:
    export: Callable[..., object] = pbd.export
    robot, file = pbd.load_robot("panda"), tmp_path / "motion.csv"
    assert robot.dock is not None
    trajectory = pbd.plan(pbd.track(pbd.load_demo("pouring")), robot.dock, robot)
    with pytest.raises(WrongTypeError, match=r"^export takes a Robot, got 'panda'; pbd\.load_robot returns one$"):
        export(trajectory, "panda", "csv", file)
    with pytest.raises(
        WrongTypeError, match=r"^export takes a Source, got 'tea'; pbd\.planning\.source_of returns one$"
    ):
        export(trajectory, robot, "csv", file, source="tea")
    for wrong, message in (
        ({"rate_hz": "500"}, "rate_hz must be a number, got '500'"),
        ({"format_name": 3}, "format_name must be one of csv, npz, "),
        ({"path": None}, "path must be a file's name, got None"),
    ):
        with pytest.raises(WrongTypeError) as caught:
            export(**({"trajectory": trajectory, "robot": robot, "format_name": "csv", "path": file} | wrong))
        assert str(caught.value).startswith(message)
    with pytest.raises(WrongTypeError, match=r"^t must be an array of numbers, got 'tea'$"):
        trajectory.at(cast(float, "tea"))


def test_none_is_no_array() -> None:
    """numpy would make NaN of it."""
    with pytest.raises(WrongTypeError, match="t must be an array of numbers, got None"):
        numeric("t", cast(Any, None))
