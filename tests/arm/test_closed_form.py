"""The closed form finds every way that its arms can be held, and says nothing of other arms."""

from __future__ import annotations

import numpy as np
import pytest

from pbd.arm.ik.branches import find_branches
from pbd.arm.ik.closed_form import closed_form, flipped_elbow
from pbd.arm.ik.seven_joints import APART_RAD, seven_joints
from pbd.arm.model import to_se3
from tests.arm.bundled import arm_of
from tests.arm.conftest import random_joints
from tests.benchmarks.branches import measure


@pytest.mark.parametrize(("name", "ways"), [("ur3", 6.0), ("ur5", 6.0), ("ur10", 6.0), ("kinova", 7.0), ("z1", 1.0)])
def test_every_way_reaches_the_pose_and_the_known_one_is_among_them(name: str, ways: float) -> None:
    arm, count = arm_of(name), 0
    joints = random_joints(arm.robot, 50, seed=11)
    for truth in joints:
        pose = arm.forward(truth)
        found = closed_form(arm, to_se3(pose))
        assert max(max(pose.distance(arm.forward(q))) for q in found) < 1e-4
        off = found - truth
        assert np.abs(off - 2.0 * np.pi * np.round(off / (2.0 * np.pi))).max(axis=1).min() < 1e-6
        count += len(found)
    assert count >= ways * len(joints)


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_every_branch_of_seven_joints_holds_the_pose_and_one_leads_past_the_known_way(name: str) -> None:
    arm = arm_of(name)
    for truth in random_joints(arm.robot, 50, seed=11):
        pose = arm.forward(truth)
        found = [branch for branch in seven_joints(arm, to_se3(pose)) if len(branch) > 1]
        assert all(max(pose.distance(arm.forward(branch[len(branch) // 2]))) < 1e-5 for branch in found)
        off = np.vstack(found) - truth
        assert np.abs(off - 2.0 * np.pi * np.round(off / (2.0 * np.pi))).max(axis=1).min() < 0.3
        steps = np.vstack([np.diff(branch, axis=0) for branch in found])
        assert np.abs(steps - 2.0 * np.pi * np.round(steps / (2.0 * np.pi))).max() <= APART_RAD


@pytest.mark.parametrize("name", ["so100", "so101"])
def test_the_elbow_of_an_arm_of_five_joints_is_tried_on_both_sides(name: str) -> None:
    arm, flips = arm_of(name), 0
    for truth in random_joints(arm.robot, 40, seed=11):
        flipped = flipped_elbow(arm, truth)
        if flipped is not None and (flipped > arm.limits.lower).all() and (flipped < arm.limits.upper).all():
            pose, flips = arm.forward(truth), flips + 1
            assert max(pose.distance(arm.forward(flipped))) < 1e-12
            found = find_branches(arm, pose, arm.robot.home[None], 12)
            for q in (truth, flipped):
                assert np.abs(found - q).max(axis=1).min() < 1e-3
    assert flips >= 3


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_planning_finds_what_a_search_a_hundred_times_longer_finds(name: str) -> None:
    assert measure(arm_of(name), 2)["found_pct"] == 100.0


@pytest.mark.parametrize("name", ["panda", "so101"])
def test_other_arms_are_left_to_descents(name: str) -> None:
    arm = arm_of(name)
    assert not len(closed_form(arm, to_se3(arm.forward(arm.robot.home))))
    assert not seven_joints(arm_of("ur5"), to_se3(arm_of("ur5").forward(arm_of("ur5").robot.home)))
