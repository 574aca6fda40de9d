"""calibration/NAME.toml -> Calibration. Every key is described in calibration/default.toml."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pbd.data import GRAVITY, TOOL_DOWN, Calibration, Linear, Obstacle, SensorErrors
from pbd.errors import CalibrationError
from pbd.files.demo import SHAPES
from pbd.files.library import find
from pbd.files.toml import Section, read_toml
from pbd.pose import Array, Pose

FORMAT = 1
FAR_M = 10.0
"""No arm comes near an obstacle that is farther away or larger."""

FARTHEST_M = 1000.0
"""Farthest position in a pose, m: a sensor, a tool or a dock is much nearer to its arm."""

FULL_TURN_DEG = 360.0
"""Largest angle of a pose, degrees."""

PARTS = ("dock", "nav", "mount", "sensor")


def load_calibration(name: str) -> Calibration:
    """Load a calibration by name (./calibration, then the bundled ones) or path.

    Raises:
        CalibrationError: nothing of that name (the valid ones are listed), or a key is missing, unknown or wrong.
    """
    return read_calibration(find("calibration", name, ".toml", CalibrationError))


def read_calibration(path: Path) -> Calibration:
    """Read a calibration file.

    Raises:
        CalibrationError: with path, line and key.
    """
    top = read_toml(path, CalibrationError)
    if (found := top.number("format")) != FORMAT:
        next_step = "it was written by a newer pbd: update pbd" if found > FORMAT else "correct it"
        top.fail("format", f"must be {FORMAT}, the only format that this version reads", next_step)
    if "dock" in top and "nav" in top:
        top.fail("dock", "and [nav] can't both be given", next_step="remove one")
    if not any(part in top for part in PARTS):
        top.refuse_misspelt(("dock", "nav"))
        top.fail("dock", "or [nav] must be given, or at least [mount] or [sensor]", "see calibration/default.toml")
    dock = top.section("dock") if "dock" in top else None
    nav = top.section("nav") if "nav" in top else None
    mount = top.section("mount") if "mount" in top else None
    sensor = top.section("sensor") if "sensor" in top else None
    base = dock or nav
    calibration = Calibration(
        name=top.text("name"),
        T_base_dock=read_pose(dock) if dock else None,
        any_attitude=dock.flag("any_attitude") if dock and "any_attitude" in dock else False,
        T_base_nav=read_pose(nav) if nav else None,
        cov_base=_covariance(base) if base else None,
        T_sensor_tool=read_pose(mount) if mount else TOOL_DOWN,
        cov_sensor_tool=_covariance(mount) if mount else None,
        table_height=top.number("table_height") if "table_height" in top else None,
        scale=top.number("scale", positive=True) if "scale" in top else 1.0,
        robots=top.texts("robots") if "robots" in top else (),
        obstacles=_obstacles(top.tables("obstacle")),
        sensor=_sensor(sensor) if sensor else None,
        residuals={
            f"{part.name}.{name}": value
            for part in (base, mount, sensor)
            if part and "fit" in part
            for name, value in part.figures("fit").items()
        },
    )
    top.done()
    return calibration


def _covariance(section: Section) -> Array | None:
    """Of a pose, (6, 6) m and rad, position and rotation vector: whole, or as sigmas; None where neither is given."""
    sigma_m = section.numbers("sigma_m", 3) if "sigma_m" in section else None
    sigma_deg = section.numbers("sigma_deg", 3) if "sigma_deg" in section else None
    if "covariance" in section:
        cov = np.reshape(section.numbers("covariance", 36), (6, 6))
        if not np.allclose(cov, cov.T) or np.linalg.eigvalsh(cov).min() < -1e-9:
            section.fail("covariance", "is not a covariance (symmetric, positive)", "remove it, or calibrate again")
        return cov
    if sigma_m is None and sigma_deg is None:
        return None
    return np.diag(np.square([*(sigma_m or np.zeros(3)), *np.radians(sigma_deg or np.zeros(3))]))


def _sensor(section: Section) -> SensorErrors:
    return SensorErrors(
        sensor=section.text("name"),
        gyr=_linear(section.section("gyr")) if "gyr" in section else None,
        acc=_linear(section.section("acc")) if "acc" in section else None,
        mag=_linear(section.section("mag")) if "mag" in section else None,
        gravity=section.number("gravity", positive=True) if "gravity" in section else GRAVITY,
        field=section.number("field", positive=True) if "field" in section else None,
        dip=np.radians(section.number("dip_deg")) if "dip_deg" in section else None,
        temperature_c=section.number("temperature_c") if "temperature_c" in section else None,
    )


def _linear(section: Section) -> Linear:
    matrix = np.reshape(section.numbers("matrix", 9), (3, 3)) if "matrix" in section else np.eye(3)
    if abs(np.linalg.det(matrix)) < 0.1:
        section.fail("matrix", "must be near the unit matrix")
    unknown = (float("nan"),) * 3
    sigma = section.numbers("bias_sigma", 3) if "bias_sigma" in section else unknown
    return Linear(np.array(section.numbers("bias", 3)), matrix, np.array(sigma))


def _obstacles(sections: list[Section]) -> tuple[Obstacle, ...]:
    obstacles: dict[str, Obstacle] = {}
    for section in sections:
        name, shape = section.text("name"), section.text("shape")
        if name in obstacles:
            section.fail("name", f"{name!r} is another obstacle's too", next_step="rename one of them")
        if shape not in SHAPES:
            section.fail("shape", f"must be one of {', '.join(SHAPES)}, got {shape!r}")
        size = section.numbers("size", SHAPES[shape], positive=True)
        position = section.numbers("position", 3)
        for key, values in (("size", size), ("position", position)):
            if max(map(abs, values)) > FAR_M:
                section.fail(key, f"has {max(values, key=abs):g}, but is in metres", "divide it by 100 if it is in cm")
        rpy_deg = _angles(section) if "rpy_deg" in section else (0.0, 0.0, 0.0)
        T_base_obstacle = Pose.from_rpy(position, np.radians(rpy_deg))
        obstacles[name] = Obstacle(name, shape, size, T_base_obstacle)
    return tuple(obstacles.values())


def read_pose(section: Section) -> Pose:
    """Read a table with `position` in m and `rpy_deg` (about x, then fixed y, then fixed z)."""
    position, rpy_deg = section.numbers("position", 3, within=FARTHEST_M), _angles(section)
    return Pose.from_rpy(position, np.radians(rpy_deg))


def _angles(section: Section) -> tuple[float, ...]:
    return section.numbers("rpy_deg", 3, within=FULL_TURN_DEG)
