"""From a plan to what a replay shows: the one place where the arm's results meet the view's values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pbd.calibration.uncertainty import tool_covariances
from pbd.data import Demonstration, HandPath, Robot
from pbd.planning import Plan, PlanOptions
from pbd.pose import quat_rotate
from pbd.view.scene import ReplayKeyframe, ReplayScene, Rod, Touching


def replay_scene(
    demo: Demonstration, path: HandPath, plan: Plan, robot: Robot, options: PlanOptions, warnings: Sequence[str] = ()
) -> ReplayScene:
    """Collect what a replay shows. The hand's path is drawn where the tool would have been, scaled as the motion is."""
    T_base_nav = plan.T_base_nav
    scale = options.scale * plan.calibration.scale
    inside = slice(path.stops[0].start, path.stops[-1].stop)
    p_base_sensor = T_base_nav.act(scale * path.p_nav_sensor[inside])
    p_sensor_tool = plan.calibration.T_sensor_tool.p
    lever = quat_rotate(T_base_nav.wxyz, quat_rotate(path.wxyz_nav_sensor[inside], p_sensor_tool))
    if options.orientation == "fixed":
        lever = np.broadcast_to(plan.T_base_tool[0].p - T_base_nav.p, p_base_sensor.shape)
    # What is unsure of the dock or the mount moves all keyframes alike; `pbd keyframes --robot` tells it.
    cov = tool_covariances(plan.keyframes, T_base_nav, plan.calibration, options.scale)["tracking"]
    keyframes = zip(plan.keyframes, plan.trajectory.keyframe_t, plan.T_base_tool, cov, strict=True)
    return ReplayScene(
        title=demo.recording.info.name,
        robot=robot,
        trajectory=plan.trajectory,
        hand_path_base=p_base_sensor + lever,
        hand_speed=np.linalg.norm(path.v_nav_sensor[inside], axis=1),
        keyframes=tuple(
            ReplayKeyframe(
                label=keyframe.label,
                t=float(t),
                T_base_tool=pose,
                cov=tracked if keyframe.cov.any() else None,  # one that a person typed has no sigma
                grip=keyframe.grip,
            )
            for keyframe, t, pose, tracked in keyframes
        ),
        table_height=plan.calibration.table_height,
        grasped=demo.grasped,
        notes=tuple(note for note in (demo.notes, *warnings) if note),
        touching=_touching(plan),
        obstacles=plan.calibration.obstacles,
        rod=_rod(robot),
    )


def _rod(robot: Robot) -> Rod | None:
    """The rod that is checked for collisions, where the model has no gripper."""
    from pbd.arm.gripper import tool_on_joint, tool_rod
    from pbd.planning import arm_of

    arm = arm_of(robot)
    checked = tool_rod(arm)
    if checked is None:
        return None
    _, T_joint_tool = tool_on_joint(arm)
    return Rod(T_joint_tool.inverse() @ checked.T_joint_body, *checked.size)


def _touching(plan: Plan) -> tuple[Touching, ...]:
    from pbd.arm.collision import describe

    if plan.touching is None:
        return ()
    first, error = plan.touching.found, plan.touching.error
    told = []
    for each in plan.touching.hits:
        bodies = (each.hit.first, each.hit.second)
        is_first = each.t == first.t and bodies == (first.hit.first, first.hit.second)
        words = error.message if is_first else f"t = {each.t:.1f} s: {describe(each.hit)}"
        told.append(Touching(bodies, each.t, each.parted_t, words))
    return tuple(told)
