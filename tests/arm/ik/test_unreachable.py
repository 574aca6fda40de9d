"""The reason why an arm can't reach a pose."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pbd.arm.ik.solver import solve
from pbd.arm.ik.unreachable import Unreached, find_reason, out_of_reach
from pbd.arm.model import ArmModel, load_model
from pbd.data import Robot
from pbd.pose import Array, Pose
from tests.arm.bundled import KINDS, arm_of
from tests.arm.conftest import changed, random_joints

DOWN = (np.pi, 0.0, 0.0)


def hindrance(arm: ArmModel, pose: Pose) -> Unreached:
    result = solve(arm, pose)
    assert not result.reached
    return find_reason(arm, pose, result)


@pytest.mark.parametrize("name", KINDS)
def test_the_distance_beyond_reach_is_that_of_the_nearest_position(name: str) -> None:
    """Oracle: of many samples none is nearer, and the nearest is not much farther."""
    arm = arm_of(name)
    p, _ = arm.forward_many(random_joints(arm.robot, 40_000, seed=1))
    reach = float(np.linalg.norm(p, axis=1).max())
    for direction in np.random.default_rng(2).normal(size=(6, 3)):
        pose = Pose.from_rpy(1.4 * reach * direction / np.linalg.norm(direction), DOWN)
        found = hindrance(arm, pose)
        nearest = np.linalg.norm(p - pose.p, axis=1).min()
        assert nearest - 0.06 * reach < found.beyond_m <= nearest
        assert found.outside
        assert str(found).startswith(f"{100 * found.beyond_m:.1f} cm beyond the arm's reach")


def test_only_the_angle_is_out_of_reach_where_the_tool_gets_in_other_ways_than_the_nearest_pose() -> None:
    """From the joints that come nearest to position and rotation no descent leads to the position alone."""
    arm = arm_of("z1")
    pose = Pose.from_rpy((0.4, 0.0, 0.2), (0.0, 0.0, np.pi))
    assert "reachable, but not with the tool at this angle" in str(hindrance(arm, pose))


@pytest.mark.parametrize(("z", "advice"), [(1.0, " lower"), (-0.7, " higher"), (0.3, "")])
def test_the_way_that_the_dock_must_move(arm: ArmModel, z: float, advice: str) -> None:
    pose = Pose.from_rpy((0.45 if advice else 1.2, 0.0, z), DOWN)
    error = out_of_reach(arm, 0, pose, arm.robot.home)
    assert error.message.endswith(f"; move the dock{advice}")


@pytest.fixture
def stiff(panda: Robot) -> Callable[[float], ArmModel]:
    """Return a panda whose joints move only a little about home."""

    def make(by: float) -> ArmModel:
        limits = changed(panda.limits, lower=panda.home - by, upper=panda.home + by)
        return load_model(replace(panda, limits=limits))

    return make


def test_a_pose_too_near_is_inside_the_reach(stiff: Callable[[float], ArmModel]) -> None:
    arm = stiff(0.3)
    shoulder, home = np.array([0.0, 0.0, 0.333]), arm.forward(arm.robot.home)
    near, far = (Pose(shoulder + share * (home.p - shoulder), home.wxyz) for share in (0.1, 1.9))
    found = hindrance(arm, near)
    assert found.beyond_m > 0.1
    assert not found.outside
    assert "cm from the nearest place that the tool reaches, with panda_joint4 at its lower limit" in str(found)
    assert hindrance(arm, far).outside


@pytest.mark.parametrize("side", ["lower", "upper"])
def test_the_limit_that_stops_it_is_named(stiff: Callable[[float], ArmModel], side: str) -> None:
    """Each joint in turn would have to exceed its limit, and the others can compensate only a little."""
    arm = stiff(0.01)
    for i, joint in enumerate(arm.robot.joints):
        beyond = arm.robot.home + (0.3 if side == "upper" else -0.3) * np.eye(7)[i]
        pose = arm.forward(beyond)
        found = find_reason(arm, pose, solve(arm, pose))
        assert (joint, side) in found.limits


def test_a_named_limit_keeps_the_tool_from_the_pose(arm: ArmModel) -> None:
    """If a joint moves a little beyond its named limit, the tool gets nearer."""
    checked = 0
    for truth in random_joints(arm.robot, 40, seed=4):
        pose = arm.forward(truth) @ Pose.from_rpy((0, 0, 0), (0.0, 1.5, 0.0))
        result = solve(arm, pose)
        if result.reached:
            continue
        found = find_reason(arm, pose, result)
        if found.beyond_m > 0.0:
            continue
        for name, side in found.limits:
            i, step = arm.robot.joints.index(name), 1e-4 if side == "upper" else -1e-4
            moved = result.q + step * np.eye(7)[i]
            assert error(arm, pose, moved) < error(arm, pose, result.q)
            checked += 1
    assert checked > 3


def error(arm: ArmModel, pose: Pose, q: Array) -> float:
    here = arm.forward(q)
    return float(np.hypot(*pose.distance(here)))


@pytest.mark.parametrize(
    ("found", "told"),
    [
        (Unreached(0.123, True, ()), "12.3 cm beyond the arm's reach"),
        (
            Unreached(0.05, False, (("elbow", "lower"),)),
            "5.0 cm from the nearest place that the tool reaches, with elbow at its lower limit",
        ),
        (
            Unreached(0.0, False, (("a", "upper"), ("b", "lower"))),
            "reachable, but not with the tool at this angle (a at its upper limit and b at its lower limit)",
        ),
        (Unreached(0.0, False, ()), "reachable, but not with the tool at this angle"),
    ],
)
def test_the_reason_is_one_phrase(found: Unreached, told: str) -> None:
    assert str(found) == told


@pytest.mark.parametrize("far", [1e9, 1e300])
def test_a_very_distant_pose_has_a_reason_too(arm: ArmModel, far: float) -> None:
    with np.errstate(all="ignore"):
        found = hindrance(arm, Pose.from_rpy((far, 0.0, 0.0), DOWN))
    assert not found.beyond_m < 0.9 * far
