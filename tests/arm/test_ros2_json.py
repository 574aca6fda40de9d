"""The export for ROS 2, interpolated as its controller does."""

import json
import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pbd.data import JointTrajectory, Robot
from pbd.errors import PbdWarning, PlanError
from pbd.files.demo import load_demo
from pbd.files.exporters import export
from pbd.files.exporters.controller_interpolation import limit_shares
from pbd.files.exporters.ros2_json import _apart
from pbd.planning import PlanOptions
from tests.arm.bundled import arm_of, keyframes_of, path_of
from tests.arm.ros2_controller import Controller, refuse, seconds
from tests.arm.straight_moves import time_keyframes
from tests.result_cache import remembering

MOTIONS = [
    ("panda", "pouring", "keyframes"),
    ("xarm7", "paper-test1", "line"),
    ("ur5", "paper-test2", "demo"),
]
"""Straight and along curves."""


@cache
def planned(arm: str, demo: str, path: Any) -> tuple[Robot, JointTrajectory]:
    robot = arm_of(arm).robot
    assert robot.dock is not None
    plan_once = remembering("pbd.planning.plan", "plan_keyframes")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        plan = plan_once(
            keyframes_of(demo), robot.dock, robot, PlanOptions(path=path), path_of(demo), load_demo(demo).grasped
        )
    return robot, plan.trajectory


def goals(robot: Robot, trajectory: JointTrajectory, path: Path, rate_hz: float | None = None) -> dict[str, Any]:
    export(trajectory, robot, "ros2-json", path, rate_hz)
    read = json.loads(path.read_text())
    assert isinstance(read, dict)
    return read


@pytest.mark.parametrize(("arm", "demo", "path"), MOTIONS)
def test_the_controller_moves_the_arm_as_planned_within_every_limit(
    tmp_path: Path, arm: str, demo: str, path: str
) -> None:
    robot, trajectory = planned(arm, demo, path)
    goal, limits = goals(robot, trajectory, tmp_path / "goal.json"), robot.limits
    refuse(goal, robot.joints)
    assert len(goal["points"]) == len(trajectory.knots)
    for accelerations in (True, False):
        controller = Controller(goal, accelerations=accelerations)
        for order, bound in enumerate((limits.velocity, limits.acceleration, limits.jerk), start=1):
            assert (controller.peaks(order) <= bound).all()
        assert_allclose(controller.at(trajectory.t), trajectory.q, atol=1e-7)
        assert_allclose(controller.at(trajectory.keyframe_t), trajectory.keyframe_q, atol=1e-7)


@pytest.mark.parametrize("rate_hz", [20.0, 1000.0])
def test_samples_at_a_rate_add_points_and_change_no_motion(tmp_path: Path, rate_hz: float) -> None:
    robot, trajectory = planned("panda", "paper-test2", "keyframes")
    goal = goals(robot, trajectory, tmp_path / "goal.json", rate_hz)
    refuse(goal, robot.joints)
    t = np.array([seconds(point["time_from_start"]) for point in goal["points"]])
    assert np.diff(t).max() <= 1.26 / rate_hz  # a sample beside a knot is left out
    for accelerations in (True, False):
        controller = Controller(goal, accelerations=accelerations)
        assert (controller.peaks(2) <= robot.limits.acceleration).all()
        assert (controller.peaks(3) <= robot.limits.jerk).all()
        assert_allclose(controller.at(trajectory.t), trajectory.q, atol=1e-7)


@pytest.mark.parametrize("arm", ["panda", "kinova"])
def test_any_move_is_exported_within_the_limits(tmp_path: Path, arm: str) -> None:
    """Also a move of 1e-10 rad, and one without some of its phases."""
    model, rng = arm_of(arm), np.random.default_rng(5)
    for length in (1e-10, 1e-7, 1e-4, 1e-2, 0.3, 0.3, 0.3):
        steps = length * rng.uniform(-1.0, 1.0, (3, len(model.robot.joints)))
        trajectory = time_keyframes(
            model, model.robot.home + steps.cumsum(axis=0), [0.0] * 3, [None] * 3, model.robot.home, speed=0.999
        )
        used = export(trajectory, model.robot, "ros2-json", tmp_path / "goal.json").receiver
        assert max(share.value for rule in used.values() for share in rule) <= 1.0
        assert np.diff(trajectory.knots).min() > 2e-5


def test_the_fingers_are_a_goal_of_their_own(tmp_path: Path) -> None:
    robot, trajectory = planned("panda", "pouring", "keyframes")
    read = goals(robot, trajectory, tmp_path / "goal.json")
    assert robot.gripper is not None
    assert robot.gripper.mimics == ("panda_finger_joint2",)  # ros2_control gives it no command interface
    refuse(read["gripper"], ["panda_finger_joint1"])
    opening = Controller(read["gripper"]).at(trajectory.t) / robot.gripper.open[0]
    assert_allclose(opening, trajectory.gripper[:, None], atol=1e-7)
    assert seconds(read["gripper"]["points"][-1]["time_from_start"]) == pytest.approx(trajectory.duration)
    closes, opens = read["gripper_commands"]
    assert (closes["opening"], opens["opening"]) == (0.0, 1.0)
    assert seconds(closes["time_from_start"]) == pytest.approx(trajectory.gripper_t[1])
    assert seconds(opens["time_from_start"]) == pytest.approx(trajectory.gripper_t[3])


def test_without_fingers_in_the_model_it_says_when_to_grip(tmp_path: Path) -> None:
    robot, trajectory = planned("ur5", "pouring", "keyframes")
    read = goals(robot, trajectory, tmp_path / "goal.json")
    assert read["gripper"] is None
    assert [command["opening"] for command in read["gripper_commands"]] == [0.0, 1.0]


def test_the_check_of_the_gaps_agrees_with_the_controller(tmp_path: Path) -> None:
    """For samples at a rate, which exceed limits between them."""
    robot, trajectory = planned("panda", "paper-test2", "keyframes")
    samples = trajectory.sample(100.0)
    points = [
        {"positions": q, "velocities": qd, "accelerations": qdd, "time_from_start": {"sec": 0, "nanosec": 1e9 * t}}
        for t, q, qd, qdd in zip(samples.t, samples.q, samples.qd, samples.qdd, strict=True)
    ]
    bounds, found = (robot.limits.velocity, robot.limits.acceleration, robot.limits.jerk), []
    for rule in ("cubic", "quintic"):
        controller = Controller({"points": points}, accelerations=rule == "quintic")
        for order, (bound, share) in enumerate(
            zip(bounds, limit_shares(samples, rule, robot.limits), strict=True), start=1
        ):
            peaks = controller.peaks(order, steps=200) / bound
            assert share.value == pytest.approx(peaks.max(), rel=1e-3)
            assert share.joint == np.argmax(peaks)
            found.append(share.value)
    assert max(found) > 1.1


def test_an_export_that_exceeds_a_limit_between_points_is_refused(tmp_path: Path) -> None:
    robot, trajectory = planned("panda", "paper-test2", "keyframes")
    slower = replace(robot, limits=replace(robot.limits, jerk=0.9 * robot.limits.jerk))
    for rate_hz in (None, 100.0):
        with pytest.raises(
            PlanError, match=r"by quintics would reach 1\.06 times .* jerk limit, at .*; give 0.94 times"
        ):
            export(trajectory, slower, "ros2-json", tmp_path / "goal.json", rate_hz)
    assert list(tmp_path.iterdir()) == []


def test_samples_that_exceed_a_limit_between_them_are_warned_of(tmp_path: Path) -> None:
    robot, trajectory = planned("panda", "paper-test2", "keyframes")
    with pytest.warns(PbdWarning, match=r"by cubics would reach 1\.\d+ times panda_joint\d's acceleration limit"):
        export(trajectory, robot, "csv", tmp_path / "motion.csv", 100.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        export(trajectory, robot, "csv", tmp_path / "motion.csv")


@pytest.mark.parametrize("last", [0.2, 0.10000001])
def test_points_closer_than_the_formats_grid_are_left_out_but_not_the_last(last: float) -> None:
    kept = _apart(np.array([0.0, 0.1, 0.100000005, last - 1e-9, last]))
    np.testing.assert_allclose(kept, [0.0, 0.1, 0.2] if last == 0.2 else [0.0, last], rtol=0.0, atol=1e-12)
