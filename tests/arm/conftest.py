from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from pbd.arm.model import ArmModel, load_model
from pbd.data import JointLimits, Robot
from pbd.pose import Array, Pose
from tests.arm.bundled import arm_of


@pytest.fixture(scope="session")
def panda() -> Robot:
    return arm_of("panda").robot


@pytest.fixture(scope="session")
def arm() -> ArmModel:
    return arm_of("panda")


@pytest.fixture(scope="session")
def oracle(panda: Robot) -> Callable[[Array], Any]:
    """Return T_base_tool as pinocchio's SE3, computed from the full URDF with its fingers."""
    model = pin.buildModelFromUrdf(str(panda.urdf))
    data = model.createData()
    body = model.getFrameId("panda_hand_tcp", pin.FrameType.BODY)
    quarter_turn = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, np.pi / 2), np.zeros(3))

    def forward(q: Array) -> Any:
        pin.framesForwardKinematics(model, data, np.concatenate((q, [0.01, 0.03])))
        return data.oMf[body] * quarter_turn

    return forward


@pytest.fixture(scope="session")
def odd_robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """An arm with every kind of joint, oblique axes, and a base that is not the root."""
    path = tmp_path_factory.mktemp("odd") / "odd.urdf"
    path.write_text(ODD_URDF, encoding="utf-8")
    joints = ("pan", "lift", "wrist", "swing")
    return Robot(
        name="odd",
        description="",
        urdf=path,
        srdf=None,
        package_dirs=(),
        base="foot",
        body="hand",
        T_body_tool=Pose.from_rpy((0.02, -0.01, 0.05), (0.3, -0.2, 0.5)),
        joints=joints,
        home=np.array([0.1, 0.2, 0.3, 0.4]),
        gripper=None,
        limits=JointLimits(
            lower=np.array([-np.inf, 0.0, -6.5, -2.0]),
            upper=np.array([np.inf, 0.4, 6.5, 2.0]),
            velocity=np.ones(4),
            acceleration=np.full(4, 5.0),
            jerk=np.full(4, 100.0),
            source="a test",
        ),
    )


@pytest.fixture(scope="session")
def odd_arm(odd_robot: Robot) -> ArmModel:
    return load_model(odd_robot)


def random_joints(robot: Robot, count: int, seed: int, margin: float = 0.0) -> Array:
    """Draw joints (count, k), rad, uniformly within limits; continuous joints within 10 rad of zero."""
    lower, upper = np.clip(robot.limits.lower, -10.0, None), np.clip(robot.limits.upper, None, 10.0)
    return np.random.default_rng(seed).uniform(lower + margin, upper - margin, (count, len(robot.joints)))


def changed(limits: JointLimits, **arrays: Any) -> JointLimits:
    return replace(limits, **arrays)


ODD_URDF = """<?xml version="1.0"?>
<robot name="odd">
  <link name="room"/> <link name="foot"/> <link name="turret"/> <link name="carriage"/> <link name="forearm"/>
  <link name="hand"/> <link name="flag"/>
  <joint name="bolts" type="fixed">
    <parent link="room"/> <child link="foot"/> <origin xyz="1 2 0.5" rpy="0.1 0.2 0.3"/>
  </joint>
  <joint name="pan" type="continuous">
    <parent link="foot"/> <child link="turret"/> <origin xyz="0 0 0.3" rpy="0 0 0"/> <axis xyz="0 0 1"/>
    <limit effort="1" velocity="1"/>
  </joint>
  <joint name="lift" type="prismatic">
    <parent link="turret"/> <child link="carriage"/> <origin xyz="0.1 0 0" rpy="0.4 0 0"/> <axis xyz="0 -1 0"/>
    <limit effort="1" lower="0" upper="0.4" velocity="1"/>
  </joint>
  <joint name="wrist" type="revolute">
    <parent link="carriage"/> <child link="forearm"/> <origin xyz="0 0.2 0" rpy="0 0.7 0"/> <axis xyz="0.6 0 0.8"/>
    <limit effort="1" lower="-6.5" upper="6.5" velocity="1"/>
  </joint>
  <joint name="swing" type="revolute">
    <parent link="forearm"/> <child link="hand"/> <origin xyz="0.25 0 0" rpy="0 0 -0.5"/> <axis xyz="0 0 -1"/>
    <limit effort="1" lower="-2" upper="2" velocity="1"/>
  </joint>
  <joint name="flagpole" type="revolute">
    <parent link="foot"/> <child link="flag"/> <origin xyz="0 0.5 0" rpy="0 0 0"/> <axis xyz="1 0 0"/>
    <limit effort="1" lower="-1" upper="1" velocity="1"/>
  </joint>
</robot>
"""
