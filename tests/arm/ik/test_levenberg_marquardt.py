"""The residual of a descent, its Jacobian, and when a descent ends."""

import numpy as np
import pinocchio as pin
import pytest

from pbd.arm.ik.levenberg_marquardt import MOST_STEPS, PATIENCE, SOLVED, Residual, StopRule, descend, descend_each
from pbd.arm.ik.starts import starts_of
from pbd.arm.model import ArmModel, to_se3
from pbd.data import JointLimits
from tests.arm.bundled import NAMES, arm_of
from tests.arm.conftest import random_joints


@pytest.fixture(params=[*NAMES, "odd"])
def any_arm(request: pytest.FixtureRequest, odd_arm: ArmModel) -> ArmModel:
    return odd_arm if request.param == "odd" else arm_of(request.param)


def test_the_error_leads_from_the_goal_to_the_tool(any_arm: ArmModel) -> None:
    for q, other in zip(random_joints(any_arm.robot, 10, 1), random_joints(any_arm.robot, 10, 2), strict=True):
        goal, here = to_se3(any_arm.forward(other)), to_se3(any_arm.forward(q))
        e, _ = Residual(any_arm, goal)(q)
        np.testing.assert_allclose(here.translation - goal.translation, e[:3], atol=1e-12)
        np.testing.assert_allclose(pin.exp3(e[3:]) @ goal.rotation, here.rotation, atol=1e-12)


def test_the_gradient_is_that_of_half_of_the_square(any_arm: ArmModel) -> None:
    """J lacks log3's own derivative; J^T e doesn't need it."""
    step = 1e-6
    for q, other in zip(random_joints(any_arm.robot, 5, 3), random_joints(any_arm.robot, 5, 4), strict=True):
        goal = to_se3(any_arm.forward(other))
        e, J = Residual(any_arm, goal)(q)
        for joint, shift in enumerate(step * np.eye(len(q))):
            after, before = (np.square(Residual(any_arm, goal)(q + sign * shift)[0]).sum() for sign in (1, -1))
            assert (J.T @ e)[joint] == pytest.approx((after - before) / (4 * step), abs=1e-6)


def test_it_stops_at_the_first_seed_that_arrives(any_arm: ArmModel) -> None:
    for truth in random_joints(any_arm.robot, 20, seed=7):
        goal = to_se3(any_arm.forward(truth))
        seeds = starts_of(any_arm).nearest(goal, 5)
        stopped = descend_each(any_arm, goal, seeds, patience=PATIENCE)
        assert (stopped[1][:-1] >= SOLVED).all()
        every = descend_each(any_arm, goal, seeds, all_seeds=True)
        np.testing.assert_array_equal(stopped[0], every[0][: len(stopped[0])])


@pytest.mark.parametrize(("patience", "reached"), [(PATIENCE, 4.0), (MOST_STEPS, 10.0)])
def test_a_seed_is_given_up_after_so_many_slow_steps(patience: int, reached: float) -> None:
    """From 10 rad away, at 1 rad a step, more than 70 % of the error remains after each of the first steps."""
    ones = np.ones(1)
    limits = JointLimits(-20.0 * ones, 20.0 * ones, ones, ones, ones, "")
    q, _ = descend(lambda q: (q - 10.0, np.eye(1)), limits, np.zeros(1), StopRule(patience))
    np.testing.assert_allclose(q, reached, atol=1e-4)
