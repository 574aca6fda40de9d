"""CSV: t, then q_, dq_, ddq_ of each joint, then the gripper's opening."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pbd.data import Samples
from pbd.data.receiver import Rule
from pbd.files.exporters.order import Order
from pbd.files.table import write_table

FILLED_BY: tuple[Rule, ...] = ()
"""None: whoever reads the file takes each row at its time."""

COUNTED = "samples"

USUAL_HZ = 1000.0


def samples(order: Order) -> Samples:
    """Evaluate at the rate."""
    return order.trajectory.sample(order.rate_hz or USUAL_HZ)


def write(order: Order, points: Samples, path: Path) -> None:
    """Write columns t (s), q_NAME (rad), dq_NAME (rad/s), ddq_NAME (rad/s2), gripper (1 open, 0 closed)."""
    names = order.trajectory.joint_names
    header = ("t", *(f"{kind}_{name}" for kind in ("q", "dq", "ddq") for name in names), "gripper")
    values = np.column_stack((points.t, points.q, points.qd, points.qdd, points.gripper))
    k = len(names)
    decimals = (6, *(9,) * k, *(8,) * k, *(6,) * k, 6)
    least = 0.5 * 10.0 ** -np.array(decimals)
    write_table(path, header, np.where(np.abs(values) <= least, 0.0, values), decimals)  # no -0.000000
