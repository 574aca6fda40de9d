"""Whether a trajectory keeps its promises, worked out anew from its pieces: nothing is shown or written unaudited.

This file and the others named audit_*.py share nothing with those that plan but the URDF and the robot's, calibration's
and demonstration's values. Extrema are found at the roots of each cubic piece's derivatives; the 1 kHz samples, which
others get to see, are differenced; poses come from pinocchio's model of the whole URDF; audit_collision.py looks for
contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NoReturn

import numpy as np

from pbd.arm.audit_arm import AuditArm
from pbd.arm.audit_collision import Touch, find_touch
from pbd.arm.audit_pairs import AuditScene
from pbd.data import Calibration, GraspedObject, JointLimits, JointTrajectory, Robot
from pbd.errors import PlanError
from pbd.pose import Array, Pose

POSE_TOLERANCE_M = 1e-5
POSE_TOLERANCE_RAD = 1e-5
RELATIVE = 1e-6
"""The share of a limit by which rounding may go beyond it, or a velocity or acceleration may jump."""
JUMP_RAD = 1e-9
"""By how much a position may jump between pieces."""

_NAMES = ("position", "velocity", "acceleration", "jerk")
_UNITS = ("rad", "rad/s", "rad/s2", "rad/s3")
_NEXT = "no trajectory was written; please report it with the demonstration and the robot's TOML"


@dataclass(frozen=True)
class AuditReport:
    """What a sound trajectory uses of what it may use.

    Attributes:
        velocity, acceleration, jerk: the largest fraction of the limit, over joints and time.
        max_position_error_m, max_rotation_error_rad: from the tool to the wanted pose, over the keyframes.
    """

    velocity: float
    acceleration: float
    jerk: float
    max_position_error_m: float
    max_rotation_error_rad: float


def audit(
    trajectory: JointTrajectory,
    limits: JointLimits,
    robot: Robot,
    T_base_tool_keyframes: Sequence[Pose],
    world: tuple[Calibration, GraspedObject | None] | None = None,
) -> AuditReport:
    """Check a trajectory for its form, smoothness, joints' limits, the poses it is to reach, and what it might touch.

    Args:
        trajectory: what is to be shown or written.
        limits: of its joints: the whole of them, whatever share the planner was given.
        robot: whose URDF it is.
        T_base_tool_keyframes: the tool's poses at `trajectory.keyframe_t`.
        world: what stands around, and what is grasped; None: touching is allowed.

    Raises:
        PlanError: a promise is broken; its fields are joint, keyframe, t (s), value, bound and bodies, as they apply.
    """
    _check_form(trajectory, robot, len(T_base_tool_keyframes))
    bounds = np.stack((limits.velocity, limits.acceleration, limits.jerk))
    _check_smoothness(trajectory, bounds)
    _check_positions(trajectory, limits)
    velocity, acceleration, jerk = _check_derivatives(trajectory, bounds)
    _check_samples(trajectory, bounds)
    position, rotation = _check_poses(trajectory, _arm(robot), T_base_tool_keyframes)
    if world is not None:
        scene = _scene(robot, *world)
        touch = find_touch(scene.arm, trajectory, scene.pairs(trajectory))
        if touch is not None:
            _refuse(trajectory, touch)
    return AuditReport(velocity, acceleration, jerk, position, rotation)


@lru_cache(maxsize=4)
def _arm(robot: Robot) -> AuditArm:
    return AuditArm(robot)


@lru_cache(maxsize=4)
def _scene(robot: Robot, calibration: Calibration, grasped: GraspedObject | None) -> AuditScene:
    return AuditScene(_arm(robot), calibration, grasped)


def _check_form(trajectory: JointTrajectory, robot: Robot, keyframes: int) -> None:
    knots, opening = trajectory.knots, trajectory.gripper_opening
    if trajectory.joint_names != robot.joints:
        _fail(f"the trajectory moves {trajectory.joint_names}, the robot's joints are {robot.joints}")
    if len(trajectory.keyframe_t) != keyframes:
        _fail(f"the trajectory has {len(trajectory.keyframe_t)} keyframes instead of {keyframes}")
    arrays = (knots, trajectory.coefficients, trajectory.gripper_t, opening, trajectory.keyframe_t)
    if not all(np.isfinite(array).all() for array in arrays):
        _fail("the trajectory contains a number that is not finite")
    if len(knots) < 2 or knots[0] != 0.0 or (np.diff(knots) <= 0.0).any():
        _fail("the trajectory's segments do not join up from t = 0")
    if (np.diff(trajectory.gripper_t) < 0.0).any() or (opening < 0.0).any() or (opening > 1.0).any():
        _fail("the gripper's times decrease, or its opening is outside 0 to 1")


def _check_smoothness(trajectory: JointTrajectory, bounds: Array) -> None:
    """No jump in position, velocity or acceleration between pieces, and rest at both ends."""
    rest = np.zeros_like(bounds[0])
    begin = _derivatives(trajectory, np.zeros(len(trajectory.coefficients)))
    end = _derivatives(trajectory, np.diff(trajectory.knots))
    for order in range(3):
        bound = np.full_like(rest, JUMP_RAD) if order == 0 else RELATIVE * bounds[order - 1]
        outer = (begin[0, :1], end[0, -1:]) if order == 0 else (rest[None], rest[None])
        jumps = np.vstack((begin[order], outer[1])) - np.vstack((outer[0], end[order]))
        i, joint = _worst(np.abs(jumps) / bound)
        if abs(jumps[i, joint]) > bound[joint]:
            what = f"jumps by {jumps[i, joint]:.3g} {_UNITS[order]} in {_NAMES[order]}"
            _break(trajectory, joint, trajectory.knots[i], what, jumps[i, joint], bound[joint])


def _check_positions(trajectory: JointTrajectory, limits: JointLimits) -> None:
    """Positions at the ends of each piece and wherever its velocity is zero."""
    duration = np.diff(trajectory.knots)[:, None]
    _, c1, c2, c3 = np.moveaxis(trajectory.coefficients, 1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        # c1 + 2 c2 s + 3 c3 s^2 = 0, in the form that loses no digits and takes c3 = 0
        w = -(c2 + np.copysign(np.sqrt(c2**2 - 3.0 * c3 * c1), c2))
        roots = (w / (3.0 * c3), c1 / w)
    for s in (0.0 * c1, duration + 0.0 * c1, *(_within(root, duration) for root in roots)):
        q = _derivatives(trajectory, s)[0]
        for sign, bound in ((-1.0, limits.lower), (1.0, limits.upper)):
            beyond = sign * (q - bound)
            i, joint = _worst(beyond)
            if beyond[i, joint] > RELATIVE:
                what = f"is at {q[i, joint]:.6g} rad, beyond its limit of {bound[joint]:.6g} rad,"
                _break(trajectory, joint, trajectory.knots[i] + s[i, joint], what, q[i, joint], bound[joint])


def _check_derivatives(trajectory: JointTrajectory, bounds: Array) -> list[float]:
    """Velocity at the ends of each piece and where its acceleration is zero; acceleration and jerk at the ends."""
    duration = np.diff(trajectory.knots)[:, None]
    _, c1, c2, c3 = np.moveaxis(trajectory.coefficients, 1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        root = _within(-c2 / (3.0 * c3), duration)
    fractions = [0.0, 0.0, 0.0]
    for s in (0.0 * c1, duration + 0.0 * c1, root):
        for order, values in enumerate(_derivatives(trajectory, s)[1:]):
            share = np.abs(values) / bounds[order]
            i, joint = _worst(share)
            if share[i, joint] > 1.0 + RELATIVE:
                t = trajectory.knots[i] + s[i, joint]
                _exceed(trajectory, joint, t, order, values[i, joint], bounds[order, joint])
            fractions[order] = max(fractions[order], float(share[i, joint]))
    return fractions


def _check_samples(trajectory: JointTrajectory, bounds: Array) -> None:
    """What the samples at 1 kHz say by their differences: they can't change faster than the limits let them."""
    dt = np.diff(trajectory.t)[:, None]
    for order, values in enumerate((trajectory.q, trajectory.qd, trajectory.qdd)):
        rates = np.diff(values, axis=0) / dt
        share = np.abs(rates) / bounds[order]
        # A difference of two numbers is known to their last digits only.
        rounding = 4.0 * np.finfo(np.float64).eps * np.abs(values).max(axis=0) / (dt * bounds[order])
        i, joint = _worst(share - rounding)
        if (share - rounding)[i, joint] > 1.0 + RELATIVE:
            _exceed(trajectory, joint, float(trajectory.t[i]), order, rates[i, joint], bounds[order, joint])


def _check_poses(trajectory: JointTrajectory, arm: AuditArm, wanted: Sequence[Pose]) -> tuple[float, float]:
    """Where the tool is at each keyframe's time, by the model of the whole URDF."""
    piece = np.clip(np.searchsorted(trajectory.knots, trajectory.keyframe_t) - 1, 0, len(trajectory.coefficients) - 1)
    worst_m = worst_rad = 0.0
    for keyframe, (t, pose, i) in enumerate(zip(trajectory.keyframe_t, wanted, piece, strict=True)):
        s = t - trajectory.knots[i]
        q = np.array([1.0, s, s**2, s**3]) @ trajectory.coefficients[i]
        if not np.abs(q - trajectory.keyframe_q[keyframe]).max() <= JUMP_RAD:
            _fail(f"at keyframe {keyframe} ({t:.3f} s) the joints differ from the planned ones", keyframe=keyframe)
        position, rotation = pose.distance(arm.tool(q).pose())
        if position > POSE_TOLERANCE_M or rotation > POSE_TOLERANCE_RAD:
            _fail(
                f"at keyframe {keyframe} ({t:.3f} s) the tool is {position:.3g} m and {rotation:.3g} rad off its pose",
                keyframe=keyframe,
                t=float(t),
                value=position,
                bound=POSE_TOLERANCE_M,
            )
        worst_m, worst_rad = max(worst_m, position), max(worst_rad, rotation)
    return worst_m, worst_rad


def _refuse(trajectory: JointTrajectory, touch: Touch) -> NoReturn:
    """Tell what touches: the planner sees to it that nothing does, but for what its own list leaves out."""
    first, second = touch.bodies
    keyframe = int(np.searchsorted(trajectory.keyframe_t, touch.t))
    last = len(trajectory.keyframe_t) - 1
    where = f"on the way to keyframe {keyframe}" if keyframe <= last else f"after keyframe {last}"
    raise PlanError(
        f"audit: {where} (t = {touch.t:.2f} s) {first} would touch {second}; move the dock or what stands in the way,"
        " turn the hand differently there, or look at it with --allow-collision",
        keyframe=keyframe,
        t=touch.t,
        bodies=touch.bodies,
    )


def _derivatives(trajectory: JointTrajectory, s: Array) -> Array:
    """Return (4, m, k): q, qd, qdd, qddd of each piece at s (m,) or (m, k) seconds from its beginning."""
    c0, c1, c2, c3 = np.moveaxis(trajectory.coefficients, 1, 0)
    s = s[:, None] if s.ndim == 1 else s
    velocity, acceleration = c1 + 2.0 * c2 * s + 3.0 * c3 * s**2, 2.0 * c2 + 6.0 * c3 * s
    return np.stack((c0 + c1 * s + c2 * s**2 + c3 * s**3, velocity, acceleration, 6.0 * c3))


def _within(s: Array, duration: Array) -> Array:
    """Put roots that lie outside their piece, or nowhere, at its ends, which are checked anyway."""
    inside: Array = np.clip(np.nan_to_num(s, nan=0.0), 0.0, duration)
    return inside


def _worst(values: Array) -> tuple[int, int]:
    i, joint = np.unravel_index(int(np.argmax(values)), values.shape)
    return int(i), int(joint)


def _exceed(trajectory: JointTrajectory, joint: int, t: float, order: int, value: float, bound: float) -> NoReturn:
    name, unit = _NAMES[order + 1], _UNITS[order + 1]
    _break(
        trajectory, joint, t, f"has {name} {value:.6g} {unit}, beyond its limit of {bound:.6g} {unit},", value, bound
    )


def _break(trajectory: JointTrajectory, joint: int, t: float, what: str, value: float, bound: float) -> NoReturn:
    name = trajectory.joint_names[joint]
    _fail(f"{name} {what} at {t:.3f} s", joint=name, t=float(t), value=float(value), bound=float(bound))


def _fail(what: str, **fields: object) -> NoReturn:
    raise PlanError(f"audit: {what}; {_NEXT}", **fields)
