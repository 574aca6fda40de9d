"""The audit of a trajectory: its form, smoothness, limits, poses, contacts and torques."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pbd.audit.arm import AuditArm
from pbd.audit.collision_pairs import AuditScene
from pbd.audit.contact import coordinates, find_touch, joint_motion
from pbd.audit.grasp import check_grips
from pbd.audit.limits import JUMP_RAD, ROUNDING, check_limits, check_samples, check_smoothness, fail
from pbd.audit.torque import Torque, find_torque
from pbd.cache import cached_by_thread
from pbd.data import Calibration, GraspedObject, JointTrajectory, Load, Robot
from pbd.errors import PlanError
from pbd.pose import Pose

POSE_TOLERANCE_M, POSE_TOLERANCE_RAD = 1e-5, 1e-5
"""Largest error of the tool's pose at a keyframe, m and rad."""

RECEIVED_M, RECEIVED_RAD = 1e-3, 2e-3
"""Largest error of the tool's pose, m and rad, at a keyframe that an exported motion passes between two of its points.
The planner's own smoothing may cut a bend by 1 mm; on an arm of half a metre that is 2 mrad."""

NO_LOAD = Load()


class TouchError(PlanError):
    """The motion would touch something: the fields `bodies` (names) and `t` (s) say what and when."""


@dataclass(frozen=True)
class AuditReport:
    """How much of the limits a sound trajectory uses, and how exact it is.

    Attributes:
        velocity, acceleration, jerk: largest used share of the limit, over joints and time.
        max_position_error_m, max_rotation_error_rad: largest errors of the tool's pose at a keyframe.
        torque: the largest share of a joint's torque limit. It may be above 1: the caller decides, by the source of
            the limit, whether to warn or to refuse. None where no limit is known.
    """

    velocity: float
    acceleration: float
    jerk: float
    max_position_error_m: float
    max_rotation_error_rad: float
    torque: Torque | None


def audit(
    trajectory: JointTrajectory,
    robot: Robot,
    T_base_tool_keyframes: Sequence[Pose],
    world: tuple[Calibration, GraspedObject | None] | None = None,
    load: Load = NO_LOAD,
    grips: Sequence[bool | None] | None = None,
) -> AuditReport:
    """Check a trajectory.

    Args:
        trajectory: what the planner made.
        robot: its full limits are checked, even if the planner used a share of them.
        T_base_tool_keyframes: the tool's required poses at `trajectory.keyframe_t`.
        world: the calibration, with the obstacles, and the grasped object; None: contacts are allowed.
        load: what the tool carries; it counts for the torques only.
        grips: for each keyframe whether the gripper closes there (True), opens (False) or stays; None: not checked.

    Raises:
        PlanError: a check fails; the fields are joint, keyframe, t (s), value, bound and bodies, as they apply.
        TouchError: the motion would touch something; the fields are the same.
    """
    _check_form(trajectory, robot, len(T_base_tool_keyframes))
    check_smoothness(trajectory, robot.limits)
    shares = check_limits(trajectory, robot.limits)
    check_samples(trajectory, robot.limits)
    errors = _check_poses(trajectory, _arm(robot), T_base_tool_keyframes)
    if grips is not None:
        check_grips(trajectory, robot, grips)
    if world is not None:
        scene = _scene(robot, *world)
        if (touch := find_touch(scene.arm, trajectory, scene.pairs(trajectory))) is not None:
            first, second = touch.bodies
            keyframe, last = int(np.searchsorted(trajectory.keyframe_t, touch.t)), len(trajectory.keyframe_t) - 1
            where = f"on the way to keyframe {keyframe}" if keyframe <= last else f"after keyframe {last}"
            # No bug report is asked for: the planner's list of pairs may leave out pairs that the audit checks.
            raise TouchError(
                f"audit: {where} (t = {touch.t:.2f} s) {first} would touch {second}; move the dock or what stands in "
                "the way, turn the hand differently there, or look at it with pbd replay --allow-collision",
                keyframe=keyframe,
                t=touch.t,
                bodies=touch.bodies,
            )
    return AuditReport(*shares, *errors, torque_of(trajectory, robot, load))


def audit_received(path: JointTrajectory, robot: Robot, world: tuple[Calibration, GraspedObject | None]) -> None:
    """Check an exported motion as its receiver interpolates it: keyframes and contacts, but not limits.

    Args:
        path: the interpolated motion, whose pieces may meet at an angle. At `keyframe_t` it must be at `keyframe_q`.
        robot: the arm.
        world: the calibration, with the obstacles, and the grasped object.

    Raises:
        PlanError: a keyframe is missed by more than RECEIVED_M or RECEIVED_RAD.
        TouchError: something would be touched.
    """
    arm, x = _arm(robot), coordinates(path, path.keyframe_t)
    for keyframe, (at, q) in enumerate(zip(x, path.keyframe_q, strict=True)):
        off_m, off_rad = arm.tool_pose(at).distance(arm.tool_pose(np.append(q, at[-1])))
        if off_m > RECEIVED_M or off_rad > RECEIVED_RAD:
            off = f"{1e3 * off_m:.1f} mm and {np.degrees(off_rad):.2f} degrees"
            what = f"between the exported points keyframe {keyframe} would be missed by {off}"
            raise PlanError(what, keyframe=keyframe, value=off_m, bound=RECEIVED_M, rotation=off_rad)
    scene = _scene(robot, *world)
    if (touch := find_touch(scene.arm, path, scene.pairs(path))) is not None:
        first, second = touch.bodies
        what = f"between the exported points {first} would touch {second} at {touch.t:.2f} s"
        raise TouchError(what, t=touch.t, bodies=touch.bodies)


def torque_of(trajectory: JointTrajectory, robot: Robot, load: Load, pace: float = 1.0) -> Torque | None:
    """Return the largest share of a torque limit (`find_torque`); None where no limit is known."""
    effort = robot.limits.effort
    return None if effort is None else find_torque(_arm(robot), trajectory, load, effort, pace)


@cached_by_thread
def _arm(robot: Robot) -> AuditArm:
    return AuditArm(robot)


@cached_by_thread
def _scene(robot: Robot, calibration: Calibration, grasped: GraspedObject | None) -> AuditScene:
    return AuditScene(_arm(robot), calibration, grasped)


def _check_form(trajectory: JointTrajectory, robot: Robot, keyframes: int) -> None:
    knots, opening = trajectory.knots, trajectory.gripper_opening
    if trajectory.joint_names != robot.joints:
        fail(f"the trajectory moves {trajectory.joint_names}, the robot's joints are {robot.joints}")
    if len(trajectory.keyframe_t) != keyframes:
        fail(f"the trajectory has {len(trajectory.keyframe_t)} keyframes instead of {keyframes}")
    arrays = (knots, trajectory.coefficients, trajectory.gripper_t, opening, trajectory.keyframe_t)
    if not all(np.isfinite(array).all() for array in arrays):
        fail("the trajectory contains a number that is not finite")
    if len(knots) < 2 or knots[0] != 0.0 or (np.diff(knots) <= 0.0).any():
        fail("the trajectory's segments do not join up from t = 0")
    if (np.diff(trajectory.keyframe_t) < 0.0).any():
        fail("the keyframes are not in their order")
    if (np.diff(trajectory.gripper_t) < 0.0).any() or (opening < 0.0).any() or (opening > 1.0).any():
        fail("the gripper's times decrease, or its opening is outside 0 to 1")


def _check_poses(trajectory: JointTrajectory, arm: AuditArm, required: Sequence[Pose]) -> tuple[float, float]:
    """Return the tool's largest error at the keyframes, m and rad, computed from the whole URDF."""
    worst_m = worst_rad = 0.0
    x, qd = coordinates(trajectory, trajectory.keyframe_t), joint_motion(trajectory, trajectory.keyframe_t)[1]
    for keyframe, (t, pose) in enumerate(zip(trajectory.keyframe_t, required, strict=True)):
        where = f"at keyframe {keyframe} ({t:.3f} s)"
        if not np.abs(x[keyframe, :-1] - trajectory.keyframe_q[keyframe]).max() <= JUMP_RAD:
            fail(f"{where} the joints differ from the planned ones", keyframe=keyframe)
        if (np.abs(qd[keyframe]) > ROUNDING * arm.robot.limits.velocity).any():
            fail(f"{where} the arm does not rest", keyframe=keyframe)
        position, rotation = pose.distance(arm.tool_pose(x[keyframe]))
        if position > POSE_TOLERANCE_M or rotation > POSE_TOLERANCE_RAD:
            fail(
                f"{where} the tool is {position:.3g} m and {rotation:.3g} rad off its pose",
                keyframe=keyframe,
                t=float(t),
                value=position,
                bound=POSE_TOLERANCE_M,
            )
        worst_m, worst_rad = max(worst_m, position), max(worst_rad, rotation)
    return worst_m, worst_rad
