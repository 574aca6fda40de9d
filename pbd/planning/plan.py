"""Plan: turn a hand path into a joint trajectory that has passed the audit."""

from __future__ import annotations

import math
import shlex
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pbd.calibration.tool_poses import with_table
from pbd.data import Calibration, GraspedObject, HandPath, JointTrajectory, Keyframe, Load, Robot
from pbd.data.keyframe import require_keyframes
from pbd.errors import PbdError, WrongValueError, collected_warnings, require_type, warn
from pbd.pipeline import track
from pbd.planning.choose_joints import PlanRefusal, choose_joints
from pbd.planning.object_frames import ThingPlace, keyframes_of_things, nearest_working_place
from pbd.planning.options import PlanOptions, dwells, hand_durations
from pbd.planning.preconditions import warn_of_wide_moves
from pbd.planning.result import Plan, find_stretched, find_touching
from pbd.planning.task import PlanningTask
from pbd.planning.torque import check_payload, check_torque
from pbd.planning.undo_corrections_advice import undo_advice
from pbd.pose import Array
from pbd.tracking.keyframes import keyframes_of

if TYPE_CHECKING:
    from pbd.arm.motion_request import Motion
    from pbd.arm.timing.time_moves import Move

DEVIATION_SHARES = 1.0, 0.1
"""Shares of the usual deviation from a curve; the second is tried if the motion touches something."""


def plan(
    hand_path: HandPath, calibration: Calibration, robot: Robot, options: PlanOptions | None = None
) -> JointTrajectory:
    """Plan the motion of a robot through the keyframes of a hand path, and audit it.

    The motion honours keyframes.toml, the dwells in it, the grasped object and places that are known in the robot's
    base, as `pbd replay` and `pbd export` do.

    Args:
        hand_path: what `pbd.track` returns. A path that was tracked without a calibration is tracked again with this
            one, if the calibration corrects the sensor's errors, or locates known places or the table.
        calibration: where the demonstration lies in the robot's base, the table and obstacles: `robot.dock`, or what
            `pbd.load_calibration` returns.
        robot: what `pbd.load_robot` returns.
        options: speed, path, payload, start and so on, as the commands' options; see `help(pbd.PlanOptions)`.

    Returns:
        The joint trajectory, which passed the audit: `t`, `q`, `qd`, `qdd` and `gripper` at 1 kHz, or `at` any time.

    Raises:
        TrackingError: fewer than two stops, or all at one place.
        CalibrationError: the calibration is for other robots, or known places fitted the path to another one.
        PlanError: a keyframe is out of reach, something is in the way, or the motion breaks a limit.
        WrongTypeError: an argument has the wrong type, for example a robot's name.
    """
    made = plan_path(hand_path, calibration, robot, options)
    if made.touching is not None:
        raise made.touching.error  # a JointTrajectory has no field for contacts
    return made.trajectory


def plan_path(hand_path: HandPath, calibration: Calibration, robot: Robot, options: PlanOptions | None = None) -> Plan:
    """Plan as `plan` does; return the path from keyframe to keyframe and the results of the audit too.

    With `options.allow_collision`, a motion that touches something is returned too, and says what it touches. A program
    that changes a hand path with `dataclasses.replace` must also set its `tracking` to None, so that its changes are
    kept.
    """
    require_type("plan", hand_path, "pbd.track", HandPath)
    _require_types(calibration, robot, options)
    options = options or PlanOptions()
    hand_path = _tracked_with(hand_path, calibration, robot)
    demo = None if hand_path.tracking is None else hand_path.tracking.demo
    if demo is not None and demo.keyframes is not None and options.dwell_s is None:
        options = replace(options, dwell_s=math.inf)  # keyframes.toml gives the dwells
    grasped = None if demo is None else demo.grasped
    return plan_keyframes(keyframes_of(hand_path), calibration, robot, options, hand_path, grasped)


def _require_types(calibration: Calibration, robot: Robot, options: PlanOptions | None) -> None:
    require_type("plan", calibration, "pbd.load_calibration", Calibration)
    require_type("plan", robot, "pbd.load_robot", Robot)
    require_type("plan", options, "pbd.PlanOptions", PlanOptions, optional=True)


def _tracked_with(path: HandPath, calibration: Calibration, robot: Robot) -> HandPath:
    """Track the path again with this calibration and the robot's table, if these may change the result.

    A path that was tracked with another calibration is kept.
    """
    made, own = path.tracking, with_table(calibration, robot)
    if made is None or made.calibration is own or made.calibration not in (None, calibration):
        return path
    corrects = made.calibration is None and own.sensor is not None
    known = [demo.places or demo.contacts for demo in (made.demo, *made.demo.takes)]
    places = made.method != "paper" and any(known)
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
    """Plan the motion of a robot through keyframes from any source; raises as `plan_path` does.

    The message of a refusal suggests other options that were tried and work.

    Args:
        keyframes: in the order of their times, which must increase.
        calibration: where the demonstration lies in the robot's base, and the table and obstacles.
        robot: what `pbd.load_robot` returns.
        options: as for `plan`.
        hand_path: the hand's path between the keyframes; None: unknown.
        grasped: the object that the grip closes on; None: none is known.
    """
    require_keyframes(keyframes)
    for before, after in pairwise(keyframes):
        if after.t <= before.t:
            what = f"a keyframe must be later than the one before ({before.t:g} s), got t = {after.t:g} s"
            raise WrongValueError(what, value=after.t, bound=before.t)
    _require_types(calibration, robot, options)
    require_type("plan_keyframes", hand_path, "pbd.track", HandPath, optional=True)
    require_type("plan_keyframes", grasped, "pbd.data.GraspedObject", GraspedObject, optional=True)
    if grasped is not None and not any(each.grip for each in keyframes):
        warn(
            f"the {grasped.shape} is left out, because the grip never closes: say where it does, by [[grip]] in "
            "demo.toml or grip in keyframes.toml"
        )
        grasped = None
    task = PlanningTask(
        tuple(keyframes), with_table(calibration, robot), robot, hand_path, grasped, options or PlanOptions()
    )
    found = plan_task(task)
    if isinstance(found, Plan):
        return found
    others = []
    for what, other in found.alternatives:
        searched = other.allow_collision and not task.options.allow_collision
        others += [what] if _works(replace(task, options=other, no_free_motion=searched)) else []
    others += _suggest_place(task, found.error)
    others += _suggest_scale(task, found.error)
    others += undo_advice(task, found.error, _works)
    raise type(found.error)(", or ".join((found.error.message, *others)), **found.error.fields)


def can_plan(plan: Plan, options: PlanOptions) -> bool:
    """Whether joints and segments for the same keyframes exist with other options; nothing is timed or audited."""
    task = PlanningTask(plan.keyframes, plan.calibration, plan.robot, plan.hand_path, plan.grasped, options)
    return _works(task, choose_joints)


def _suggest_place(task: PlanningTask, error: PbdError) -> list[str]:
    """Suggest a place that works for the thing to which the keyframe of the error belongs."""
    number, options = error.fields.get("keyframe"), task.options
    of = task.keyframes[number].frames if isinstance(number, int) else ()
    wanted = next((each for each in options.at if each.name in of), None)
    if wanted is None:
        return []
    others = [each for each in options.at if each is not wanted]

    def with_things_at(*places: ThingPlace) -> PlanningTask:
        return replace(task, options=replace(options, at=(*others, *places)))

    p_shown = with_things_at().T_base_tool[keyframes_of_things(task.keyframes)[wanted.name][0]].p
    found = nearest_working_place(wanted, p_shown, lambda place: _works(with_things_at(place)))
    return (
        []
        if found is None
        else [f"put the {wanted.name} nearer to where it was shown (--at {shlex.quote(str(found))} works)"]
    )


def _suggest_scale(task: PlanningTask, error: PbdError) -> list[str]:
    """Suggest the largest size, in percent of the present one, that works where a keyframe is out of reach."""

    def scale_at(percent: int) -> float:
        return float(f"{task.options.scale * percent / 100:.3g}")

    def fails(percent: int) -> bool:
        return not _works(replace(task, options=replace(task.options, scale=scale_at(percent))))

    largest = bisect_left(range(1, 100), True, key=fails) if "nearest" in error.fields else 0
    return [f"make the path smaller (--scale {scale_at(largest):g} works)"] if largest else []


def plan_task(task: PlanningTask) -> Plan | PlanRefusal:
    """Plan as `plan_keyframes` does, without trying other options after a refusal."""
    from pbd.arm.ik.partial_pose import held_poses
    from pbd.arm.timing.time_moves import time_moves
    from pbd.audit.audit import TouchError, audit, torque_of

    chosen = choose_joints(task)
    if isinstance(chosen, PlanRefusal):
        return chosen
    robot, options, arm = task.robot, task.options, task.arm
    warn_of_wide_moves(arm, chosen)
    held, off_rad = held_poses(arm, task.T_base_tool, chosen.q)
    durations_s = hand_durations(task.keyframes, task.hand_path)
    moves, retreat = _moves(task, chosen, durations_s)

    def timed_at(speed: float, deviation_share: float) -> tuple[JointTrajectory, Array]:
        return time_moves(
            arm,
            task.q_start if options.approach else chosen.q[0],
            moves,
            dwells(task.keyframes, options),
            task.request.grips,
            retreat=retreat,
            speed=speed * (1.0 - options.margin),
            deviation_share=deviation_share,
        )

    load = Load(options.payload, options.p_tool_payload, task.grasped, task.calibration.table_height)

    def share_at(speed: float) -> float:
        another, pace = (timed_at(speed, deviation_share)[0], 1.0) if speed else (trajectory, 0.0)
        torque = torque_of(another, robot, load, pace)
        return torque.share if torque else 0.0

    for deviation_share in DEVIATION_SHARES:
        trajectory, took = timed_at(options.speed, deviation_share)
        touching = find_touching(task.scene.closer(), trajectory) if options.allow_collision else None
        world = (task.calibration, task.grasped) if touching is None else None
        try:
            report = audit(trajectory, robot, held, world, load, task.request.grips)
            break
        except TouchError:
            if deviation_share == DEVIATION_SHARES[-1]:
                raise
    if (heavy := check_torque(report.torque, robot.limits, load, options, share_at)) is not None:
        return heavy
    check_payload(robot, load)
    return Plan(
        task.keyframes,
        task.calibration,
        robot,
        task.hand_path,
        task.grasped,
        options,
        task.placed,
        task.T_base_tool,
        off_rad,
        chosen.segments,
        trajectory,
        report,
        find_stretched(took, durations_s, options.speed) if options.time == "demo" else (),
        touching,
        chosen.retreat,
    )


def _moves(task: PlanningTask, chosen: Motion, durations_s: Sequence[float]) -> tuple[list[Move], Move | None]:
    """Make the moves of the segments, which time_moves.py times, and the retreat or None.

    `durations_s`: the hand's, from each keyframe to the next.
    """
    from pbd.arm.ik.cartesian import keep_on_path, line
    from pbd.arm.motion_request import DEMO, LINE
    from pbd.arm.timing.time_moves import APPROACH_SPEED, Move

    first, retreat, as_demonstrated = chosen.segments[0], chosen.retreat, task.options.time == "demo"
    moves = [Move(first.q, first.curved, share=APPROACH_SPEED)]
    for i, (segment, hand_s) in enumerate(zip(chosen.segments[1:], durations_s, strict=True)):
        t = task.hand_moves[i].t if as_demonstrated and segment.kind == DEMO else None
        q = segment.q
        if segment.kind == LINE:
            q = keep_on_path(task.arm, line(*task.T_base_tool[i : i + 2]), np.vstack((chosen.q[i], q)))[1:]
        moves.append(Move(q, segment.curved, t, hand_s if as_demonstrated else 0.0))
    return moves, None if retreat is None else Move(retreat.q, retreat.curved, share=APPROACH_SPEED)


def _works(task: PlanningTask, attempt: Callable[[PlanningTask], object] = plan_task) -> bool:
    with collected_warnings():  # they concern a plan that nobody sees
        try:
            return not isinstance(attempt(task), PlanRefusal)
        except PbdError:
            return False
