"""A robot's kinematics: pinocchio's model of its URDF with everything but the arm's joints locked.

Joint vectors `q` here and in all of pbd/arm are (k,) in the order of `robot.joints`, rad (m for a sliding joint); a
continuous joint is one angle, not pinocchio's cosine and sine. No mesh is read here: that can take seconds.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pbd.data import JointLimits, Robot
from pbd.errors import RobotError, listed
from pbd.io.urdf import kinematics
from pbd.pose import Array, Pose, quat_from_xyzw, quat_to_xyzw

FloatArray = NDArray[np.floating[Any]]

TOOL = "pbd_tool"
_JOINT = " (joint)"


def load_model(robot: Robot) -> ArmModel:
    """Build the kinematic model.

    Raises:
        RobotError: the URDF can't be read, or a joint or body that the robot names isn't in it.
    """
    try:
        full = pin.buildModelFromXML(kinematics(robot.urdf))
    except (ValueError, RuntimeError) as reason:
        message = f"{robot.urdf}: not a valid URDF: {_one_line(reason)}; correct it"
        raise RobotError(message, path=robot.urdf) from None
    return ArmModel(robot, full)


class ArmModel:
    """An arm that can be asked where its tool is. Not to be shared between threads: pinocchio keeps its workings in it.

    Attributes:
        robot: what it was built from.
        full: pinocchio's model of the whole URDF, for the viewer and for collision.
        model, data: pinocchio's model of the arm's joints alone, and its workings.
        tool_id: the tool's frame in `model`.
        T_base_universe: pinocchio's world in `base`.
    """

    def __init__(self, robot: Robot, full: Any) -> None:
        fingers = robot.gripper.joints if robot.gripper else ()
        for name in (*robot.joints, *fingers):
            if not full.existJointName(name):
                raise _unknown(robot, "joint", name, full.names[1:])
        self.robot = robot
        self.full = full
        reference = self.full_q(robot.home, 1.0)
        self.model = _reduced(full, robot.joints, reference)
        if tuple(self.model.names[1:]) != robot.joints:
            raise RobotError(
                f"{robot.name}: joints must be in the order of {robot.urdf}; list them as "
                f"{listed(self.model.names[1:])}",
                robot=robot.name,
            )
        body = self._frame(robot.body)
        T_joint_tool = body.placement * to_se3(robot.T_body_tool)
        frame = pin.Frame(TOOL, body.parentJoint, 0, T_joint_tool, pin.FrameType.OP_FRAME)
        self.tool_id: int = self.model.addFrame(frame)
        base = self._frame(robot.base)
        if base.parentJoint != 0:
            raise RobotError(
                f"{robot.name}: base {robot.base!r} moves with joint {self.model.names[base.parentJoint]}; choose a "
                "link that is fixed",
                robot=robot.name,
            )
        self.T_base_universe: Any = base.placement.inverse()
        self.data = self.model.createData()
        self.steps = _steps(self)
        # Which joints are at the same place after a whole turn.
        self.turns: Array = np.array([step.joint == "turns" for step in self.steps[:-1]], dtype=np.float64)

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links of the URDF."""
        return tuple(frame.name for frame in self.full.frames if frame.type == pin.FrameType.BODY)

    @property
    def limits(self) -> JointLimits:
        """The robot's, of the arm's joints."""
        return self.robot.limits

    def forward(self, q: Array) -> Pose:
        """Return T_base_tool at q (k,)."""
        pin.forwardKinematics(self.model, self.data, configuration(self.model, q))
        T_base_tool = self.T_base_universe * pin.updateFramePlacement(self.model, self.data, self.tool_id)
        return from_se3(T_base_tool)

    def forward_many(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the tool's positions (n, 3) in m and rotation matrices (n, 3, 3) in base, at joints (n, k).

        Plain numpy in the precision of q, for samples and pictures by the thousand; planning relies on `forward`.
        """
        joints, (c_of, s_of) = q.T, (np.cos(q.T), np.sin(q.T))
        p = np.zeros((3, len(q)), q.dtype)
        R = np.repeat(np.eye(3, dtype=q.dtype)[:, :, None], len(q), axis=2)
        for i, step in enumerate(self.steps):
            p += step.offset.astype(q.dtype, copy=False) @ R
            R = step.turn.T.astype(q.dtype, copy=False) @ R
            if step.joint == "slides":
                p += R[:, 2] * joints[i]
            elif step.joint == "turns":
                c, s, x, y = c_of[i], s_of[i], R[:, 0], R[:, 1]
                R[:, 0], R[:, 1] = x * c + y * s, y * c - x * s
        return p.T, R.transpose(2, 0, 1)

    def jacobian(self, q: Array) -> Array:
        """Return (6, k): the tool's velocity in its own frame, m/s then rad/s, per joint velocity."""
        J: Array = pin.computeFrameJacobian(
            self.model, self.data, configuration(self.model, q), self.tool_id, pin.ReferenceFrame.LOCAL
        ).reshape(6, -1)  # pinocchio's of one joint is a vector
        return J

    def full_q(self, q: Array, opening: float) -> Array:
        """Return pinocchio's configuration of the `full` model: the arm at q, the gripper 1 open to 0 closed."""
        angles = dict(zip(self.robot.joints, q, strict=True))
        if gripper := self.robot.gripper:
            fingers = gripper.closed + opening * (gripper.open - gripper.closed)
            angles.update(zip(gripper.joints, fingers, strict=True))
        return configuration(self.full, np.array([angles.get(name, 0.0) for name in self.full.names[1:]]))

    def _frame(self, name: str) -> Any:
        # Asked for by kind: some URDFs give a joint and a body the same name.
        if not self.model.existFrame(name, pin.FrameType.BODY):
            bodies = [frame.name for frame in self.model.frames if frame.type == pin.FrameType.BODY]
            raise _unknown(self.robot, "body", name, bodies)
        return self.model.frames[self.model.getFrameId(name, pin.FrameType.BODY)]


def _reduced(full: Any, joints: tuple[str, ...], reference: Array) -> Any:
    """Lock all joints but these at a configuration."""
    model = full.copy()
    # Pinocchio's own function fails where a joint shares its name with a body.
    for joint in range(1, model.njoints):
        frame = model.frames[model.getFrameId(model.names[joint], pin.FrameType.JOINT)]
        frame.name = model.names[joint] = f"{model.names[joint]}{_JOINT}"
    locked = [joint for joint in range(1, full.njoints) if full.names[joint] not in joints]
    reduced = pin.buildReducedModel(model, locked, reference)
    for joint in range(1, reduced.njoints):
        reduced.names[joint] = reduced.names[joint].removesuffix(_JOINT)
    return reduced


def configuration(model: Any, q: Array) -> Array:
    """Turn one number per joint into pinocchio's configuration, which holds cosine and sine of a continuous joint."""
    if model.nq == len(q):
        return q
    joints = list(model.joints)[1:]
    angles = zip(joints, q, strict=True)
    return np.concatenate([(a,) if joint.nq == 1 else (np.cos(a), np.sin(a)) for joint, a in angles])


def to_se3(pose: Pose) -> Any:
    """Turn a Pose into pinocchio's."""
    return pin.XYZQUATToSE3(np.concatenate((pose.p, quat_to_xyzw(pose.wxyz))))


def from_se3(placement: Any) -> Pose:
    """Turn pinocchio's pose into ours."""
    xyzquat = pin.SE3ToXYZQUAT(placement)
    return Pose(xyzquat[:3], quat_from_xyzw(xyzquat[3:]))


class _Step(NamedTuple):
    """A fixed step along the arm, then a joint that turns about z of where it leads, or slides along it."""

    offset: Array
    turn: Array
    joint: Literal["turns", "slides", "none"]


def _steps(arm: ArmModel) -> list[_Step]:
    """Break the arm into steps from base to tool; no joint follows the last."""
    model, data = arm.model, arm.model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    steps: list[_Step] = []
    T_axis_joint = arm.T_base_universe
    for i in range(1, model.njoints):
        column = pin.getJointJacobian(model, data, i, pin.ReferenceFrame.LOCAL).reshape(6, -1)[:, i - 1]
        slides = not column[3:].any()
        axis = column[:3] if slides else column[3:]
        T_joint_axis = pin.SE3(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis).matrix(), np.zeros(3))
        step = T_axis_joint * model.jointPlacements[i] * T_joint_axis
        steps.append(_Step(step.translation.copy(), step.rotation.copy(), "slides" if slides else "turns"))
        T_axis_joint = T_joint_axis.inverse()
    last = T_axis_joint * model.frames[arm.tool_id].placement
    return [*steps, _Step(last.translation.copy(), last.rotation.copy(), "none")]


def _unknown(robot: Robot, kind: str, name: str, known: Iterable[str]) -> RobotError:
    message = f"{robot.name}: {robot.urdf} has no {kind} {name!r}; choose one of {listed(known)}"
    return RobotError(message, robot=robot.name, name=name)


def _one_line(reason: Exception) -> str:
    return " ".join(str(reason).split())
