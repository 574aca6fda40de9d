"""How several takes of one task became one demonstration."""

from __future__ import annotations

from dataclasses import dataclass

from pbd.data.constraints import Place
from pbd.data.freeze import freeze
from pbd.data.one_line_repr import brief, counted
from pbd.pose import Array, Pose

TOLERANCE_SIGMAS = 2.0
"""Learned tolerance of a keyframe, in standard deviations of the hand's scatter: 95 % along each axis."""


@dataclass(frozen=True, eq=False)
class FusedTake:
    """One take.

    Attributes:
        name: the demonstration's.
        own: index of its keyframe for each of the task's, or None.
        off: (n, 3) m, its keyframes' offset from the task's, in nav; NaN where there is none.
        outliers: of the task's keyframes those at which it is not believed.
        extra: keyframes of its own that few takes have: left out.
        yaw: rad, by which its nav is turned against the first take's.
        T_hand: how its sensor sits in the hand, against the first take's; None where it is left out.
        turn_sigma: rad, one sigma of its turn there, about the axis of which least is known.
        device: its number among the takes' devices.
        left_out: why none of it is used, or "".
    """

    name: str
    own: tuple[int | None, ...]
    off: Array
    outliers: tuple[int, ...] = ()
    extra: tuple[int, ...] = ()
    yaw: float = 0.0
    T_hand: Pose | None = None
    turn_sigma: float = 0.0
    device: int = 0
    left_out: str = ""

    def __post_init__(self) -> None:
        freeze(self, off=(len(self.own), 3))


@dataclass(frozen=True)
class MovedThing:
    """A thing that stood elsewhere in some takes: its first and last keyframe of the task, which move together.

    Attributes:
        first, last: they and those between.
        log_likelihood: by how much that is likelier than that all are in one frame, as a logarithm.
        moved_m: by take, m: how far from where it stood in the first of them.
    """

    first: int
    last: int
    log_likelihood: float
    moved_m: dict[str, float]


@dataclass(frozen=True, eq=False)
class Fusion:
    """Takes made one, and the hand's scatter from take to take, without what the tracker is unsure of.

    Attributes:
        takes: as named.
        scatter: (n, 3) m, standard deviation at each of the task's keyframes along nav's axes.
        turn: (n,) rad, of the attitude about each axis.
        unsure: (n, 4) one sigma of the logarithm of those four.
        overall: m and rad, the same of all keyframes together but the first; overall_unsure of their logarithms.
        places: where takes know a keyframe to be in base, at the path's time.
        thing: that stood elsewhere in some takes, or None.
    """

    takes: tuple[FusedTake, ...]
    scatter: Array
    turn: Array
    unsure: Array
    overall: tuple[float, float]
    overall_unsure: tuple[float, float]
    places: tuple[Place, ...] = ()
    thing: MovedThing | None = None

    def __post_init__(self) -> None:
        n = len(self.scatter)
        freeze(self, scatter=(n, 3), turn=(n,), unsure=(n, 4))

    @property
    def tolerance_m(self) -> Array:
        """(n, 3) m, learned: where the hand scatters much it matters little."""
        return TOLERANCE_SIGMAS * self.scatter

    @property
    def tolerance_rad(self) -> Array:
        """(n,) rad, the same of the attitude."""
        return TOLERANCE_SIGMAS * self.turn

    def __repr__(self) -> str:
        return brief(self, counted(len(self.takes), "take"), counted(len(self.scatter), "keyframe"))
