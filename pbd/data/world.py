"""Obstacles around the arm, loads, and the grasped object's motion."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pbd.data.field_checks import freeze_tuples, require_fields, require_finite, wrong_value
from pbd.errors import WrongValueError, amount
from pbd.pose import Array, Pose, quat_about_z, quat_rotate

SHAPES = {"box": 3, "cylinder": 2, "sphere": 1}
"""Shapes of an object, and the number of sizes of each."""

REACH_M = 10.0
"""Largest coordinate of a place in a robot's base, and largest size of an object, m: beyond any arm's reach."""

TABLE, THE_TOOL = "the table", "the tool"
"""Names of the table, and of the rod before the gripper, in collision checks."""

TABLE_HEIGHT = "table_height in the calibration or in the robot's [dock]"
"""Where a person corrects the table."""

IN_METRES = "give metres, not cm or mm"
"""What to do about a length that `beyond_reach` found."""


def beyond_reach(lengths_m: Iterable[float], most_m: float = REACH_M) -> str:
    """Describe the largest of these lengths if it is beyond any arm's reach, as cm or mm would be; "" if it is not."""
    far = max(lengths_m, key=abs, default=0.0)
    return "" if abs(far) <= most_m else f"{far:g} m, beyond any arm's reach"


@dataclass(frozen=True)
class GraspedObject:
    """The object that the hand grips: a box (x, y, z), cylinder (diameter, height) or sphere (diameter), sizes in m.

    `mass` is in kg, evenly distributed; None: unknown.
    """

    shape: str
    size: tuple[float, ...]
    mass: float | None = None

    def __post_init__(self) -> None:
        _check_solid(self)
        require_finite(self, "mass", above=0.0)


@dataclass(frozen=True)
class Load:
    """The loads on the arm besides its own links.

    Attributes:
        mass: mass that the tool always carries, kg.
        p_tool: its centre of mass in tool axes, m.
        grasped: the object that the arm also carries while the gripper holds it, or None.
        table: z of the table's top in base, m, or None.
    """

    mass: float = 0.0
    p_tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
    grasped: GraspedObject | None = None
    table: float | None = None

    def __str__(self) -> str:
        """Describe it for people; empty without a mass."""
        thing, named = self.grasped, [f"{self.mass:g} kg"] if self.mass else []
        if thing is not None and thing.mass:
            named.append(f"a {thing.shape} of {thing.mass:g} kg")
        return " and ".join(named)

    @property
    def heaviest(self) -> float:
        """Largest mass that the tool carries at one time, kg."""
        return self.mass + (self.grasped.mass or 0.0 if self.grasped else 0.0)


@dataclass(frozen=True, eq=False)
class Obstacle:
    """Something that the arm must not touch. `shape` and `size` are as of a `GraspedObject`, in m."""

    name: str
    shape: str
    size: tuple[float, ...]
    T_base_obstacle: Pose

    def __post_init__(self) -> None:
        _check_solid(self)
        require_fields(self, name=str, T_base_obstacle=Pose)
        refuse_beyond_reach(self, "T_base_obstacle")


def _check_solid(solid: GraspedObject | Obstacle) -> None:
    if solid.shape not in SHAPES:
        raise wrong_value(solid, "shape", f"must be one of {', '.join(SHAPES)}")
    freeze_tuples(solid, size=float)
    if len(solid.size) != SHAPES[solid.shape]:
        raise wrong_value(solid, "size", f"of a {solid.shape} must have {amount(SHAPES[solid.shape], 'number')}")
    require_finite(solid, "size", above=0.0)
    refuse_beyond_reach(solid, "size")


def refuse_beyond_reach(owner: object, *names: str) -> None:
    """Raise WrongValueError if a field, lengths or a pose in m, is beyond any arm's reach. None passes."""
    for name in names:
        value = getattr(owner, name)
        lengths_m = () if value is None else np.ravel(value.p if isinstance(value, Pose) else value)
        if far := beyond_reach(lengths_m):
            raise WrongValueError(f"{type(owner).__name__}.{name} has {far}; {IN_METRES}", value=value)


@dataclass(frozen=True, eq=False)
class ObjectPhase:
    """Where the grasped object is from `start` to `end`: fixed in base, or fixed to the tool.

    Attributes:
        start, end: s, or keyframe indices, as given to `object_phases`. The first starts at -inf, the last ends at inf.
        held: whether it is fixed to the tool.
        pose: T_tool_object if held, else T_base_object.
        rests: T_base_object where it is gripped and where it is let go; empty if it is not held.
    """

    start: float
    end: float
    held: bool
    pose: Pose
    rests: tuple[Pose, ...] = ()


def gripped_spans(t: Array, opening: Array) -> list[tuple[float, float]]:
    """Find when a gripper holds: from the end of each closing to the beginning of the next opening (inf: none).

    Args:
        t: (g,) s, or keyframe indices.
        opening: (g,) the gripper's opening at each t.
    """
    spans: list[tuple[float, float]] = []
    changes = np.diff(opening)
    since = t[0] if changes.any() else None
    for i, change in enumerate(changes):
        if change < 0.0:
            since = t[i + 1]
        elif change > 0.0 and since is not None:
            spans.append((float(since), float(t[i])))
            since = None
    if since is not None:
        spans.append((float(since), np.inf))
    return spans


def object_phases(
    thing: GraspedObject, spans: Sequence[tuple[float, float]], tool: Callable[[float], Pose], table: float | None
) -> tuple[ObjectPhase, ...]:
    """Follow an object: it stands upright where it is first gripped, moves with the tool, and stays where it is let go.

    If the gripper closes elsewhere, the object stays. If it never closes, the result is empty: the place is unknown.

    Args:
        spans: when the gripper holds, as from `gripped_spans`.
        tool: T_base_tool at an instant (inf: at the end).
        table: z of the table's top in base, m. An object gripped within its own height above it stands on it.
    """
    if not spans:
        return ()
    reach = 0.05 + 0.5 * max(thing.size)
    T_base_object, since = _upright(tool(spans[0][0]), thing.size[-1], table), -np.inf
    found: list[ObjectPhase] = []
    for start, end in spans:
        T_base_tool = tool(start)
        if np.linalg.norm(T_base_tool.p - T_base_object.p) > reach:
            continue
        T_tool_object, T_base_before = T_base_tool.inverse() @ T_base_object, T_base_object
        found.append(ObjectPhase(since, start, False, T_base_before))
        T_base_object, since = tool(end) @ T_tool_object, end
        found.append(ObjectPhase(start, end, True, T_tool_object, (T_base_before, T_base_object)))
    if since < np.inf:
        found.append(ObjectPhase(since, np.inf, False, T_base_object))
    return tuple(found)


def _upright(T_base_tool: Pose, height: float, table: float | None) -> Pose:
    x = quat_rotate(T_base_tool.wxyz, (1.0, 0.0, 0.0))
    p = T_base_tool.p.copy()
    if table is not None and p[2] - table <= height:
        p[2] = table + 0.5 * height  # it stands on the table, gripped somewhere along its height
    return Pose(p, quat_about_z(float(np.arctan2(x[1], x[0]))))
