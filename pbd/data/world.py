"""Obstacles around the arm, and the grasped object's motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pbd.pose import Array, Pose, quat_about_z, quat_rotate


@dataclass(frozen=True)
class GraspedObject:
    """What the hand grips: a box (x, y, z), cylinder (diameter, height) or sphere (diameter); sizes in metres.

    `mass` in kg, evenly spread; None where nobody said.
    """

    shape: str
    size: tuple[float, ...]
    mass: float | None = None


@dataclass(frozen=True)
class Load:
    """What weighs on the arm besides its own links.

    Attributes:
        mass: kg, of what the tool carries all the time.
        p_tool: m, where that has its centre of mass, in tool axes.
        grasped: what it also carries while the gripper holds it.
        table: m, z of the table's top in base, or None.
    """

    mass: float = 0.0
    p_tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
    grasped: GraspedObject | None = None
    table: float | None = None

    def __str__(self) -> str:
        """Say what it is, for people; nothing where it has no mass."""
        thing, named = self.grasped, [f"{self.mass:g} kg"] if self.mass else []
        if thing is not None and thing.mass:
            named.append(f"a {thing.shape} of {thing.mass:g} kg")
        return " and ".join(named)


@dataclass(frozen=True, eq=False)
class Obstacle:
    """Something that the arm must not touch.

    Attributes:
        shape, size: as of a `GraspedObject`: box (x, y, z), cylinder (diameter, height) or sphere (diameter), in m.
    """

    name: str
    shape: str
    size: tuple[float, ...]
    T_base_obstacle: Pose


@dataclass(frozen=True, eq=False)
class Stay:
    """Where the grasped object is from `start` to `end`: standing in base, or fixed to the tool.

    Attributes:
        start, end: s, or keyframes, as those of `stays`; the first starts at -inf, the last ends at inf.
        held: fixed to the tool.
        pose: T_tool_object where held, else T_base_object.
        rests: T_base_object where it is gripped and where it is let go; empty where it stands.
    """

    start: float
    end: float
    held: bool
    pose: Pose
    rests: tuple[Pose, ...] = ()


def holds(t: Array, opening: Array) -> list[tuple[float, float]]:
    """From when to when a gripper holds, of opening (g,) at t (g,) s, or keyframes: from closed to opening, or inf."""
    spans: list[tuple[float, float]] = []
    change = np.sign(np.diff(opening))
    moves = change[change != 0.0]
    since = t[0] if len(moves) and moves[0] > 0.0 else None
    for i, direction in enumerate(change):
        if direction < 0.0:
            since = t[i + 1]
        elif direction > 0.0 and since is not None:
            spans.append((float(since), float(t[i])))
            since = None
    if since is not None:
        spans.append((float(since), np.inf))
    return spans


def stays(
    thing: GraspedObject, spans: Sequence[tuple[float, float]], tool: Callable[[float], Pose], table: float | None
) -> tuple[Stay, ...]:
    """Follow an object: it stands upright where it is first gripped, goes with the tool, and stays where it is let go.

    A gripper that closes elsewhere leaves it where it is. One that never closes does not say where it is.

    Args:
        spans: when the gripper holds, see `holds`.
        tool: T_base_tool at an instant (inf: at the end).
        table: m, z of the table's top in base: what is gripped within its own height above it stands on it.
    """
    if not spans:
        return ()
    reach = 0.05 + 0.5 * max(thing.size)
    T_base_object, since = _upright(tool(spans[0][0]), thing.size[-1], table), -np.inf
    found: list[Stay] = []
    for start, end in spans:
        T_base_tool = tool(start)
        if np.linalg.norm(T_base_tool.p - T_base_object.p) > reach:
            continue
        T_tool_object, T_base_before = T_base_tool.inverse() @ T_base_object, T_base_object
        found.append(Stay(since, start, False, T_base_before))
        T_base_object, since = tool(end) @ T_tool_object, end
        found.append(Stay(start, end, True, T_tool_object, (T_base_before, T_base_object)))
    if since < np.inf:
        found.append(Stay(since, np.inf, False, T_base_object))
    return tuple(found)


def _upright(T_base_tool: Pose, height: float, table: float | None) -> Pose:
    x = quat_rotate(T_base_tool.wxyz, (1.0, 0.0, 0.0))
    p = T_base_tool.p.copy()
    if table is not None and p[2] - table <= height:
        p[2] = table + 0.5 * height  # it stands, and is gripped somewhere along its height
    return Pose(p, quat_about_z(float(np.arctan2(x[1], x[0]))))
