"""Write one part of calibration/NAME.toml and leave the rest, comments and all, as a person wrote it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import Comment, Table, Whitespace

from pbd.data import Calibration
from pbd.errors import CalibrationError
from pbd.files.calibration import FORMAT, read_calibration
from pbd.files.find_by_name import bundled
from pbd.io.atomic import write_text
from pbd.io.read_file import read_text
from pbd.pose import Array, Pose, quat_to_rpy

HEADER = "Made by `pbd calibrate`; docs/calibration.md explains each part, calibration/default.toml each key."

Value = str | float | bool | Sequence[float] | Mapping[str, float]
Values = Mapping[str, tuple[Value | None, str]]


def calibration_file(name: str) -> Path:
    """Say where a calibration is written: ./calibration/NAME.toml, or the path that was given.

    A path that leads upwards must be spelled as a file's, with .toml. CalibrationError: nothing could have that name.
    """
    path = Path(name)
    word = path.name.removesuffix(".toml")
    upwards = ".." in path.parts and path.suffix != ".toml"
    if not word or name.startswith("~") or upwards or any(c.isspace() or not c.isprintable() for c in word):
        raise CalibrationError(f"'{name}' can't be a calibration's name; give a word, or a file's path", value=name)
    if path.suffix != ".toml":
        path = path.with_name(path.name + ".toml")
    return path if len(path.parts) > 1 else Path("calibration") / path


def update_calibration(
    path: Path,
    parts: Mapping[str, Values],
    *,
    instead: Mapping[str, str] = MappingProxyType({}),
    robots: Sequence[str] = (),
    scale: float | None = None,
) -> None:
    """Set keys of some tables; what else stands in the file stays. The file appears whole or not at all.

    Where there is no such file yet, it begins as a copy of the bundled one of that name, if there is one.

    Args:
        path: of the file; its folder is made.
        parts: by table ("dock", "sensor.acc"), in order: its keys, each with its value (None takes the key out) and a
            comment for a key that is new.
        instead: tables that are renamed first, old to new.
        robots: for which, of a file that is new.
        scale: None leaves it.

    Raises:
        CalibrationError: what is there can't be read, or makes no sense with the new parts.
        PbdError: the place can't be written.
    """
    document = _opened(path, instead, robots)
    if scale is not None:
        document["scale"] = round(scale, 5)
    for part, values in parts.items():
        _fill(_table(document, part), values)
    write_text(path, tomlkit.dumps(document), parents=True, read=read_calibration)


def pose_values(pose: Pose, where: str, cov: Array) -> dict[str, tuple[Value | None, str]]:
    """A pose and its covariance (6, 6), m and rad: as sigmas where it is diagonal, else whole.

    What has no variance was not measured (a lever alone, or a rotation alone), so no sigma is written of it.
    """
    sigma = np.sqrt(np.diagonal(cov))
    place, turn = sigma[:3], np.degrees(sigma[3:])
    diagonal = not (cov - np.diag(np.diagonal(cov))).any()
    return {
        "position": (_rounded(pose.p, 5), f"m, {where}"),
        "rpy_deg": (_rounded(np.degrees(quat_to_rpy(pose.wxyz)), 4), "about x, then fixed y, then fixed z"),
        "sigma_m": (_rounded(place, 6) if place.any() else None, "one sigma of the position"),
        "sigma_deg": (_rounded(turn, 4) if turn.any() else None, "one sigma of the rotation, about x, y and z"),
        "covariance": (
            None if diagonal else [float(f"{x:.9g}") for x in cov.ravel()],
            "m and rad, 6 x 6: used instead of the sigmas above, which are only for reading",
        ),
    }


def existing_calibration(name: str) -> tuple[Path, Calibration]:
    """A calibration's file, and what is in it; a new one starts as the bundled one of its name, or empty."""
    path = calibration_file(name)
    source = _source(path)
    return path, Calibration(path.stem) if source is None else read_calibration(source)


def _source(path: Path) -> Path | None:
    return next((file for file in (path, bundled("calibration") / path.name) if file.is_file()), None)


def _opened(path: Path, instead: Mapping[str, str], robots: Sequence[str]) -> tomlkit.TOMLDocument:
    if source := _source(path):
        read_calibration(source)  # reports errors with their line
        text = read_text(source, CalibrationError, "give the path of a TOML file")
        for old, new in instead.items():
            text = re.sub(rf"(?m)^(\s*\[\s*){old}(\s*\])", rf"\g<1>{new}\g<2>", text)
        return tomlkit.parse(text)
    document = tomlkit.document()
    document.add(tomlkit.comment(HEADER))
    document["format"] = FORMAT
    document["name"] = path.stem
    if robots:
        document["robots"] = list(robots)
    return document


def _table(document: tomlkit.TOMLDocument, part: str) -> Table:
    """The table of a dotted name, made where it is missing."""
    inside: Any = document
    for name in part.split("."):
        if not isinstance(inside.get(name), Table):
            if inside is document:
                document.add(tomlkit.nl())
            inside[name] = tomlkit.table()
        inside = inside[name]
    assert isinstance(inside, Table)
    return inside


def _fill(table: Table, values: Values) -> None:
    body, after = table.value.body, []
    while body and body[-1][0] is None:
        after.append(body.pop()[1])  # comments there are about the next table: new keys go before them
    for key, (value, comment) in values.items():
        if value is None:
            if key in table:
                table.remove(key)
        elif isinstance(value, Mapping):
            table[key] = tomlkit.inline_table()
            table[key].update(value)
        elif key in table:
            table[key] = _item(value)
        else:
            item = _item(value)
            if comment:
                item.comment(comment)
            table.add(key, item)
    for remark in reversed(after):
        assert isinstance(remark, Comment | Whitespace)
        table.add(remark)


def _item(value: Value) -> Any:
    if isinstance(value, str) or not isinstance(value, Sequence):
        return tomlkit.item(value)
    if len(value) < 9:
        return tomlkit.item(list(value))
    array, width = tomlkit.array(), math.isqrt(len(value))
    for start in range(0, len(value), width):
        array.add_line(*value[start : start + width])
    array.add_line(indent="")
    return array


def _rounded(values: Array, decimals: int) -> list[float]:
    return [round(float(x), decimals) + 0.0 for x in values]
