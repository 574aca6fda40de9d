"""A file of known points in the robot's base."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pbd.data.freeze import freeze
from pbd.doors.numbers import finite
from pbd.doors.opening import read_text
from pbd.errors import CalibrationError, listed, printable
from pbd.files.table import split_header, split_rows
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
    text = read_text(path, CalibrationError, "give a CSV file", encoding="utf-8-sig")
    lines = [
        (number, line)
        for number, line in enumerate(text.split("\n"), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise CalibrationError(
            f"{path}: the file is empty; write a header name,x_m,y_m,z_m and one row per point", path=path
        )
    header, delimiter = split_header(path, *lines[0], CalibrationError)
    header = [name.lower() for name in header]
    columns, metres = _columns(path, header, unit)
    names: list[str] = []
    points: list[list[float]] = []
    for number, row in split_rows(path, lines[1:], delimiter, CalibrationError):
        if len(row) != len(header):
            raise CalibrationError(
                f"{path}:{number}: {len(row)} cells under {len(header)} columns; correct that line",
                path=path,
                line=number,
            )
        points.append([_number(path, number, header[k], row[k]) * metres for k in columns])
        names.append(row[header.index("name")].strip() if "name" in header else f"{len(names) + 1}")
        if (far := max(map(abs, points[-1]))) > FARTHEST_M:
            raise CalibrationError(
                f"{path}:{number}: the point '{printable(names[-1])}' is {far:.0f} m from the robot's base; "
                "is the unit right? name the columns x_mm,y_mm,z_mm",
                path=path,
                line=number,
            )
    if twice := next((name for name, count in Counter(names).items() if count > 1), None):
        raise CalibrationError(f"{path}: two points are named '{printable(twice)}'; rename one", path=path, value=twice)
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
        f"{path}: the columns are {listed(header)}; they must be x_m, y_m and z_m (or _cm, _mm), and perhaps name",
        path=path,
    )


def _number(path: Path, line: int, column: str, cell: str) -> float:
    try:
        return finite(cell)
    except ValueError:
        message = f"{path}:{line}: {column} is '{printable(cell.strip())}', which is not a number; correct it"
        raise CalibrationError(message, path=path, line=line) from None
