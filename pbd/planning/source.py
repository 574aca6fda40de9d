"""What a plan was made from, for exports that tell more than joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pbd.data import HandPath, JointTrajectory, Robot
from pbd.planning.steps import arm_of
from pbd.planning.values import Plan
from pbd.pose import Array, quat_from_matrix

if TYPE_CHECKING:
    from pbd.files.exporters.order import Source


def source_of(plan: Plan, hand: HandPath, robot: Robot, name: str) -> Source:
    """Collect it; `name` is the demonstration's."""
    from pbd.arm.links import links_in_parents
    from pbd.audit.audit import audit_received
    from pbd.files.exporters.order import Source

    arm = arm_of(robot)

    def tool(q: Array) -> tuple[Array, Array]:
        p, R = arm.forward_many(q)
        return np.asarray(p, np.float64), quat_from_matrix(R)

    def audit(path: JointTrajectory) -> None:
        grasped = None if hand.tracking is None else hand.tracking.demo.grasped
        audit_received(path, robot, (plan.calibration, grasped))

    return Source(
        name=name,
        keyframes=plan.keyframes,
        hand=hand,
        T_base_nav=plan.T_base_nav,
        tool=tool,
        links=lambda q, opening: links_in_parents(arm, q, opening),
        audit=audit,
    )
