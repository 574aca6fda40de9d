"""Move keyframes that belong to a thing to where that thing stands now."""

import shlex
from bisect import bisect_left
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from pbd.data import Keyframe
from pbd.data.keyframe import thing_carriers
from pbd.errors import UsageError, listed, nearest
from pbd.pose import Array, Pose, quat_about_z, quat_rotate

HALVINGS = 6
"""Bisection steps to find how far a thing can be moved from where it was shown: to 2 % of the distance."""


class ThingPlace(NamedTuple):
    """Where a thing stands now: the tool's position in base at its first keyframe, m; its rotation about z, rad."""

    name: str
    p_base: tuple[float, float, float]
    turn_rad: float = 0.0

    def __str__(self) -> str:
        x, y, z = self.p_base
        return f"{self.name}={x:.3f},{y:.3f},{z:.3f},{np.degrees(self.turn_rad) + 0.0:.0f}"


def keyframes_of_things(keyframes: Sequence[Keyframe]) -> dict[str, tuple[int, ...]]:
    """Return the indices of each thing's keyframes by its name; a carrier comes before what it carries.

    A lid on a cup also moves with the tray that carries the cup at other keyframes.

    Raises:
        RecordingError: a thing carries itself.
    """
    carriers = thing_carriers(keyframes)
    members: dict[str, list[int]] = {name: [] for name in carriers}
    for i, keyframe in enumerate(keyframes):
        beyond = carriers[keyframe.frames[-1]] if len(keyframe.frames) > 1 else set[str]()
        for name in beyond.union(keyframe.frames):
            members[name].append(i)
    return {name: tuple(of) for name, of in members.items()}


def place_things(
    T_base_tool: Sequence[Pose], keyframes: Sequence[Keyframe], places: Sequence[ThingPlace]
) -> tuple[Pose, ...]:
    """Move the keyframes of each thing, and of the things it carries, to where it stands now.

    Raises:
        UsageError: no keyframe belongs to the thing of a place.
    """
    poses, known = list(T_base_tool), keyframes_of_things(keyframes)
    by_name = {place.name: place for place in places}
    refuse_unknown_things(by_name, known)
    for name, members in known.items():
        if (place := by_name.get(name)) is not None:
            turn = quat_about_z(place.turn_rad)
            moved = Pose(np.array(place.p_base) - quat_rotate(turn, poses[members[0]].p), turn)
            for i in members:
                poses[i] = moved @ poses[i]
    return tuple(poses)


def refuse_unknown_things(names: Iterable[str], known: Collection[str]) -> None:
    """Refuse a thing that no keyframe belongs to (UsageError)."""
    for name in names:
        if name not in known:
            given = f"known are {listed(known)}{nearest(name, known)}" if known else "none belongs to anything"
            how = f"`pbd keyframes DEMO --frame {shlex.quote(name)}=3..5` says which do"
            raise UsageError(f"no keyframe belongs to '{name}': {given}; {how}", value=name, valid=list(known))


def nearest_working_place(wanted: ThingPlace, shown: Array, works: Callable[[ThingPlace], bool]) -> ThingPlace | None:
    """Return the place nearest to `wanted` that works, on the way from where the thing was shown (3,), m in base.

    None if not even the place where it was shown works.
    """
    start = np.array([*shown, 0.0])
    change = np.array([*wanted.p_base, wanted.turn_rad]) - start

    def at(share: float) -> ThingPlace:
        x, y, z, turn = (start + share * change).tolist()
        return ThingPlace(wanted.name, (x, y, z), turn)

    if not works(at(0.0)):
        return None
    steps = 2**HALVINGS
    return at(bisect_left(range(1, steps), True, key=lambda k: not works(at(k / steps))) / steps)
