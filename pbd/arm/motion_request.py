"""The request for a motion, and the motion that was chosen for it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pbd.arm.collision.scene import Hit
from pbd.arm.tool_deviation import ToolDeviation
from pbd.data.one_line_repr import brief, counted
from pbd.frozen_arrays import Frozen, readonly
from pbd.pose import Array, Pose

STRAIGHT, LINE, DEMO, DETOUR = "straight", "line", "demo", "detour"
"""Kinds of moves: straight in joint space; the tool on a straight line; the tool on the hand's path; a detour in joint
space around what a straight move would touch."""


@dataclass(frozen=True, eq=False)
class MotionRequest:
    """The request for a motion through n keyframes.

    Attributes:
        T_base_tool: n poses of the tool, one for each keyframe.
        q_start: (k,) rad, the arm's present joints; configurations near them are preferred.
        approach: the motion begins at q_start; else at keyframe 0.
        q_retreat: (k,) rad, where the arm retreats to after the last keyframe; None: it stays there.
        kind: kind of the moves between keyframes: STRAIGHT, LINE or DEMO.
        hand_paths: function that returns the n - 1 demonstrated paths of the tool; None if they are unknown.
        tolerance_m: a straight move on which the tool leaves the straight line by more becomes a LINE. Without a
            tolerance, a wide move (see tool_deviation.py) does if possible.
        detour: search for a DETOUR if nothing else is free; between keyframes only if `kind` is STRAIGHT and there is
            no tolerance.
        grips: for each keyframe, True if the gripper closes there, False if it opens, None if it does not move. An
            empty sequence: it stays open.
    """

    T_base_tool: Sequence[Pose]
    q_start: Array
    approach: bool = True
    q_retreat: Array | None = None
    kind: str = STRAIGHT
    hand_paths: Callable[[], Sequence[Sequence[Pose]]] | None = None
    tolerance_m: float | None = None
    detour: bool = True
    grips: Sequence[bool | None] = ()


@dataclass(frozen=True, eq=False)
class Segment(Frozen):
    """The move to a keyframe.

    Attributes:
        kind: STRAIGHT, LINE, DEMO or DETOUR.
        q: (m, k) rad, without the joints at which the move begins; the last row is the keyframe's.
        off_line_m: for a STRAIGHT move, the tool's largest distance from the straight line.
        avoided: what a straight move would have touched, if that is the reason for another kind.
        wide: the tool's deviation on a wide STRAIGHT move, or on the one that a path replaced.
    """

    kind: str
    q: Array
    off_line_m: float = 0.0
    avoided: Hit | None = None
    wide: ToolDeviation | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "q", readonly(self.q))

    def __repr__(self) -> str:
        off = f"{1e3 * self.off_line_m:.1f} mm off the line" if self.off_line_m else ""
        return brief(self, self.kind, counted(len(self.q), "row"), off)

    @property
    def curved(self) -> bool:
        """Whether the arm follows a smooth curve through q; else it moves straight from each row to the next."""
        return self.kind != STRAIGHT


@dataclass(frozen=True, eq=False)
class Motion:
    """Joints (n, k) at the keyframes, the segments to them, and the retreat or None."""

    q: Array
    segments: tuple[Segment, ...]
    retreat: Segment | None
