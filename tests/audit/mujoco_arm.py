"""An arm in MuJoCo: the URDF without its meshes, with the load as a link of its own."""

import xml.etree.ElementTree as ET

import numpy as np

from pbd.data import Load, Robot
from pbd.pose import quat_to_matrix


class MujocoArm:
    """MuJoCo's model and data, with the addresses of the arm's joints in qpos (`at`) and in qvel (`driven`).

    Contacts, friction and armature are off, as in the audit.
    """

    def __init__(self, robot: Robot, load: Load) -> None:
        import mujoco

        root = ET.parse(robot.urdf).getroot()
        for link in root.findall("link"):
            for shape in (*link.findall("visual"), *link.findall("collision")):
                link.remove(shape)
        if load.mass:
            p = robot.T_body_tool.p + quat_to_matrix(robot.T_body_tool.wxyz) @ np.array(load.p_tool)
            root.append(ET.fromstring(
                f'<link name="load"><inertial><mass value="{load.mass}"/>'
                '<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            ))  # fmt: skip
            root.append(ET.fromstring(
                f'<joint name="carries" type="fixed"><parent link="{robot.body}"/><child link="load"/>'
                f'<origin xyz="{" ".join(map(repr, p.tolist()))}"/></joint>'
            ))  # fmt: skip
        self.robot = robot
        self.model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.model.dof_damping[:] = self.model.dof_frictionloss[:] = self.model.dof_armature[:] = 0.0
        self.data = mujoco.MjData(self.model)
        self.at = [self.model.joint(name).qposadr[0] for name in robot.joints]
        self.driven = [self.model.joint(name).dofadr[0] for name in robot.joints]

    def open_gripper(self, opening: float) -> None:
        """Move the fingers to an opening from 1 (open) to 0 (closed)."""
        if gripper := self.robot.gripper:
            fingers = [self.model.joint(name).qposadr[0] for name in gripper.joints]
            self.data.qpos[fingers] = gripper.closed + opening * (gripper.open - gripper.closed)
