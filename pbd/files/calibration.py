"""calibration/NAME.toml -> Calibration. Every key is described in calibration/default.toml."""

from pathlib import Path

import numpy as np

from pbd.data import GRAVITY, TOOL_DOWN, Calibration, LinearErrors, Obstacle, SensorErrors
from pbd.data.calibration import LEAST_DETERMINANT
from pbd.data.world import REACH_M, SHAPES
from pbd.errors import CalibrationError
from pbd.files.find_by_name import find
from pbd.io.toml import Section, read_toml
from pbd.pose import Array, Pose

FULL_TURN_DEG = 360.0
"""Largest magnitude of a roll, pitch, yaw or angle tolerance in a file, degrees."""


def load_calibration(name: str | Path) -> Calibration:
    """Load a calibration by name (./calibration, then the bundled ones) or path.

    Raises:
        CalibrationError: none has that name (the valid names are listed), or a key is missing, unknown or
            wrong.
    """
    return read_calibration(find("calibration", name, CalibrationError))


def read_calibration(path: Path) -> Calibration:
    """Read a calibration file; a CalibrationError tells path, line and key."""
    return parse_calibration(read_toml(path, CalibrationError))


def parse_calibration(top: Section) -> Calibration:
    """Make a calibration of a file's top level; raises as `read_calibration`."""
    top.require_format()
    if "dock" in top and "nav" in top:
        top.fail("dock", "and [nav] can't both be given", next_step="remove one")
    dock, nav = top.section("dock", None), top.section("nav", None)
    mount, sensor, base = top.section("mount", None), top.section("sensor", None), dock or nav
    calibration = Calibration(
        name=top.text("name"),
        T_base_dock=None if dock is None else read_pose(dock),
        any_attitude=dock is not None and dock.flag("any_attitude", False),
        T_base_nav=None if nav is None else read_pose(nav),
        cov_base=_covariance(base),
        T_sensor_tool=TOOL_DOWN if mount is None else read_pose(mount),
        cov_sensor_tool=_covariance(mount),
        table_height=top.length("table_height"),
        scale=top.number("scale", 1.0, positive=True),
        robots=top.texts("robots", ()),
        obstacles=_obstacles(top.tables("obstacle")),
        sensor=None if sensor is None else _sensor(sensor),
        residuals={
            f"{part.name}.{name}": value
            for part in (base, mount, sensor)
            if part is not None
            for name, value in part.named_numbers("fit").items()
        },
    )
    top.refuse_unread()
    if base is None and mount is None and sensor is None:
        top.fail("dock", "or [nav] must be given, or at least [mount] or [sensor]", "see calibration/default.toml")
    return calibration


def read_pose(section: Section, position: str = "position", within_m: float = REACH_M) -> Pose:
    """Read a pose from a table.

    Args:
        position: the key of the position, (3,) m. The rotation's key is `rpy_deg`: about x, then fixed y, then fixed z.
        within_m: largest magnitude of a coordinate, m.
    """
    p, rpy_deg = section.lengths(position, 3, within=within_m), section.numbers("rpy_deg", 3, within=FULL_TURN_DEG)
    return Pose.from_rpy(p, np.radians(rpy_deg))


def read_shape(section: Section) -> tuple[str, tuple[float, ...]]:
    """Read an object's `shape` and its `size`, m."""
    count = section.choice("shape", SHAPES)
    return section.text("shape"), section.lengths("size", count, positive=True)


def _covariance(section: Section | None) -> Array | None:
    """Read a pose's covariance (6, 6), position in m and rotation vector in rad: `covariance`, or else the sigmas.

    None if the table has none of these.
    """
    if section is None:
        return None
    sigma_m, sigma_deg = section.sigmas("sigma_m", None), section.sigmas("sigma_deg", None)
    if "covariance" in section:
        cov = np.reshape(section.numbers("covariance", 36), (6, 6))
        if not np.allclose(cov, cov.T) or np.linalg.eigvalsh(cov).min() < -1e-9:
            section.fail("covariance", "is not a covariance (symmetric, positive)", "remove it, or calibrate again")
        return cov
    if sigma_m is None and sigma_deg is None:
        return None
    return np.diag(np.square([*(sigma_m or np.zeros(3)), *np.radians(sigma_deg or np.zeros(3))]))


def _sensor(section: Section) -> SensorErrors:
    triads = {kind: section.section(kind, None) for kind in ("gyr", "acc", "mag")}
    dip_deg = section.number("dip_deg", None)
    return SensorErrors(
        sensor=section.text("name"),
        **{kind: None if triad is None else _linear(triad) for kind, triad in triads.items()},
        gravity=section.number("gravity", GRAVITY, positive=True),
        field=section.number("field", None, positive=True),
        dip=None if dip_deg is None else np.radians(dip_deg),
        temperature_c=section.number("temperature_c", None),
    )


def _linear(section: Section) -> LinearErrors:
    matrix = np.reshape(section.numbers("matrix", 9, (1, 0, 0, 0, 1, 0, 0, 0, 1)), (3, 3))
    if np.linalg.det(matrix) < LEAST_DETERMINANT:
        section.fail("matrix", "must be near the unit matrix")
    sigma = section.sigmas("bias_sigma", (np.nan, np.nan, np.nan))
    matrix_sigma = section.number("matrix_sigma", np.nan, positive=True)
    return LinearErrors(np.array(section.numbers("bias", 3)), matrix, np.array(sigma), matrix_sigma)


def _obstacles(sections: list[Section]) -> tuple[Obstacle, ...]:
    obstacles: dict[str, Obstacle] = {}
    for section in sections:
        name, (shape, size) = section.text("name"), read_shape(section)
        if name in obstacles:
            section.fail("name", f"{name!r} is another obstacle's too", next_step="rename one of them")
        position = section.lengths("position", 3)
        rpy_deg = section.numbers("rpy_deg", 3, (0.0, 0.0, 0.0), within=FULL_TURN_DEG)
        obstacles[name] = Obstacle(name, shape, size, Pose.from_rpy(position, np.radians(rpy_deg)))
    return tuple(obstacles.values())
