"""The cost of a configuration, the order of seeds, and the solutions of a pose."""

import numpy as np
import pytest

from pbd.arm.ik import branches
from pbd.arm.ik.branches import _nearest_first, configuration_cost, find_branches
from pbd.arm.ik.levenberg_marquardt import EXACT, Residual
from pbd.arm.ik.partial_pose import measure
from pbd.arm.ladder_building import STARTS_WIDE
from pbd.arm.model import to_se3
from pbd.pose import Pose
from tests.arm.bundled import FIVE_JOINTS, arm_of
from tests.arm.conftest import random_joints

STRAIGHT_ELBOW = np.array([0.0, -1.57, 0.0, -1.57, 1.57, 0.0])


def test_a_joint_within_a_tenth_of_a_radian_of_its_limit_costs() -> None:
    arm = arm_of("panda")
    near = np.array(arm.robot.home)
    near[6] = arm.limits.upper[6] - 0.05
    home, at = configuration_cost(arm, np.stack((arm.robot.home, near)))
    assert at - home == pytest.approx(0.3 * 0.5**2, abs=1e-9)


def test_a_singular_elbow_costs() -> None:
    assert configuration_cost(arm_of("ur5"), STRAIGHT_ELBOW[None]) == pytest.approx(0.3, rel=0.01)


def test_a_whole_turn_is_no_distance() -> None:
    q = STRAIGHT_ELBOW + np.array([[1.0], [2.0 * np.pi - 0.1]]) * np.eye(6)[5]
    assert _nearest_first(arm_of("ur5"), q, STRAIGHT_ELBOW[None]).tolist() == [1, 0]


def test_solutions_are_exact_but_for_rounding() -> None:
    arm = arm_of("panda")
    goal = to_se3(arm.forward(arm.robot.home))
    found = find_branches(arm, arm.forward(arm.robot.home), arm.robot.home[None] + 1e-6, 24)
    assert max(np.linalg.norm(Residual(arm, goal)(q)[0]) for q in found) < EXACT


def test_a_pose_that_no_descent_reaches_is_solved_as_solve_does(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = arm_of("ur5")
    q = random_joints(arm.robot, 1, seed=2)[0]
    goal = to_se3(arm.forward(q))
    monkeypatch.setattr(branches, "_solutions", lambda *_: np.empty((0, 6)))
    found = find_branches(arm, arm.forward(q), arm.robot.home[None], 24)
    assert len(found) == 1
    assert np.linalg.norm(Residual(arm, goal)(found[0])[0]) < 1e-10
    far = Pose(np.array([5.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
    assert find_branches(arm, far, arm.robot.home[None], 24).shape == (0, 6)


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_a_wide_search_covers_the_self_motion_of_a_redundant_arm(name: str) -> None:
    """If an obstacle bars nearby configurations, the free one may be anywhere on the self-motion."""
    arm = arm_of(name)
    lower, upper = np.maximum(arm.limits.lower, -np.pi), np.minimum(arm.limits.upper, np.pi)
    for q in np.random.default_rng(3).uniform(lower, upper, (10, len(lower))):
        found = find_branches(arm, arm.forward(q), np.array([arm.robot.home]), STARTS_WIDE)
        way = np.abs((found - q + np.pi) % (2.0 * np.pi) - np.pi)
        assert way.max(axis=1).min() < 0.3


def test_configurations_along_a_self_motion_are_spaced_by_the_number_of_starts_or_0_6_rad() -> None:
    """Measured from the arm's joints to the next configuration on the branch, in the joint that moves most. The last
    joint is sampled in steps of about 0.05 rad."""
    arm = arm_of("panda")
    for starts, apart_rad in ((12, 0.6), (81, 2.0 * np.pi / 27)):
        following = []
        for q in random_joints(arm.robot, 30, seed=1, margin=0.2):
            way = np.abs(find_branches(arm, arm.forward(q), q[None], starts) - q).max(axis=1)
            following.append(way[way > 0.12].min())
        assert np.median(following) == pytest.approx(apart_rad + 0.02, abs=0.02)


@pytest.mark.parametrize("name", FIVE_JOINTS)
def test_solutions_of_five_joints_differ_by_less_than_a_tenth_of_a_degree(name: str) -> None:
    """By the rule: one degree of the approach axis counts as ten degrees about it."""
    arm = arm_of(name)
    before = random_joints(arm.robot, 6, seed=2)
    for q in before:
        pose = arm.forward(q) @ Pose.exp((0.0, 0.0, 0.0, 0.3, 0.2, 0.1))
        ways = [measure(arm, to_se3(pose), each) for each in find_branches(arm, pose, before[:6], 24)]
        off = np.degrees([np.hypot(way.approach_rad, 0.1 * way.about_rad) for way in ways])
        assert np.ptp(off) < 0.1 + 1e-6
