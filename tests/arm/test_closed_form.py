"""The closed form finds every way that its arms can be held, and says nothing of other arms."""

from __future__ import annotations

import numpy as np
import pytest

from pbd.arm.ik.closed_form import closed_form
from pbd.arm.tool import target
from tests.arm.bundled import arm_of
from tests.arm.conftest import random_joints


@pytest.mark.parametrize(("name", "ways"), [("ur3", 6.0), ("ur5", 6.0), ("ur10", 6.0), ("kinova", 7.0), ("z1", 1.0)])
def test_every_way_reaches_the_pose_and_the_known_one_is_among_them(name: str, ways: float) -> None:
    arm, count = arm_of(name), 0
    joints = random_joints(arm.robot, 50, seed=11)
    for truth in joints:
        pose = arm.forward(truth)
        found = closed_form(arm, target(pose))
        assert max(max(pose.distance(arm.forward(q))) for q in found) < 1e-4
        off = found - truth
        assert np.abs(off - 2.0 * np.pi * np.round(off / (2.0 * np.pi))).max(axis=1).min() < 1e-6
        count += len(found)
    assert count >= ways * len(joints)


@pytest.mark.parametrize("name", ["panda", "so101"])
def test_other_arms_are_left_to_descents(name: str) -> None:
    arm = arm_of(name)
    assert not len(closed_form(arm, target(arm.forward(arm.robot.home))))
