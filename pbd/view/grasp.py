"""The grasped object: it stands where the gripper first closes, goes with the tool, and stays where it is let go."""

from __future__ import annotations

import numpy as np

from pbd.data import GraspedObject
from pbd.pose import Array, Pose, quat_about_z, quat_rotate
from pbd.view import shapes
from pbd.view.meshes import Mesh
from pbd.view.motion import Track

RGB = (0.16, 0.55, 0.53)


def holds(gripper_t: Array, opening: Array) -> list[tuple[float, float]]:
    """From when to when the gripper holds: from the end of its closing to the start of its opening, seconds."""
    spans: list[tuple[float, float]] = []
    change = np.sign(np.diff(opening))
    moves = change[change != 0.0]
    since = gripper_t[0] if len(moves) and moves[0] > 0.0 else None
    for i, direction in enumerate(change):
        if direction < 0.0:
            since = gripper_t[i + 1]
        elif direction > 0.0 and since is not None:
            spans.append((float(since), float(gripper_t[i])))
            since = None
    if since is not None:
        spans.append((float(since), np.inf))
    return spans


def carried(
    thing: GraspedObject, t: Array, tool: Track, spans: list[tuple[float, float]], table: float | None
) -> Track:
    """T_base_object at instants t (n,): still, but where the tool holds it. A gripper that closes elsewhere leaves it.

    Args:
        thing: what is grasped; upright when it is grasped for the first time.
        t: (n,) s.
        tool: T_base_tool at these instants.
        spans: when the gripper holds; at least one.
        table: m, z of the table's top in base: what is gripped within its own height above it stands on it.
    """
    height, reach = _height(thing), 0.05 + 0.5 * float(np.max(thing.size))
    T_base_thing = _upright(tool[int(np.searchsorted(t, spans[0][0]).clip(0, len(t) - 1))], height, table)
    p, wxyz = np.tile(T_base_thing.p, (len(t), 1)), np.tile(T_base_thing.wxyz, (len(t), 1))
    for start, end in spans:
        first, last = np.searchsorted(t, (start, end)).clip(0, len(t) - 1)
        if np.linalg.norm(tool.p[first] - p[first]) > reach:
            continue
        T_tool_thing = tool[first].inverse() @ Pose(p[first], wxyz[first])
        moved = tool @ T_tool_thing
        p[first:], wxyz[first:] = moved.p[last], moved.wxyz[last]
        p[first : last + 1], wxyz[first : last + 1] = moved.p[first : last + 1], moved.wxyz[first : last + 1]
    return Track(p, wxyz)


def mesh(thing: GraspedObject) -> Mesh:
    """What it looks like."""
    if thing.shape == "box":
        return shapes.box(thing.size, RGB)
    if thing.shape == "cylinder":
        return shapes.cylinder(0.5 * thing.size[0], thing.size[1], RGB)
    if thing.shape == "sphere":
        return shapes.sphere(0.5 * thing.size[0], RGB)
    raise ValueError(f"a grasped object is a box, cylinder or sphere, not {thing.shape!r}")


def _height(thing: GraspedObject) -> float:
    return thing.size[-1]


def _upright(T_base_tool: Pose, height: float, table: float | None) -> Pose:
    x = quat_rotate(T_base_tool.wxyz, (1.0, 0.0, 0.0))
    p = T_base_tool.p.copy()
    if table is not None and p[2] - table <= height:
        p[2] = table + 0.5 * height  # it stands, and is gripped somewhere along its height
    return Pose(p, quat_about_z(float(np.arctan2(x[1], x[0]))))
