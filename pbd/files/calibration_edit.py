"""Write one part of calibration/NAME.toml and keep the rest as a person wrote it, with its comments."""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import Table

from pbd.data import Calibration, SensorErrors
from pbd.errors import CalibrationError, warn
from pbd.files.calibration import parse_calibration, read_calibration
from pbd.files.find_by_name import bundled
from pbd.io.atomic import write_text
from pbd.io.read_file import read_text
from pbd.io.toml import FORMAT, parse_toml
from pbd.pose import Array, Pose, quat_to_rpy

Value = str | float | bool | Sequence[float] | Mapping[str, float]
Values = Mapping[str, tuple[Value | None, str]]
"""Key -> its value (None removes the key), and a comment for a new key."""


def calibration_file(name: str) -> Path:
    """Return the path of a calibration: ./calibration/NAME.toml, or a given path, which has a slash.

    A path with `..` must end in .toml. CalibrationError: this can't be a calibration's name.
    """
    path = Path(name)
    word = path.name.removesuffix(".toml")
    upwards = ".." in path.parts and path.suffix != ".toml"
    if not word or name.startswith("~") or upwards or any(c.isspace() or not c.isprintable() for c in word):
        advice = "give a path that ends in .toml" if upwards else "give a word without spaces"
        raise CalibrationError(f"'{name}' can't be a calibration's name; {advice}", value=name)
    if path.suffix != ".toml":
        path = path.with_name(path.name + ".toml")
    return path if "/" in name else Path("calibration") / path


def update_calibration(
    path: Path,
    parts: Mapping[str, Values],
    *,
    robots: Sequence[str] = (),
    scale: float | None = None,
) -> None:
    """Set keys of some tables and keep the rest of the file. The file is replaced atomically.

    A new file starts as a copy of the bundled calibration of its name, if there is one.

    Args:
        path: the file; its folder is made.
        parts: table ("dock", "sensor.acc") -> its new values. A "dock" replaces a [nav], and a "nav" a [dock].
        robots: the `robots` of a new file.
        scale: the new scale; None keeps the old one.

    Raises:
        CalibrationError: the file can't be read, or is not valid with the new parts.
        PbdError: the path can't be written.
    """
    document = _document(path, parts, robots)
    if scale is not None:
        document["scale"] = round(scale, 5)
    for part, values in parts.items():
        _fill(_table(document, part), values)
    text = tomlkit.dumps(document)
    parse_calibration(parse_toml(path, text, CalibrationError))  # before it replaces a valid file
    write_text(path, text, parents=True)


def pose_values(pose: Pose, where: str, cov: Array) -> dict[str, tuple[Value | None, str]]:
    """Return the keys of a pose and of its covariance.

    Args:
        where: the frame of the position, for its comment ("in base").
        cov: (6, 6) m and rad: position, then rotation vector. It is written as a matrix unless it is diagonal. A
            position or rotation without variance was not measured, so its sigma is not written.
    """
    sigma = np.sqrt(np.diagonal(cov))
    sigma_m, sigma_deg = sigma[:3], np.degrees(sigma[3:])
    diagonal = not (cov - np.diag(np.diagonal(cov))).any()
    return {
        "position": (_rounded(pose.p, 5), f"m, {where}"),
        "rpy_deg": (_rounded(np.degrees(quat_to_rpy(pose.wxyz)), 4), "about x, then fixed y, then fixed z"),
        "sigma_m": (_rounded(sigma_m, 6) if sigma_m.any() else None, "one sigma of the position"),
        "sigma_deg": (_rounded(sigma_deg, 4) if sigma_deg.any() else None, "one sigma of the rotation, about x, y, z"),
        "covariance": (
            None if diagonal else [float(f"{x:.9g}") for x in cov.ravel()],
            "m and rad, 6 x 6: used instead of the sigmas above, which are only for reading",
        ),
    }


def calibration_to_update(name: str) -> tuple[Path, Calibration]:
    """Return a calibration's path, and its content: the file's, else the bundled one's of that name, else an empty one.

    CalibrationError: this can't be a calibration's name, or the file is not valid.
    """
    path = calibration_file(name)
    source = _source(path)
    return path, Calibration(path.stem) if source is None else read_calibration(source)


def warn_of_nav(path: Path, calibration: Calibration) -> None:
    """Warn if a calibration has a [nav], which other sensor errors make wrong; `path` is its file."""
    if calibration.T_base_nav is not None:
        warn(
            f"the [nav] of {path} holds for the sensor as it was read before: with other errors, nav has another "
            "heading and tilt; find it again: pbd calibrate points"
        )


def earlier_fit(calibration: Calibration, part: str) -> dict[str, float]:
    """Return the figures of a part's `fit`: how well it fitted when it was made. Whole numbers become int."""
    prefix = f"{part}."
    of_part = {name[len(prefix) :]: x for name, x in calibration.residuals.items() if name.startswith(prefix)}
    return {name: int(x) if x == int(x) else x for name, x in of_part.items()}


def _source(path: Path) -> Path | None:
    return next((file for file in (path, bundled("calibration") / path.name) if file.is_file()), None)


def _document(path: Path, parts: Collection[str], robots: Sequence[str]) -> tomlkit.TOMLDocument:
    """Parse the file, or its bundled original, or start a new one."""
    if source := _source(path):
        read_calibration(source)  # its errors tell the line
        text = read_text(source, CalibrationError, "give the path of a TOML file")
        for old, new in (("dock", "nav"), ("nav", "dock")):
            if new in parts:
                text = re.sub(rf"(?m)^(\s*\[\s*){old}(\s*\])", rf"\g<1>{new}\g<2>", text)
        return tomlkit.parse(text)
    document = tomlkit.document()
    explained = "docs/calibration.md explains each part, calibration/default.toml each key."
    document.add(tomlkit.comment(f"Made by `pbd calibrate`; {explained}"))
    document["format"] = FORMAT
    document["name"] = path.stem
    if robots:
        document["robots"] = list(robots)
    return document


def _table(document: tomlkit.TOMLDocument, part: str) -> Table:
    """Return the table of a dotted name; make it if it is missing."""
    table: Any = document
    for name in part.split("."):
        if not isinstance(table.get(name), Table):
            if table is document:
                document.add(tomlkit.nl())
            table[name] = tomlkit.table()
        table = table[name]
    assert isinstance(table, Table)
    return table


def _fill(table: Table, values: Values) -> None:
    body, trailing = table.value.body, []
    while body and body[-1][0] is None:
        trailing.append(body.pop())  # comments at the end belong to the next table: new keys go before them
    for key, (value, comment) in values.items():
        if value is None:
            table.pop(key, None)
        elif key in table:
            table[key] = _item(value)
        else:
            item = _item(value)
            if comment:
                item.comment(comment)
            table.add(key, item)
    body.extend(reversed(trailing))


def _item(value: Value) -> Any:
    """Make the TOML item of a value. A list of nine or more numbers is a square matrix, with one row a line."""
    if isinstance(value, Mapping):
        inline = tomlkit.inline_table()
        inline.update(value)
        return inline
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
    return [round(float(x), decimals) + 0.0 for x in values]  # + 0.0: no -0.0


def sensor_parts(errors: SensorErrors, figures: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """Return a sensor's errors as tables of the calibration's TOML; `figures`: the fit's figures."""
    parts: dict[str, dict[str, Any]] = {
        "sensor": {
            "name": (errors.sensor, "whose errors these are; another's recordings are refused"),
            "gravity": (round(errors.gravity, 5), "m/s2, where it was calibrated"),
            "temperature_c": (errors.temperature_c, ""),
            "field": (None if errors.field is None else round(errors.field, 3), "uT"),
            "dip_deg": (None if errors.dip is None else round(float(np.degrees(errors.dip)), 3), "below the horizon"),
            "fit": (figures or None, ""),
        }
    }
    for kind, linear, unit in (("gyr", errors.gyr, "rad/s"), ("acc", errors.acc, "m/s2"), ("mag", errors.mag, "uT")):
        if linear is not None:
            known = not np.isnan(linear.bias_sigma).any()
            parts[f"sensor.{kind}"] = {
                "bias": ([float(f"{x:.7g}") for x in linear.bias], f"{unit}; what is true is matrix (read - bias)"),
                "bias_sigma": ([float(f"{x:.3g}") for x in linear.bias_sigma] if known else None, ""),
                "matrix": ([round(float(x), 7) for x in linear.matrix.ravel()], ""),
                "matrix_sigma": (float(f"{linear.matrix_sigma:.3g}") if linear.matrix_sigma > 0.0 else None, ""),
            }
    return parts
