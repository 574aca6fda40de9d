"""CSV files of known points in the robot's base."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pbd.data.world import REACH_M
from pbd.errors import CalibrationError, listed, printable
from pbd.files.header_line import without_thousands
from pbd.files.table import open_sheet
from pbd.pose import Array

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Unit of a coordinate -> its factor to m."""


def read_points(path: Path, unit: str | None = None) -> dict[str, Array]:
    """Read points, name -> position in base (3,), m.

    The table's columns are x_m, y_m, z_m (or `x (mm)` and its like), or x, y, z in a `unit`. The points'
    names are in the column `name`, or in the first if it is no coordinate.

    Raises:
        CalibrationError: the file can't be read, a column or a unit is missing, or a cell is not a number.
    """
    sheet = open_sheet(path, foreign=True, error=CalibrationError)
    sheet = replace(sheet, body=without_thousands(sheet.body, sheet.delimiter), cells_required=True)
    column = {re.sub(r"\W+(?:in\W+)?", "_", name.lower()).strip("_"): name for name in sheet.header}
    endings = {f"_{name}": name for name in UNITS} | {"": unit}  # of the columns' names -> the unit
    ending = next((each for each in endings if all(f"{axis}{each}" in column for axis in "xyz")), None)
    if ending is None:
        wanted = "they must be x_m, y_m and z_m (or _cm, _mm), and perhaps name"
        raise CalibrationError.at(path, f"the columns are {listed(sheet.header)}; {wanted}")
    unit, given = endings[ending], unit
    if given not in (None, unit):
        raise CalibrationError.at(path, f"the columns are in {unit}, as their names say; leave --unit out")
    if unit is None:
        wanted = "name the columns x_m,y_m,z_m (or _cm, _mm), or give --unit"
        raise CalibrationError.at(path, f"the unit of x, y, z is not known; {wanted}")
    columns = [column[f"{axis}{ending}"] for axis in "xyz"]
    p_base = sheet.read(columns).values * UNITS[unit]
    of_names = column.get("name", sheet.header[0])
    names = [f"{k}" for k in range(1, len(p_base) + 1)] if of_names in columns else sheet.words(of_names)
    for name, point in zip(names, p_base, strict=True):
        if not (far := np.abs(point).max()) <= REACH_M:
            what = f"is {far:.0f} m from the robot's base; is the unit right? name the columns x_mm,y_mm,z_mm"
            what = what if np.isfinite(far) else "lacks a coordinate; add it"
            raise CalibrationError.at(path, f"the point '{printable(name)}' {what}")
    if twice := next((name for name, count in Counter(names).items() if count > 1), None):
        raise CalibrationError.at(path, f"two points are named '{printable(twice)}'; rename one", value=twice)
    return dict(zip(names, p_base, strict=True))


def points_csv(points: Mapping[str, Sequence[float]], remark: str) -> str:
    """Return the text of a CSV file for `read_points`, rounded to six digits, with a comment above its header.

    `points`: name -> position in base (3,), m.
    """
    rows = (f"{name},{1e3 * x:g},{1e3 * y:g},{1e3 * z:g}" for name, (x, y, z) in points.items())
    return "\n".join((f"# {remark}", "name,x_mm,y_mm,z_mm", *rows, ""))
