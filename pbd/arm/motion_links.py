"""What the search for a motion knows of each move between keyframes, and of each link of its ladder graph."""

from __future__ import annotations

from dataclasses import dataclass, field

from pbd.arm.collision.scene import Hit
from pbd.arm.motion_request import DETOUR, STRAIGHT, Segment
from pbd.arm.sweep import Sweep
from pbd.pose import Array, Pose

MOST_PATHS, MOST_STEPS = 4, 60
"""Refused paths of the tool before a link is mended: from end to end, and along a few of its poses."""
MOST_DETOURS, MOST_CHECKED = 4, 2000
"""Pairs of ways to hold the arm between which a detour is sought in vain, and checks for each."""
DETOUR_EXTRA = 1.0
"""How much farther than straight a detour is taken to be, rad, until it is found."""
ENOUGH_DETOURS, ANY_OTHER = 2, 100.0
"""Detours found after which another one is only sought where these lead nowhere: so many rad more it is taken to be."""


@dataclass(eq=False)
class Move:
    """A move to a keyframe: its kind, how else it may be made, and what was found to be in the way of each kind.

    `pose_hit`: what the arm touches at the keyframe itself. `tried`: how many pairs of ways to hold the arm were.
    `found_wide`: how many of them sweep the tool. `wide`: what is told of it, once a line was tried instead.
    `tool_barred`: what the tool carries touches something on its path, however the arm is held.
    `detour`: nothing else was free, so that any way around is sought; `searched`: how many checks were for that.
    """

    kind: str
    remedies: list[str]
    hits: dict[str, Hit] = field(default_factory=dict)
    pose_hit: Hit | None = None
    tried: int = 0
    found_wide: int = 0
    wide: Sweep | None = None
    tool_barred: bool = False
    detour: bool = False
    searched: int = 0

    def last_resort(self) -> bool:
        """Whether a detour is left; no other remedy is from now on."""
        self.remedies[:] = [each for each in self.remedies if each == "detour"]
        return bool(self.remedies)

    def segment(self, q: Array) -> Segment:
        """What is made of it with joints (m, k); a detour of one is none."""
        kind = (DETOUR if len(q) > 1 else STRAIGHT) if self.detour else self.kind
        return Segment(kind, q, avoided=None if kind == STRAIGHT else self.hits.get(STRAIGHT), wide=self.wide)


@dataclass(eq=False)
class Link:
    """What leads to a layer: part of the move to a keyframe, along poses of the tool or (None) straight.

    `at_keyframe`: whether the layer is the keyframe itself. `found`: joints (m, k) of what is free, by both ends.
    """

    keyframe: int
    poses: tuple[Pose, ...] | None = None
    at_keyframe: bool = True
    found: dict[bytes, Array] = field(default_factory=dict)
