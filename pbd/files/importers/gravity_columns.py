"""Specific force in two parts, as Apple's Core Motion and Android's fusion give it: gravity, and the rest.

MotionSense's files have `gravity.x` and `userAcceleration.x`, others `gravity_x` and `linear_acceleration_x`.
"""

import re
from collections.abc import Sequence

from pbd.data.source_columns import SourceColumns
from pbd.files.importers.header_names import plain, split_unit
from pbd.files.table import Sheet
from pbd.pose import Array

_GRAVITY, _REST = "gravity", "(?:user|linear|lin)_?acc(?:el|eleration)?"


def parts_of_force(header: Sequence[str], found: SourceColumns) -> tuple[dict[str, str], dict[str, str]]:
    """Map ax, ay, az to the columns of gravity, and each part's column to the other part's, of the same axis and unit.

    Both are {} if there isn't one such pair for each axis, or the accelerometer's own readings were found.
    """
    gravity, rest = ({_key(name, part): name for name in header} for part in (_GRAVITY, _REST))
    pairs = {key: (name, rest[key]) for key, name in gravity.items() if key and key in rest}
    others = {name: other for pair in pairs.values() for name, other in (pair, pair[::-1])}
    if sorted(axis for _, axis, _ in pairs) != [*"xyz"] or any(each.name not in others for each in found.of("acc")):
        return {}, {}
    return {f"a{axis}": name for (_, axis, _), (name, _) in pairs.items()}, others


def _key(name: str, part: str) -> tuple[str, ...]:
    """Return the words before a part of specific force, the axis and the unit; () if a column is of no such part."""
    match = re.fullmatch(f"(.*_)?{part}_?([xyz])", plain(name))
    return (match[1] or "", match[2], split_unit(name)[1]) if match else ()


def add_rest(sheet: Sheet, acc: Array, found: SourceColumns, others: dict[str, str]) -> Array:
    """Add to one part of specific force (n, 3) the other, which has the same unit and signs."""
    columns = found.of("acc")
    rest = [others[column.name] for column in columns]
    return acc + sheet.read(rest).columns(*rest) * [column.factor for column in columns]
