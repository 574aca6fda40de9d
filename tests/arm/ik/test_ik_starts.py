"""Starts are near the wanted pose, within limits, and the same each time."""

import numpy as np
import pytest

from pbd.arm.ik.starts import ROTATION_WEIGHT_M, manipulability, relative_manipulability, starts_of
from pbd.arm.model import ArmModel, to_se3
from pbd.pose import Array
from tests.arm.bundled import arm_of
from tests.arm.conftest import random_joints


def features(arm: ArmModel, q: Array) -> Array:
    p, R = arm.forward_many(q)
    return np.hstack((p, ROTATION_WEIGHT_M * R.reshape(-1, 9)))


def test_the_nearest_are_the_nearest_of_all(arm: ArmModel) -> None:
    starts = starts_of(arm)
    assert ((starts.q >= arm.limits.lower) & (starts.q <= arm.limits.upper)).all()
    for truth in random_joints(arm.robot, 20, seed=5):
        wanted = features(arm, truth[None])
        found = np.linalg.norm(features(arm, starts.nearest(to_se3(arm.forward(truth)), 8)) - wanted, axis=1)
        np.testing.assert_allclose(
            found, np.sort(np.linalg.norm(features(arm, starts.q) - wanted, axis=1))[:8], atol=1e-5
        )
        p = arm.forward(truth).p
        off = np.linalg.norm(arm.forward_many(starts.at(p, 8))[0] - p, axis=1)
        np.testing.assert_allclose(off, np.sort(np.linalg.norm(starts.p - p, axis=1))[:8], atol=1e-5)


@pytest.mark.parametrize("name", ["panda", "ur5", "so101"])
def test_manipulability_is_the_product_of_the_singular_values(name: str) -> None:
    arm = arm_of(name)
    some = random_joints(arm.robot, 2000, seed=7)
    J = np.array([arm.jacobian(q) for q in some])
    measured = manipulability(J)
    # For five joints it is the root of a determinant, whose rounding depends on the processor.
    squared = np.linalg.svd(J, compute_uv=False).prod(axis=1) ** 2
    np.testing.assert_allclose(measured**2, squared, rtol=1e-6, atol=1e-16)
    assert (relative_manipulability(arm, some) < 1.0).mean() == pytest.approx(0.25, abs=0.06)
    assert manipulability(arm_of("ur5").jacobian(np.zeros(6))[None])[0] < 1e-9  # straight
