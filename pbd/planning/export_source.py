"""What a plan was made from, for exports that tell more than joints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pbd.data import HandPath, JointTrajectory, Robot
from pbd.errors import PlanError
from pbd.planning.options import PlanOptions
from pbd.planning.result import Plan
from pbd.planning.steps import arm_of
from pbd.pose import Array, quat_from_matrix

if TYPE_CHECKING:
    from pbd.files.exporters.job import Source


def source_of(plan: Plan, hand: HandPath, robot: Robot, name: str, options: PlanOptions | None = None) -> Source:
    """Collect it.

    Args:
        plan: the motion.
        hand: the path that it was planned from.
        robot: whose it is.
        name: the demonstration's.
        options: what it was planned with.
    """
    from pbd.arm.links import links_in_parents
    from pbd.audit.audit import audit_received
    from pbd.files.exporters.job import Source

    arm = arm_of(robot)

    def tool(q: Array) -> tuple[Array, Array]:
        p, R = arm.forward_many(q)
        return np.asarray(p, np.float64), quat_from_matrix(R)

    def audit(path: JointTrajectory) -> None:
        grasped = None if hand.tracking is None else hand.tracking.demo.grasped
        audit_received(path, robot, (plan.calibration, grasped))

    def draw(t: Array, path: Path) -> None:
        from pbd.replay import replay_scene, robot_motion
        from pbd.view.glb import write_glb

        if hand.tracking is None:
            raise PlanError("glb shows the demonstration, which this path doesn't tell; track one with pbd.track")
        scene = replay_scene(hand.tracking.demo, hand, plan, robot, options or PlanOptions())
        write_glb(replace(scene, motion=robot_motion(arm, plan.trajectory.at(t))), path)

    return Source(
        name=name,
        keyframes=plan.keyframes,
        hand=hand,
        T_base_nav=plan.T_base_nav,
        tool=tool,
        links=lambda q, opening: links_in_parents(arm, q, opening),
        audit=audit,
        draw=draw,
    )
