"""npz: what the clients of real arms take as arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pbd.data import JointTrajectory, Robot, Samples
from pbd.data.receiver import Rule

FILLED_BY: tuple[Rule, ...] = ()
"""None: a client sends each row at its time."""


def write(trajectory: JointTrajectory, robot: Robot, points: Samples, path: Path) -> None:
    """Write arrays joints (k,) names, t (n,) s, q, dq, ddq (n, k) rad, rad/s, rad/s2, gripper (n,) 1 open, 0 closed."""
    with path.open("wb") as file:
        np.savez(
            file,
            joints=np.array(trajectory.joint_names),
            t=points.t,
            q=points.q,
            dq=points.qd,
            ddq=points.qdd,
            gripper=points.gripper,
        )
