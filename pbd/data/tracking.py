"""Values of tracking, from the sensor's samples to the keyframes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pbd.data.calibration import Calibration
from pbd.data.constraints import CalibrationUpdate, ClaimFit, Contact, Known, Place
from pbd.data.covariance import PoseCovariance
from pbd.data.estimated_sensor_errors import SensorEstimate
from pbd.data.fusion import Fusion
from pbd.data.keyframe import Keyframe, TouchUp
from pbd.data.one_line_repr import brief, counted, span
from pbd.data.recording import GripEvent, Recording, Truth
from pbd.data.world import GraspedObject
from pbd.errors import WrongValueError
from pbd.frozen_arrays import Frozen, freeze_arrays
from pbd.lazy import cached_property
from pbd.pose import Array

DOUBTED_WEIGHT = 0.8
"""Weight below which a stop is reported as doubtful. A stop is left out if its weight is 1 - DOUBTED_WEIGHT or less."""

UNSURE_SIGMA_M = 0.05
"""Standard deviation of a keyframe's position above which a warning is given, m."""


@dataclass(frozen=True, eq=False)
class Demonstration:
    """A recording and everything else that is known about the demonstration.

    Attributes:
        recording: the recording; the first take's in a fused demonstration.
        keyframes: those edited by a person, which replace the automatic ones.
        closed: the hand ended at the dock.
        failed: it was recorded or imported with fewer than two stops, or could not be tracked then.
        places, contacts: known places and heights of stops.
        takes: of a fused demonstration.
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
    failed: bool = False

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
        """What tracking may rely on: `closed`, `places` and `contacts`."""
        return Known(self.closed, self.places, self.contacts)

    @property
    def recorded(self) -> Demonstration:
        """The same as the sensor alone shows it: nothing known of its stops or its takes' stops, nothing edited."""
        takes = tuple(take.recorded for take in self.takes)
        return replace(self, keyframes=None, touch_ups=(), closed=False, places=(), contacts=(), takes=takes)


@dataclass(frozen=True)
class Stop:
    """The hand stands still over the samples start <= i < stop. `weight`: the confidence that it does, 0 to 1."""

    start: int
    stop: int
    dwell_s: float
    weight: float = 1.0

    @property
    def middle(self) -> int:
        """The sample in its middle."""
        return (self.start + self.stop - 1) // 2

    def middle_s(self, t: Array) -> float:
        """Half-way from its first sample to its last, s; t (n,) s are the times of all samples."""
        return 0.5 * float(t[self.start] + t[self.stop - 1])


@dataclass(frozen=True, eq=False)
class Tracking(Frozen):
    """What a path was tracked from, and intermediate results that other stages use.

    Attributes:
        method: "default" or "paper".
        calibration: has the sensor's errors, and where known places lie in nav; or None.
        recording: the repaired and calibrated recording, at the path's instants.
        a_nav: (n, 3) motion acceleration as integrated, m/s2: specific force in nav minus gravity.
        gravity: norm of the specific force at rest, m/s2.
        rest: the samples start <= i < stop from which noise, gyro bias and gravity are estimated.
        accept_gap: whether a person said that the hand stood still where a rest lacks data.
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
        freeze_arrays(self, a_nav=(len(self.recording), 3))

    def __repr__(self) -> str:
        by = "" if self.calibration is None else f"calibrated by '{self.calibration.name}'"
        return brief(self, self.method, f"gravity {self.gravity:.3f} m/s2", by, name=self.demo.recording.info.name)


@dataclass(frozen=True, eq=False)
class HandPath(Frozen):
    """The hand's path in nav, segmented by its stops.

    Attributes:
        t: (n,) s.
        p_nav_sensor: (n, 3) m; the origin is the first rest.
        v_nav_sensor: (n, 3) m/s; exactly zero in stops.
        wxyz_nav_sensor: (n, 4).
        stops: in order; between two of them lies one move.
        closure: (len(stops) - 1, 3) velocity at each move's end before its correction to zero, m/s: the raw drift.
        covariance: joint covariance of the poses at all stops, relative to the first stop's position and heading.
        claims: the claims about stops that were used.
        calibration_update: what they say of the calibration; None: nothing.
        tracking: what the path was tracked from; None for a path that was not tracked.
        sensor: the sensor's errors as estimated; None if they were not.
        fusion: how several takes were combined; None for a single take.
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
    calibration_update: CalibrationUpdate | None = None
    tracking: Tracking | None = None
    sensor: SensorEstimate | None = None
    fusion: Fusion | None = None

    def __post_init__(self) -> None:
        n, k = len(self.t), len(self.stops)
        freeze_arrays(self, t=(n,), p_nav_sensor=(n, 3), v_nav_sensor=(n, 3), wxyz_nav_sensor=(n, 4))
        freeze_arrays(self, closure=(max(k - 1, 0), 3))
        if self.covariance.count != k:
            raise WrongValueError(f"HandPath.covariance must be of {k} poses, got {self.covariance.count}")

    @property
    def cov(self) -> Array:
        """(len(stops), 6, 6) covariance of position (m) and rotation vector (rad) in nav, at each stop."""
        return self.covariance.of_each

    @property
    def demonstrated(self) -> slice:
        """The samples from the first stop to the last. Outside them no stop bounds the path on one side."""
        return slice(self.stops[0].start, self.stops[-1].stop)

    @cached_property
    def rests(self) -> tuple[tuple[float, float], ...]:
        """When each stop begins and ends, s."""
        return tuple((float(self.t[stop.start]), float(self.t[stop.stop - 1])) for stop in self.stops)

    def stop_at(self, t: float) -> int | None:
        """Index of the stop during which t (s) is; None: the hand moves then."""
        return next((k for k, (begin, end) in enumerate(self.rests) if begin <= t <= end), None)

    def stop_numbers(self, t: Sequence[float]) -> Array:
        """The stop's number at each t (s); in moves between two numbers, by the share of the time (`errors_at`)."""
        return np.interp(t, np.ravel(self.rests), np.repeat(np.arange(len(self.stops)), 2))

    def rest_at(self, t: float) -> tuple[float, float]:
        """When the hand's rest at t (s) begins and ends; t and t if the hand moves then."""
        k = self.stop_at(t)
        return (t, t) if k is None else self.rests[k]

    def __repr__(self) -> str:
        return brief(
            self, span(self.t), counted(len(self.stops), "stop") or "no stops", counted(len(self.grip), "grip")
        )


@dataclass(frozen=True)
class HandSegment:
    """A rest or a move over the samples start <= i < stop. `ms`: from the first to the last sample (Table I), ms."""

    start: int
    stop: int
    kind: str
    ms: float
    description: str
