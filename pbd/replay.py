"""Converts a plan to the scene of a replay. This is the only place where the arm's results meet the view's values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pbd.calibration.success_probability import success_of
from pbd.calibration.tool_poses import KeyframesInBase
from pbd.calibration.uncertainty import tool_covariances
from pbd.data import Keyframe, Samples
from pbd.planning import Plan, arm_of, scene_of
from pbd.pose import Array, quat_rotate, quat_to_matrix
from pbd.view.replay_scene import ReplayKeyframe, ReplayScene, Rod, Touching
from pbd.view.robot_motion import FRAME_RATE_HZ, RobotMotion

if TYPE_CHECKING:
    from pbd.arm.model import ArmModel


def replay_scene(plan: Plan, warnings: Sequence[str] = ()) -> ReplayScene:
    """Collect what a replay shows. The hand's path is drawn at the tool, in base, and scaled as the motion is."""
    from pbd.arm.collision.motion_check import object_stays

    (path, demo), arm, T_base_nav, options = plan.tracked, arm_of(plan.robot), plan.T_base_nav, plan.options
    scale = options.scale * plan.calibration.scale
    rows = slice(path.stops[0].start, path.stops[-1].stop)
    p_base_sensor = T_base_nav.act(scale * path.p_nav_sensor[rows])
    p_sensor_tool = plan.calibration.T_sensor_tool.p
    lever = quat_rotate(T_base_nav.wxyz, quat_rotate(path.wxyz_nav_sensor[rows], p_sensor_tool))
    if options.orientation == "fixed":
        lever = np.broadcast_to(plan.T_base_tool[0].p - T_base_nav.p, p_base_sensor.shape)
    # Errors of the dock and the mount shift all keyframes together, so they are left out; `pbd keyframes` prints them.
    placed = KeyframesInBase(plan.keyframes, T_base_nav, plan.calibration, options.scale, path)
    cov = tool_covariances(placed)["tracking"]
    tolerated = any(keyframe.tolerance_m is not None for keyframe in plan.keyframes)
    success = success_of(placed) if tolerated else None
    probability = np.ones(len(cov)) if success is None else success.of_each
    note = success and f"probability that all keyframes are within their tolerances: {success.band}"
    keyframes = zip(plan.keyframes, plan.trajectory.keyframe_t, plan.T_base_tool, cov, probability, strict=True)
    return ReplayScene(
        title=demo.recording.info.name,
        robot=plan.robot,
        trajectory=plan.trajectory,
        motion=robot_motion(arm, plan.trajectory.sample(FRAME_RATE_HZ)),
        hand_path_base=p_base_sensor + lever,
        hand_speed=np.linalg.norm(path.v_nav_sensor[rows], axis=1),
        keyframes=tuple(
            ReplayKeyframe(
                label=keyframe.label,
                t=float(t),
                T_base_tool=pose,
                cov=tracked if keyframe.cov.any() else None,  # a keyframe that a person inserted has no covariance
                grip=keyframe.grip,
                weight=keyframe.weight,
                tolerance=_squared_tolerance(keyframe, scale * quat_to_matrix(T_base_nav.wxyz)),
                inside=None if keyframe.tolerance_m is None else float(chance),
            )
            for keyframe, t, pose, tracked, chance in keyframes
        ),
        table_height=plan.calibration.table_height,
        grasped=plan.grasped,
        phases=object_stays(scene_of(arm, plan.calibration, plan.grasped), plan.trajectory),
        notes=tuple(each for each in (demo.notes, note, *warnings) if each),
        touching=_touching(plan),
        obstacles=plan.calibration.obstacles,
        rod=_rod(arm),
        torque=None if plan.report.torque is None else plan.report.torque.share,
        detours=detours(plan),
    )


def _squared_tolerance(keyframe: Keyframe, R_base_nav: Array) -> Array | None:
    """A keyframe's position tolerance as a matrix (3, 3) m2 in base, with the squares of its half axes; or None."""
    if keyframe.tolerance_m is None:
        return None
    squared: Array = R_base_nav @ np.diag(keyframe.tolerance_m**2) @ R_base_nav.T
    return squared


def robot_motion(arm: ArmModel, samples: Samples) -> RobotMotion:
    """Return the motion of all joints, of arm and fingers, at the times of the samples."""
    q = arm.configurations(np.column_stack((samples.q, samples.gripper)))
    return RobotMotion(arm.full, samples.t, q)


def detours(plan: Plan) -> tuple[tuple[float, float], ...]:
    """Return (start, end) s of each detour: from the keyframe before it to the keyframe after it, or to the end."""
    from pbd.arm.motion_request import DETOUR

    ends = (0.0, *plan.trajectory.keyframe_t.tolist(), plan.trajectory.duration)
    moves = (*plan.segments, plan.back) if plan.back else plan.segments
    return tuple((ends[i], ends[i + 1]) for i, move in enumerate(moves) if move.kind == DETOUR)


def _rod(arm: ArmModel) -> Rod | None:
    """The rod that stands for the tool in collision checks if the model has no gripper; else None."""
    from pbd.arm.gripper import tool_on_joint, tool_rod

    body = tool_rod(arm)
    if body is None:
        return None
    _, T_joint_tool = tool_on_joint(arm)
    return Rod(T_joint_tool.inverse() @ body.T_joint_body, *body.size)


def _touching(plan: Plan) -> tuple[Touching, ...]:
    """Describe each contact; the first one has the words of the refusal."""
    from pbd.arm.collision.motion_check import describe

    if plan.touching is None:
        return ()
    first, error = plan.touching.found, plan.touching.error
    messages = []
    for each in plan.touching.hits:
        bodies = (each.hit.first, each.hit.second)
        is_first = each.t == first.t and bodies == (first.hit.first, first.hit.second)
        words = error.message if is_first else f"t = {each.t:.1f} s: {describe(each.hit)}"
        messages.append(Touching(bodies, each.t, each.parted_t, words))
    return tuple(messages)
