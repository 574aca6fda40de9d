"""Moving parts: against pinocchio asked directly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from pbd.data import JointTrajectory, Robot
from pbd.errors import RobotError
from pbd.pose import Pose
from pbd.view.motion import Motion
from tests.view import scenes


@pytest.fixture(scope="module")
def pouring() -> tuple[Robot, JointTrajectory]:
    scene = scenes.pouring()
    return scene.robot, scene.trajectory


def test_the_tool_is_where_pinocchio_says(pouring: tuple[Robot, JointTrajectory]) -> None:
    robot, trajectory = pouring
    motion = Motion(robot, trajectory, 20.0)
    model = pin.buildModelFromUrdf(str(robot.urdf))
    data = model.createData()
    base, body = (model.getFrameId(name, pin.FrameType.BODY) for name in (robot.base, robot.body))
    tool = motion.tool()
    for i in range(0, len(motion.t), 25):
        q = pin.neutral(model)
        q[:7] = trajectory.at(motion.t[i : i + 1]).q[0]
        pin.framesForwardKinematics(model, data, q)
        T = Pose.from_matrix((data.oMf[base].inverse() * data.oMf[body]).homogeneous) @ robot.T_body_tool
        metres, radians = T.distance(tool[i])
        assert metres < 1e-12
        assert radians < 1e-7


def test_joint_motions_chain_up_to_the_links(pouring: tuple[Robot, JointTrajectory]) -> None:
    motion = Motion(*pouring, 10.0)
    for joint in motion.local:
        chain, up = motion.local[joint][30], motion.parent(joint)
        while up:
            chain, up = motion.local[up][30] @ chain, motion.parent(up)
        metres, radians = (motion.T_base_world @ chain).distance(motion.joint(joint)[30])
        assert metres < 1e-12
        assert radians < 1e-7


def test_the_fingers_open_and_close(pouring: tuple[Robot, JointTrajectory]) -> None:
    robot, trajectory = pouring
    motion = Motion(robot, trajectory, 50.0)
    left, right = (motion.joint(motion.link("finger", f"panda_{side}finger")[0]) for side in ("left", "right"))
    opening = np.interp(motion.t, trajectory.gripper_t, trajectory.gripper_opening)
    np.testing.assert_allclose(np.linalg.norm(left.p - right.p, axis=1), 0.08 * opening, atol=1e-12)


def test_continuous_joints_turn() -> None:
    robot = scenes.robot(
        "kinova", "kinova_description/robots/kinova.urdf", "base", "j2s6s200_end_effector", ("j2s6s200_joint_1",)
    )
    turn = scenes.rest_to_rest(robot.joints, [[0.0], [7.0]], 1.0, np.ones(2))
    motion = Motion(robot, turn, 50.0)
    first, last = motion.local[1][0], motion.local[1][-1]
    assert first.distance(last)[1] == pytest.approx(7.0 - 2.0 * np.pi, abs=1e-9)


def test_all_is_seen_from_the_base(pouring: tuple[Robot, JointTrajectory]) -> None:
    robot, trajectory = pouring
    T_world_hand = Motion(robot, trajectory, 10.0).tool()[0] @ robot.T_body_tool.inverse()
    other = Motion(replace(robot, base="panda_hand"), trajectory, 10.0)
    inverse = other.T_base_world @ T_world_hand
    np.testing.assert_allclose(inverse.p, [0.0, 0.0, 0.1034], atol=1e-6)  # the hand's tcp, seen from the hand


@pytest.mark.parametrize("change", [{"base": "nowhere"}, {"body": "nowhere"}])
def test_a_missing_link_is_named(pouring: tuple[Robot, JointTrajectory], change: dict[str, str]) -> None:
    robot, trajectory = pouring
    motion = Motion(replace(robot, **change), trajectory, 10.0)  # type: ignore[arg-type]
    with pytest.raises(RobotError, match="nowhere"):
        motion.tool()


def test_a_missing_joint_is_named(pouring: tuple[Robot, JointTrajectory]) -> None:
    robot, trajectory = pouring
    with pytest.raises(RobotError, match=r"elbow.*panda_joint1"):
        Motion(robot, replace(trajectory, joint_names=("elbow", *trajectory.joint_names[1:])), 10.0)


def test_what_is_no_urdf_is_named(pouring: tuple[Robot, JointTrajectory], tmp_path: Path) -> None:
    robot, trajectory = pouring
    (tmp_path / "no.urdf").write_text("<robot/>")
    with pytest.raises(RobotError, match=r"no\.urdf"):
        Motion(replace(robot, urdf=tmp_path / "no.urdf"), trajectory, 10.0)
