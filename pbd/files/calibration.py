"""calibration/NAME.toml -> Calibration. Every key is described in calibration/default.toml."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pbd.data import TOOL_DOWN, Calibration, Obstacle
from pbd.errors import CalibrationError
from pbd.files.demo import SHAPES
from pbd.files.library import find
from pbd.files.toml import Section, read_toml
from pbd.pose import Pose

FORMAT = 1


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
    if top.number("format") != FORMAT:
        top.fail("format", f"must be {FORMAT}, the only format that this version reads")
    if ("dock" in top) == ("nav" in top):
        top.fail("dock", "or [nav] must be given, and not both", next_step="see calibration/default.toml")
    dock = top.section("dock") if "dock" in top else None
    calibration = Calibration(
        name=top.text("name"),
        T_base_dock=read_pose(dock) if dock else None,
        any_attitude=dock.flag("any_attitude") if dock and "any_attitude" in dock else False,
        T_base_nav=read_pose(top.section("nav")) if "nav" in top else None,
        T_sensor_tool=read_pose(top.section("mount")) if "mount" in top else TOOL_DOWN,
        table_height=top.number("table_height") if "table_height" in top else None,
        scale=top.number("scale", positive=True) if "scale" in top else 1.0,
        robots=top.texts("robots") if "robots" in top else (),
        obstacles=_obstacles(top.tables("obstacle")),
    )
    top.done()
    return calibration


def _obstacles(sections: list[Section]) -> tuple[Obstacle, ...]:
    obstacles: dict[str, Obstacle] = {}
    for section in sections:
        name, shape = section.text("name"), section.text("shape")
        if name in obstacles:
            section.fail("name", f"{name!r} is another obstacle's too", next_step="rename one of them")
        if shape not in SHAPES:
            section.fail("shape", f"must be one of {', '.join(SHAPES)}, got {shape!r}")
        size = section.numbers("size", SHAPES[shape], positive=True)
        rpy_deg = section.numbers("rpy_deg", 3) if "rpy_deg" in section else (0.0, 0.0, 0.0)
        T_base_obstacle = Pose.from_rpy(section.numbers("position", 3), np.radians(rpy_deg))
        obstacles[name] = Obstacle(name, shape, size, T_base_obstacle)
    return tuple(obstacles.values())


def read_pose(section: Section) -> Pose:
    """Read a table with `position` in m and `rpy_deg` (about x, then fixed y, then fixed z)."""
    return Pose.from_rpy(section.numbers("position", 3), np.radians(section.numbers("rpy_deg", 3)))
