"""CSV: t, then q_, dq_, ddq_ of each joint, then the gripper's opening."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import orjson

from pbd.data import Samples
from pbd.files.exporters.job import Order


def write(order: Order, points: Samples, path: Path) -> None:
    """Write columns t (s), q_NAME (rad), dq_NAME (rad/s), ddq_NAME (rad/s2), gripper (1 open, 0 closed), all digits."""
    names = order.trajectory.joint_names
    header = ("t", *(f"{kind}_{name}" for kind in ("q", "dq", "ddq") for name in names), "gripper")
    values = np.column_stack((points.t, points.q, points.qd, points.qdd, points.gripper))
    rows = orjson.dumps(values + 0.0, option=orjson.OPT_SERIALIZE_NUMPY)  # no -0.0
    path.write_bytes(b"%s\n%s\n" % (",".join(header).encode(), rows[2:-2].replace(b"],[", b"\n")))


def read(path: Path) -> Samples:
    """Read what `write` wrote."""
    _, _, rows = path.read_bytes().rstrip().partition(b"\n")
    values = np.array(orjson.loads(b"[[%s]]" % rows.replace(b"\n", b"],[")), np.float64)
    q, qd, qdd = np.split(values[:, 1:-1], 3, axis=1)
    return Samples(values[:, 0], q, qd, qdd, values[:, -1])
