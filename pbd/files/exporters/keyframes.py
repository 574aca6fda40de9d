"""Keyframes: only their joint targets and tool poses, as JSON, or as CSV if the file's name ends in .csv."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from pbd.data import Samples
from pbd.errors import one_line
from pbd.files.exporters.export_request import ExportRequest


def samples(request: ExportRequest) -> Samples:
    """Sample at the keyframes."""
    return request.trajectory.at(request.trajectory.keyframe_t)


def write(request: ExportRequest, points: Samples, path: Path) -> None:
    """Write keyframes with the keys of `pbd keyframes --json --robot R`; the pose is computed from the joints.

    A keyframe is one line of the CSV: control characters in names become spaces or escapes.
    """
    names, q = request.trajectory.joint_names, request.trajectory.keyframe_q
    p, wxyz = request.source.tool(q)
    rows: list[dict[str, Any]] = []
    for i, keyframe in enumerate(request.source.keyframes):
        row: dict[str, Any] = {"index": i, "t_s": float(points.t[i]), "dwell_s": _dwell(request, i)}
        row |= {"grip": keyframe.grip, "label": keyframe.label, "joints": q[i].tolist()}
        rows.append(row | {"base_position_m": p[i].tolist(), "base_wxyz": wxyz[i].tolist()})
    if request.suffix != ".csv":
        top = {
            "demo": request.source.name,
            "robot": request.robot.name,
            "base": request.robot.base,
            "joint_names": names,
        }
        lines = ",\n".join(json.dumps(row) for row in rows)
        path.write_text(f'{json.dumps(top)[:-1]}, "keyframes": [\n{lines}\n]}}\n', encoding="utf-8")
        return
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        scalars = ("index", "t_s", "dwell_s", "grip", "label")
        joints = (f"q_{one_line(name)}" for name in names)
        table.writerow((*scalars, *joints, *"xyz", *(f"q{axis}" for axis in "wxyz")))
        for row in rows:
            row["label"] = one_line(row["label"])
            row["grip"] = {None: "", True: "closes", False: "opens"}[row["grip"]]
            values = (row[key] for key in scalars)
            table.writerow((*values, *row["joints"], *row["base_position_m"], *row["base_wxyz"]))


def _dwell(request: ExportRequest, i: int) -> float:
    """Return how long the arm stays at keyframe i, s."""
    knots, t = request.trajectory.knots, request.trajectory.keyframe_t[i]
    at = int(np.searchsorted(knots, t - 1e-9))
    moves = np.append(request.trajectory.coefficients[at:, 1:].any(axis=(1, 2)), True)
    return float(knots[at + int(np.argmax(moves))] - knots[at])
