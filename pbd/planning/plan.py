"""The second verb: `plan` turns a hand path into a joint trajectory that has passed the audit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

from pbd.calibration.frames import nav_in_base, tool_poses, with_table
from pbd.data import Calibration, GraspedObject, HandPath, JointTrajectory, Keyframe, Robot
from pbd.errors import CalibrationError, PbdError, PlanError
from pbd.pipeline import track
from pbd.planning.advice import advised, works
from pbd.planning.checks import refuse_few, refuse_one_place, refuse_unsure, start_joints, warn_of_shapes, warn_of_table
from pbd.planning.options import PlanOptions, dwells
from pbd.planning.steps import choose, find_passage, hand_between, moves_of, retreat_of
from pbd.planning.values import Plan, find_stretched, find_touching
from pbd.pose import Array, Pose
from pbd.tracking.keyframes import keyframes_of

if TYPE_CHECKING:
    from pbd.arm.model import ArmModel
    from pbd.arm.scene import CollisionScene


def plan(
    hand_path: HandPath, calibration: Calibration, robot: Robot, options: PlanOptions | None = None
) -> JointTrajectory:
    """Plan the motion of a robot through the keyframes of a hand path, audited; see `plan_path`."""
    made = plan_path(hand_path, calibration, robot, options)
    if made.touching is not None:
        raise made.touching.error  # a trajectory can't say that it touches something
    return made.trajectory


def plan_path(hand_path: HandPath, calibration: Calibration, robot: Robot, options: PlanOptions | None = None) -> Plan:
    """Plan as the commands do: edited keyframes with their dwells, the grasped object, known places in base.

    A path that was tracked without a calibration is tracked again with this one where that tells tracking more: what
    the sensor reads wrongly, or where known places and the table are. (So what a program changed in a path with
    `dataclasses.replace` counts if its `tracking` is None.)

    Raises:
        TrackingError: fewer than two stops, or all at one place.
        CalibrationError: the calibration is for other robots.
        PlanError: a keyframe is out of reach, something is in the way, or the motion breaks a limit.
    """
    options = options or PlanOptions()
    hand_path = _tracked_with(hand_path, calibration, robot)
    demo = None if hand_path.tracking is None else hand_path.tracking.demo
    if demo is not None and demo.keyframes is not None and options.dwell_s is None:
        options = replace(options, dwell_s=math.inf)  # a person has said how long
    grasped = None if demo is None else demo.grasped
    return plan_keyframes(keyframes_of(hand_path), calibration, robot, options, hand_path, grasped)


def _tracked_with(path: HandPath, calibration: Calibration, robot: Robot) -> HandPath:
    """The path as tracked with this calibration and the robot's table, unless another was named when it was tracked."""
    made, own = path.tracking, with_table(calibration, robot)
    if made is None or made.calibration is own or made.calibration not in (None, calibration):
        return path
    corrects = made.calibration is None and own.sensor is not None
    places = made.method != "paper" and bool(made.demo.places or made.demo.contacts)
    if not (corrects or places):
        return path
    return track(made.demo, made.method, calibration=own, accept_gap=made.accept_gap)


def plan_keyframes(
    keyframes: Sequence[Keyframe],
    calibration: Calibration,
    robot: Robot,
    options: PlanOptions | None = None,
    hand_path: HandPath | None = None,
    grasped: GraspedObject | None = None,
) -> Plan:
    """Plan the motion of a robot through keyframes, whatever they are of; raises as `plan_path` does.

    A refusal names other options where they were tried and work.

    Args:
        keyframes: of a demonstration.
        calibration: where it lies in the robot's base, and what stands there.
        robot: which.
        options: what the user chose.
        hand_path: how the hand went between the keyframes; without it that is never followed.
        grasped: what the gripper takes.
    """
    options = options or PlanOptions()

    def made(chosen: PlanOptions) -> Plan:
        return _made(keyframes, calibration, robot, chosen, hand_path, grasped)

    try:
        return made(options)
    except PbdError as error:
        raise advised(error, made, options) from None


def can_plan(
    plan: Plan, robot: Robot, options: PlanOptions, hand_path: HandPath, grasped: GraspedObject | None
) -> bool:
    """Whether what was planned can be planned with other options too."""

    def made(chosen: PlanOptions) -> Plan:
        return _made(plan.keyframes, plan.calibration, robot, chosen, hand_path, grasped)

    return works(made, options)


def _made(
    keyframes: Sequence[Keyframe],
    calibration: Calibration,
    robot: Robot,
    options: PlanOptions,
    hand_path: HandPath | None,
    grasped: GraspedObject | None,
) -> Plan:
    from pbd.arm.relax import hold
    from pbd.arm.timing import time_moves
    from pbd.audit.audit import audit

    calibration = with_table(calibration, robot)
    if options.path == "demo" and hand_path is None:
        raise PlanError("only the keyframes are known, not the hand's path; choose another --path")
    refuse_few(keyframes)
    refuse_unsure(keyframes, options.scale * calibration.scale)
    arm = arm_of(robot)
    T_base_nav, T_base_tool = place(arm, keyframes, calibration, options)
    if options.path != "demo":
        refuse_one_place(T_base_tool)
    q_start = start_joints(arm, options)
    scene = scene_of(arm, calibration, grasped)
    warn_of_shapes(arm)
    warn_of_table(scene)
    hand = hand_between(hand_path, keyframes, T_base_nav, calibration, options)
    try:
        passage = find_passage(scene, T_base_tool, keyframes, options, q_start)
        chosen = choose(arm, T_base_tool, q_start, hand, options, passage)
    except PlanError as error:
        if not options.allow_collision or "bodies" not in error.fields:
            raise
        chosen = choose(arm, T_base_tool, q_start, hand, options, None)
    held = hold(arm, T_base_tool, chosen.q)
    timed = time_moves(
        arm,
        q_start if options.approach else chosen.q[0],
        moves_of(chosen, keyframes, hand, options),
        dwells(keyframes, options),
        [keyframe.grip for keyframe in keyframes],
        retreat=retreat_of(chosen),
        speed=options.speed,
    )
    world = None if options.allow_collision else (calibration, grasped)
    report = audit(timed.trajectory, robot.limits, robot, held.T_base_tool, world)
    return Plan(
        tuple(keyframes),
        calibration,
        T_base_nav,
        T_base_tool,
        held.off_rad,
        chosen.ways,
        timed.trajectory,
        report,
        find_stretched(timed, keyframes) if options.time == "demo" else (),
        find_touching(scene, timed.trajectory) if options.allow_collision else None,
    )


def solve_keyframes(
    robot: Robot, keyframes: Sequence[Keyframe], calibration: Calibration, options: PlanOptions
) -> tuple[tuple[Pose, ...], Array, Array]:
    """Find joints for keyframes, whatever is in the way between them.

    Returns:
        The tool's pose in base at each keyframe, the joints (n, k) that reach them, and how far off (n, 2, rad) an arm
        with too few joints holds the tool: approach axis, and about it.
    """
    from pbd.arm.relax import hold

    arm = arm_of(robot)
    _, T_base_tool = place(arm, keyframes, calibration, options)
    q = choose(arm, T_base_tool, start_joints(arm, options), None, PlanOptions(), None).q
    return T_base_tool, q, hold(arm, T_base_tool, q).off_rad


def place(
    arm: ArmModel, keyframes: Sequence[Keyframe], calibration: Calibration, options: PlanOptions
) -> tuple[Pose, tuple[Pose, ...]]:
    """Return T_base_nav and the tool's pose in base at each keyframe."""
    if calibration.robots and arm.robot.name not in calibration.robots:
        raise CalibrationError(
            f"the calibration '{calibration.name}' is for {', '.join(calibration.robots)}, not for {arm.robot.name}; "
            "choose another, or add the robot to it",
            value=arm.robot.name,
        )
    T_base_nav = nav_in_base(calibration, keyframes[0].T_nav_sensor.wxyz)
    return T_base_nav, tool_poses(keyframes, T_base_nav, calibration, options.scale, options.orientation)


@lru_cache(maxsize=8)
def arm_of(robot: Robot) -> ArmModel:
    """Load a robot's model, once."""
    from pbd.arm.model import load_model

    return load_model(robot)


@lru_cache(maxsize=8)
def scene_of(arm: ArmModel, calibration: Calibration, grasped: GraspedObject | None) -> CollisionScene:
    """Build a collision scene, once."""
    from pbd.arm.scene import CollisionScene

    return CollisionScene.build(arm, calibration, grasped)
