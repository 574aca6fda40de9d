"""The closed forms find all solutions of the arms for which they are made, and none for other arms."""

import numpy as np
import pinocchio as pin
import pytest

from pbd.arm.ik.branches import find_branches
from pbd.arm.ik.closed_form import closed_form, flipped_elbow
from pbd.arm.ik.seven_joints import seven_joints
from pbd.arm.model import load_model, to_se3
from pbd.pose import Pose
from tests.arm.bundled import arm_of
from tests.arm.conftest import random_joints
from tests.benchmarks.branches import measure


@pytest.mark.parametrize(("name", "ways"), [("ur3", 6.0), ("ur5", 6.0), ("ur10", 6.0), ("kinova", 7.0), ("z1", 1.0)])
def test_every_solution_reaches_the_pose_and_the_known_one_is_among_them(name: str, ways: float) -> None:
    """So are ways up to 0.05 rad beyond a limit, from where a descent leads back."""
    arm, count, beyond = arm_of(name), 0, -np.inf
    joints = random_joints(arm.robot, 50, seed=11)
    for truth in joints:
        pose = arm.forward(truth)
        found = closed_form(arm, to_se3(pose))
        assert max(max(pose.distance(arm.forward(q))) for q in found) < 1e-4
        off = found - truth
        assert np.abs(off - 2.0 * np.pi * np.round(off / (2.0 * np.pi))).max(axis=1).min() < 1e-6
        count += len(found)
        beyond = max(beyond, float(-arm.limit_margins(found).min()))
    assert count >= ways * len(joints)
    assert beyond < 0.05
    assert beyond > 0.03 or name.startswith("ur")


@pytest.mark.parametrize("name", ["ur5", "kinova", "panda"])
def test_a_base_may_stand_beside_the_first_axis(name: str) -> None:
    """One arm of each kind; the same arm and poses moved together have the same solutions."""
    arm, moved, shift = arm_of(name), load_model(arm_of(name).robot), np.array([0.1, -0.2, 0.3])
    moved.model.jointPlacements[1].translation += shift
    for truth in random_joints(arm.robot, 10, seed=12):
        pose = arm.forward(truth)
        there = Pose(pose.p + shift, pose.wxyz)
        np.testing.assert_allclose(closed_form(moved, to_se3(there)), closed_form(arm, to_se3(pose)), atol=1e-6)
        branches = [branch for branch in seven_joints(moved, to_se3(there)) if len(branch) > 1]
        assert all(max(there.distance(moved.forward(branch[0]))) < 1e-5 for branch in branches)
        assert bool(branches) == (name == "panda")


@pytest.mark.parametrize(("name", "joint"), [("kinova", 3), ("ur5", 3), ("ur5", 4)])
def test_parallel_axes_may_point_in_opposite_directions(name: str, joint: int) -> None:
    arm, other, half = arm_of(name), load_model(arm_of(name).robot), pin.SE3(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    other.model.jointPlacements[joint] *= half
    other.model.jointPlacements[joint + 1] = half * other.model.jointPlacements[joint + 1]
    for truth in random_joints(arm.robot, 5, seed=13):
        pose = arm.forward(truth)
        found = closed_form(other, to_se3(pose))
        assert len(found)
        assert max(max(pose.distance(other.forward(q))) for q in found) < 1e-4


@pytest.mark.parametrize(("name", "joint"), [("kinova", 3), ("ur5", 4), ("ur5", 6), ("panda", 2), ("panda", 6)])
def test_a_bent_arm_has_no_closed_form_but_is_solved(name: str, joint: int) -> None:
    """Axes that were parallel or met no longer do."""
    bent = load_model(arm_of(name).robot)
    bent.model.jointPlacements[joint] *= pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.0])), np.array([0.01, 0.02, 0.03]))
    truth = bent.robot.home
    pose = bent.forward(truth)
    assert not len(closed_form(bent, to_se3(pose)))
    assert not seven_joints(bent, to_se3(pose))
    assert len(find_branches(bent, pose, truth[None], 41))


def test_an_arm_that_would_have_to_turn_its_last_joint_too_far_has_no_branch() -> None:
    arm, far = arm_of("panda"), np.array([2.0, 0.0, 0.5])
    goals = [to_se3(Pose.from_rpy(far, (np.pi, 0.0, yaw))) for yaw in np.linspace(-np.pi, np.pi, 24)]
    found = [seven_joints(arm, goal) for goal in goals]
    assert [] in found


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_every_branch_of_seven_joints_reaches_the_pose_and_one_passes_the_known_solution(name: str) -> None:
    """A branch is divided where a joint moves by more than 1 rad from one solution to the next, and nowhere else.

    Where a joint moves fast, the angles of the last one are nine times as dense.
    """
    arm, largest, nearly, dense = arm_of(name), 0.0, 0.0, 0
    for truth in random_joints(arm.robot, 50, seed=11):
        pose = arm.forward(truth)
        branches = seven_joints(arm, to_se3(pose))
        found = [branch for branch in branches if len(branch) > 1]
        nearly = max([nearly, *(float(-arm.limit_margins(branch[0]).min()) for branch in branches if len(branch) == 1)])
        assert all(max(pose.distance(arm.forward(branch[len(branch) // 2]))) < 1e-5 for branch in found)
        off = np.vstack(found) - truth
        assert np.abs(off - 2.0 * np.pi * np.round(off / (2.0 * np.pi))).max(axis=1).min() < 0.3
        gaps = np.diff(np.unique(np.concatenate([branch[:, 6] for branch in found]).round(9)))
        dense += np.isclose(gaps, gaps.max() / 9.0, rtol=0.01).sum()
        steps = np.vstack([np.diff(branch, axis=0) for branch in found])
        largest = max(largest, float(np.abs(steps - 2.0 * np.pi * np.round(steps / (2.0 * np.pi))).max()))
    assert 0.6 < largest <= 1.0
    assert 0.15 < nearly < 0.2  # rad beyond a limit, where a short branch may lie
    assert dense > 200


def test_the_elbow_of_an_arm_of_five_joints_is_tried_on_both_sides() -> None:
    arm, flips = arm_of("so101"), 0
    beyond = [
        -arm.limit_margins(q).min(axis=-1)
        for q in (flipped_elbow(arm, q) for q in random_joints(arm.robot, 200, 11))
        if q is not None
    ]
    assert 0.03 < max(beyond) < 0.05
    for truth in random_joints(arm.robot, 40, seed=11):
        flipped = flipped_elbow(arm, truth)
        if flipped is not None and (flipped > arm.limits.lower).all() and (flipped < arm.limits.upper).all():
            pose, flips = arm.forward(truth), flips + 1
            assert max(pose.distance(arm.forward(flipped))) < 1e-12
            found = find_branches(arm, pose, arm.robot.home[None], 12)
            for q in (truth, flipped):
                assert np.abs(found - q).max(axis=1).min() < 1e-3
    assert flips >= 3


def test_planning_finds_what_a_search_a_hundred_times_longer_finds() -> None:
    assert measure(arm_of("panda"), 1)["found_pct"] == 100.0


@pytest.mark.parametrize("name", ["panda", "so101"])
def test_other_arms_have_no_closed_form(name: str) -> None:
    arm = arm_of(name)
    assert not len(closed_form(arm, to_se3(arm.forward(arm.robot.home))))
    assert not seven_joints(arm_of("ur5"), to_se3(arm_of("ur5").forward(arm_of("ur5").robot.home)))
