"""Converts a plan to the scene of a replay. This is the only place where the arm's results meet the view's values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pbd.calibration.success_probability import success_of
from pbd.calibration.touch_up import touched_covariances
from pbd.data import Samples
from pbd.errors import require_type
from pbd.planning import Plan, arm_of, scene_of
from pbd.planning.result import size_remark
from pbd.pose import Array, quat_rotate, quat_to_matrix
from pbd.view.replay_scene import ReplayScene, Rod, TouchingPair
from pbd.view.robot_motion import FRAME_RATE_HZ, RobotMotion

if TYPE_CHECKING:
    from pbd.arm.model import ArmModel


def replay_scene(plan: Plan, warnings: Sequence[str] = ()) -> ReplayScene:
    """Collect what a replay shows, for `pbd.view.page.write_page` and `pbd.view.server.show_replay`.

    Args:
        plan: what `pbd.planning.plan_path` returns.
        warnings: lines that the page shows.

    Raises:
        PlanError: the plan was made from keyframes alone.
        WrongTypeError: it is no Plan, for example the trajectory alone.
    """
    from pbd.arm.collision.motion_check import object_phases_of

    require_type("replay_scene", plan, "pbd.planning.plan_path", Plan)
    (path, demo), arm = plan.tracked, arm_of(plan.robot)
    cov = touched_covariances(plan.placed)
    R = plan.scale * quat_to_matrix(plan.placed.T_base_nav.wxyz)
    tolerances = [each.tolerance_m for each in plan.keyframes]
    success = success_of(plan.placed) if any(each is not None for each in tolerances) else None
    size = size_remark(plan.robot, plan.calibration, plan.options.scale)
    likely = success and f"probability that all keyframes are within their tolerances: {success.band}"
    return ReplayScene(
        title=demo.recording.info.name,
        robot=plan.robot,
        trajectory=plan.trajectory,
        motion=robot_motion(arm, plan.trajectory.sample(FRAME_RATE_HZ)),
        calibration=plan.calibration,
        keyframes=plan.keyframes,
        T_base_tool=plan.T_base_tool,
        # Errors of the dock and of the mount move all keyframes alike; `pbd keyframes --robot` reports them.
        cov=cov["tracking"] + cov.get("touch-ups", 0.0),
        tolerance=np.array([R @ np.diag(np.full(3, np.nan) if m is None else m**2) @ R.T for m in tolerances]),
        inside=np.ones(len(tolerances)) if success is None else success.of_each,
        off_rad=plan.off_rad,
        hand_path_base=_hand_path(plan),
        hand_speed=np.linalg.norm(path.v_nav_sensor[path.demonstrated], axis=1),
        grasped=plan.grasped,
        phases=object_phases_of(scene_of(arm, plan.calibration, plan.grasped), plan.trajectory),
        rod=_rod(arm),
        slides=tuple((arm.turns == 0.0).tolist()),
        torque=None if plan.report.torque is None else plan.report.torque.share,
        detours=detours(plan),
        contacts=_contacts(plan),
        notes=tuple(filter(None, (size, demo.notes, likely))),
        warnings=tuple(warnings),
    )


def robot_motion(arm: ArmModel, samples: Samples) -> RobotMotion:
    """Return the motion of all joints, of arm and fingers, at the times of the samples."""
    q = arm.configurations(np.column_stack((samples.q, samples.gripper)))
    return RobotMotion(arm.full, samples.t, q)


def _hand_path(plan: Plan) -> Array:
    """Return where the hand would have carried the tool, (n, 3) m in base, scaled as the motion is."""
    path, T_base_nav = plan.tracked[0], plan.placed.T_base_nav
    p_base_sensor = T_base_nav.act(plan.scale * path.p_nav_sensor[path.demonstrated])
    if plan.options.orientation == "fixed":
        return p_base_sensor + (plan.T_base_tool[0].p - T_base_nav.p)
    p_nav_lever = quat_rotate(path.wxyz_nav_sensor[path.demonstrated], plan.placed.calibration.T_sensor_tool.p)
    return p_base_sensor + quat_rotate(T_base_nav.wxyz, p_nav_lever)


def detours(plan: Plan) -> tuple[tuple[float, float], ...]:
    """Return start and end of each detour, s: from a keyframe to the next one, or to the end."""
    from pbd.arm.motion_request import DETOUR

    ends = (0.0, *plan.trajectory.keyframe_t.tolist(), plan.trajectory.duration)
    moves = (*plan.segments, plan.retreat) if plan.retreat else plan.segments
    return tuple((ends[i], ends[i + 1]) for i, move in enumerate(moves) if move.kind == DETOUR)


def _rod(arm: ArmModel) -> Rod | None:
    from pbd.arm.gripper import tool_rod

    body = tool_rod(arm)
    if body is None:
        return None
    return Rod(arm.T_joint_tool.inverse() @ body.T_joint_body, *body.size)


def _contacts(plan: Plan) -> tuple[TouchingPair, ...]:
    """Return all contacts; the first one's message is the plan's, which says what to change."""
    if plan.touching is None:
        return ()
    messages = [f"t = {each.t:.1f} s: {each.hit}" for each in plan.touching.hits]
    messages[0] = plan.touching.error.message
    return tuple(
        TouchingPair((each.hit.first, each.hit.second), each.t, each.parted_t, message)
        for each, message in zip(plan.touching.hits, messages, strict=True)
    )
