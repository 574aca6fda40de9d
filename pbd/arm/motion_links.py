"""What the search for a motion knows of each move between keyframes, and of each link of its ladder graph."""

from __future__ import annotations

from dataclasses import dataclass, field

from pbd.arm.collision.scene import Hit
from pbd.pose import Array, Pose


@dataclass(eq=False)
class Move:
    """A move to a keyframe: its kind, how else it may be made, and what was found to be in the way of each kind.

    `pose_hit`: what the arm touches at the keyframe itself. `tried`: how many pairs of ways to hold the arm were.
    `detour`: nothing else was free, so that any way around is sought; `searched`: how many moves were for that.
    """

    kind: str
    remedies: list[str]
    hits: dict[str, Hit] = field(default_factory=dict)
    pose_hit: Hit | None = None
    tried: int = 0
    detour: bool = False
    searched: int = 0


@dataclass(eq=False)
class Link:
    """What leads to a layer: part of the move to a keyframe, along poses of the tool or (None) straight.

    `at_keyframe`: whether the layer is the keyframe itself. `found`: joints (m, k) of what is free, by both ends.
    """

    keyframe: int
    poses: tuple[Pose, ...] | None = None
    at_keyframe: bool = True
    found: dict[bytes, Array] = field(default_factory=dict)
