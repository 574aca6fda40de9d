"""Types of a recording session: its options, a person's commands, the status for the screen, the outcome."""

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pbd.data import Keyframe, Recording, SensorErrors
from pbd.pose import Array
from pbd.sensors.decoding import Sample

FEWEST_STOPS = 2
"""Smallest number of stops that can be replayed: the first rest and one more."""

TOO_FEW_STOPS = "fewer than two stops: nothing to replay; hold still for two seconds, then move, stop, move, stop"


def recording_from_samples(t: Array, samples: Sequence[Sample], **more: Any) -> Recording:
    """Make a recording of samples at t (n,) s, all with an acceleration. Other missing readings become NaN.

    `more` are further fields of the recording. A channel that no sample has is None.
    """
    channels: dict[str, Any] = {
        name: np.array([getattr(sample, name) or (np.nan,) * 3 for sample in samples]).reshape(-1, 3)
        for name in ("acc", "gyr", "mag", "rpy")
        if name == "acc" or any(getattr(sample, name) for sample in samples)
    }
    return Recording(t, channels.pop("acc"), device_rpy=channels.pop("rpy", None), **channels, **more)


class Command(enum.Enum):
    """What a person, or a simulated hand, may do while recording. FINISH: the hand has done its task."""

    END = enum.auto()
    GRIP = enum.auto()
    DISCARD = enum.auto()
    FINISH = enum.auto()


ENDED_BY = dict.fromkeys((Command.END, Command.DISCARD), "stopped by you") | {Command.FINISH: "simulated task finished"}
"""Who ends a recording by a command, in words."""


@dataclass(frozen=True)
class RecordOptions:
    """What to record, and how.

    Attributes:
        folder: the demonstration's folder.
        sensor: the protocol's name.
        created: UTC start in ISO 8601.
        duration_s: end the recording after this many seconds of samples; None: no limit.
        tolerance_m: ask for a pause when the position's sigma grows beyond this in a move.
        closed: the hand will end where it started, at the dock.
        raw: also store the raw bytes.
        reconnect: wait for a sensor that is gone, and continue.
        force: replace an old demonstration of that name, once the new one has ended well.
        taps: two taps on the sensor's back mark the grip, besides the person's key.
        errors: the sensor's calibrated errors. The live tracker corrects them, and warns if the first rest contradicts
            them. The recording stays as read.
    """

    folder: Path
    sensor: str
    created: str
    duration_s: float | None = None
    tolerance_m: float = 0.01
    closed: bool = False
    raw: bool = False
    reconnect: bool = False
    force: bool = False
    taps: bool = False
    errors: SensorErrors | None = None


@dataclass(frozen=True)
class Message:
    """A message to the person, with a bell if the person should act or may move on."""

    t: float
    text: str
    bell: bool = False


@dataclass(frozen=True, eq=False)
class Status:
    """What the screen shows, t s after the first sample.

    Attributes:
        rate_hz: measured over the last second.
        samples: number of samples so far.
        lost: number of samples that never came.
        bad_packets: number of rejected packets.
        waiting: what the tracker waits for, or "".
        moving: whether the hand seems to move.
        stops: number of stops so far, as in `Feedback.stops`.
        keyframes: one for each of the tracker's stops.
        p_nav_sensor, v_nav_sensor, wxyz_nav_sensor: (3,) m, (3,) m/s, (4,).
        sigma_m: one sigma of the position along its least certain axis if the hand stopped now.
        sigma_of_move_m: the part of `sigma_m` that the present move adds; 0 in a stop.
        tremor: standard deviation of the norm of the specific force over the last half second, m/s2.
        messages: those since the last status.
        closed: whether the grip is closed.
        ended: the samples are on disk, and the whole recording is being tracked. For an hour this takes some seconds.
    """

    t: float
    rate_hz: float
    samples: int
    lost: int
    bad_packets: int
    waiting: str
    moving: bool
    stops: int
    keyframes: tuple[Keyframe, ...]
    p_nav_sensor: Array
    v_nav_sensor: Array
    wxyz_nav_sensor: Array
    sigma_m: float
    sigma_of_move_m: float
    tremor: float
    closed: bool
    messages: tuple[Message, ...]
    ended: bool = False


@dataclass(frozen=True)
class Outcome:
    """How a recording ended, with the counts of its last `Status`.

    Attributes:
        folder: the demonstration's folder; None if it was discarded.
        duration_s: time of the last sample, s after the first.
        ended_by: who or what ended it, in words.
        backup_note: what became of the demonstration that it replaced, in words, or "".
        why_bad: what was wrong with the last bad packet, as in `Tally`, or "".
        why_failed: why nothing can be replayed, or "".
    """

    folder: Path | None
    samples: int
    duration_s: float
    lost: int
    bad_packets: int
    stops: int
    ended_by: str
    backup_note: str = ""
    why_bad: str = ""
    why_failed: str = ""
