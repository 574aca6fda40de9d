"""The grasped object: it stands where the gripper first closes, goes with the tool, and stays where it is let go."""

from __future__ import annotations

import numpy as np

from pbd.data import GraspedObject
from pbd.data.world import holds, stays
from pbd.pose import Array
from pbd.view.motion import Track

__all__ = ["carried", "holds"]

RGB = (0.16, 0.55, 0.53)


def carried(
    thing: GraspedObject, t: Array, tool: Track, spans: list[tuple[float, float]], table: float | None
) -> Track:
    """T_base_object at instants t (n,): still, but where the tool holds it; see `pbd.data.world.stays`.

    Args:
        thing: what is grasped.
        t: (n,) s.
        tool: T_base_tool at these instants.
        spans: when the gripper holds; at least one.
        table: m, z of the table's top in base.
    """

    def sample(instant: float) -> int:
        return int(np.searchsorted(t, instant).clip(0, len(t) - 1))

    p, wxyz = np.empty((len(t), 3)), np.empty((len(t), 4))
    for stay in stays(thing, spans, lambda instant: tool[sample(instant)], table):
        first, last = sample(stay.start), sample(stay.end) + 1
        moved = tool @ stay.pose
        p[first:last] = moved.p[first:last] if stay.held else stay.pose.p
        wxyz[first:last] = moved.wxyz[first:last] if stay.held else stay.pose.wxyz
    return Track(p, wxyz)
