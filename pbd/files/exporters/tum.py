"""TUM: `t x y z qx qy qz qw` a line, as evo reads it; of the tool in base, or of the hand in nav."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pbd.data import Samples
from pbd.files.exporters.order import Order
from pbd.pose import quat_to_xyzw


def samples(order: Order) -> Samples:
    """Evaluate at the rate; for the hand's path at its recording's own instants, in the arm's time or beyond it."""
    if order.format_name == "tum-hand":
        return order.trajectory.at(order.source.hand.t)
    return order.sampled()


def write(order: Order, points: Samples, path: Path) -> None:
    """Write the poses, with all their digits."""
    if order.format_name == "tum-hand":
        p, wxyz = order.source.hand.p_nav_sensor, order.source.hand.wxyz_nav_sensor
    else:
        p, wxyz = order.source.tool(points.q)
    rows = np.column_stack((points.t, p, quat_to_xyzw(wxyz))) + 0.0  # no -0.0
    with path.open("w", encoding="utf-8") as file:
        file.writelines(" ".join(map(repr, row)) + "\n" for row in rows.tolist())
