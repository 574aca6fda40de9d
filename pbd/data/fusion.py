"""How several takes of one task were combined into one demonstration."""

from dataclasses import dataclass

from pbd.data.constraints import Place
from pbd.data.one_line_repr import brief, counted
from pbd.frozen_arrays import Frozen, freeze_arrays
from pbd.pose import Array, Pose

TOLERANCE_SIGMAS = 2.0
"""A keyframe's learned tolerance in standard deviations of the hand's scatter: 95 % along each axis."""


@dataclass(frozen=True, eq=False)
class FusedTake(Frozen):
    """One take, and how its keyframes match those of the task.

    Attributes:
        own: for each keyframe of the task the index of the take's keyframe, or None.
        off: (n, 3) offset of the take's keyframes from the task's in nav, m; NaN where the take has none.
        off_rad: (n,) angle between the attitudes of the take's keyframes and the task's, rad; NaN where there is none.
        outliers: the task's keyframes at which the take is not used.
        extra: keyframes of the take that few other takes have; they are not used.
        yaw: rotation of the take's nav about z relative to the first take's, rad.
        T_hand: pose of the sensor in the hand relative to the first take's; None if the take is left out.
        turn_sigma: one sigma of the rotation in T_hand about its least certain axis, rad.
        device: index of the take's device among the devices of all takes.
        left_out: why the take is not used at all, or "".
    """

    name: str
    own: tuple[int | None, ...]
    off: Array
    off_rad: Array
    outliers: tuple[int, ...] = ()
    extra: tuple[int, ...] = ()
    yaw: float = 0.0
    T_hand: Pose | None = None
    turn_sigma: float = 0.0
    device: int = 0
    left_out: str = ""

    def __post_init__(self) -> None:
        freeze_arrays(self, off=(len(self.own), 3), off_rad=(len(self.own),))


@dataclass(frozen=True)
class MovedThing:
    """A thing that stood elsewhere in some takes, so that a run of keyframes moved together.

    Attributes:
        first, last: the first and the last keyframe of the run, both included.
        moved_m: take -> distance from where the thing stood in the first take, m.
    """

    first: int
    last: int
    moved_m: dict[str, float]


@dataclass(frozen=True, eq=False)
class Fusion(Frozen):
    """The takes of a task, and the hand's scatter from take to take. The tracker's own uncertainty is taken out.

    Attributes:
        scatter: (n, 3) standard deviation at each of the task's keyframes along nav's axes, m.
        turn: (n,) standard deviation of the attitude about each axis, rad.
        log_sigma: (n, 4) one sigma of the logarithms of `scatter` and `turn`.
        overall: standard deviations (m, rad) over all keyframes but the first.
        overall_log_sigma: one sigma of the logarithms of `overall`.
        places: keyframes whose places in base the takes know, at the path's times.
        thing: the thing that stood elsewhere in some takes, or None.
    """

    takes: tuple[FusedTake, ...]
    scatter: Array
    turn: Array
    log_sigma: Array
    overall: tuple[float, float]
    overall_log_sigma: tuple[float, float]
    places: tuple[Place, ...] = ()
    thing: MovedThing | None = None

    def __post_init__(self) -> None:
        n = len(self.scatter)
        freeze_arrays(self, scatter=(n, 3), turn=(n,), log_sigma=(n, 4))

    @property
    def tolerance_m(self) -> Array:
        """(n, 3) learned tolerance of the position, m: where the hand scatters much, precision matters little."""
        return TOLERANCE_SIGMAS * self.scatter

    @property
    def tolerance_rad(self) -> Array:
        """(n,) learned tolerance of the attitude, rad."""
        return TOLERANCE_SIGMAS * self.turn

    def __repr__(self) -> str:
        return brief(self, counted(len(self.takes), "take"), counted(len(self.scatter), "keyframe"))
