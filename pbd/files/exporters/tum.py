"""TUM, the format of evo: lines `t x y z qx qy qz qw`, the tool's path in base or the hand's path in nav."""

from pathlib import Path

import numpy as np

from pbd.data import Samples
from pbd.files.exporters.export_request import ExportRequest
from pbd.pose import Array, quat_continuous, quat_to_xyzw


def samples(request: ExportRequest) -> Samples:
    """Sample at the rate; for the hand's path at the recording's instants, which may be after the motion's end."""
    if request.format_name == "tum-hand":
        return request.trajectory.at(request.source.hand.t)
    return request.sampled()


def write(request: ExportRequest, points: Samples, path: Path) -> None:
    """Write the poses with full precision."""
    if request.format_name == "tum-hand":
        p, wxyz = request.source.hand.p_nav_sensor, request.source.hand.wxyz_nav_sensor
    else:
        p, wxyz = request.source.tool(points.q)
    write_poses(points.t, p, wxyz, path)


def write_poses(t: Array, p: Array, wxyz: Array, path: Path) -> None:
    """Write poses: t (n,) s, p (n, 3) m, wxyz (n, 4)."""
    rows = np.column_stack((t, p, quat_to_xyzw(quat_continuous(wxyz)))) + 0.0  # no -0.0
    with path.open("w", encoding="utf-8") as file:
        file.writelines(" ".join(map(repr, row)) + "\n" for row in rows.tolist())
