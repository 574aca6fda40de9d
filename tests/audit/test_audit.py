from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PPoly

from pbd.arm.model import ArmModel
from pbd.audit.audit import audit
from pbd.audit.limits import check_limits, check_samples
from pbd.data import JointTrajectory, Robot
from pbd.errors import PlanError
from pbd.pose import Array, Pose
from tests.arm.conftest import changed, random_joints
from tests.arm.straight_moves import time_keyframes
from tests.audit.motions import changed_sample, spline
from tests.not_none import not_none

GRIPS = (None, True, None, False, None)


def plan(arm: ArmModel, **factors: float) -> tuple[JointTrajectory, list[Pose]]:
    """A motion through five keyframes and its poses; planned with limits multiplied by `factors`, by name."""
    wide = {name: factor * getattr(arm.limits, name) for name, factor in factors.items()}
    stretched = type("Stretched", (), {"robot": arm.robot, "limits": changed(arm.limits, **wide)})()
    q = random_joints(arm.robot, 5, seed=1, margin=0.1)
    trajectory = time_keyframes(stretched, q, [0, 0.2, 0.2, 0.2, 0], GRIPS, arm.robot.home)
    return trajectory, [arm.forward(row) for row in q]


def test_a_sound_trajectory_passes_and_reports_its_shares(arm: ArmModel) -> None:
    trajectory, poses = plan(arm)
    report = audit(trajectory, arm.robot, poses, grips=GRIPS)
    fine = trajectory.sample(5000.0)
    velocity = (np.abs(fine.qd) / arm.limits.velocity).max()
    acceleration = (np.abs(fine.qdd) / arm.limits.acceleration).max()
    jerk = (np.abs(6 * trajectory.coefficients[:, 3]) / arm.limits.jerk).max()
    assert report.velocity == pytest.approx(velocity, abs=1e-6)
    assert report.acceleration == pytest.approx(acceleration, abs=1e-6)
    assert report.jerk == pytest.approx(jerk, rel=1e-12)
    assert report.max_position_error_m < 1e-12
    assert report.max_rotation_error_rad < 1e-12


@pytest.mark.parametrize(("limit", "unit"), [("velocity", "rad/s"), ("acceleration", "rad/s2"), ("jerk", "rad/s3")])
def test_each_limit_is_enforced(arm: ArmModel, limit: str, unit: str) -> None:
    """A motion planned with one limit 0.1 % too wide exceeds that limit and no other."""
    trajectory, poses = plan(arm, **{limit: 1.001})
    with pytest.raises(PlanError) as caught:
        audit(trajectory, arm.robot, poses)
    fields = caught.value.fields
    joint, t, value, bound = fields["joint"], fields["t"], fields["value"], fields["bound"]
    assert isinstance(t, float)
    assert isinstance(value, float)
    assert bound == getattr(arm.limits, limit)[arm.robot.joints.index(str(joint))]
    assert abs(value) == pytest.approx(1.001 * float(str(bound)), rel=1e-9)
    assert caught.value.message == (
        f"audit: {joint} has {limit} {value:.6g} {unit}, beyond its limit of {bound:.6g} {unit}, at {t:.3f} s; no "
        "trajectory was written; please report it with the demonstration and the robot's TOML"
    )
    # The same trajectory passes the limits that it was planned with.
    audit(trajectory, limited(arm, **{limit: 1.001 * getattr(arm.limits, limit)}), poses)


def limited(arm: ArmModel, **arrays: Array) -> Robot:
    return replace(arm.robot, limits=changed(arm.limits, **arrays))


def extremes(values: PPoly, joint: int) -> Array:
    """Oracle: the values at the ends and at scipy's roots of the derivative."""
    one = PPoly(values.c[:, :, joint], values.x)
    roots = one.derivative().roots(discontinuity=False, extrapolate=False)
    return np.asarray(one(np.concatenate((values.x[[0, -1]], roots))))


@pytest.mark.parametrize("seed", range(10))
def test_extremes_inside_the_pieces_are_found(arm: ArmModel, seed: int) -> None:
    trajectory, q = spline(arm, seed)
    poses = [arm.forward(trajectory.keyframe_q[0])]
    velocity = max(np.abs(extremes(q.derivative(), j)).max() / arm.limits.velocity[j] for j in range(7))
    assert audit(trajectory, arm.robot, poses).velocity == pytest.approx(velocity, rel=1e-9)
    with pytest.raises(PlanError, match="has velocity") as caught:
        audit(trajectory, limited(arm, velocity=0.99 * velocity * arm.limits.velocity), poses)
    then = np.abs(q(caught.value.fields["t"], nu=1)) / arm.limits.velocity
    assert then.max() == pytest.approx(velocity, rel=1e-9)
    for joint in range(7):
        highest, lowest = (float(pick(extremes(q, joint))) for pick in (np.max, np.min))
        tight = {"lower": np.where(np.arange(7) == joint, lowest, -10.0), "upper": np.full(7, 10.0)}
        audit(trajectory, limited(arm, **tight), poses)
        tight["lower"] += 1e-5
        with pytest.raises(PlanError, match=f"{arm.robot.joints[joint]} is at") as caught:
            audit(trajectory, limited(arm, **tight), poses)
        assert q(caught.value.fields["t"])[joint] == pytest.approx(lowest, abs=1e-9)
        assert caught.value.fields["value"] == pytest.approx(lowest)
        tight = {"lower": np.full(7, -10.0), "upper": np.where(np.arange(7) == joint, highest - 1e-5, 10.0)}
        with pytest.raises(PlanError, match=f"{arm.robot.joints[joint]} is at"):
            audit(trajectory, limited(arm, **tight), poses)


def altered(trajectory: JointTrajectory, piece: int, order: int, by: float) -> JointTrajectory:
    coefficients = trajectory.coefficients.copy()
    coefficients[piece, order, 3] += by
    return replace(trajectory, coefficients=coefficients)


def shifted(trajectory: JointTrajectory, piece: int, by: float) -> JointTrajectory:
    """The trajectory with all pieces from one on shifted: a jump of the position alone."""
    coefficients = trajectory.coefficients.copy()
    coefficients[piece:, 0, 3] += by
    return replace(trajectory, coefficients=coefficients)


def gripped(trajectory: JointTrajectory, t: Array, opening: Array) -> JointTrajectory:
    return replace(trajectory, gripper_t=t, gripper_opening=opening)


def passed(trajectory: JointTrajectory) -> JointTrajectory:
    """The trajectory with keyframe 0 halfway on the approach."""
    t, q = trajectory.keyframe_t.copy(), trajectory.keyframe_q.copy()
    t[0] *= 0.5
    q[0] = trajectory.at(t[:1]).q
    return replace(trajectory, keyframe_t=t, keyframe_q=q)


def test_a_gripper_that_is_slower_than_the_stay_is_refused(arm: ArmModel) -> None:
    trajectory, poses = plan(arm)
    gripper = not_none(arm.robot.gripper)
    slow = replace(arm.robot, gripper=replace(gripper, stroke_s=gripper.stroke_s + 0.1))
    late = gripped(trajectory, trajectory.gripper_t + 0.1 * np.array([0, 0, 1, 0, 1]), trajectory.gripper_opening)
    with pytest.raises(PlanError, match="no stroke of the gripper at keyframe 1 while the arm stands"):
        audit(late, slow, poses, grips=GRIPS)


Alter = Callable[[JointTrajectory], JointTrajectory]


@pytest.mark.parametrize(
    ("alter", "message"),
    [
        (lambda t: shifted(t, 9, 1e-8), r"panda_joint4 jumps by 1e-08 rad in position at .* s"),
        (lambda t: altered(t, 9, 1, 1e-5), r"panda_joint4 jumps by .* in (position|velocity) at .* s"),
        (lambda t: altered(t, 0, 1, 1e-5), r"panda_joint4 jumps by .* rad.* in .* at .* s"),
        (lambda t: altered(t, -1, 2, 1e-3), r"panda_joint4 jumps by .* rad.* in .* at .* s"),
        (lambda t: altered(t, 4, 3, np.nan), "the trajectory contains a number that is not finite"),
        (lambda t: replace(t, knots=t.knots + 0.1), "the trajectory's segments do not join up from t = 0"),
        (lambda t: replace(t, knots=np.sort(t.knots)[::-1] * 1.0), "the trajectory's segments do not join up"),
        (lambda t: replace(t, knots=np.append(0.0, t.knots[:-1])), "the trajectory's segments do not join up"),
        (lambda t: replace(t, gripper_opening=t.gripper_opening * 1.1), "the gripper's times decrease, or its opening"),
        (lambda t: replace(t, gripper_opening=-0.1 * t.gripper_opening), "the gripper's times decrease, or its"),
        (
            lambda t: replace(t, gripper_t=t.gripper_t[::-1]),
            "the gripper's times decrease, or its opening is outside 0",
        ),
        (lambda t: replace(t, joint_names=("a", *t.joint_names[1:])), r"the trajectory moves \('a', .*the robot's"),
        (
            lambda t: replace(t, keyframe_t=t.keyframe_t[:-1], keyframe_q=t.keyframe_q[:-1]),
            "has 4 keyframes instead of 5",
        ),
        (
            lambda t: replace(t, keyframe_t=t.keyframe_t + 0.05),
            r"keyframe 0 \(.* s\) the joints differ from the planned",
        ),
        (
            lambda t: replace(t, keyframe_q=t.keyframe_q + 1e-8),
            r"keyframe 0 \(.* s\) the joints differ from the planned",
        ),
        (lambda t: replace(t, keyframe_t=t.keyframe_t[::-1]), "the keyframes are not in their order"),
        (lambda t: gripped(t, t.gripper_t, 1.0 - t.gripper_opening), "no stroke of the gripper at keyframe 1"),
        (lambda t: gripped(t, np.zeros(1), np.ones(1)), "no stroke of the gripper at keyframe 1 while"),
        (passed, "keyframe 0 .* the arm does not rest"),
        (lambda t: gripped(t, t.gripper_t + 0.01, t.gripper_opening), "no stroke of the gripper at keyframe 1"),
        (
            lambda t: gripped(t, np.append(t.gripper_t, t.gripper_t[-1] + 0.1), np.append(t.gripper_opening, 0.9)),
            "the gripper moves where it should not",
        ),
        (lambda t: replace(t, keyframe_q=t.keyframe_q * np.nan), r"keyframe 0 \(.* s\) the joints differ from the"),
    ],
)
def test_each_fault_is_found(arm: ArmModel, alter: Alter, message: str) -> None:
    trajectory, poses = plan(arm)
    with pytest.raises(PlanError, match=f"^audit: .*{message}.*; no trajectory was written; please report it"):
        audit(alter(trajectory), arm.robot, poses, grips=GRIPS)


@pytest.mark.parametrize(
    ("twist", "sound"),
    [((0.9e-5, 0, 0, 0, 0, 0), True), ((1.1e-5, 0, 0, 0, 0, 0), False),
     ((0, 0, 0, 0.9e-5, 0, 0), True), ((0, 0, 0, 0, 0, 1.1e-5), False)],
)  # fmt: skip
def test_a_pose_off_by_more_than_its_tolerance_is_refused(arm: ArmModel, twist: tuple[float, ...], sound: bool) -> None:
    trajectory, poses = plan(arm)
    required = [*poses[:3], poses[3] @ Pose.exp(twist), poses[4]]
    if sound:
        report = audit(trajectory, arm.robot, required)
        assert report.max_position_error_m + report.max_rotation_error_rad == pytest.approx(0.9e-5, rel=1e-3)
    else:
        with pytest.raises(PlanError) as caught:
            audit(trajectory, arm.robot, required)
        assert caught.value.fields["keyframe"] == 3
        assert "at keyframe 3 (" in caught.value.message
        assert " rad off its pose; no trajectory was written; " in caught.value.message


def test_samples_that_differ_from_the_pieces_are_found(arm: ArmModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """`JointTrajectory.sample` gives the samples that are exported; the audit catches a fault there too."""
    trajectory, poses = plan(arm)
    changed_sample(monkeypatch)
    with pytest.raises(PlanError, match="panda_joint6 has velocity"):
        audit(trajectory, arm.robot, poses)


@pytest.mark.parametrize("order", ["q", "qd", "qdd"])
@pytest.mark.parametrize(("share", "sound"), [(0.99, True), (1.01, False)])
def test_a_step_between_two_samples_is_held_to_the_limit(arm: ArmModel, order: str, share: float, sound: bool) -> None:
    limits = arm.limits
    still = np.tile(arm.robot.home, (3, 1))
    stepped = dict.fromkeys(("q", "qd", "qdd"), still)
    rate = {"q": limits.velocity, "qd": limits.acceleration, "qdd": limits.jerk}[order][3]
    stepped[order] = still + np.outer((0.0, 0.0, 1.0), 1e-3 * share * rate * np.eye(7)[3])
    samples: Any = SimpleNamespace(t=1e-3 * np.arange(3), joint_names=arm.robot.joints, **stepped)
    with nullcontext() if sound else pytest.raises(PlanError, match=r"panda_joint4 has .* at 0\.001 s"):
        check_samples(samples, limits)


@pytest.mark.parametrize("up", [1.0, -1.0])
def test_a_joint_that_turns_back_at_constant_acceleration_is_seen_at_its_farthest(arm: ArmModel, up: float) -> None:
    """It sets out at 0.2 rad/s and is back after 1 s; between, it was 0.05 rad away."""
    coefficients = np.zeros((1, 4, 7))
    coefficients[0, 1:3, 0] = 0.2 * up, -0.2 * up
    trajectory = JointTrajectory(
        joint_names=arm.robot.joints,
        knots=np.array([0.0, 1.0]),
        coefficients=coefficients,
        gripper_t=np.zeros(1),
        gripper_opening=np.ones(1),
        keyframe_t=np.zeros(1),
        keyframe_q=np.zeros((1, 7)),
    )
    for most, sound in ((0.051, True), (0.049, False)):
        limits = changed(arm.limits, lower=np.full(7, -most), upper=np.full(7, most))
        with (
            nullcontext()
            if sound
            else pytest.raises(PlanError, match=r"panda_joint1 is at -?0\.05 rad, .* at 0\.500 s")
        ):
            check_limits(trajectory, limits)
