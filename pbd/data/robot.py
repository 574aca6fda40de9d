"""Values of planning: the robot and its motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pbd.data.calibration import Calibration
from pbd.data.frozen_arrays import freeze_arrays, frozen_mapping, numeric
from pbd.data.one_line_repr import brief, counted, span
from pbd.errors import UsageError
from pbd.pose import Array, Pose


@dataclass(frozen=True, eq=False)
class Gripper:
    """Finger joints, their positions (m or rad) when open and closed, and the duration of a full stroke.

    A model may have no finger joints. The motion still says when the gripper opens and closes. `mimics` mimic others.
    """

    joints: tuple[str, ...]
    open: Array
    closed: Array
    stroke_s: float
    mimics: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        k = len(self.joints)
        freeze_arrays(self, open=(k,), closed=(k,))

    def positions(self, opening: Array) -> Array:
        """Finger joints (n, k) at openings (n,), 0 closed to 1 open."""
        return self.closed + opening[:, None] * (self.open - self.closed)


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Per joint: position rad, velocity rad/s, acceleration rad/s2, jerk rad/s3, effort N m (prismatic joints: m, N).

    `source` names the sources in one line. `sources` has one per key: "position", "velocity", "acceleration", "jerk",
    "effort". Without known efforts, `effort` is None and torques are not checked.
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
        freeze_arrays(self, lower=(k,), upper=(k,), velocity=(k,), acceleration=(k,), jerk=(k,), effort=(k,))
        object.__setattr__(self, "sources", frozen_mapping(self.sources))

    def __repr__(self) -> str:
        return brief(self, counted(len(self.lower), "joint"), self.source)

    @property
    def assumed(self) -> tuple[str, ...]:
        """The limits that no maker publishes: their source begins with "assumed"."""
        return tuple(name for name, source in self.sources.items() if source.startswith("assumed"))


@dataclass(frozen=True, eq=False)
class ServoUnits:
    """Converts between the model's joints and LeRobot's readings: degrees, and 0 to 100 for the gripper.

    LeRobot's 0 degrees is the middle of the range that its calibration found for a joint.

    Attributes:
        robot_type: LeRobot's name of the arm.
        zero: (k,) the model's joint positions where LeRobot reads 0, rad.
        sign: (k,) 1, or -1 where LeRobot's direction is opposite.
        gripper: (2,) the finger joint's positions where LeRobot reads 0 (closed) and 100 (open), rad.
        source: where these figures come from.
    """

    robot_type: str
    zero: Array
    sign: Array
    gripper: Array
    source: str

    def __post_init__(self) -> None:
        k = len(self.zero)
        freeze_arrays(self, zero=(k,), sign=(k,), gripper=(2,))

    def to_degrees(self, q: Array) -> Array:
        """Convert the model's joint positions (..., k) rad to LeRobot's degrees."""
        return np.degrees(self.sign * (np.asarray(q) - self.zero))

    def to_radians(self, degrees: Array) -> Array:
        """Convert LeRobot's degrees (..., k) to the model's joint positions, rad."""
        return self.zero + self.sign * np.radians(degrees)

    def to_percent(self, finger: Array) -> Array:
        """Convert the finger joint's positions (...) rad to LeRobot's 0 (closed) to 100 (open)."""
        closed, opened = self.gripper
        return np.asarray(100.0 * (np.asarray(finger) - closed) / (opened - closed))


@dataclass(frozen=True)
class MimicJoint:
    """A joint that mimics another one, as beside the arm in a parallel linkage.

    Its position is that of `leader` times `multiplier`, plus `offset`; rad, or m for a prismatic joint.
    """

    joint: str
    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm as robots/NAME.toml describes it.

    Attributes:
        urdf, srdf: the model's files.
        package_dirs: folders in which package:// addresses of those files are looked up.
        base: the link whose frame is `base`.
        body: the link in which T_body_tool is given.
        T_body_tool: z is the approach direction, x the direction in which the jaws open, the origin between the
            fingertips.
        joints: names of the arm's joints, base to tool.
        home: (k,) rad.
        dock: the calibration to use if the user names none, or None.
        notes: the assumptions, for people.
        license: license and owner of the URDF and its meshes; empty: unknown.
        servos: conversion to LeRobot's joints; None if LeRobot does not support this arm.
        may_touch: pairs of links that touch by design, so they are not checked against each other.
        mimic_joints: joints beside the arm that move with its joints.
        payload_kg: the rated payload, kg, or None. `payload_source` says who rates it.
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
    servos: ServoUnits | None = None
    may_touch: tuple[tuple[str, str], ...] = ()
    mimic_joints: tuple[MimicJoint, ...] = ()
    payload_kg: float | None = None
    payload_source: str = ""

    def __post_init__(self) -> None:
        freeze_arrays(self, home=(len(self.joints),))

    def __repr__(self) -> str:
        gripper = "no gripper" if self.gripper is None else "gripper"
        return brief(self, counted(len(self.joints), "joint"), gripper, name=self.name)


@dataclass(frozen=True, eq=False)
class Samples:
    """A sampled joint trajectory: t (n,) s; q, qd, qdd (n, k) rad, rad/s, rad/s2; gripper (n,) 0 closed to 1 open."""

    t: Array
    q: Array
    qd: Array
    qdd: Array
    gripper: Array

    def __post_init__(self) -> None:
        n, k = self.q.shape
        freeze_arrays(self, t=(n,), q=(n, k), qd=(n, k), qdd=(n, k), gripper=(n,))

    def __repr__(self) -> str:
        return brief(self, span(self.t), counted(self.q.shape[1], "joint"))


@dataclass(frozen=True, eq=False)
class JointTrajectory:
    """A piecewise cubic motion: position, velocity, acceleration and jerk are exact at every instant.

    Attributes:
        knots: (m + 1,) increasing from 0, s. Piece i covers knots[i] <= t <= knots[i + 1].
        coefficients: (m, 4, k): q = c0 + c1 s + c2 s^2 + c3 s^3 with s = t - knots[i].
        gripper_t, gripper_opening: (g,) s, and 0 closed to 1 open; linear between, constant outside.
        keyframe_t: (f,) when the arm reaches each keyframe, s.
        keyframe_q: (f, k) the joint positions solved for each keyframe, rad.
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
        freeze_arrays(self, knots=(m + 1,), coefficients=(m, 4, k))
        freeze_arrays(self, gripper_t=(g,), gripper_opening=(g,), keyframe_t=(f,), keyframe_q=(f, k))

    def __repr__(self) -> str:
        joints, keyframes = counted(len(self.joint_names), "joint"), counted(len(self.keyframe_t), "keyframe")
        return brief(self, joints, f"{self.duration:.1f} s", keyframes)

    @property
    def duration(self) -> float:
        """Duration, s."""
        return float(self.knots[-1])

    def at(self, t: ArrayLike) -> Samples:
        """Evaluate at one instant or at instants (n,), s: n rows. Before 0 and after `duration` the arm stands still.

        Raises:
            UsageError: an instant is NaN.
        """
        t = np.atleast_1d(numeric("t", t))
        if np.isnan(t).any():
            raise UsageError("an instant of the trajectory is NaN; give seconds from its start", value=np.nan)
        inside = np.clip(t, 0.0, self.duration)
        piece = np.clip(np.searchsorted(self.knots, inside, side="right") - 1, 0, len(self.coefficients) - 1)
        s = (inside - self.knots[piece])[:, None]
        c0, c1, c2, c3 = np.moveaxis(self.coefficients[piece], 1, 0)
        # Velocity is exactly zero at the end and outside: controllers refuse a final velocity.
        moving = ((t >= 0.0) & (t < self.duration))[:, None]
        return Samples(
            t=t,
            q=c0 + s * (c1 + s * (c2 + s * c3)),
            qd=(c1 + s * (2.0 * c2 + s * 3.0 * c3)) * moving,
            qdd=(2.0 * c2 + 6.0 * s * c3) * moving,
            gripper=np.interp(t, self.gripper_t, self.gripper_opening),
        )

    def sample(self, rate_hz: float) -> Samples:
        """Evaluate at a constant rate from 0 to the first sample at or after the end."""
        steps = round(self.duration * rate_hz)
        steps += steps / rate_hz < self.duration  # the quotient, not the product, is the last sample's rounded time
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
