from dataclasses import replace

import numpy as np
import pytest

from pbd.arm.ik.starts import reach, sample_joints
from pbd.arm.model import ArmModel, load_model
from pbd.data import Robot
from tests.arm.conftest import changed, random_joints


def test_samples_are_uniform_within_limits_and_the_same_each_time(arm: ArmModel) -> None:
    count = 20_000
    q = sample_joints(arm, count)
    assert q.shape == (count, 7)
    assert ((q >= arm.limits.lower) & (q <= arm.limits.upper)).all()
    np.testing.assert_array_equal(sample_joints(arm, count), q)
    # uniform: the mean of each joint is its middle, to the statistical error
    middle, width = (arm.limits.lower + arm.limits.upper) / 2, arm.limits.upper - arm.limits.lower
    assert (np.abs(q.mean(axis=0) - middle) < 4 * width / np.sqrt(12 * count)).all()


@pytest.mark.parametrize(
    ("bounds", "sampled"),
    [
        ((-1.0, 5.0), (-1.0, 5.0)),
        ((-6.5, 6.5), (-np.pi, np.pi)),
        ((0.0, 7.0), (0.0, 2 * np.pi)),
        ((-9.0, -1.0), (-1 - 2 * np.pi, -1.0)),
    ],
)
def test_a_joint_is_sampled_over_one_turn_within_its_limits(
    odd_robot: Robot, bounds: tuple[float, float], sampled: tuple[float, float]
) -> None:
    lower, upper = odd_robot.limits.lower.copy(), odd_robot.limits.upper.copy()
    lower[2], upper[2] = bounds
    arm = load_model(replace(odd_robot, limits=changed(odd_robot.limits, lower=lower, upper=upper)))
    q = sample_joints(arm, 20_000)
    np.testing.assert_allclose((q[:, 2].min(), q[:, 2].max()), sampled, atol=5e-3)
    np.testing.assert_allclose((q[:, 0].min(), q[:, 0].max()), (-np.pi, np.pi), atol=5e-3)  # endless
    np.testing.assert_allclose((q[:, 1].min(), q[:, 1].max()), (0.0, 0.4), atol=5e-3)  # slides


@pytest.mark.parametrize("which", ["arm", "odd_arm"])
def test_the_farthest_is_farther_than_any_sample_and_no_farther_than_the_arm_is_long(
    which: str, request: pytest.FixtureRequest
) -> None:
    arm: ArmModel = request.getfixturevalue(which)
    longest = reach(arm)
    p, _ = arm.forward_many(random_joints(arm.robot, 20_000, seed=6))
    assert longest > np.hypot(p[:, 0], p[:, 1]).max()
    placements = [arm.model.jointPlacements[i].translation for i in range(2, arm.model.njoints)]
    steps = [np.linalg.norm(step) for step in (*placements, arm.model.frames[arm.tool_id].placement.translation)]
    slides = 0.4 if which == "odd_arm" else 0.0
    assert longest < sum(steps) + slides
