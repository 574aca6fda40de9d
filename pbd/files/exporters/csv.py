"""CSV: t, then positions, velocities and accelerations of all joints, then the gripper's opening."""

import csv
from pathlib import Path

import numpy as np

from pbd.data import Samples
from pbd.files.exporters.export_request import ExportRequest
from pbd.files.table import Sheet, write_table


def write(request: ExportRequest, points: Samples, path: Path) -> None:
    """Write the columns t (s), q_JOINT (rad), dq_JOINT (rad/s), ddq_JOINT (rad/s2), gripper (1 open, 0 closed)."""
    names = request.trajectory.joint_names
    header = ("t", *(f"{kind}_{name}" for kind in ("q", "dq", "ddq") for name in names), "gripper")
    values = np.column_stack((points.t, points.q, points.qd, points.qdd, points.gripper))
    write_table(path, header, values + 0.0)  # no -0.0


def read(path: Path) -> Samples:
    """Read what `write` wrote."""
    with path.open(encoding="utf-8", newline="") as file:
        header = tuple(next(csv.reader(file)))
        values = Sheet(path, header, file.read(), ",", first_line=2).read().values
    q, qd, qdd = np.split(values[:, 1:-1], 3, axis=1)
    return Samples(values[:, 0], q, qd, qdd, values[:, -1])
