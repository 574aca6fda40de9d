"""What the search for a motion knows of each move between keyframes, and of each link of its ladder graph."""

from __future__ import annotations

from dataclasses import dataclass, field

from pbd.arm.collision.scene import Hit
from pbd.arm.sweep import Sweep
from pbd.pose import Array, Pose


@dataclass(eq=False)
class Move:
    """A move to a keyframe: its kind, how else it may be made, and what was found to be in the way of each kind.

    `pose_hit`: what the arm touches at the keyframe itself. `tried`: how many pairs of ways to hold the arm were.
    `found_wide`: how many of them sweep the tool. `wide`: what is told of it, once a line was tried instead.
    """

    kind: str
    remedies: list[str]
    hits: dict[str, Hit] = field(default_factory=dict)
    pose_hit: Hit | None = None
    tried: int = 0
    found_wide: int = 0
    wide: Sweep | None = None


@dataclass(eq=False)
class Link:
    """What leads to a layer: part of the move to a keyframe, along poses of the tool or (None) straight.

    `at_keyframe`: whether the layer is the keyframe itself. `found`: joints (m, k) of what is free, by both ends.
    """

    keyframe: int
    poses: tuple[Pose, ...] | None = None
    at_keyframe: bool = True
    found: dict[bytes, Array] = field(default_factory=dict)
