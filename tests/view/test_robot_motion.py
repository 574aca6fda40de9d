"""Poses of joints and links, compared with pinocchio's own."""

import numpy as np
import pinocchio as pin
import pytest

from pbd.arm.model import load_model
from pbd.pose import Pose
from pbd.replay import robot_motion
from pbd.view.replay_scene import ReplayScene
from pbd.view.robot_motion import FRAME_RATE_HZ
from tests.view import scenes


@pytest.fixture(scope="module")
def pouring() -> ReplayScene:
    return scenes.pouring()


def test_the_tool_is_where_pinocchio_says(pouring: ReplayScene) -> None:
    robot, motion = pouring.robot, pouring.motion
    model = pin.buildModelFromUrdf(str(robot.urdf))
    data = model.createData()
    base, body = (model.getFrameId(name, pin.FrameType.BODY) for name in (robot.base, robot.body))
    tool = motion.tool(robot)
    for i in range(0, len(motion.t), 60):
        q = pin.neutral(model)
        q[:7] = pouring.trajectory.at(motion.t[i : i + 1]).q[0]
        pin.framesForwardKinematics(model, data, q)
        T = Pose.from_matrix((data.oMf[base].inverse() * data.oMf[body]).homogeneous) @ robot.T_body_tool
        assert max(T.distance(tool[i])) < 1e-7


def test_joint_motions_chain_up_to_the_links(pouring: ReplayScene) -> None:
    world = {0: Pose.identity()}
    for joint, parent, _, local in pouring.motion.joints():
        world[joint] = world[parent] @ local[150]
        assert max(world[joint].distance(pouring.motion.joint(joint)[150])) < 1e-7


def test_the_fingers_open_and_close(pouring: ReplayScene) -> None:
    motion, trajectory = pouring.motion, pouring.trajectory
    left, right = (motion.joint(motion.link(f"panda_{side}finger")[0]) for side in ("left", "right"))
    opening = np.interp(motion.t, trajectory.gripper_t, trajectory.gripper_opening)
    np.testing.assert_allclose(np.linalg.norm(left.p - right.p, axis=1), 0.08 * opening, atol=1e-12)


def test_continuous_joints_turn() -> None:
    joints = tuple(f"j2s6s200_joint_{i}" for i in range(1, 7))
    robot = scenes.robot("kinova", "kinova_description/robots/kinova.urdf", "base", "j2s6s200_end_effector", joints)
    turn = scenes.rest_to_rest(joints, np.outer((0.0, 7.0), np.eye(6)[0]), 1.0, np.ones(2))
    _, _, _, local = next(robot_motion(load_model(robot), turn.sample(FRAME_RATE_HZ)).joints())
    assert local[0].distance(local[-1])[1] == pytest.approx(7.0 - 2.0 * np.pi, abs=1e-9)
