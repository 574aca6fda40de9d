"""The state of each move between keyframes and of each link of the ladder graph, while a motion is searched for."""

from dataclasses import dataclass, field

from pbd.arm.collision.scene import Hit
from pbd.arm.motion_request import DETOUR, STRAIGHT, MotionRequest, Segment
from pbd.arm.tool_deviation import ToolDeviation
from pbd.pose import Array, Pose


@dataclass(eq=False)
class MoveState:
    """The state of the search for the move to a keyframe.

    Attributes:
        kind: STRAIGHT, LINE or DEMO: how the move is made at present.
        remedies: what to try next, in order: "follow" (a path), "widen", "split", "detour", "connect".
        hits: kind of move -> the first hit that was found.
        pose_hit: a hit of the arm at the keyframe itself.
        barred_pairs: number of barred pairs of configurations.
        wide: the tool's deviation on the wide straight move that a path replaced.
        tried_around: a detour was tried in place of that move, or there was no reason to.
        detour: nothing else was free, so a detour is searched for.
        detour_checks: number of collision checks of the searches for a detour.
        widened: more configurations were added at the keyframe.
    """

    kind: str
    remedies: list[str]
    hits: dict[str, Hit] = field(default_factory=dict)
    pose_hit: Hit | None = None
    barred_pairs: int = 0
    wide: ToolDeviation | None = None
    tried_around: bool = False
    detour: bool = False
    detour_checks: int = 0
    widened: bool = False

    def keep_detours_only(self) -> bool:
        """Drop all remedies except detours; return whether any is left."""
        self.remedies[:] = self._detours()
        return bool(self.remedies)

    def drop_remedy(self, name: str) -> None:
        """Drop one remedy."""
        self.remedies = [each for each in self.remedies if each != name]

    def drop_path_remedies(self) -> None:
        """Drop the remedies that keep the tool on its present path, since it touches something there."""
        if "split" in self.remedies:
            self.remedies = [*self.remedies[: self.remedies.index("split")], *self._detours()]

    def _detours(self) -> list[str]:
        return self.remedies[self.remedies.index("detour") :] if "detour" in self.remedies else self.remedies[:0]

    def segment(self, q: Array) -> Segment:
        """Make a segment of joints (m, k); a detour with m = 1 is a straight move."""
        kind = (DETOUR if len(q) > 1 else STRAIGHT) if self.detour else self.kind
        return Segment(kind, q, avoided=None if kind == STRAIGHT else self.hits.get(STRAIGHT), wide=self.wide)


@dataclass(eq=False)
class Link:
    """The link to a layer: a part of the move to a keyframe.

    Attributes:
        keyframe: index of the keyframe; n for the retreat.
        poses: the tool's poses along the link; None: straight in joint space.
        at_keyframe: the layer is the keyframe itself, not a pose on the way.
        free_moves: `ends_key` of a free move -> its joints (m, k), without the first.
    """

    keyframe: int
    poses: tuple[Pose, ...] | None = None
    at_keyframe: bool = True
    free_moves: dict[bytes, Array] = field(default_factory=dict)


def ends_key(q_before: Array, q: Array) -> bytes:
    """Return the key of a move between two configurations (k,) in `Link.free_moves`."""
    return q_before.tobytes() + q.tobytes()


def remedies_of(request: MotionRequest, i: int, *, may_detour: bool) -> list[str]:
    """Return the remedies for the move to keyframe i in the order of trial; i = n is the retreat."""
    if i in (0, len(request.T_base_tool)):
        return ["detour", "connect"] if may_detour else ["widen"]
    if request.kind != STRAIGHT:
        return ["split", "widen"]
    if not may_detour or request.tolerance_m is not None:
        return ["follow", "widen", "split"]
    # A line is optional, so it gets fewer remedies.
    path = ["follow", "widen", "split"] if request.hand_paths else ["follow"]
    return [*path, "detour", "connect"]
