"""What the search for a motion knows of each move between keyframes, and of each link of its ladder graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pbd.arm.collision.scene import Hit
from pbd.arm.model import ArmModel
from pbd.arm.motion_request import DETOUR, STRAIGHT, Motion, MotionRequest, Segment
from pbd.arm.tool_deviation import ToolDeviation, tool_deviations
from pbd.pose import Array, Pose

MOST_PATHS = 4
"""Barred paths of the tool, from end to end, before a link is mended."""
MOST_DETOURS = 4
"""Pairs of configurations without a detour before a link is mended."""
DETOUR_EXTRA = 1.0
"""How much longer than straight a detour is assumed to be, rad, until it is found."""
ENOUGH_DETOURS, ANY_OTHER = 1, 100.0
"""After so many detours another costs so many rad more: it is searched for only where these lead nowhere."""


class DetourSearch(NamedTuple):
    """How a detour is searched for.

    Attributes:
        most_checks: collision checks before it is given up.
        seed: of random joints.
        step_rad: the longest move that is added to a tree, over all joints.
        winding_rad: how far beyond all starts and goals a joint may go.
        turned: goals that are made of each configuration by whole turns.
    """

    most_checks: int
    seed: int = 1
    step_rad: float = 1.0
    winding_rad: float = np.pi
    turned: int = 1


BETWEEN_TWO = DetourSearch(400)
FROM_ANY_TO_ANY = (
    DetourSearch(1000, winding_rad=0.5 * np.pi),
    DetourSearch(1000, turned=8),
    DetourSearch(1000, winding_rad=0.5 * np.pi, seed=2),
    DetourSearch(1500, winding_rad=0.5 * np.pi, seed=3, step_rad=0.5),
    DetourSearch(1500, seed=4, step_rad=0.5),
)
"""Most searches end soon or never: several short ones that differ find more than a long one."""
CHECKS, CHECKS_EACH, CHECKS_CLOSE = 6000, 1000, 0.5
"""Checks for all detours of a motion; more for each keyframe; share of that at the smaller margin."""


@dataclass(eq=False)
class Move:
    """A move to a keyframe: its kind, the remedies left to try, and the first hit of each kind that was tried.

    `pose_hit`: what the arm touches at the keyframe itself. `tried`: barred pairs of configurations.
    `found_wide`: pairs of configurations on which the tool deviates widely.
    `wide`: the deviation because of which a line is tried instead.
    `tool_barred`: what the tool carries touches something on its path, in every configuration.
    `detour`: nothing else was free, so a detour is searched for; `searched`: collision checks for that.
    `widened`: more configurations were added at its end; `looked_closely`: those of all its null space.
    """

    kind: str
    remedies: list[str]
    hits: dict[str, Hit] = field(default_factory=dict)
    pose_hit: Hit | None = None
    tried: int = 0
    found_wide: int = 0
    wide: ToolDeviation | None = None
    tool_barred: bool = False
    detour: bool = False
    searched: int = 0
    widened: bool = False
    looked_closely: bool = False

    def last_resort(self) -> bool:
        """Drop all remedies but detours; say whether any is left."""
        self.remedies[:] = self._detours()
        return bool(self.remedies)

    def leave_path(self) -> None:
        """Drop the remedies that keep the tool on its path, on which it touches something."""
        first = self.remedies.index("split") if "split" in self.remedies else len(self.remedies)
        self.remedies = [*self.remedies[:first], *(self._detours() if first < len(self.remedies) else ())]
        self.tool_barred = False

    def _detours(self) -> list[str]:
        return self.remedies[self.remedies.index("detour") :] if "detour" in self.remedies else self.remedies[:0]

    def segment(self, q: Array) -> Segment:
        """Make a segment of joints (m, k); a detour of one row is a straight move."""
        kind = (DETOUR if len(q) > 1 else STRAIGHT) if self.detour else self.kind
        return Segment(kind, q, avoided=None if kind == STRAIGHT else self.hits.get(STRAIGHT), wide=self.wide)


@dataclass(eq=False)
class Link:
    """The link to a layer: part of the move to a keyframe, along poses of the tool or (None) straight.

    `at_keyframe`: the layer is the keyframe itself. `found`: joints (m, k) of free moves, by the bytes of both ends.
    `tool_free`: what the tool carries is known to touch nothing on the path.
    """

    keyframe: int
    poses: tuple[Pose, ...] | None = None
    at_keyframe: bool = True
    found: dict[bytes, Array] = field(default_factory=dict)
    tool_free: bool = False


def remedies_of(request: MotionRequest, i: int, *, may_detour: bool) -> list[str]:
    """Return the remedies for the move to keyframe i, the likeliest first; i = n leads away from the last one."""
    if i in (0, len(request.T_base_tool)):
        return ["detour", "connect"] if may_detour else ["widen"]
    if request.kind != STRAIGHT:
        return ["split", "widen"]
    if not may_detour or request.tolerance_m is not None:
        return ["follow", "widen", "split"]
    # Search less for an optional line than for the hand's path.
    path = ["follow", "widen", "split"] if request.hand else ["follow"]
    return [*path, "detour", "connect"]


def motion_of(arm: ArmModel, links: Sequence[Link], moves: Sequence[Move], q: Array, n: int) -> Motion:
    """Put a motion through n keyframes together from what was found on the links between joints (l + 1, k)."""
    parts: list[list[Array]] = [[] for _ in moves]
    ends = [q[0]] * n
    for place, link in enumerate(links, start=1):
        parts[link.keyframe].append(link.found[q[place - 1].tobytes() + q[place].tobytes()])
        if link.keyframe < n:
            ends[link.keyframe] = q[place]
    segments = []
    for i in range(n):
        segment = moves[i].segment(np.vstack(parts[i]))
        if i > 0 and segment.kind == STRAIGHT:
            (deviation,) = tool_deviations(arm, ends[i - 1][None], ends[i][None])
            segment = replace(segment, off_line_m=deviation.off_line_m, wide=deviation if deviation.wide else None)
        segments.append(segment)
    back = moves[n].segment(np.vstack(parts[n])) if len(parts) > n and parts[n] else None
    return Motion(np.array(ends), tuple(segments), back)
