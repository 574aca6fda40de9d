"""The frozen values that pass between the stages, in the order in which they come to be.

Arrays are copied in, made read-only and checked for their shape; a value that exists is a value that is well formed.
SI and radians throughout; frames stand in the names (docs/frames.md): `sensor`, `nav`, `base`, `tool`, `dock`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from pbd.pose import Array, Pose, readonly

GRAVITY = 9.80665
"""Standard gravity, m/s2: what a sensor's unit "g" means. Tracking estimates the local value at rest."""


def _freeze(owner: object, **shapes: tuple[int | None, ...]) -> None:
    """Replace array fields by read-only copies of the given shapes (None: any length)."""
    for name, shape in shapes.items():
        value = getattr(owner, name)
        if value is None:
            continue
        array = readonly(value)
        if len(array.shape) != len(shape) or any(
            want is not None and want != got for want, got in zip(shape, array.shape, strict=True)
        ):
            raise ValueError(f"{type(owner).__name__}.{name} must have shape {shape}, got {array.shape}")
        object.__setattr__(owner, name, array)


# --- tracking ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class GripEvent:
    """The hand closed (or opened) its grip at `t` seconds from the first sample."""

    t: float
    closed: bool


@dataclass(frozen=True)
class RecordingInfo:
    """Where a recording comes from: its name, the sensor, the nominal rate in Hz, the UTC start in ISO 8601."""

    name: str = "recording"
    sensor: str = "unknown"
    rate_hz: float | None = None
    created: str | None = None


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
        _freeze(self, t=(n,), acc=(n, 3), gyr=(n, 3), mag=(n, 3), device_rpy=(n, 3))
        object.__setattr__(self, "grip", tuple(self.grip))

    def __len__(self) -> int:
        return len(self.t)

    @property
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
        _freeze(self, t=(n,), p_nav_sensor=(n, 3), wxyz_nav_sensor=(n, 4))


@dataclass(frozen=True)
class GraspedObject:
    """What the hand grips: a box (x, y, z), cylinder (diameter, height) or sphere (diameter); sizes in metres."""

    shape: str
    size: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Demonstration:
    """A recording and what is known about it beside the sensor's stream.

    `keyframes` are those that a person edited; they win over the automatic ones. `closed`: the hand ended at the dock.
    """

    recording: Recording
    truth: Truth | None = None
    keyframes: tuple[Keyframe, ...] | None = None
    notes: str = ""
    bundled: bool = False
    closed: bool = False
    grasped: GraspedObject | None = None
    folder: Path | None = None


@dataclass(frozen=True, eq=False)
class Attitude:
    """The sensor's orientation in nav.

    Attributes:
        wxyz_nav_sensor: (n, 4) at each sample's instant.
        gyro_bias: (n, 3) rad/s; zero where there is no gyro.
    """

    wxyz_nav_sensor: Array
    gyro_bias: Array

    def __post_init__(self) -> None:
        n = len(self.wxyz_nav_sensor)
        _freeze(self, wxyz_nav_sensor=(n, 4), gyro_bias=(n, 3))


@dataclass(frozen=True)
class Stop:
    """The hand stands still over the samples start <= i < stop, for `dwell_s` seconds."""

    start: int
    stop: int
    dwell_s: float


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
        cov: (len(stops), 6, 6) of position (m) and rotation vector (rad) in nav, at each stop.
        grip: the recording's grip events.
    """

    t: Array
    p_nav_sensor: Array
    v_nav_sensor: Array
    wxyz_nav_sensor: Array
    stops: tuple[Stop, ...]
    closure: Array
    cov: Array
    grip: tuple[GripEvent, ...] = ()

    def __post_init__(self) -> None:
        n, k = len(self.t), len(self.stops)
        _freeze(self, t=(n,), p_nav_sensor=(n, 3), v_nav_sensor=(n, 3), wxyz_nav_sensor=(n, 4))
        _freeze(self, closure=(max(k - 1, 0), 3), cov=(k, 6, 6))
        object.__setattr__(self, "stops", tuple(self.stops))
        object.__setattr__(self, "grip", tuple(self.grip))


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A pose at which the hand stood still.

    Attributes:
        t: s, the middle of the stop.
        dwell_s: how long the hand stood.
        T_nav_sensor: the sensor's pose.
        cov: (6, 6) m and rad: position, then rotation vector, in nav.
        grip: True where the grip closes at this stop, False where it opens, None where nothing changes.
        label: a word for people.
        tolerance_m: how far the tool may be off, where a person said so.
    """

    t: float
    dwell_s: float
    T_nav_sensor: Pose
    cov: Array
    grip: bool | None = None
    label: str = ""
    tolerance_m: float | None = None

    def __post_init__(self) -> None:
        _freeze(self, cov=(6, 6))


@dataclass(frozen=True)
class Segment:
    """A rest or a move, over the samples start <= i < stop; `ms` from its first to its last sample (Table I)."""

    start: int
    stop: int
    kind: str
    ms: float
    description: str


# --- calibration ------------------------------------------------------------------------------------------------------


TOOL_DOWN = Pose(np.zeros(3), np.array([0.0, 1.0, 0.0, 0.0]))
"""T_sensor_tool where nobody says else: a half turn about x, so that a level sensor is a gripper that points down."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """How the hand's frame lies in the robot's: exactly one of T_base_dock and T_base_nav is given.

    Attributes:
        T_base_dock: the sensor's pose in base at its first rest; only its position and yaw are taken.
        any_attitude: take the dock's yaw alone and say nothing of the tilt.
        T_base_nav: nav in base, registered from touched points.
        T_sensor_tool: how the sensor sits on the tool; by default a level sensor is a gripper that points down.
        table_height: m, z of the table's top in base, or None.
        scale: multiplies p_nav_sensor, and nothing else.
        robots: the robots that it is for; empty: any.
    """

    name: str
    T_base_dock: Pose | None = None
    any_attitude: bool = False
    T_base_nav: Pose | None = None
    T_sensor_tool: Pose = TOOL_DOWN
    table_height: float | None = None
    scale: float = 1.0
    robots: tuple[str, ...] = ()
    residuals: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if (self.T_base_dock is None) == (self.T_base_nav is None):
            raise ValueError("a calibration takes exactly one of T_base_dock and T_base_nav")


# --- arm --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Gripper:
    """Finger joints, their positions (m or rad) when open and closed, and the seconds that a full stroke takes."""

    joints: tuple[str, ...]
    open: Array
    closed: Array
    stroke_s: float

    def __post_init__(self) -> None:
        k = len(self.joints)
        _freeze(self, open=(k,), closed=(k,))


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Per joint: position rad, velocity rad/s, acceleration rad/s2, jerk rad/s3; `source` says who says so."""

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    source: str

    def __post_init__(self) -> None:
        k = len(self.lower)
        _freeze(self, lower=(k,), upper=(k,), velocity=(k,), acceleration=(k,), jerk=(k,))


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm as robots/NAME.toml describes it.

    Attributes:
        urdf, srdf: files; `package_dirs` are where package:// addresses in them are looked up.
        base: the body whose frame is `base`.
        body: the body that T_body_tool is given in.
        T_body_tool: z the approach direction, x the way the jaws open, the origin between the fingertips.
        joints: names of the arm's joints, base to tool.
        home: (k,) rad.
        gripper: or None.
        limits: of `joints`.
        dock: the calibration that is used where the user names none, or None.
        notes: what is assumed, for people.
    """

    name: str
    description: str
    urdf: Path
    srdf: Path | None
    package_dirs: tuple[Path, ...]
    base: str
    body: str
    T_body_tool: Pose
    joints: tuple[str, ...]
    home: Array
    gripper: Gripper | None
    limits: JointLimits
    dock: Calibration | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _freeze(self, home=(len(self.joints),))


@dataclass(frozen=True, eq=False)
class Samples:
    """A joint trajectory at instants: t (n,) s; q, qd, qdd (n, k); gripper (n,) opening, 1 open, 0 closed."""

    t: Array
    q: Array
    qd: Array
    qdd: Array
    gripper: Array

    def __post_init__(self) -> None:
        n, k = self.q.shape
        _freeze(self, t=(n,), q=(n, k), qd=(n, k), qdd=(n, k), gripper=(n,))


@dataclass(frozen=True, eq=False)
class JointTrajectory:
    """A motion as cubic pieces, so that position, velocity, acceleration and jerk are known exactly at every instant.

    Attributes:
        joint_names: k names.
        knots: (m + 1,) s, from 0, increasing: piece i holds over knots[i] <= t <= knots[i + 1].
        coefficients: (m, 4, k): q = c0 + c1 s + c2 s^2 + c3 s^3 with s = t - knots[i].
        gripper_t: (g,) s; gripper_opening: (g,) 1 open, 0 closed; linear between, held outside.
        keyframe_t: (f,) s, when the arm reaches each keyframe.
        keyframe_q: (f, k) rad, the joints that were solved for it.
    """

    joint_names: tuple[str, ...]
    knots: Array
    coefficients: Array
    gripper_t: Array
    gripper_opening: Array
    keyframe_t: Array
    keyframe_q: Array

    def __post_init__(self) -> None:
        m, k, g, f = len(self.coefficients), len(self.joint_names), len(self.gripper_t), len(self.keyframe_t)
        _freeze(self, knots=(m + 1,), coefficients=(m, 4, k))
        _freeze(self, gripper_t=(g,), gripper_opening=(g,), keyframe_t=(f,), keyframe_q=(f, k))

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.knots[-1])

    def at(self, t: Array) -> Samples:
        """Evaluate at instants (n,) in seconds; outside, the ends are held."""
        t = np.asarray(t, dtype=np.float64)
        inside = np.clip(t, 0.0, self.duration)
        piece = np.clip(np.searchsorted(self.knots, inside, side="right") - 1, 0, len(self.coefficients) - 1)
        s = (inside - self.knots[piece])[:, None]
        c0, c1, c2, c3 = np.moveaxis(self.coefficients[piece], 1, 0)
        moving = (t < self.duration)[:, None]  # held at the end, to the last bit: controllers refuse a final velocity
        return Samples(
            t=t,
            q=c0 + s * (c1 + s * (c2 + s * c3)),
            qd=(c1 + s * (2.0 * c2 + s * 3.0 * c3)) * moving,
            qdd=(2.0 * c2 + 6.0 * s * c3) * moving,
            gripper=np.interp(t, self.gripper_t, self.gripper_opening),
        )

    def sample(self, rate_hz: float) -> Samples:
        """Evaluate at a constant rate from 0 until the end has been reached and is held."""
        return self.at(np.arange(int(np.ceil(self.duration * rate_hz)) + 1) / rate_hz)

    @cached_property
    def _at_1khz(self) -> Samples:
        return self.sample(1000.0)

    @property
    def t(self) -> Array:
        """(n,) s at 1 kHz."""
        return self._at_1khz.t

    @property
    def q(self) -> Array:
        """(n, k) rad at 1 kHz."""
        return self._at_1khz.q

    @property
    def qd(self) -> Array:
        """(n, k) rad/s at 1 kHz."""
        return self._at_1khz.qd

    @property
    def qdd(self) -> Array:
        """(n, k) rad/s2 at 1 kHz."""
        return self._at_1khz.qdd

    @property
    def gripper(self) -> Array:
        """(n,) opening at 1 kHz: 1 open, 0 closed."""
        return self._at_1khz.gripper
