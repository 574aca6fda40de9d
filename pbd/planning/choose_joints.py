"""Choose joints and segments for keyframes, or say why there are none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from pbd.data import Calibration, HandPath, Keyframe, Robot
from pbd.errors import PbdError, PlanError
from pbd.planning.options import PlanOptions
from pbd.planning.preconditions import (
    check_certainty,
    check_count,
    spread_error,
    warn_of_frames,
    warn_of_shapes,
    warn_of_table,
)
from pbd.planning.task import PlanningTask
from pbd.planning.undo_corrections_advice import undo_advice
from pbd.pose import Array, Pose

if TYPE_CHECKING:
    from pbd.arm.collision.scene import CollisionScene
    from pbd.arm.motion_request import Motion
    from pbd.arm.refusal import Refusal


class PlanRefusal(NamedTuple):
    """Why there is no plan, and other options that may give one, each with its description."""

    error: PbdError
    alternatives: tuple[tuple[str, PlanOptions], ...] = ()


def choose_joints(task: PlanningTask) -> Motion | PlanRefusal:
    """Choose joints and segments, without timing; refuse what no motion can be planned for, and warn of doubts."""
    options = task.options
    if options.path == "demo" and task.hand_path is None:
        raise PlanError("only the keyframes are known, not the hand's path; choose another --path")
    check_count(task.keyframes)
    check_certainty(task.keyframes, options.scale * task.calibration.scale, task.hand_path)
    request = task.request  # refuses the calibration of another robot, and a start outside the limits
    if options.path != "demo" and (error := spread_error(request.T_base_tool)) is not None:
        demo = replace(options, path="demo", tolerance_m=None)
        return PlanRefusal(error, (("follow the hand with --path demo", demo),))
    warn_of_shapes(task.arm)
    warn_of_frames(task.arm)
    warn_of_table(task.scene)
    chosen = None if task.no_free_motion else _choose(task, task.scene)
    if chosen is None or (isinstance(chosen, PlanRefusal) and options.allow_collision):
        return _choose(task, None)
    return chosen


def _choose(task: PlanningTask, scene: CollisionScene | None) -> Motion | PlanRefusal:
    """Choose joints and segments; without a scene, collisions are ignored."""
    from pbd.arm.choose_motion import choose_motion
    from pbd.arm.collision.motion_check import MOVE_ARM, refuse_home, where_it_stands
    from pbd.arm.motion_request import Motion

    options, request = task.options, task.request
    if scene is not None:
        if options.retreat or (options.approach and options.start is None):
            try:
                refuse_home(scene)
            except PlanError as error:
                return PlanRefusal(error, (_without_home(options),))
        grasp, *_ = scene.grasp_states(request.T_base_tool, request.grips)
        if options.approach and (hit := scene.hit(request.q_start, grasp)) is not None:
            what = f"at the arm's start: {hit}; {where_it_stands(scene, hit, MOVE_ARM)}"
            return PlanRefusal(PlanError(what, **hit.fields))
    found = choose_motion(task.arm, request, scene)
    return found if isinstance(found, Motion) else PlanRefusal(found.error, _alternatives(found, options))


def _without_home(options: PlanOptions) -> tuple[str, PlanOptions]:
    if options.approach and options.start is None:
        what = "skip home (--no-approach --no-retreat), or start elsewhere (--from, --no-retreat)"
        return what, replace(options, approach=False, retreat=False)
    return "do not go back home (--no-retreat)", replace(options, retreat=False)


def _alternatives(refusal: Refusal, options: PlanOptions) -> tuple[tuple[str, PlanOptions], ...]:
    from pbd.arm.motion_request import STRAIGHT
    from pbd.arm.refusal import CANNOT_FOLLOW, COLLISION

    others: tuple[tuple[str, PlanOptions], ...] = ()
    if refusal.why == CANNOT_FOLLOW or refusal.error.fields.get("closest", STRAIGHT) != STRAIGHT:
        straight = replace(options, path="keyframes", tolerance_m=None)
        if straight != options:
            what = "leave out --path-tolerance" if options.path == "keyframes" else "use --path keyframes"
            others += ((what, straight),)
    if refusal.why == COLLISION:
        others += (("view the motion with pbd replay --allow-collision", replace(options, allow_collision=True)),)
    return others


def solve_keyframes(
    robot: Robot,
    keyframes: Sequence[Keyframe],
    calibration: Calibration,
    options: PlanOptions,
    hand_path: HandPath | None = None,
) -> tuple[tuple[Pose, ...], Array, Array]:
    """Find joints for keyframes, without collision checks.

    Returns:
        The tool's pose in base at each keyframe; the joints (n, k) there; and the rotation errors (n, 2), rad, of an
        arm with too few joints: of the approach axis, and of the rotation about it.
    """
    from pbd.arm.choose_motion import choose_motion
    from pbd.arm.ik.partial_pose import held_poses
    from pbd.arm.motion_request import Motion

    def solved(task: PlanningTask) -> Motion | Refusal:
        return choose_motion(task.arm, task.request, None)

    straight = replace(options, path="keyframes", tolerance_m=None)
    task = PlanningTask(tuple(keyframes), calibration, robot, hand_path, None, straight)
    found = solved(task)
    if not isinstance(found, Motion):
        advice = undo_advice(task, found.error, lambda without: isinstance(solved(without), Motion))
        raise PlanError(", or ".join((found.error.message, *advice)), **found.error.fields)
    return task.T_base_tool, found.q, held_poses(task.arm, task.T_base_tool, found.q)[1]
