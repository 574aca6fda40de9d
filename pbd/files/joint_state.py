"""An arm's present joints, from a file that another program wrote.

A list is in the joints' order. An object names joints, and so does a /joint_states message, as JSON or as
`ros2 topic echo` prints it: joints that are not the arm's, fingers say, are left out.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from pbd.errors import PbdError, listed, printable
from pbd.io.numbers import finite
from pbd.io.read_file import read_text

NAME, POSITION = "name", "position"
"""The fields of a sensor_msgs/JointState that are read. Its positions are always in rad and m."""

LARGEST_POSITION = 1e6
"""Largest joint position, in any unit: beyond every turn of an endless joint."""


def read_joints(
    given: str, names: Sequence[str], unit: str = "rad", per_si: Sequence[float] | None = None
) -> tuple[float, ...]:
    """Read joints, return them in rad (m where they slide).

    Args:
        given: JSON or a file.
        names: the arm's joints.
        unit: of what is not a message, for the error.
        per_si: how many of these units make a rad, or a m, for each joint; one, where left out.

    Raises:
        PbdError: the file can't be read, a joint is missing, or one has no number.
    """
    text, what = given, "--from"
    if not given.lstrip().startswith(("[", "{")):
        what = given
        text = read_text(Path(given), PbdError, "give a JSON file, or the joints as [...]", name=f"--from {given}")
    try:
        value = _echoed(text) or json.loads(text)
    except (ValueError, RecursionError) as error:
        wanted = f"give a list of {len(names)} numbers, in {unit}"
        raise PbdError(f"{what}: not JSON ({str(error)[:100]}); {wanted}") from None
    if isinstance(value, dict) and {NAME, POSITION} <= value.keys():
        joints, positions, unit, per_si = value[NAME], value[POSITION], "rad", None
        if not (isinstance(joints, list) and isinstance(positions, list) and len(joints) == len(positions)):
            raise PbdError(f"{what}: name and position must be lists of one length; give a whole /joint_states message")
        value = {str(name): position for name, position in zip(joints, positions, strict=True)}
    if isinstance(value, dict):
        if missing := [name for name in names if name not in value]:
            raise PbdError(f"{what}: lacks {listed(missing)}; give a number, in {unit}, for each joint of the arm")
        value = [value[name] for name in names]
    if not isinstance(value, list) or len(value) != len(names) or not all(map(_is_number, value)):
        raise PbdError(f"{what}: needs {len(names)} numbers, in {unit}, for {listed(names)}; got {printable(text)}")
    return tuple(float(each) / per for each, per in zip(value, per_si or [1.0] * len(names), strict=True))


def _echoed(text: str) -> dict[str, list[object]] | None:
    """Read names and positions as `ros2 topic echo` prints them, one a line; None where it isn't that."""
    message = re.split(r"(?m)^---", text)[0]  # what follows is the next message
    found: dict[str, list[object]] = {}
    for part in (NAME, POSITION):
        block = re.search(rf"(?m)^{part}:.*\n((?:[- ].*(?:\n|\Z))*)", message)
        found[part] = [_value(word) for word in re.findall(r"(?m)^- *(.*?) *$", block[1])] if block else []
    return found if found[NAME] else None


def _value(word: str) -> object:
    with suppress(ValueError):
        return finite(word)
    return word.strip("'\"")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST_POSITION
