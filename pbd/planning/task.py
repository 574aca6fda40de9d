"""The steps of planning, each from the values of the step before; slow imports are made where they are used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

from pbd.calibration.dock import in_base
from pbd.calibration.touch_up import touched_poses
from pbd.data import Calibration, GraspedObject, HandPath, Keyframe, Robot
from pbd.errors import CalibrationError
from pbd.planning.object_frames import place_things
from pbd.planning.options import PlanOptions
from pbd.pose import Array, Pose

if TYPE_CHECKING:
    from pbd.arm.collision.scene import CollisionScene
    from pbd.arm.model import ArmModel
    from pbd.arm.motion_request import Motion, MotionRequest
    from pbd.arm.timing.time_moves import Move
    from pbd.calibration.demonstrated_path import DemonstratedMove

    Hand = Callable[[], Sequence[DemonstratedMove]]


def load_robot_and_calibration(robot: str, calibration: str | None = None) -> tuple[Robot, Calibration]:
    """Load a robot, and its calibration: the one named, else the robot's own dock, else the default.

    Raises:
        RobotError, CalibrationError: one can't be loaded.
    """
    from pbd.calibration.tool_poses import with_table
    from pbd.files.calibration import load_calibration
    from pbd.files.robot import load_robot

    loaded = load_robot(robot)
    if calibration is None and loaded.dock is not None:
        return loaded, loaded.dock
    return loaded, with_table(load_calibration(calibration or "default"), loaded)


def request_of(
    arm: ArmModel,
    T_base_tool: Sequence[Pose],
    q_start: Array,
    hand: Hand | None,
    options: PlanOptions,
    grips: Sequence[bool | None] = (),
) -> MotionRequest:
    """Make the request for a motion from the options."""
    from pbd.arm.motion_request import DEMO, LINE, STRAIGHT, MotionRequest

    return MotionRequest(
        T_base_tool,
        q_start,
        options.approach,
        arm.robot.home if options.retreat else None,
        {"keyframes": STRAIGHT, "line": LINE, "demo": DEMO}[options.path],
        hand and (lambda: [move.T_base_tool for move in hand()]),
        options.tolerance_m,
        options.detour,
        grips,
    )


def moves_of(
    chosen: Motion, durations_s: Sequence[float], hand: Hand | None, options: PlanOptions
) -> tuple[list[Move], Move | None]:
    """Make the moves of the segments, which time_moves.py times, and the retreat or None.

    Args:
        durations_s: the time that the hand took from each keyframe to the next.
    """
    from pbd.arm.motion_request import DEMO
    from pbd.arm.timing.time_moves import APPROACH_SPEED, Move

    first, retreat = chosen.segments[0], chosen.retreat
    moves = [Move(first.q, first.curved, share=APPROACH_SPEED)]
    for i, (segment, demonstrated_s) in enumerate(zip(chosen.segments[1:], durations_s, strict=True)):
        least_s = demonstrated_s if options.time == "demo" else 0.0
        t = hand()[i].t if options.time == "demo" and segment.kind == DEMO and hand else None
        moves.append(Move(segment.q, curved=segment.curved, t=t, least_s=least_s))
    return moves, None if retreat is None else Move(retreat.q, retreat.curved, share=APPROACH_SPEED)


class Task(NamedTuple):
    """The arguments of `plan_keyframes` without the options."""

    keyframes: tuple[Keyframe, ...]
    calibration: Calibration
    robot: Robot
    hand_path: HandPath | None
    grasped: GraspedObject | None


def place_keyframes(task: Task, options: PlanOptions) -> tuple[Pose, tuple[Pose, ...]]:
    """Return T_base_nav and the tool's pose in base at each keyframe, with nudges, touch-ups and places of things."""
    keyframes, calibration, robot, path, _ = task
    if calibration.robots and robot.name not in calibration.robots:
        raise CalibrationError(
            f"the calibration '{calibration.name}' is for {', '.join(calibration.robots)}, not for {robot.name}; "
            "choose another, or add the robot to it",
            value=robot.name,
        )
    placed = in_base(keyframes, calibration, options.scale, path, options.orientation)
    return placed.T_base_nav, place_things(touched_poses(placed), keyframes, options.at)


@lru_cache(maxsize=16)
def arm_of(robot: Robot) -> ArmModel:
    """Load a robot's model; cached."""
    from pbd.arm.model import load_model

    return load_model(robot)


@lru_cache(maxsize=16)
def scene_of(arm: ArmModel, calibration: Calibration, grasped: GraspedObject | None) -> CollisionScene:
    """Build a collision scene; cached."""
    from pbd.arm.collision.scene import CollisionScene

    return CollisionScene(arm, calibration.table_height, calibration.obstacles, grasped)
