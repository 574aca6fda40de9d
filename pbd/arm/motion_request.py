"""What is asked of a motion, and the motion that was chosen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pbd.arm.collision.scene import Hit
from pbd.arm.tool_deviation import ToolDeviation
from pbd.pose import Array, Pose

STRAIGHT, LINE, DEMO, DETOUR = "straight", "line", "demo", "detour"
"""Kinds of moves: straight in joint space; the tool on a straight line; as the hand went; around what is in the way."""


@dataclass(frozen=True, eq=False)
class MotionRequest:
    """What is asked of a motion.

    Attributes:
        q_start: (k,) rad, where the arm stands; branches near it are preferred.
        approach: the motion begins there; else at keyframe 0.
        q_back: (k,) rad, where it goes after the last keyframe, or None.
        kind: of the moves between keyframes: STRAIGHT, LINE or DEMO.
        hand: returns the n - 1 paths of the tool as the hand went, computed when first called; or None.
        tolerance_m: a straight move whose tool gets farther from the line becomes a LINE; without a tolerance a wide
            one (see tool_deviation.py) does where possible.
        detour: where nothing else is free, search for a DETOUR, unless the tool was to follow something.
        grips: at each keyframe True where the gripper closes, False where it opens, None where nothing changes; none:
            it stays open.
    """

    T_base_tool: Sequence[Pose]
    q_start: Array
    approach: bool = True
    q_back: Array | None = None
    kind: str = STRAIGHT
    hand: Callable[[], Sequence[Sequence[Pose]]] | None = None
    tolerance_m: float | None = None
    detour: bool = True
    grips: Sequence[bool | None] = ()


@dataclass(frozen=True, eq=False)
class Segment:
    """The move to a keyframe.

    Attributes:
        kind: STRAIGHT, LINE, DEMO or DETOUR.
        q: (m, k) rad, without the joints that the move begins at; the last row is the keyframe's.
        off_line_m: of a move straight in joint space: the tool's largest distance from the straight line.
        avoided: what a straight move would have touched, where that is why this isn't one.
        wide: the tool's deviation on a wide straight move; or the one because of which this is a LINE.
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
