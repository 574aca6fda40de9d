"""CSV: t, then q_, dq_, ddq_ of each joint, then the gripper's opening."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pbd.data import Samples
from pbd.files.table import write_table


def write(joint_names: tuple[str, ...], samples: Samples, path: Path) -> None:
    """Write columns t (s), q_NAME (rad), dq_NAME (rad/s), ddq_NAME (rad/s2), gripper (1 open, 0 closed)."""
    header = ("t", *(f"{kind}_{name}" for kind in ("q", "dq", "ddq") for name in joint_names), "gripper")
    values = np.column_stack((samples.t, samples.q, samples.qd, samples.qdd, samples.gripper))
    k = len(joint_names)
    decimals = (6, *(9,) * k, *(8,) * k, *(6,) * k, 6)
    least = 0.5 * 10.0 ** -np.array(decimals)
    write_table(path, header, np.where(np.abs(values) <= least, 0.0, values), decimals)  # no -0.000000
