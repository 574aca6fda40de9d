"""Values of planning: the robot, its motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from pbd.data.calibration import Calibration
from pbd.data.freeze import freeze
from pbd.data.one_line_repr import brief, counted, span
from pbd.pose import Array, Pose


@dataclass(frozen=True, eq=False)
class Gripper:
    """Finger joints, their positions (m or rad) when open and closed, and the seconds that a full stroke takes.

    There may be no joints, where the model shows none: the motion still says when the gripper opens and closes.
    """

    joints: tuple[str, ...]
    open: Array
    closed: Array
    stroke_s: float

    def __post_init__(self) -> None:
        k = len(self.joints)
        freeze(self, open=(k,), closed=(k,))


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Per joint: position rad, velocity rad/s, acceleration rad/s2, jerk rad/s3, effort N m (N where it slides).

    `source` names the sources in one line; `sources` has one for each: "position", "velocity", "acceleration", "jerk",
    "effort". Where no effort is known it is None, and torques are not checked.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    source: str
    sources: Mapping[str, str] = field(default_factory=dict)
    effort: Array | None = None

    def __post_init__(self) -> None:
        k = len(self.lower)
        freeze(self, lower=(k,), upper=(k,), velocity=(k,), acceleration=(k,), jerk=(k,), effort=(k,))
        object.__setattr__(self, "sources", MappingProxyType(dict(self.sources)))

    def __repr__(self) -> str:
        return brief(self, counted(len(self.lower), "joint"), self.source)

    @property
    def assumed(self) -> tuple[str, ...]:
        """The names of the limits that no maker gives: their source begins with "assumed"."""
        return tuple(name for name, source in self.sources.items() if source.startswith("assumed"))


@dataclass(frozen=True, eq=False)
class Servos:
    """How the model's joints stand to what LeRobot reads from an arm's servos: degrees, and 0 to 100 of the gripper.

    LeRobot's 0 degrees is the middle of the range that its calibration found for a joint.

    Attributes:
        robot_type: LeRobot's name of the arm.
        zero: (k,) rad, the model's joint positions where LeRobot reads 0.
        sign: (k,) 1, or -1 where LeRobot counts the other way.
        gripper: (2,) rad, the finger joint's positions where LeRobot reads 0 (closed) and 100 (open).
        source: who says so.
    """

    robot_type: str
    zero: Array
    sign: Array
    gripper: Array
    source: str

    def __post_init__(self) -> None:
        k = len(self.zero)
        freeze(self, zero=(k,), sign=(k,), gripper=(2,))

    def to_degrees(self, q: Array) -> Array:
        """Give the model's joint positions (..., k) rad as LeRobot's degrees."""
        return np.degrees(self.sign * (np.asarray(q) - self.zero))

    def to_radians(self, degrees: Array) -> Array:
        """Give LeRobot's degrees (..., k) as the model's joint positions, rad."""
        return self.zero + self.sign * np.radians(degrees)

    def to_percent(self, finger: Array) -> Array:
        """Give the finger joint's positions (...), rad, as LeRobot's 0 (closed) to 100 (open)."""
        closed, opened = self.gripper
        return np.asarray(100.0 * (np.asarray(finger) - closed) / (opened - closed))


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
        license: of the URDF and its meshes, and whose they are; empty if unknown.
        servos: how LeRobot counts its joints, or None where it doesn't know this arm.
        may_touch: links that are not checked against each other: they touch by design.
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
    license: str = ""
    servos: Servos | None = None
    may_touch: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        freeze(self, home=(len(self.joints),))

    def __repr__(self) -> str:
        gripper = "no gripper" if self.gripper is None else "gripper"
        return brief(self, counted(len(self.joints), "joint"), gripper, name=self.name)


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
        freeze(self, t=(n,), q=(n, k), qd=(n, k), qdd=(n, k), gripper=(n,))

    def __repr__(self) -> str:
        return brief(self, span(self.t), counted(self.q.shape[1], "joint"))


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
        freeze(self, knots=(m + 1,), coefficients=(m, 4, k))
        freeze(self, gripper_t=(g,), gripper_opening=(g,), keyframe_t=(f,), keyframe_q=(f, k))

    def __repr__(self) -> str:
        joints, keyframes = counted(len(self.joint_names), "joint"), counted(len(self.keyframe_t), "keyframe")
        return brief(self, joints, f"{self.duration:.1f} s", keyframes)

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.knots[-1])

    def at(self, t: ArrayLike) -> Samples:
        """Evaluate at one instant or at instants (n,), s, in n rows; before 0 and after the end, the ends are held."""
        t = np.atleast_1d(np.asarray(t, dtype=np.float64))
        inside = np.clip(t, 0.0, self.duration)
        piece = np.clip(np.searchsorted(self.knots, inside, side="right") - 1, 0, len(self.coefficients) - 1)
        s = (inside - self.knots[piece])[:, None]
        c0, c1, c2, c3 = np.moveaxis(self.coefficients[piece], 1, 0)
        # Held outside, to the last bit: controllers refuse a final velocity.
        moving = ((t >= 0.0) & (t < self.duration))[:, None]
        return Samples(
            t=t,
            q=c0 + s * (c1 + s * (c2 + s * c3)),
            qd=(c1 + s * (2.0 * c2 + s * 3.0 * c3)) * moving,
            qdd=(2.0 * c2 + 6.0 * s * c3) * moving,
            gripper=np.interp(t, self.gripper_t, self.gripper_opening),
        )

    def sample(self, rate_hz: float) -> Samples:
        """Evaluate at a constant rate from 0 until the end has been reached and is held."""
        steps = round(self.duration * rate_hz)
        steps += steps / rate_hz < self.duration  # compared as t is made: a product may round down past the end
        return self.at(np.arange(steps + 1) / rate_hz)

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
