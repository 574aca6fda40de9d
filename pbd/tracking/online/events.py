"""The events that the live tracker reports."""

from dataclasses import dataclass

from pbd.data import Keyframe
from pbd.tracking.first_rest import Rest


@dataclass(frozen=True, eq=False)
class RestFound:
    """At `t` s the sensor has rested for a second. Tracking begins there, at nav's origin."""

    t: float
    rest: Rest


@dataclass(frozen=True, eq=False)
class StopBegan:
    """The hand stands still and may move on.

    Attributes:
        index: number of the stop, from 0.
        t: s, when the stop began.
        announced_t: s, time of the sample that gave this event.
        keyframe: the stop so far: time, dwell and pose.
        continues: whether it continues the stop that had this index; else that was no stop, if there was one.
    """

    index: int
    t: float
    announced_t: float
    keyframe: Keyframe
    continues: bool = False


@dataclass(frozen=True, eq=False)
class StopEnded:
    """The hand left its stop at `t` s; the keyframe is final."""

    index: int
    t: float
    keyframe: Keyframe


@dataclass(frozen=True, eq=False)
class DataFlaw:
    """Something is wrong with the data after the last good sample at `t` s; `message` is one line for a person."""

    t: float
    message: str


LiveEvent = RestFound | StopBegan | StopEnded | DataFlaw
