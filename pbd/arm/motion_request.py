"""What a motion is to be, and what was chosen for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pbd.arm.collision.scene import Hit
from pbd.arm.tool_deviation import ToolDeviation
from pbd.pose import Array, Pose

STRAIGHT, LINE, DEMO, DETOUR = "straight", "line", "demo", "detour"
"""Kinds of moves: straight in joint space, the tool on a straight line, as the hand went, around what bars these."""


@dataclass(frozen=True, eq=False)
class MotionRequest:
    """What the motion is to be.

    Attributes:
        q_start: (k,) rad, where the arm comes from.
        approach: it does come from there; else the motion begins at keyframe 0.
        q_back: (k,) rad, where it goes after the last keyframe, or None.
        kind: of the moves between keyframes: STRAIGHT, LINE or DEMO.
        hand: gives n - 1 paths of the tool as the hand went, asked only where they are needed; or None.
        tolerance_m: a straight move whose tool gets farther from the line is made as LINE; without it one that is
            wide (see tool_deviation.py) is, where that can be.
        detour: where nothing else is free, a DETOUR is sought, unless the tool was to follow something.
    """

    T_base_tool: Sequence[Pose]
    q_start: Array
    approach: bool = True
    q_back: Array | None = None
    kind: str = STRAIGHT
    hand: Callable[[], Sequence[Sequence[Pose]]] | None = None
    tolerance_m: float | None = None
    detour: bool = True


@dataclass(frozen=True, eq=False)
class Segment:
    """How the arm comes to a keyframe.

    Attributes:
        kind: STRAIGHT, LINE, DEMO or DETOUR.
        q: (m, k) rad, from the first joints after those before to those at the keyframe.
        off_line_m: the tool's largest distance from the straight line, where the move is straight in joint space.
        avoided: what a straight move would have touched, where that is why this isn't one.
        wide: what the tool does on a straight move that is wide; or would do, where that is why this is a LINE.
    """

    kind: str
    q: Array
    off_line_m: float = 0.0
    avoided: Hit | None = None
    wide: ToolDeviation | None = None

    @property
    def curved(self) -> bool:
        """Whether the joints lie on a smooth curve; else the arm goes straight from each to the next."""
        return self.kind != STRAIGHT


@dataclass(frozen=True, eq=False)
class Motion:
    """Joints (n, k) at the keyframes, the segments to them, and the way back or None."""

    q: Array
    segments: tuple[Segment, ...]
    back: Segment | None
