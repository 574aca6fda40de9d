"""Arms of five joints follow the rule: the position exactly, then the approach axis, then the rotation about it."""

import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import Bounds, NonlinearConstraint, minimize

from pbd.arm.ik.partial_pose import (
    ABOUT_AXIS_WEIGHT,
    TOLERANCE_M,
    PartialPose,
    held_poses,
    is_partial,
    is_redundant,
    measure,
    solve_partial,
)
from pbd.arm.ik.solver import solve
from pbd.arm.model import ArmModel, load_model, to_se3
from pbd.calibration.dock import place_in_base
from pbd.calibration.tool_poses import tool_poses
from pbd.errors import PbdWarning
from pbd.files.robot import read_robot
from pbd.pose import Array, Pose, quat_to_matrix
from tests.arm.bundled import FIVE_JOINTS, NAMES, arm_of, keyframes_of
from tests.arm.conftest import random_joints
from tests.arm.own_robot import own_toml, own_urdf
from tests.arm.straight_moves import solve_path


def turned(pose: Pose, rotation: Array) -> Pose:
    """Rotate a pose about the tool's own axes."""
    return pose @ Pose.exp((0.0, 0.0, 0.0, *rotation))


def test_only_arms_of_fewer_than_six_joints_are_relaxed() -> None:
    assert {name for name in NAMES if is_partial(arm_of(name))} == set(FIVE_JOINTS)


@pytest.mark.parametrize("rounded", [0.0, 2e-4])
def test_an_arm_whose_joints_move_the_tool_alike_is_relaxed_too(tmp_path: Path, rounded: float) -> None:
    """Four of six joints are parallel, but for the URDF's rounding: the tool tips in one plane, as with five joints."""
    axes = ("0 0 1", "0 1 0", f"0 1 {rounded}", f"{-rounded} 1 0", "0 1 0", "1 0 0")
    (tmp_path / "mine.urdf").write_text(own_urdf(axes), encoding="utf-8")
    (tmp_path / "mine.toml").write_text(own_toml(), encoding="utf-8")
    arm, rng = load_model(read_robot(tmp_path / "mine.toml")), np.random.default_rng(4)
    assert is_partial(arm)
    assert not is_redundant(arm)
    for truth in random_joints(arm.robot, 10, seed=5):
        pose = turned(arm.forward(truth), 0.5 * rng.normal(size=3))
        result = solve(arm, pose)
        assert result.reached
        assert np.linalg.norm(arm.forward(result.q).p - pose.p) < TOLERANCE_M


def test_a_full_pose_within_reach_is_met() -> None:
    arm = arm_of("so101")
    for truth in random_joints(arm.robot, 25, seed=1):
        pose = arm.forward(truth)
        result = solve(arm, pose)
        assert result.reached
        assert max(pose.distance(arm.forward(result.q))) < 1e-3
        assert result.position_error_m < 1e-5
        assert solve_partial(arm, to_se3(pose), np.empty((0, 5)))[0].weighted_rad < 1e-3


def test_the_position_is_met_whatever_the_rotation() -> None:
    arm, rng = arm_of("so101"), np.random.default_rng(2)
    for truth in random_joints(arm.robot, 20, seed=3):
        pose = turned(arm.forward(truth), rng.normal(size=3))
        result = solve(arm, pose)
        assert result.reached
        assert np.linalg.norm(arm.forward(result.q).p - pose.p) < TOLERANCE_M
        assert ((result.q >= arm.limits.lower) & (result.q <= arm.limits.upper)).all()


def test_a_roll_that_cant_be_met_leaves_the_approach_axis_alone() -> None:
    """If the goal is rotated about an approach axis that five joints can meet, only the wrist turns."""
    arm = arm_of("so101")
    wrist = len(arm.robot.joints) - 1
    for truth in random_joints(arm.robot, 15, seed=4, margin=0.4):
        truth[wrist] = np.clip(truth[wrist], -1.0, 1.0)
        found = solve_partial(arm, to_se3(turned(arm.forward(truth), np.array([0.0, 0.0, 0.3]))), truth[None])[0]
        assert np.degrees(found.approach_rad) < 0.5
        assert np.degrees(found.about_rad) < 5.0


def test_no_joints_do_better_by_the_rule() -> None:
    """Oracle: scipy's SLSQP on the rule itself, with the position as a constraint, from the solution and around it."""
    arm, rng = arm_of("so101"), np.random.default_rng(5)
    for truth, pose, found in solved(arm, 4, seed=6):
        assert found.reached
        for start in (found.q, truth, *(found.q + 0.3 * rng.normal(size=(3, 5)))):
            assert best_by_slsqp(arm, pose, start) > found.weighted_rad - np.radians(0.2)


def test_no_joints_nearby_do_better_by_a_fiftieth_of_a_degree() -> None:
    """Also where the position leaves hardly any choice of rotation: the weight of the rotation is small enough."""
    arm = arm_of("so101")
    for _, pose, found in solved(arm, 20, seed=8):
        assert best_by_slsqp(arm, pose, found.q) > found.weighted_rad - np.radians(0.02)


def solved(arm: ArmModel, count: int, seed: int) -> Iterator[tuple[Array, Pose, PartialPose]]:
    """Yield joints, the tool's pose there rotated by about 0.3 rad, and the solution for it."""
    rng = np.random.default_rng(seed)
    for truth in random_joints(arm.robot, count, seed, margin=0.3):
        pose = turned(arm.forward(truth), 0.3 * rng.normal(size=3))
        yield truth, pose, solve_partial(arm, to_se3(pose), np.empty((0, 5)))[0]


def best_by_slsqp(arm: ArmModel, pose: Pose, start: Array) -> float:
    wanted = quat_to_matrix(pose.wxyz)

    def off(q: Array) -> float:
        R = arm.forward_many(q[None])[1]
        z, x = (1.0 - float(R[0][:, column] @ wanted[:, column]) for column in (2, 0))
        return z + ABOUT_AXIS_WEIGHT**2 * x

    def place(q: Array) -> Array:
        return np.asarray(10.0 * (arm.forward_many(q[None])[0][0] - pose.p))

    inside = np.clip(start, arm.limits.lower, arm.limits.upper)
    bounds, exactly = Bounds(arm.limits.lower, arm.limits.upper), NonlinearConstraint(place, 0.0, 0.0)
    result = minimize(off, inside, method="SLSQP", bounds=bounds, constraints=exactly, options={"maxiter": 100})
    found = measure(arm, to_se3(pose), result.x)
    return found.weighted_rad if found.position_m < 1e-4 else np.inf


def test_measures_are_the_angles_that_a_pose_was_turned_by() -> None:
    arm = arm_of("so101")
    q = arm.robot.home
    for tilt, roll in ((0.0, 0.4), (0.3, 0.0), (0.2, -0.7), (1.2, 2.0)):
        wanted = turned(turned(arm.forward(q), np.array([0.0, 0.0, roll])), np.array([0.0, tilt, 0.0]))
        found = measure(arm, to_se3(wanted), q)
        assert found.approach_rad == pytest.approx(tilt, abs=1e-9)
        assert found.about_rad == pytest.approx(abs(roll), abs=1e-9)
        assert found.position_m < 1e-15


def test_poses_that_are_held_with_another_rotation_are_warned_of() -> None:
    arm = arm_of("so101")
    q = np.array([arm.robot.home, arm.robot.home])
    here = arm.forward(arm.robot.home)
    wanted = [turned(here, np.array([0.0, np.radians(4.0), 0.0])), turned(here, np.array([0.0, 0.0, 0.5]))]
    with pytest.warns(PbdWarning) as told:
        held, off_rad = held_poses(arm, wanted, q)
    assert [str(warning.message) for warning in told] == [
        "so101 moves its tool in 5 of 6 directions and can't match the hand's orientation: its approach axis is off by"
        " up to 4 degrees, its rotation about the approach axis is off by up to 29 degrees, worst at keyframe 0; use an"
        " arm that moves it in all 6, as most of six joints do, move the dock, or try a smaller --scale"
    ]
    with pytest.warns(PbdWarning, match=r"orientation: its rotation about the approach axis is off by up to 29 deg"):
        held_poses(arm, wanted[1:], q[1:])  # not of an axis that is off by 0 degrees
    np.testing.assert_allclose(off_rad, [[np.radians(4.0), 0.0], [0.0, 0.5]], atol=1e-9)
    assert all(max(pose.distance(here)) < 1e-12 for pose in held)


def test_a_tool_that_is_off_by_half_a_turn_everywhere_is_told_to_be_turned() -> None:
    arm = arm_of("so101")
    q = np.array([arm.robot.home, arm.robot.home])
    for angles, told in (((3.1, 2.0), True), ((3.1, 0.1), False)):
        wanted = [turned(arm.forward(arm.robot.home), np.array([0.0, 0.0, angle])) for angle in angles]
        with pytest.warns(PbdWarning) as warned:
            held_poses(arm, wanted, q)
        assert ("turn T_body_tool by half a turn about its own z" in str(warned[0].message)) == told


def test_small_rotation_errors_give_no_warning_and_six_joints_hold_the_pose() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arm = arm_of("so101")
        wanted = turned(arm.forward(arm.robot.home), np.array([0.0, 0.0, np.radians(4.0)]))
        assert held_poses(arm, [wanted], arm.robot.home[None])[1][0, 1] == pytest.approx(np.radians(4.0))
        arm = arm_of("ur5")
        held, off_rad = held_poses(arm, [wanted], arm.robot.home[None])
        assert held == (wanted,)
        np.testing.assert_array_equal(off_rad, [[0.0, 0.0]])


def test_out_of_reach_is_the_nearest_place() -> None:
    arm = arm_of("so101")
    far = Pose.from_rpy((0.6, 0.1, 0.2), (np.pi, 0.0, 0.0))
    result = solve(arm, far)
    assert not result.reached
    p, _ = arm.forward_many(random_joints(arm.robot, 50_000, seed=7))
    assert result.position_error_m <= np.linalg.norm(p - far.p, axis=1).min()


@pytest.mark.parametrize(("name", "demo"), [("so101", "pouring"), ("so100", "paper-test1")])
def test_five_joints_hold_the_bundled_demonstrations(name: str, demo: str) -> None:
    """What docs/robots.md says of them; tests/bundled_plans.txt has every one."""
    arm, keyframes = arm_of(name), keyframes_of(demo)
    dock = arm.robot.dock
    assert dock is not None
    poses = tool_poses(place_in_base(keyframes, dock))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        q = solve_path(arm, poses, arm.robot.home)
        held, off_rad = held_poses(arm, poses, q)
    approach, about = np.degrees(off_rad).max(axis=0)
    assert approach < (2.0 if demo == "pouring" else 4.0)
    assert about < 0.5
    for pose, at in zip(held, q, strict=True):
        assert max(pose.distance(arm.forward(at))) < TOLERANCE_M
    assert ((q >= arm.limits.lower) & (q <= arm.limits.upper)).all()
