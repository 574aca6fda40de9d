"""TUM: `t x y z qx qy qz qw` a line, as evo reads it; of the tool in base, or of the hand in nav."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pbd.data import Samples
from pbd.files.exporters.export_request import ExportRequest
from pbd.pose import quat_to_xyzw


def samples(request: ExportRequest) -> Samples:
    """Evaluate at the rate; for the hand's path at its recording's own instants, in the arm's time or beyond it."""
    if request.format_name == "tum-hand":
        return request.trajectory.at(request.source.hand.t)
    return request.sampled()


def write(request: ExportRequest, points: Samples, path: Path) -> None:
    """Write the poses, with all their digits."""
    if request.format_name == "tum-hand":
        p, wxyz = request.source.hand.p_nav_sensor, request.source.hand.wxyz_nav_sensor
    else:
        p, wxyz = request.source.tool(points.q)
    rows = np.column_stack((points.t, p, quat_to_xyzw(wxyz))) + 0.0  # no -0.0
    with path.open("w", encoding="utf-8") as file:
        file.writelines(" ".join(map(repr, row)) + "\n" for row in rows.tolist())
