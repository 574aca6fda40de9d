from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import least_squares

from pbd.arm.ik.levenberg_marquardt import descend_each
from pbd.arm.ik.partial_pose import TOLERANCE_M, TOLERANCE_RAD
from pbd.arm.ik.solver import ik_result, solve
from pbd.arm.model import ArmModel, to_se3
from pbd.pose import Array, Pose
from tests.arm.bundled import FIVE_JOINTS, NAMES, arm_of
from tests.arm.conftest import random_joints


def assert_reaches(arm: ArmModel, oracle: Callable[[Array], Any], pose: Pose, q: Array) -> None:
    assert (q >= arm.limits.lower).all()
    assert (q <= arm.limits.upper).all()
    off = to_se3(pose).actInv(oracle(q))
    assert np.linalg.norm(off.translation) <= TOLERANCE_M
    assert np.linalg.norm(pin.log3(off.rotation)) <= TOLERANCE_RAD


def test_every_reachable_pose_is_reached(arm: ArmModel, oracle: Callable[[Array], Any]) -> None:
    for truth in random_joints(arm.robot, 150, seed=6):
        pose = arm.forward(truth)
        result = solve(arm, pose)
        assert result.reached
        assert_reaches(arm, oracle, pose, result.q)


@pytest.mark.parametrize("name", [name for name in NAMES if name not in (*FIVE_JOINTS, "panda")])
def test_every_arm_reaches_its_own_poses(name: str) -> None:
    arm = arm_of(name)
    for truth in random_joints(arm.robot, 100, seed=9):
        pose = arm.forward(truth)
        q = solve(arm, pose).q
        assert_reaches(arm, lambda q, arm=arm: to_se3(arm.forward(q)), pose, q)  # type: ignore[misc]


def test_poses_at_the_joint_limits_are_reached(arm: ArmModel, oracle: Callable[[Array], Any]) -> None:
    """Three random joints at a limit: a solver that only clips gets stuck there."""
    rng = np.random.default_rng(7)
    for truth in random_joints(arm.robot, 100, seed=8):
        for joint in rng.choice(7, size=3, replace=False):
            truth[joint] = (arm.limits.lower, arm.limits.upper)[rng.integers(2)][joint]
        pose = arm.forward(truth)
        result = solve(arm, pose, arm.robot.home)
        assert result.reached
        assert_reaches(arm, oracle, pose, result.q)


@pytest.mark.parametrize(
    "truth",
    [
        [1.5505, 1.3985, -1.7147, -0.4737, -0.0215, 2.3304, -0.2202],
        [-0.6216, 1.2783, -1.5063, -0.4657, 0.0227, 0.2844, -1.7564],
        [-2.7457, 1.4552, 0.0233, -0.4664, 2.8394, 0.0795, 2.0947],
    ],
)
def test_poses_that_are_approached_slowly_are_reached(arm: ArmModel, truth: list[float]) -> None:
    """The slowest of 60,000 random poses, near the edge of the reach."""
    assert solve(arm, arm.forward(np.array(truth))).reached


def test_odd_joints_are_solved_too(odd_arm: ArmModel) -> None:
    """An arm of four joints reaches its own poses, position and rotation."""
    for truth in random_joints(odd_arm.robot, 50, seed=9):
        result = solve(odd_arm, odd_arm.forward(truth), odd_arm.robot.home)
        assert result.reached
        assert result.rotation_error_rad < TOLERANCE_RAD


def test_a_near_seed_gives_a_near_solution(arm: ArmModel) -> None:
    rng = np.random.default_rng(10)
    for truth in random_joints(arm.robot, 50, seed=11, margin=0.2):
        seed = truth + rng.uniform(-0.02, 0.02, 7)
        result = solve(arm, arm.forward(truth), seed)
        assert result.reached
        assert np.abs(result.q - seed).max() < 0.3


def test_a_solution_is_its_own_solution(arm: ArmModel) -> None:
    q = arm.robot.home
    found, squares = descend_each(arm, to_se3(arm.forward(q)), q[None])
    np.testing.assert_array_equal(found, q[None])
    assert squares[0] < 1e-24


def test_the_same_question_gets_the_same_answer(arm: ArmModel) -> None:
    pose = arm.forward(random_joints(arm.robot, 1, seed=12)[0])
    far = arm.limits.upper
    np.testing.assert_array_equal(solve(arm, pose, far).q, solve(arm, pose, far).q)


@pytest.mark.parametrize(
    "pose",
    [
        Pose.from_rpy((1.2, 0.1, 0.4), (np.pi, 0, 0)),  # beyond its reach
        Pose.from_rpy((0.05, 0.0, 0.3), (np.pi, 0, 0)),  # inside its own column
        Pose.from_rpy((0.75, 0.0, 0.5), (0, -np.pi / 2, 0)),  # near enough, but pointing back at itself
    ],
)
def test_out_of_reach_gives_the_nearest_pose(arm: ArmModel, pose: Pose) -> None:
    result = solve(arm, pose, arm.robot.home)
    assert not result.reached
    here = pose.distance(arm.forward(result.q))
    np.testing.assert_allclose((result.position_error_m, result.rotation_error_rad), here, atol=1e-12)

    # Oracle: scipy's bounded least squares, from the solution and from another start, gets no nearer.
    def error(q: Array) -> Array:
        at, wanted = to_se3(arm.forward(q)), to_se3(pose)
        return np.concatenate((at.translation - wanted.translation, pin.log3(at.rotation @ wanted.rotation.T)))

    starts = np.vstack((result.q, random_joints(arm.robot, 1, seed=13, margin=0.05)))
    inside = np.clip(starts, arm.limits.lower + 1e-9, arm.limits.upper - 1e-9)
    least = min(
        least_squares(error, q, bounds=(arm.limits.lower, arm.limits.upper), max_nfev=200).cost * 2 for q in inside
    )
    assert error(result.q) @ error(result.q) <= 1.001 * least

    # It is a minimum: no joint that is free to move brings the tool nearer.
    for joint in range(7):
        for step in (-1e-3, 1e-3):
            q = result.q + step * np.eye(7)[joint]
            if arm.limits.lower[joint] <= q[joint] <= arm.limits.upper[joint]:
                assert np.linalg.norm(error(q)) > np.linalg.norm(error(result.q)) - 1e-6


def test_reach_means_both_tolerances(arm: ArmModel) -> None:
    q = arm.robot.home
    here = arm.forward(q)
    for twist, reached in (
        ((0.9e-5, 0, 0, 0, 0, 0), True),
        ((1.1e-5, 0, 0, 0, 0, 0), False),
        ((0, 0, 0, 0, 0.9e-5, 0), True),
        ((0, 0, 0, 0, 1.1e-5, 0), False),
    ):
        assert ik_result(arm, to_se3(here @ Pose.exp(twist)), q).reached is reached
