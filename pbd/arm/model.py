"""A robot's kinematics: pinocchio's model of its URDF with all joints locked except the arm's.

Joint vectors `q` here and in all of pbd/arm are (k,) in the order of `robot.joints`, rad (m for a prismatic joint). A
continuous joint is one angle, not pinocchio's cosine and sine. Coordinates `x` are (k + 1,): q, then the gripper's
opening, 1 open to 0 closed. Pinocchio's world is `base` in both models. No mesh is read here, since that can take
seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Literal, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from pbd.data import JointLimits, Robot
from pbd.errors import RobotError, listed
from pbd.io.urdf import kinematics_xml
from pbd.pose import Array, Pose, quat_from_xyzw, quat_to_xyzw

FloatArray = NDArray[np.floating[Any]]

_JOINT = " (joint)"
_BASE_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def load_model(robot: Robot) -> ArmModel:
    """Build the kinematic model.

    Raises:
        RobotError: the URDF can't be read, or a joint or body that the robot names isn't in it.
    """
    try:
        full = pin.buildModelFromXML(kinematics_xml(robot.urdf))
    except (ValueError, RuntimeError) as reason:
        message = f"{robot.urdf}: not a valid URDF: {' '.join(str(reason).split())}; correct it"
        raise RobotError(message, path=robot.urdf) from None
    return ArmModel(robot, full)


class ArmModel:
    """An arm's forward kinematics. Not safe to share between threads: pinocchio computes in `data`.

    Attributes:
        full: pinocchio's model of the entire URDF, for the viewer and for collision checks.
        axes: joint of `full` -> its axis (3,) in its own frame, and whether it is prismatic.
        drives: driven joint of `full` -> its column of x, slope, at_zero; the joint's value is at_zero + slope * x.
        model, data: pinocchio's model of the arm's joints alone, and its buffers.
        configuration: converts joints (k,) to pinocchio's configuration of `model`.
        tool_id: index of the tool's frame in `model`.
        steps: the fixed transforms and joints from base to tool, for `forward_many`.
        tool_joint, T_joint_tool: the joint of `full` that carries the tool, and the tool's pose on it.
        turns: (k,) 1 for a revolute joint, whose whole turns change no pose; 0 for a prismatic joint.
        travel_scale: (k,) rad of joint travel per unit of a joint: 1 for a revolute joint; for a prismatic joint the
            angle by which a revolute joint turns while it moves by 1 m, both at their largest velocity.
    """

    def __init__(self, robot: Robot, full: Any) -> None:
        columns = [(name, (i, 1.0, 0.0)) for i, name in enumerate(robot.joints)]
        if gripper := robot.gripper:
            strokes = (gripper.open - gripper.closed).tolist()
            fingers = zip(gripper.joints, strokes, gripper.closed.tolist(), strict=True)
            columns += [(name, (len(columns), stroke, closed)) for name, stroke, closed in fingers]
        for each in robot.mimic_joints:
            columns.append((each.joint, (robot.joints.index(each.leader), each.multiplier, each.offset)))
        for name, _ in columns:
            if not full.existJointName(name):
                raise _unknown(robot, "joint", name, full.names[1:])
        self.robot = robot
        self.full = full
        self.axes = _axes(full)
        self.drives = {int(full.getJointId(name)): drive for name, drive in columns}
        self._driven = np.array([*self.drives]) - 1
        self._drive = tuple(map(np.array, zip(*self.drives.values(), strict=True)))
        self._full_configuration = _configuration_of(full)
        self.model = _reduced(full, robot.joints, self.configurations(np.append(robot.home, 1.0)))
        if tuple(self.model.names[1:]) != robot.joints:
            raise RobotError(
                f"{robot.name}: joints must be in the order of {robot.urdf}; list them as "
                f"{listed(self.model.names[1:])}",
                robot=robot.name,
            )
        fastest = self.model.velocityLimit  # 0 in a URDF means unknown
        for name, velocity, most in zip(robot.joints, robot.limits.velocity.tolist(), fastest.tolist(), strict=True):
            if velocity > most > 0.0:
                what = f"{robot.name}: the limits give {name} a velocity of {velocity:g}, but {robot.urdf} {most:g}"
                raise RobotError(f"{what}; lower it, or correct the URDF", joint=name, value=velocity, bound=most)
        body, base = self._frame(robot.body), self._frame(robot.base)
        if base.parentJoint != 0:
            raise RobotError(
                f"{robot.name}: base {robot.base!r} moves with joint {self.model.names[base.parentJoint]}; choose a "
                "link that is fixed",
                robot=robot.name,
            )
        T_base_universe = base.placement.inverse()
        for model in (full, self.model):
            _move_world(model, T_base_universe)
        self.tool_joint, T_joint_body = self.link_on_joint(robot.body)
        self.T_joint_tool = T_joint_body @ robot.T_body_tool
        placement = body.placement * to_se3(robot.T_body_tool)
        frame = pin.Frame("pbd_tool", body.parentJoint, 0, placement, pin.FrameType.OP_FRAME)
        self.tool_id: int = self.model.addFrame(frame)
        self.data = self.model.createData()
        self.configuration = _configuration_of(self.model)
        self.steps = _steps(self)
        self.turns: Array = np.array([step.joint == "turns" for step in self.steps[:-1]], dtype=np.float64)
        turning, velocity = self.turns > 0.0, robot.limits.velocity
        typical = np.median(velocity[turning] if turning.any() else velocity)
        self.travel_scale: Array = np.where(turning, 1.0, typical / velocity)

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links of the URDF."""
        return tuple(frame.name for frame in self.full.frames if frame.type == pin.FrameType.BODY)

    @property
    def limits(self) -> JointLimits:
        """The limits of the arm's joints."""
        return self.robot.limits

    def unmoved_between(self, *links: str) -> tuple[str, ...]:
        """Return the joints between two links that neither the arm nor the gripper moves; they stand at 0."""
        one, other = (set(self.full.supports[self.link_on_joint(link)[0]]) for link in links)
        return tuple(self.full.names[joint] for joint in sorted(one ^ other) if joint not in self.drives)

    def link_on_joint(self, name: str) -> tuple[int, Pose]:
        """Return the joint that carries a link, as an index in `full`, and T_joint_link."""
        frame = self.full.frames[self.full.getFrameId(name, pin.FrameType.BODY)]
        return int(frame.parentJoint), from_se3(frame.placement)

    def limit_margins(self, q: Array) -> Array:
        """Return the distance (..., k) of each joint from its nearer limit, rad or m; negative beyond it."""
        return np.minimum(q - self.limits.lower, self.limits.upper - q)

    def forward(self, q: Array) -> Pose:
        """Return T_base_tool at q (k,)."""
        pin.forwardKinematics(self.model, self.data, self.configuration(q))
        return from_se3(pin.updateFramePlacement(self.model, self.data, self.tool_id))

    def forward_many(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the tool's positions (n, 3) in m and rotation matrices (n, 3, 3) in base, at joints (n, k).

        It uses numpy in the precision of q, and is fast for thousands of samples. Planning relies on `forward`.
        """
        joints, (c_of, s_of) = q.T, (np.cos(q.T), np.sin(q.T))
        p = np.zeros((3, len(q)), q.dtype)
        R = np.repeat(np.eye(3, dtype=q.dtype)[:, :, None], len(q), axis=2)
        for i, step in enumerate(self.steps):
            p += step.offset.astype(q.dtype, copy=False) @ R
            R = step.rotation.T.astype(q.dtype, copy=False) @ R
            if step.joint == "slides":
                p += R[:, 2] * joints[i]
            elif step.joint == "turns":
                c, s, x, y = c_of[i], s_of[i], R[:, 0], R[:, 1]
                R[:, 0], R[:, 1] = x * c + y * s, y * c - x * s
        return p.T, R.transpose(2, 0, 1)

    def jacobian(self, q: Array) -> Array:
        """Return (6, k): the tool's velocity in its own frame, m/s then rad/s, per joint velocity."""
        J: Array = pin.computeFrameJacobian(
            self.model, self.data, self.configuration(q), self.tool_id, pin.ReferenceFrame.LOCAL
        ).reshape(6, -1)  # for an arm of one joint, pinocchio returns a vector
        return J

    def tool_with_jacobian(self, q: Array) -> tuple[Array, Array, Array]:
        """Return the tool's position (3,) m, rotation (3, 3) and Jacobian (6, k), all in base, at q (k,), for fast IK.

        Position and rotation are views of pinocchio's buffers: the next call overwrites them.
        """
        J = pin.computeFrameJacobian(self.model, self.data, self.configuration(q), self.tool_id, _BASE_AXES)
        placement = self.data.oMf[self.tool_id]
        return placement.translation, placement.rotation, J.reshape(6, -1)

    def configurations(self, x: Array) -> Array:
        """Return pinocchio's configurations (..., nq) of the `full` model at coordinates (..., k + 1).

        Raises:
            ValueError: a coordinate isn't finite.
        """
        if not np.isfinite(x).all():
            raise ValueError("joints and opening must be finite")
        column, slope, at_zero = self._drive
        values = np.zeros((*x.shape[:-1], self.full.njoints - 1))
        values[..., self._driven] = at_zero + slope * x[..., column]
        return self._full_configuration(values)

    def _frame(self, name: str) -> Any:
        # Search by kind, since some URDFs give a joint and a body the same name.
        if not self.model.existFrame(name, pin.FrameType.BODY):
            bodies = [frame.name for frame in self.model.frames if frame.type == pin.FrameType.BODY]
            raise _unknown(self.robot, "body", name, bodies)
        return self.model.frames[self.model.getFrameId(name, pin.FrameType.BODY)]


def _reduced(full: Any, joints: tuple[str, ...], reference: Array) -> Any:
    """Return the model with all joints except these locked at a configuration."""
    model = full.copy()
    # Pinocchio's own function fails if a joint shares its name with a body.
    for joint in range(1, model.njoints):
        frame = model.frames[model.getFrameId(model.names[joint], pin.FrameType.JOINT)]
        frame.name = model.names[joint] = f"{model.names[joint]}{_JOINT}"
    locked = [joint for joint in range(1, full.njoints) if full.names[joint] not in joints]
    reduced = pin.buildReducedModel(model, locked, reference)
    for joint in range(1, reduced.njoints):
        reduced.names[joint] = reduced.names[joint].removesuffix(_JOINT)
    return reduced


def _move_world(model: Any, T_new_old: Any) -> None:
    """Express a model in another fixed world frame."""
    for joint in range(1, model.njoints):
        if model.parents[joint] == 0:
            model.jointPlacements[joint] = T_new_old * model.jointPlacements[joint]
    for frame in model.frames:
        if frame.parentJoint == 0:
            frame.placement = T_new_old * frame.placement


def _configuration_of(model: Any) -> Callable[[Array], Array]:
    """Return the conversion of joint values (..., n) to pinocchio's: cosine and sine for a continuous joint.

    Floating and planar joints, which nothing drives, stay neutral.
    """
    joints = list(model.joints)[1:]
    if model.nq == len(joints):
        return lambda q: q
    starts, sizes = (np.array([getattr(joint, key) for joint in joints]) for key in ("idx_q", "nq"))
    single, turning, neutral = sizes == 1, sizes == 2, pin.neutral(model)
    scalars, cosines = starts[single], starts[turning]

    def convert(q: Array) -> Array:
        made = np.empty((*q.shape[:-1], model.nq))
        made[...] = neutral
        made[..., scalars] = q[..., single]
        made[..., cosines], made[..., cosines + 1] = np.cos(q[..., turning]), np.sin(q[..., turning])
        return made

    return convert


def to_se3(pose: Pose) -> Any:
    """Convert a Pose to pinocchio's SE3."""
    return pin.XYZQUATToSE3(np.concatenate((pose.p, quat_to_xyzw(pose.wxyz))))


def from_se3(placement: Any) -> Pose:
    """Convert pinocchio's SE3 to a Pose."""
    xyzquat = pin.SE3ToXYZQUAT(placement)
    return Pose(xyzquat[:3], quat_from_xyzw(xyzquat[3:]))


def _axes(model: Any) -> dict[int, tuple[Array, bool]]:
    data, axes = model.createData(), {}
    pin.computeJointJacobians(model, data, pin.neutral(model))
    for joint in range(1, model.njoints):
        J = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL).reshape(6, -1)
        column = J[:, model.joints[joint].idx_v]
        slides = not column[3:].any()
        axes[joint] = (column[:3] if slides else column[3:], slides)
    return axes


class _Step(NamedTuple):
    """A fixed transform along the arm, then a joint about (or along) the transformed frame's z axis."""

    offset: Array
    rotation: Array
    joint: Literal["turns", "slides", "none"]


def _steps(arm: ArmModel) -> list[_Step]:
    """Split the arm into steps from base to tool; the last one has no joint."""
    model, steps = arm.model, list[_Step]()
    T_axis_joint = pin.SE3.Identity()
    for i in range(1, model.njoints):
        axis, slides = arm.axes[arm.full.getJointId(model.names[i])]
        T_joint_axis = pin.SE3(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), axis).matrix(), np.zeros(3))
        step = T_axis_joint * model.jointPlacements[i] * T_joint_axis
        steps.append(_Step(step.translation.copy(), step.rotation.copy(), "slides" if slides else "turns"))
        T_axis_joint = T_joint_axis.inverse()
    last = T_axis_joint * model.frames[arm.tool_id].placement
    return [*steps, _Step(last.translation.copy(), last.rotation.copy(), "none")]


def _unknown(robot: Robot, kind: str, name: str, known: Iterable[str]) -> RobotError:
    message = f"{robot.name}: {robot.urdf} has no {kind} {name!r}; choose one of {listed(known)}"
    return RobotError(message, robot=robot.name, name=name)
