import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from pbd.arm.ik.solver import solve
from pbd.arm.model import ArmModel, load_model, to_se3
from pbd.audit.arm import AuditArm
from pbd.data import Gripper, JointLimits, MimicJoint, Robot
from pbd.errors import RobotError
from pbd.pose import Array, Pose, quat_to_matrix
from tests.arm.conftest import random_joints


def test_forward_agrees_with_the_whole_urdf(arm: ArmModel, oracle: Callable[[Array], Any]) -> None:
    for q in random_joints(arm.robot, 100, seed=1):
        np.testing.assert_allclose(arm.forward(q).matrix(), oracle(q).homogeneous, atol=1e-14)


@pytest.mark.parametrize("which", ["arm", "odd_arm"])
def test_many_poses_agree_with_one(which: str, request: pytest.FixtureRequest) -> None:
    arm: ArmModel = request.getfixturevalue(which)
    q = random_joints(arm.robot, 50, seed=2)
    p, R = arm.forward_many(q)
    for i, pose in enumerate(map(arm.forward, q)):
        np.testing.assert_allclose(p[i], pose.p, atol=1e-14)
        np.testing.assert_allclose(R[i], quat_to_matrix(pose.wxyz), atol=1e-14)


@pytest.mark.parametrize("which", ["arm", "odd_arm"])
def test_jacobian_is_the_derivative_of_forward(which: str, request: pytest.FixtureRequest) -> None:
    arm: ArmModel = request.getfixturevalue(which)
    step = 1e-6
    for q in random_joints(arm.robot, 20, seed=3):
        here, J = arm.forward(q), arm.jacobian(q)
        for joint in range(len(q)):
            shift = np.zeros(len(q))
            shift[joint] = step
            central = (here.inverse() @ arm.forward(q + shift)).log() - (here.inverse() @ arm.forward(q - shift)).log()
            np.testing.assert_allclose(J[:, joint], central / (2 * step), atol=1e-9)


def test_a_base_that_is_not_the_root(odd_arm: ArmModel) -> None:
    model = odd_arm.full
    data = model.createData()
    q = np.array([0.4, 0.1, -0.3, 1.2])
    pin.framesForwardKinematics(model, data, odd_arm.configurations(np.append(q, 1.0)))
    foot, hand = (data.oMf[model.getFrameId(name)] for name in ("foot", "hand"))
    expected = foot.inverse() * hand * to_se3(odd_arm.robot.T_body_tool)
    np.testing.assert_allclose(odd_arm.forward(q).matrix(), expected.homogeneous, atol=1e-14)


def test_a_follower_moves_with_its_leader_in_the_planner_and_in_the_audit(odd_robot: Robot) -> None:
    """The whole URDF's forward kinematics, with the flagpole's angle worked out by hand, is the oracle."""
    robot = replace(odd_robot, mimic_joints=(MimicJoint("flagpole", "swing", -0.5, 0.1),))
    planner, audit, x = load_model(robot), AuditArm(robot), np.array([0.4, 0.1, -0.3, 1.2, 1.0])
    model = pin.buildModelFromUrdf(str(robot.urdf))
    q = pin.neutral(model)
    q[model.joints[model.getJointId("flagpole")].idx_q] = 0.1 - 0.5 * 1.2
    data, flag = model.createData(), model.getJointId("flagpole")
    pin.framesForwardKinematics(model, data, q)
    expected = data.oMf[model.getFrameId("foot")].inverse() * data.oMi[flag]
    pin.forwardKinematics(planner.full, data, planner.configurations(x))
    np.testing.assert_allclose(data.oMi[flag].homogeneous, expected.homogeneous, atol=1e-14)
    by_audit = audit.T_universe_base.inverse() * audit.joint_poses(x)[flag]
    np.testing.assert_allclose(by_audit.homogeneous, expected.homogeneous, atol=1e-14)


def test_limits_without_effort_and_velocity_are_read_by_the_planner_and_the_audit(
    odd_robot: Robot, tmp_path: Path
) -> None:
    """urdfdom takes them for required."""
    urdf = tmp_path / "bare.urdf"
    urdf.write_text(re.sub(' (effort|velocity)="1"', "", odd_robot.urdf.read_text()))
    robot, x = replace(odd_robot, urdf=urdf), np.array([0.4, 0.1, -0.3, 1.2, 1.0])
    by_planner, by_audit = load_model(robot).forward(x[:-1]), AuditArm(robot).tool_pose(x)
    assert max(by_planner.distance(by_audit)) < 1e-12


def test_an_endless_joint_is_one_angle(odd_arm: ArmModel) -> None:
    q = np.array([0.4, 0.1, -0.3, 1.2])
    turned = q + np.array([2 * np.pi, 0, 0, 0])
    np.testing.assert_allclose(odd_arm.forward(turned).matrix(), odd_arm.forward(q).matrix(), atol=1e-14)
    assert odd_arm.full.nq == 6  # the angle's cosine and sine, three joints of the arm, the flagpole
    np.testing.assert_array_equal(odd_arm.turns, [1, 0, 1, 1])


SHARED_NAMES = """<?xml version="1.0"?>
<robot name="twins">
  <link name="foot"/> <link name="turn"/> <link name="hand"/> <link name="finger"/>
  <joint name="turn" type="continuous">
    <parent link="foot"/> <child link="turn"/> <axis xyz="0 0 1"/> <limit effort="1" velocity="1"/>
  </joint>
  <joint name="swing" type="revolute">
    <parent link="turn"/> <child link="hand"/> <origin xyz="0.3 0 0.1"/> <axis xyz="0 1 0"/>
    <limit effort="1" lower="-2" upper="2" velocity="1"/>
  </joint>
  <joint name="hand" type="revolute">
    <parent link="hand"/> <child link="finger"/> <origin xyz="0.1 0 0"/> <axis xyz="0 0 1"/>
    <limit effort="1" lower="0" upper="1" velocity="1"/>
  </joint>
</robot>
"""


def test_joints_and_bodies_may_share_names(odd_robot: Robot, tmp_path: Path) -> None:
    """In so100 a locked joint does, in z1 a fixed one; pinocchio accepts neither as it is."""
    urdf = tmp_path / "twins.urdf"
    urdf.write_text(SHARED_NAMES, encoding="utf-8")
    one = np.ones(2)
    robot = replace(
        odd_robot,
        urdf=urdf,
        joints=("turn", "swing"),
        home=np.zeros(2),
        limits=JointLimits(-one, one, one, one, one, "a test"),
        gripper=Gripper(("hand",), np.array([0.8]), np.array([0.2]), 0.5),
    )
    arm = load_model(robot)
    assert arm.full.names[3] == "hand"  # the full model keeps the name
    np.testing.assert_allclose(arm.configurations(np.array([np.pi / 2, 0.1, 0.5])), [0, 1, 0.1, 0.5], atol=1e-15)
    data = arm.full.createData()
    q = np.array([0.7, -0.4])
    pin.framesForwardKinematics(arm.full, data, arm.configurations(np.append(q, 0.0)))
    hand = data.oMf[arm.full.getFrameId("hand", pin.FrameType.BODY)] * to_se3(robot.T_body_tool)
    np.testing.assert_allclose(arm.forward(q).matrix(), hand.homogeneous, atol=1e-14)


@pytest.mark.parametrize(("kind", "neutral"), [("floating", [0, 0, 0, 0, 0, 0, 1]), ("planar", [0, 0, 1, 0])])
def test_what_floats_beside_the_arm_stays_neutral(
    odd_robot: Robot, tmp_path: Path, kind: str, neutral: list[float]
) -> None:
    """Its configuration used to be whatever was in memory."""
    text = odd_robot.urdf.read_text(encoding="utf-8")
    kite = f'<link name="kite"/><joint name="kite" type="{kind}"><parent link="hand"/><child link="kite"/></joint>'
    urdf = tmp_path / "kite.urdf"
    urdf.write_text(text.replace("</robot>", f"{kite}</robot>"), encoding="utf-8")
    arm = load_model(replace(odd_robot, urdf=urdf))
    joint = arm.full.joints[arm.full.getJointId("kite")]
    x = np.append(random_joints(odd_robot, 1, seed=4)[0], 0.5)
    for _ in range(3):
        np.full(arm.full.nq, 7.7)  # the next array of this size gets its memory
        np.testing.assert_array_equal(arm.configurations(x)[joint.idx_q : joint.idx_q + joint.nq], neutral)


def test_full_configuration_opens_the_gripper_by_its_share(arm: ArmModel) -> None:
    q = random_joints(arm.robot, 1, seed=4)[0]
    np.testing.assert_array_equal(arm.configurations(np.append(q, 0.25)), [*q, 0.01, 0.01])


def test_loading_reads_no_mesh(panda: Robot, tmp_path: Path) -> None:
    """A URDF without its meshes can be loaded, so planning does not wait for meshes."""
    lonely = tmp_path / "panda.urdf"
    lonely.write_bytes(panda.urdf.read_bytes())
    arm = load_model(replace(panda, urdf=lonely, package_dirs=()))
    assert arm.forward(panda.home).p[0] > 0.2


def test_errors_are_one_line_and_list_the_names(odd_robot: Robot, tmp_path: Path) -> None:
    urdf = odd_robot.urdf
    cases = (
        (
            replace(odd_robot, body="hnad"),
            f"odd: {urdf} has no body 'hnad'; choose one of room, foot, flag, turret, carriage, forearm, hand",
        ),
        (
            replace(odd_robot, joints=("pan", "lift", "elbow", "swing")),
            f"odd: {urdf} has no joint 'elbow'; choose one of flagpole, pan, lift, wrist, swing",
        ),
        (
            replace(odd_robot, base="carriage"),
            "odd: base 'carriage' moves with joint lift; choose a link that is fixed",
        ),
        (
            replace(odd_robot, joints=("lift", "pan", "wrist", "swing")),
            f"odd: joints must be in the order of {urdf}; list them as pan, lift, wrist, swing",
        ),
    )
    for robot, message in cases:
        with pytest.raises(RobotError) as caught:
            load_model(robot)
        assert caught.value.message == message


@pytest.mark.parametrize("text", ["", "no robot at all", "<robot name='x'><link name='a'/><link name='b'/></robot>"])
def test_a_urdf_that_cant_be_read_is_one_line(odd_robot: Robot, tmp_path: Path, text: str) -> None:
    broken = tmp_path / "broken.urdf"
    broken.write_text(text, encoding="utf-8")
    with pytest.raises(RobotError, match=r"broken\.urdf: not (a valid URDF|valid XML): .*; correct it") as caught:
        load_model(replace(odd_robot, urdf=broken))
    assert "\n" not in caught.value.message


def test_the_arm_needs_no_viewer() -> None:
    """Planning imports pinocchio and ruckig, but neither the viewer nor matplotlib."""
    code = "import sys, pbd.arm.ladder_building, pbd.arm.timing.time_moves, pbd.audit.audit; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert {"pinocchio", "ruckig"} <= set(loaded)
    assert not {"meshcat", "matplotlib"} & set(loaded)


def test_an_arm_of_one_joint(tmp_path: Path) -> None:
    urdf = tmp_path / "one.urdf"
    urdf.write_text(
        '<robot name="one"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>',
        encoding="utf-8",
    )
    one = np.ones(1)
    limits = JointLimits(-one, one, one, one, one, "assumed")
    tool = Pose(np.array([0.5, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
    arm = load_model(Robot("one", "one", urdf, None, (), "a", "b", tool, ("j",), 0.0 * one, None, limits))
    np.testing.assert_allclose(arm.forward(0.5 * one).p, [0.5 * np.cos(0.5), 0.5 * np.sin(0.5), 0.0], atol=1e-12)
    np.testing.assert_allclose(arm.jacobian(one)[:, 0], [0.0, 0.5, 0.0, 0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(solve(arm, arm.forward(0.7 * one)).q, [0.7], atol=1e-6)
