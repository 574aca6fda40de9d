"""What the live tracker announces while the hand moves."""

from __future__ import annotations

from dataclasses import dataclass

from pbd.data import Keyframe
from pbd.tracking.first_rest import Rest


@dataclass(frozen=True, eq=False)
class RestFound:
    """By `t` s the sensor has rested for a second: tracking begins, at the origin of nav."""

    t: float
    rest: Rest


@dataclass(frozen=True, eq=False)
class StopBegan:
    """The hand has stood still since `t` s: the hand may move on.

    Attributes:
        index: of the stop, from 0.
        t: s, when the stop began.
        announced_t: s, when that was known: the time of the sample that brought this event.
        keyframe: where the hand stands; its time, dwell and pose are those so far.
        flaws: what was wrong with the data since the stop before, a line each.
    """

    index: int
    t: float
    announced_t: float
    keyframe: Keyframe
    flaws: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class StopEnded:
    """The hand left its stop at `t` s, and the keyframe is final."""

    index: int
    t: float
    keyframe: Keyframe


@dataclass(frozen=True, eq=False)
class DataFlaw:
    """Something is wrong with the data at `t` s (that of the last good sample): one line for a person."""

    t: float
    message: str


LiveEvent = RestFound | StopBegan | StopEnded | DataFlaw
