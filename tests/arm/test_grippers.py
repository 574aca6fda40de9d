"""Every bundled arm's tool frame compared with the geometry of its own gripper.

The gripper is measured here by pinocchio and coal, from the URDF's meshes and the positions of the finger joints.
"""

import xml.etree.ElementTree as ET
from functools import cache
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin
import pytest

from pbd.data import Robot
from pbd.pose import Array
from tests.arm.bundled import NAMES, arm_of


class Jaws(NamedTuple):
    """The links of the two jaws; the tool's x axis points from the near one to the far one."""

    near: str
    far: str


JAWS = {
    "panda": Jaws("panda_rightfinger", "panda_leftfinger"),
    "z1": Jaws("gripperStator", "gripperMover"),
    "kinova": Jaws("j2s6s200_link_finger_tip_1", "j2s6s200_link_finger_tip_2"),
    "so100": Jaws("gripper", "jaw"),
    "so101": Jaws("gripper_link", "moving_jaw_so101_v1_link"),
}
MOVING = tuple(name for name in JAWS if name != "kinova")  # its fingers stand still in the model
WITHOUT = tuple(name for name in NAMES if name not in JAWS)


@cache
def tip_in_link(name: str, link: str) -> Array:
    """Return the tip of a jaw in its link: the mean of its mesh points within 8 mm of the last one."""
    arm = arm_of(name)
    p_link = np.vstack([_points(arm.robot, element) for element in _link(arm.robot, link).iterfind("visual")])
    # The last one is the one farthest from where the wrist's last joint is.
    data = arm.full.createData()
    pin.framesForwardKinematics(arm.full, data, arm.configurations(np.append(arm.robot.home, 0.0)))
    wrist = data.oMi[arm.full.getJointId(arm.robot.joints[-1])]
    here = data.oMf[arm.full.getFrameId(link, pin.FrameType.BODY)]
    far = np.linalg.norm(p_link - here.actInv(wrist).translation, axis=1)
    tip: Array = p_link[far > far.max() - 0.008].mean(axis=0)
    return tip


def _link(robot: Robot, name: str) -> ET.Element:
    return next(link for link in ET.parse(robot.urdf).getroot().iterfind("link") if link.get("name") == name)


def _points(robot: Robot, visual: ET.Element) -> Array:
    """(n, 3) m in the link, of a <visual> element's mesh."""
    origin, mesh = visual.find("origin"), visual.find("geometry/mesh")
    assert mesh is not None
    placed = {} if origin is None else origin.attrib
    address = mesh.attrib["filename"].removeprefix("package://")
    path = next(folder / address for folder in robot.package_dirs if (folder / address).is_file())
    scale = np.array([float(word) for word in mesh.get("scale", "1 1 1").split()])
    xyz, rpy = ([float(word) for word in placed.get(key, "0 0 0").split()] for key in ("xyz", "rpy"))
    points: Array = coal.MeshLoader().load(str(path), scale).vertices() @ pin.rpy.rpyToMatrix(*rpy).T + xyz
    return points


def tips_in_tool(name: str, opening: float) -> tuple[Array, Array]:
    """Return the tips of both jaws in the tool frame, at an opening from 0 to 1."""
    arm, data = arm_of(name), arm_of(name).full.createData()
    pin.framesForwardKinematics(arm.full, data, arm.configurations(np.append(arm.robot.home, opening)))
    base = data.oMf[arm.full.getFrameId(arm.robot.base, pin.FrameType.BODY)]
    T_tool_base = arm.forward(arm.robot.home).inverse()

    def tip(link: str) -> Array:
        here = base.actInv(data.oMf[arm.full.getFrameId(link, pin.FrameType.BODY)])
        return T_tool_base.act(here.act(tip_in_link(name, link)))

    return tip(JAWS[name].near), tip(JAWS[name].far)


def wrist_in_tool(name: str) -> Any:
    """T_tool_joint of the arm's last joint, as pinocchio's."""
    arm = arm_of(name)
    return arm.model.frames[arm.tool_id].placement.inverse()


@pytest.mark.parametrize("name", JAWS)
def test_z_leads_from_the_wrist_to_the_fingertips(name: str) -> None:
    near, far = tips_in_tool(name, 0.0)
    wrist = wrist_in_tool(name).translation
    approach = (near + far) / 2 - wrist
    assert np.degrees(np.arccos(approach[2] / np.linalg.norm(approach))) < 8.0
    assert wrist[2] < -0.05


@pytest.mark.parametrize("name", MOVING)
def test_x_is_the_way_the_jaws_part(name: str) -> None:
    (near_shut, far_shut), (near_wide, far_wide) = tips_in_tool(name, 0.0), tips_in_tool(name, 1.0)
    parted = (far_wide - near_wide) - (far_shut - near_shut)
    assert parted[0] > 0.05
    assert abs(parted[1]) < 0.01 * parted[0]
    assert far_wide[0] > 0.01  # and the tool lies between them
    assert near_wide[0] < -0.005


@pytest.mark.parametrize("name", JAWS)
def test_x_leads_from_one_fingertip_to_the_other(name: str) -> None:
    near, far = tips_in_tool(name, 0.3)
    across = far - near
    assert np.hypot(across[1], across[2]) < 0.35 * across[0]


@pytest.mark.parametrize("name", JAWS)
def test_the_origin_lies_between_the_fingertips(name: str) -> None:
    near, far = tips_in_tool(name, 0.0)
    assert np.linalg.norm((near + far) / 2) < 0.012
    assert (near + far)[2] / 2 > -0.002  # not beyond their ends


@pytest.mark.parametrize("name", WITHOUT)
def test_without_fingers_the_tool_lies_straight_ahead_of_the_flange(name: str) -> None:
    arm, wrist = arm_of(name), wrist_in_tool(name)
    assert arm.robot.gripper is not None  # the motion says when to grip
    assert arm.robot.gripper.joints == (), "name the links of its jaws in JAWS"
    axis = arm.jacobian(arm.robot.home)[:, -1]  # of the last joint, in the tool's frame
    np.testing.assert_allclose(axis[:3], 0.0, atol=1e-9)  # the origin is on it
    np.testing.assert_allclose(np.abs(axis[5]), 1.0, atol=1e-9)  # and it is z
    assert wrist.translation[2] < -0.15
