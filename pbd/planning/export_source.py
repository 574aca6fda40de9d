"""Collect what a plan was made from, for exports that contain more than joints."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pbd.data import JointTrajectory
from pbd.errors import PlanError, require_type
from pbd.planning.result import Plan
from pbd.planning.task import arm_of
from pbd.pose import Array, quat_from_matrix

if TYPE_CHECKING:
    from pbd.files.exporters.export_request import Source


def source_of(plan: Plan) -> Source:
    """Return the source of an export; PlanError if the plan was made from keyframes alone."""
    from pbd.arm.link_frames import links_in_parents
    from pbd.audit.audit import audit_received
    from pbd.files.exporters.export_request import Source

    require_type("source_of", plan, "pbd.planning.plan_path", Plan)
    arm, hand = arm_of(plan.robot), plan.hand_path
    if hand is None:
        raise PlanError("a plan of keyframes alone has no path of the hand; plan from what pbd.track gives")

    def tool(q: Array) -> tuple[Array, Array]:
        p, R = arm.forward_many(q)
        return np.asarray(p, np.float64), quat_from_matrix(R)

    def audit(path: JointTrajectory) -> None:
        audit_received(path, plan.robot, (plan.calibration, plan.grasped))

    def draw(t: Array, path: Path) -> None:
        from pbd.replay import replay_scene, robot_motion
        from pbd.view.glb import write_glb

        write_glb(replace(replay_scene(plan), motion=robot_motion(arm, plan.trajectory.at(t))), path)

    return Source(
        name=plan.name,
        keyframes=plan.keyframes,
        hand=hand,
        T_base_nav=plan.placed.T_base_nav,
        tool=tool,
        links=partial(links_in_parents, arm),
        audit=audit,
        draw=draw,
    )
