"""Values of calibration: where nav lies in the robot's base, and a sensor's errors."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pbd.data.field_checks import freeze_tuples, require_covariance, require_fields, require_finite
from pbd.data.one_line_repr import brief, counted
from pbd.data.units import GRAVITY
from pbd.data.world import Obstacle, refuse_beyond_reach
from pbd.errors import WrongValueError
from pbd.frozen_arrays import Frozen, freeze_arrays, frozen_mapping
from pbd.pose import Array, Pose

TOOL_DOWN = Pose(np.zeros(3), np.array([0.0, 1.0, 0.0, 0.0]))
"""Default T_sensor_tool: a half turn about x, so that a level sensor means a gripper that points down."""


DOCK_SIGMA_M, DOCK_SIGMA_RAD = 0.003, np.radians(1.0)
"""Assumed one sigma of a dock whose covariance is not given: position along each axis (m), heading (rad)."""

LEAST_DETERMINANT = 0.1
"""Smallest determinant of a sensor's matrix: a negative one mirrors, one near 0 makes all readings alike."""


@dataclass(frozen=True, eq=False)
class LinearErrors(Frozen):
    """Linear errors of three axes: the true vector is matrix @ (reading - bias).

    Attributes:
        bias: (3,) in the sensor's unit.
        matrix: (3, 3), near the identity: scale on the diagonal, misalignment (or soft iron) off it.
        bias_sigma: (3,) one sigma of the bias; NaN: unknown.
        matrix_sigma: one sigma of the matrix' least certain element; NaN: unknown.
    """

    bias: Array
    matrix: Array
    bias_sigma: Array
    matrix_sigma: float = np.nan

    def __post_init__(self) -> None:
        freeze_arrays(self, bias=(3,), matrix=(3, 3), bias_sigma=(3,))

    def __repr__(self) -> str:
        x, y, z = self.bias
        return brief(self, f"bias ({x:.4g}, {y:.4g}, {z:.4g})")

    def correct(self, read: Array) -> Array:
        """Correct readings (..., 3)."""
        return np.asarray((read - self.bias) @ self.matrix.T)


@dataclass(frozen=True, eq=False)
class SensorErrors:
    """The errors of one sensor, and the gravity and field that it should read.

    Attributes:
        sensor: the sensor's name, as recordings have it.
        gyr, acc, mag: errors of each triad, rad/s, m/s2 and uT; None: unknown.
        gravity: norm of the specific force at rest, m/s2.
        field: strength of the magnetic field where the sensor was calibrated, uT; None without a magnetometer.
        dip: angle of that field below the horizon, rad; None without a magnetometer.
        temperature_c: temperature during calibration, °C; None: not noted.
    """

    sensor: str
    gyr: LinearErrors | None = None
    acc: LinearErrors | None = None
    mag: LinearErrors | None = None
    gravity: float = GRAVITY
    field: float | None = None
    dip: float | None = None
    temperature_c: float | None = None

    def __repr__(self) -> str:
        return brief(
            self, *(name for name in ("gyr", "acc", "mag") if getattr(self, name) is not None), name=self.sensor
        )


@dataclass(frozen=True, eq=False)
class Calibration(Frozen):
    """Where the hand's frame lies in the robot's: T_base_dock, or T_base_nav, or neither.

    Without either, tracking works but planning does not.

    Attributes:
        T_base_dock: the sensor's pose in base at its first rest. Only its position and yaw are used.
        any_attitude: use only the yaw of the dock's attitude, and do not compare its tilt with the measured one.
        T_base_nav: pose of nav in base, registered from touched points.
        cov_base: (6, 6) m and rad, covariance of the dock's or nav's pose: position, rotation vector in base; or None.
        T_sensor_tool: the tool's pose in sensor. By default a level sensor means a gripper that points down.
        cov_sensor_tool: (6, 6) m and rad, covariance of T_sensor_tool in sensor axes; None: unknown.
        table_height: z of the table's top in base, m, or None.
        scale: factor on p_nav_sensor, and on nothing else.
        robots: names of the robots that it is for; empty: any.
        obstacles: obstacles besides the table.
        sensor: the sensor's errors; None: readings are not corrected.
        residuals: "part.figure" -> how well that part fitted when it was made.
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
            raise WrongValueError("a calibration takes at most one of T_base_dock and T_base_nav")
        require_fields(self, name=str, T_base_dock=Pose | None, T_base_nav=Pose | None, T_sensor_tool=Pose)
        require_fields(self, sensor=SensorErrors | None)
        require_finite(self, "scale", above=0.0)
        require_finite(self, "table_height")
        refuse_beyond_reach(self, "T_base_dock", "T_base_nav", "T_sensor_tool", "table_height")
        freeze_tuples(self, robots=str, obstacles=Obstacle)
        freeze_arrays(self, cov_base=(6, 6), cov_sensor_tool=(6, 6))
        require_covariance(self, "cov_base", "cov_sensor_tool")
        object.__setattr__(self, "residuals", frozen_mapping(self.residuals))

    @property
    def knows_start(self) -> bool:
        """Whether it says where the hand starts in the robot's base."""
        return self.T_base_dock is not None or self.T_base_nav is not None

    @property
    def nav_points_north(self) -> bool | None:
        """Whether a magnetometer gave the heading of T_base_nav; None: no points were fitted, so it is unknown."""
        if self.T_base_nav is None or "nav.chi2" not in self.residuals:
            return None
        return "nav.heading_deg" in self.residuals

    @property
    def cov_start(self) -> Array:
        """(6, 6) m and rad, covariance of the dock's or nav's pose in base; assumed if `cov_base` is None."""
        if self.cov_base is not None:
            return self.cov_base
        return np.diag(np.square([*[DOCK_SIGMA_M] * 3, 0.0, 0.0, DOCK_SIGMA_RAD]))

    @property
    def scale_sigma(self) -> float:
        """One sigma of `scale`, as a share of it; 0 if the points did not show it."""
        return self.residuals.get(f"{'dock' if self.T_base_nav is None else 'nav'}.scale_sigma", 0.0)

    def __repr__(self) -> str:
        parts = {"dock": self.T_base_dock, "nav": self.T_base_nav, "sensor": self.sensor, "table": self.table_height}
        known = [name for name, part in parts.items() if part is not None]
        return brief(self, *known, counted(len(self.obstacles), "obstacle"), name=self.name)
