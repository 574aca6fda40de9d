"""Values of calibration: nav in the robot's base, and a sensor's errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from pbd.data.freeze import freeze
from pbd.data.one_line_repr import brief, counted
from pbd.data.units import GRAVITY
from pbd.data.world import Obstacle
from pbd.pose import Array, Pose

TOOL_DOWN = Pose(np.zeros(3), np.array([0.0, 1.0, 0.0, 0.0]))
"""The default T_sensor_tool: a half turn about x, so that a level sensor is a gripper that points down."""


DOCK_SIGMA_M, DOCK_SIGMA_RAD = 0.003, np.radians(1.0)
"""Default sigma of a dock: position per axis (m), heading (rad)."""


@dataclass(frozen=True, eq=False)
class Linear:
    """A triad's errors: what is true is matrix @ (what it reads - bias).

    Attributes:
        bias: (3,) in the triad's unit.
        matrix: (3, 3), near the unit matrix: scale on the diagonal, misalignment (or soft iron) beside it.
        bias_sigma: (3,) one sigma; nan: not known.
    """

    bias: Array
    matrix: Array
    bias_sigma: Array

    def __post_init__(self) -> None:
        freeze(self, bias=(3,), matrix=(3, 3), bias_sigma=(3,))

    def __repr__(self) -> str:
        x, y, z = self.bias
        return brief(self, f"bias ({x:.4g}, {y:.4g}, {z:.4g})")

    def true(self, read: Array) -> Array:
        """What is true where it reads (..., 3)."""
        return np.asarray((read - self.bias) @ self.matrix.T)


@dataclass(frozen=True, eq=False)
class SensorErrors:
    """The errors of one sensor, and what it reads at rest without them.

    Attributes:
        sensor: whose they are, as a recording names it.
        gyr: bias in rad/s; or None.
        acc: m/s2; or None.
        mag: uT; or None.
        gravity: m/s2, what the norm of specific force at rest is.
        field: uT, strength of the magnetic field where it was calibrated; None without a magnetometer.
        dip: rad, of the field below the horizon; None as above.
        temperature_c: if it was noted.
    """

    sensor: str
    gyr: Linear | None = None
    acc: Linear | None = None
    mag: Linear | None = None
    gravity: float = GRAVITY
    field: float | None = None
    dip: float | None = None
    temperature_c: float | None = None

    def __repr__(self) -> str:
        return brief(
            self, *(name for name in ("gyr", "acc", "mag") if getattr(self, name) is not None), name=self.sensor
        )


@dataclass(frozen=True, eq=False)
class Calibration:
    """How the hand's frame lies in the robot's: at most one of T_base_dock and T_base_nav is given.

    Without either it can be tracked with, not planned.

    Attributes:
        T_base_dock: the sensor's pose in base at its first rest; only its position and yaw are taken.
        any_attitude: take the dock's yaw alone and say nothing of the tilt.
        T_base_nav: nav in base, registered from touched points.
        cov_base: (6, 6) m and rad, of the dock's or nav's pose, position and rotation vector in base; None: not known.
        T_sensor_tool: how the sensor sits on the tool; by default a level sensor is a gripper that points down.
        cov_sensor_tool: (6, 6) m and rad, of T_sensor_tool in sensor axes; None: not known.
        table_height: m, z of the table's top in base, or None.
        scale: multiplies p_nav_sensor, and nothing else.
        robots: the robots that it is for; empty: any.
        obstacles: what stands around, beside the table.
        sensor: what the sensor reads wrongly; None: nothing is corrected.
        residuals: how well each part fitted when it was made, by "part.figure".
    """

    name: str
    T_base_dock: Pose | None = None
    any_attitude: bool = False
    T_base_nav: Pose | None = None
    cov_base: Array | None = None
    T_sensor_tool: Pose = TOOL_DOWN
    cov_sensor_tool: Array | None = None
    table_height: float | None = None
    scale: float = 1.0
    robots: tuple[str, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
    sensor: SensorErrors | None = None
    residuals: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.T_base_dock is not None and self.T_base_nav is not None:
            raise ValueError("a calibration takes at most one of T_base_dock and T_base_nav")
        freeze(self, cov_base=(6, 6), cov_sensor_tool=(6, 6))
        object.__setattr__(self, "residuals", MappingProxyType(dict(self.residuals)))

    @property
    def knows_start(self) -> bool:
        """Whether it says where the hand starts in the robot's base."""
        return self.T_base_dock is not None or self.T_base_nav is not None

    @property
    def cov_start(self) -> Array:
        """(6, 6) m and rad, of the dock's or nav's pose in base; an assumption unless it was measured."""
        if self.cov_base is not None:
            return self.cov_base
        return np.diag(np.square([*[DOCK_SIGMA_M] * 3, 0.0, 0.0, DOCK_SIGMA_RAD]))

    def __repr__(self) -> str:
        parts = {"dock": self.T_base_dock, "nav": self.T_base_nav, "sensor": self.sensor, "table": self.table_height}
        there = [name for name, part in parts.items() if part is not None]
        return brief(self, *there, counted(len(self.obstacles), "obstacle"), name=self.name)
