"""Specific force in two parts, as Apple's Core Motion and Android's fusion give it: gravity, and the rest.

MotionSense's files have `gravity.x` and `userAcceleration.x`, others `gravity_x` and `linear_acceleration_x`.
"""

import re
from collections.abc import Mapping, Sequence

from pbd.data.imu_columns import ACC
from pbd.data.source_columns import SourceColumns
from pbd.files.importers.header_names import plain
from pbd.files.table import Sheet
from pbd.pose import Array

_PARTS = (r"(?:.*_)?gravity_?", r"(?:.*_)?(?:user|linear|lin)_?acc(?:el|eleration)?_?")


def parts_of_force(header: Sequence[str], found: SourceColumns) -> dict[str, tuple[str, str]]:
    """Map ax, ay, az to the columns of gravity and of the acceleration without it.

    Return {} if an axis lacks a part, or the accelerometer's own readings were found.
    """
    names = {plain(name): name for name in reversed(header)}
    gravity, rest = (
        [next((name for word, name in names.items() if re.fullmatch(part + ours[1], word)), "") for ours in ACC]
        for part in _PARTS
    )
    if not all(gravity + rest) or any(column.name not in rest for column in found.of("acc")):
        return {}
    return dict(zip(ACC, zip(gravity, rest, strict=True), strict=True))


def add_rest(sheet: Sheet, gravity: Array, found: SourceColumns, parts: Mapping[str, tuple[str, str]]) -> Array:
    """Add to gravity (n, 3) the acceleration without it, which has the same unit and signs."""
    rest = [parts[column.ours][1] for column in found.of("acc")]
    return gravity + sheet.read(rest).values * [column.factor for column in found.of("acc")]
