"""Values of tracking, from the sensor's samples to the keyframes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from pbd.data.calibration import Calibration
from pbd.data.constraints import ClaimFit, Contact, Known, Place
from pbd.data.covariance import PoseCovariance
from pbd.data.freeze import freeze
from pbd.data.fusion import Fusion
from pbd.data.keyframe import Keyframe, TouchUp
from pbd.data.one_line_repr import brief, counted, span
from pbd.data.sensor_estimate import SensorEstimate
from pbd.data.world import GraspedObject
from pbd.pose import Array

DOUBTED_WEIGHT = 0.8
"""Weight below which a stop is reported as doubtful; one that is as surely none is left out."""


@dataclass(frozen=True)
class GripEvent:
    """The hand closed (or opened) its grip at `t` seconds from the first sample."""

    t: float
    closed: bool


@dataclass(frozen=True)
class RecordingInfo:
    """Where a recording comes from: its name, the sensor, the nominal rate in Hz, the UTC start in ISO 8601.

    `clock` says where its times come from, in words.
    """

    name: str = "recording"
    sensor: str = "unknown"
    rate_hz: float | None = None
    created: str | None = None
    clock: str = ""


@dataclass(frozen=True, eq=False)
class Recording:
    """What a sensor said, in SI units and the housing's axes.

    Attributes:
        t: (n,) s from the first sample, increasing.
        acc: (n, 3) m/s2, specific force: +g up at rest. NaN where a sample is missing.
        gyr: (n, 3) rad/s, or None where the device has no gyro.
        mag: (n, 3) uT, or None.
        device_rpy: (n, 3) rad, the device's own roll, pitch, yaw (about x, y, z of ENU, URDF's order), or None.
        grip: when the grip closed and opened.
        info: name, sensor, nominal rate, start.
    """

    t: Array
    acc: Array
    gyr: Array | None = None
    mag: Array | None = None
    device_rpy: Array | None = None
    grip: tuple[GripEvent, ...] = ()
    info: RecordingInfo = field(default_factory=RecordingInfo)

    def __post_init__(self) -> None:
        n = len(self.t)
        freeze(self, t=(n,), acc=(n, 3), gyr=(n, 3), mag=(n, 3), device_rpy=(n, 3))

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        channels = [name for name in ("acc", "gyr", "mag", "device_rpy") if getattr(self, name) is not None]
        return brief(self, span(self.t), *channels, counted(len(self.grip), "grip"), name=self.info.name)

    @cached_property
    def rate_hz(self) -> float:
        """The measured rate: the inverse of the median sampling interval."""
        return float(1.0 / np.median(np.diff(self.t)))


@dataclass(frozen=True, eq=False)
class Truth:
    """The sensor's true pose in nav, where it is known (simulated or optical): t (n,), p (n, 3), wxyz (n, 4)."""

    t: Array
    p_nav_sensor: Array
    wxyz_nav_sensor: Array

    def __post_init__(self) -> None:
        n = len(self.t)
        freeze(self, t=(n,), p_nav_sensor=(n, 3), wxyz_nav_sensor=(n, 4))

    def __repr__(self) -> str:
        return brief(self, span(self.t))


@dataclass(frozen=True, eq=False)
class Demonstration:
    """A recording and what is known about it beside the sensor's stream.

    `keyframes` are those that a person edited; they win over the automatic ones. `touch_ups` correct either. `closed`:
    the hand ended at the dock; with `places` and `contacts` it is what tracking may rely on: `known`. `takes`: those
    that it is made of; its recording is then the first one's.
    """

    recording: Recording
    truth: Truth | None = None
    keyframes: tuple[Keyframe, ...] | None = None
    touch_ups: tuple[TouchUp, ...] = ()
    notes: str = ""
    bundled: bool = False
    closed: bool = False
    places: tuple[Place, ...] = ()
    contacts: tuple[Contact, ...] = ()
    grasped: GraspedObject | None = None
    folder: Path | None = None
    takes: tuple[Demonstration, ...] = ()

    def __repr__(self) -> str:
        return brief(
            self,
            span(self.recording.t),
            "truth" if self.truth is not None else "",
            counted(len(self.keyframes or ()), "edited keyframe"),
            "bundled" if self.bundled else "",
            counted(len(self.takes), "take"),
            name=self.recording.info.name,
        )

    @property
    def known(self) -> Known:
        """Known places and contacts, as `track` takes them."""
        return Known(self.closed, self.places, self.contacts)


@dataclass(frozen=True)
class Stop:
    """The hand stands still over the samples start <= i < stop, for `dwell_s` seconds; `weight`: how sure that is."""

    start: int
    stop: int
    dwell_s: float
    weight: float = 1.0


@dataclass(frozen=True, eq=False)
class Tracking:
    """What a path was tracked from, and intermediate results that others use again.

    Attributes:
        demo: as it was given: with edited keyframes, what is known of the stops, what is grasped.
        method: one of pbd.pipeline.METHODS.
        calibration: says what the sensor reads wrongly and where known places lie in nav; or None.
        recording: as repaired and calibrated, at the path's instants.
        a_nav: (n, 3) m/s2, motion acceleration as integrated: specific force in nav less gravity.
        gravity: m/s2, the norm of specific force at rest.
        rest: the samples start <= i < stop that tell the sensor's noise, the gyro's bias and gravity.
        accept_gap: whether the hand is known to have stood still where data are missing in a rest.
    """

    demo: Demonstration
    method: str
    calibration: Calibration | None
    recording: Recording
    a_nav: Array
    gravity: float
    rest: tuple[int, int]
    accept_gap: bool = False

    def __post_init__(self) -> None:
        freeze(self, a_nav=(len(self.recording), 3))

    def __repr__(self) -> str:
        by = "" if self.calibration is None else f"calibrated by '{self.calibration.name}'"
        return brief(self, self.method, f"gravity {self.gravity:.3f} m/s2", by, name=self.demo.recording.info.name)


@dataclass(frozen=True, eq=False)
class HandPath:
    """The hand's path in nav, segmented by its stops.

    Attributes:
        t: (n,) s.
        p_nav_sensor: (n, 3) m; the origin is the first rest.
        v_nav_sensor: (n, 3) m/s; exactly zero in stops.
        wxyz_nav_sensor: (n, 4).
        stops: in order; between two of them lies one move.
        closure: (len(stops) - 1, 3) m/s, the velocity left over at each move's end before it was removed: honest drift.
        covariance: of the poses at all stops together, relative to the first's place and heading.
        grip: the recording's grip events.
        claims: what was known of the stops and has been used.
        tracking: what it was tracked from; None for a path that no recording was tracked for.
        sensor: its own errors, as the recording shows them; None where they were not estimated.
        fusion: of several takes; None for one.
    """

    t: Array
    p_nav_sensor: Array
    v_nav_sensor: Array
    wxyz_nav_sensor: Array
    stops: tuple[Stop, ...]
    closure: Array
    covariance: PoseCovariance
    grip: tuple[GripEvent, ...] = ()
    claims: tuple[ClaimFit, ...] = ()
    tracking: Tracking | None = None
    sensor: SensorEstimate | None = None
    fusion: Fusion | None = None

    def __post_init__(self) -> None:
        n, k = len(self.t), len(self.stops)
        freeze(self, t=(n,), p_nav_sensor=(n, 3), v_nav_sensor=(n, 3), wxyz_nav_sensor=(n, 4))
        freeze(self, closure=(max(k - 1, 0), 3))
        if self.covariance.count != k:
            raise ValueError(f"HandPath.covariance must be of {k} poses, got {self.covariance.count}")

    @property
    def cov(self) -> Array:
        """(len(stops), 6, 6) of position (m) and rotation vector (rad) in nav, at each stop."""
        return self.covariance.of_each

    def __repr__(self) -> str:
        return brief(
            self, span(self.t), counted(len(self.stops), "stop") or "no stops", counted(len(self.grip), "grip")
        )


@dataclass(frozen=True)
class Segment:
    """A rest or a move, over the samples start <= i < stop; `ms` from its first to its last sample (Table I)."""

    start: int
    stop: int
    kind: str
    ms: float
    description: str
