"""Values of a recording session: its options, a person's commands, the status for the screen, the outcome."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pbd.data import Keyframe, Recording, SensorErrors
from pbd.pose import Array
from pbd.sensors.decoding import Sample

NOTHING = (np.nan, np.nan, np.nan)
"""A reading that is missing."""

FEWEST_STOPS = 2
"""Least number of stops that can be replayed: the first rest and one more."""


def recording_of(t: Array, samples: Sequence[Sample], **more: Any) -> Recording:
    """Samples with an acceleration, at t (n,) s, as a recording with `more`; of a channel that some lack: NaN there."""
    channels: dict[str, Any] = {
        name: np.array([getattr(sample, name) or NOTHING for sample in samples]).reshape(-1, 3)
        for name in ("acc", "gyr", "mag", "rpy")
        if name == "acc" or any(getattr(sample, name) for sample in samples)
    }
    return Recording(t, channels.pop("acc"), device_rpy=channels.pop("rpy", None), **channels, **more)


class Command(enum.Enum):
    """What a person may do while recording."""

    END = enum.auto()
    GRIP = enum.auto()
    DISCARD = enum.auto()


@dataclass(frozen=True)
class RecordOptions:
    """What to record, and how.

    Attributes:
        duration_s: the recording ends after this many seconds of samples.
        tolerance_m: a move whose sigma grows beyond this is worth a pause.
        closed: the hand will end at the dock.
        force: replace a demonstration of that name, once the new one has ended well.
        taps: two taps on the sensor's back mark the grip, beside the person's key.
        errors: of the sensor, as calibrated: the live tracker works without them, and a rest that contradicts them is
            told. What is recorded stays as it was read.
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
class Say:
    """A message, with a bell if the person should act or may go on."""

    t: float
    text: str
    bell: bool = False


@dataclass(frozen=True, eq=False)
class Status:
    """What the screen shows at t s since the first sample.

    Attributes:
        rate_hz: as measured over the last second.
        lost: samples that never came.
        bad_packets: thrown away by the decoder.
        waiting: what the tracker waits for, or "".
        keyframes: one a stop.
        p_nav_sensor, v_nav_sensor, wxyz_nav_sensor: (3,) m, (3,) m/s, (4,).
        sigma_m: one sigma of the position, if the hand stopped now.
        sigma_of_move_m: the part of it that the move under way adds; 0 in a stop.
        tremble: m/s2, rms of the last half second.
        said: what is new since the last status.
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
    tremble: float
    closed: bool
    said: tuple[Say, ...]


@dataclass(frozen=True)
class Outcome:
    """How a recording ended, with the numbers of its last `Status`.

    Attributes:
        folder: where it is; None where it was discarded.
        ended_by: by whom or what.
        before: what became of the demonstration that had the name before, in words, or "".
    """

    folder: Path | None
    samples: int
    duration_s: float
    lost: int
    bad_packets: int
    stops: int
    ended_by: str
    before: str = ""
