"""A file of known points in the robot's base."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pbd.data.freeze import freeze
from pbd.errors import CalibrationError, in_words
from pbd.pose import Array

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
FARTHEST_M = 10.0
"""No point that an arm touches is further from its base."""


@dataclass(frozen=True, eq=False)
class Points:
    """Names and positions (m, 3) in m in base."""

    names: tuple[str, ...]
    p_base: Array

    def __post_init__(self) -> None:
        freeze(self, p_base=(len(self.names), 3))


def read_points(path: Path, unit: str | None = None) -> Points:
    """Read a CSV with a header: x, y, z with their unit (x_m, x_cm or x_mm, all three alike), and perhaps a name.

    Args:
        path: the file.
        unit: "m", "cm" or "mm", of columns that don't say.

    Raises:
        CalibrationError: it can't be read; a column is missing; no unit is known; a cell is no number: with the line.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as reason:
        raise CalibrationError(
            f"{path}: can't be read as text ({in_words(reason)}); give a CSV file", path=path
        ) from None
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise CalibrationError(
            f"{path}: the file is empty; write a header name,x_m,y_m,z_m and one row per point", path=path
        )
    delimiter = max(",;\t", key=lines[0][1].count)
    rows = list(csv.reader((line for _, line in lines), delimiter=delimiter))
    header = [name.strip().lower() for name in rows[0]]
    columns, metres = _columns(path, header, unit)
    names: list[str] = []
    points: list[list[float]] = []
    for (number, _), row in zip(lines[1:], rows[1:], strict=True):
        if len(row) != len(header):
            raise CalibrationError(
                f"{path}:{number}: {len(row)} cells under {len(header)} columns; correct that line",
                path=path,
                line=number,
            )
        points.append([_number(path, number, header[k], row[k]) * metres for k in columns])
        names.append(row[header.index("name")].strip() if "name" in header else f"{len(names) + 1}")
        if max(map(abs, points[-1])) > FARTHEST_M:
            raise CalibrationError(
                f"{path}:{number}: the point '{names[-1]}' is {max(map(abs, points[-1])):.0f} m from the robot's base; "
                "is the unit right? name the columns x_mm,y_mm,z_mm",
                path=path,
                line=number,
            )
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise CalibrationError(f"{path}: two points are named '{twice}'; rename one", path=path, value=twice)
    if not points:
        raise CalibrationError(f"{path}: a header but no points; add one row per point", path=path)
    return Points(tuple(names), np.array(points))


def points_csv(points: Points, remark: str) -> str:
    """Write a CSV's text that `read_points` reads, to 0.01 mm, with a remark for people above its header."""
    rows = (f"{name},{x:g},{y:g},{z:g}" for name, (x, y, z) in zip(points.names, 1e3 * points.p_base, strict=True))
    return "\n".join((f"# {remark}", "name,x_mm,y_mm,z_mm", *rows, ""))


def _columns(path: Path, header: list[str], unit: str | None) -> tuple[list[int], float]:
    """Where x, y and z stand, and how many metres their unit is."""
    for known, metres in UNITS.items():
        if all(f"{axis}_{known}" in header for axis in "xyz"):
            return [header.index(f"{axis}_{known}") for axis in "xyz"], metres
    if all(axis in header for axis in "xyz"):
        if unit is None:
            raise CalibrationError(
                f"{path}: the unit of x, y, z is not known; name the columns x_m,y_m,z_m (or _cm, _mm), or give --unit",
                path=path,
            )
        return [header.index(axis) for axis in "xyz"], UNITS[unit]
    raise CalibrationError(
        f"{path}: the columns are {', '.join(header)}; they must be x_m, y_m and z_m (or _cm, _mm), and perhaps name",
        path=path,
    )


def _number(path: Path, line: int, column: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise CalibrationError(
            f"{path}:{line}: {column} is '{cell.strip()}', which is not a number; correct it", path=path, line=line
        )
    return value
