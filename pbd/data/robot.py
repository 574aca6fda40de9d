"""Values of planning: the robot."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from pbd.data.calibration import Calibration
from pbd.data.field_checks import freeze_tuples, require_fields, require_finite, wrong_value
from pbd.data.one_line_repr import brief, counted
from pbd.errors import amount
from pbd.frozen_arrays import Frozen, freeze_arrays, frozen_mapping
from pbd.pose import Array, Pose


@dataclass(frozen=True, eq=False)
class Gripper(Frozen):
    """Finger joints, their positions (m or rad) when open and closed, and the duration of a full stroke.

    A model may have no finger joints. The motion still says when the gripper opens and closes. `mimics` mimic others.
    """

    joints: tuple[str, ...]
    open: Array
    closed: Array
    stroke_s: float
    mimics: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze_tuples(self, joints=str, mimics=str)
        k = len(self.joints)
        freeze_arrays(self, open=(k,), closed=(k,))
        require_finite(self, "stroke_s", above=0.0)

    def positions(self, opening: ArrayLike) -> Array:
        """Finger joints (..., k), rad or m, at openings (...), 0 closed to 1 open."""
        return np.asarray(self.closed + np.asarray(opening)[..., None] * (self.open - self.closed))


@dataclass(frozen=True, eq=False)
class JointLimits(Frozen):
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
        require_finite(self, "velocity", "acceleration", "jerk", "effort", above=0.0)
        if not (self.lower < self.upper).all():
            raise wrong_value(self, "lower", f"must be below upper, {self.upper}")
        object.__setattr__(self, "sources", frozen_mapping(self.sources))

    def __repr__(self) -> str:
        return brief(self, counted(len(self.lower), "joint"), self.source)

    @property
    def assumed(self) -> tuple[str, ...]:
        """The limits that no maker publishes: their source begins with "assumed"."""
        return tuple(name for name, source in self.sources.items() if source.startswith("assumed"))


@dataclass(frozen=True, eq=False)
class ServoUnits(Frozen):
    """Converts between the model's joints and LeRobot's readings: degrees, and 0 to 100 for the gripper.

    LeRobot's 0 degrees is the middle of the range that its calibration found for a joint.

    Attributes:
        robot_type: LeRobot's name of the arm.
        zero: (k,) the model's joint positions where LeRobot reads 0, rad.
        sign: (k,) 1, or -1 where LeRobot's direction is opposite.
        gripper: (2,) the finger joint's positions where LeRobot reads 0 (closed) and 100 (open), rad.
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
class Robot(Frozen):
    """An arm as robots/NAME.toml describes it.

    Attributes:
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
        file: the TOML file that it was read from, or None.
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
    file: Path | None = None

    def __post_init__(self) -> None:
        freeze_tuples(self, package_dirs=Path, joints=str, notes=str, may_touch=tuple, mimic_joints=MimicJoint)
        require_fields(self, name=str, base=str, body=str, urdf=Path, srdf=Path | None, T_body_tool=Pose)
        require_fields(self, limits=JointLimits, gripper=Gripper | None, dock=Calibration | None)
        k = len(self.joints)
        freeze_arrays(self, home=(k,))
        if len(self.limits.lower) != k:
            raise wrong_value(self, "limits", f"must be of {amount(k, 'joint')}")
        require_finite(self, "home")

    def __repr__(self) -> str:
        gripper = "no gripper" if self.gripper is None else "gripper"
        return brief(self, counted(len(self.joints), "joint"), gripper, name=self.name)
