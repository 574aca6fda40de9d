"""An arm's present joint positions, from JSON or from `ros2 topic echo /joint_states`.

JSON is a list in the order of the arm's joints, an object joint -> position, or a /joint_states message. Other joints,
such as fingers, are ignored.
"""

import json
import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from pbd.errors import PbdError, UsageError, is_number, listed, printable
from pbd.io.numbers import finite
from pbd.io.read_file import read_text

NAME, POSITION = "name", "position"
"""The fields of a sensor_msgs/JointState that are read. Its positions are in rad, or m for sliding joints."""


def read_joints(
    given: str, names: Sequence[str], unit: str = "rad", per_si: Sequence[float] | None = None
) -> tuple[float, ...]:
    """Read joint positions, and return them in rad (m for sliding joints).

    Args:
        given: JSON, a message as `ros2 topic echo` prints it, or the path of a file of either.
        unit: the unit's name, for errors; a message is always in rad and m.
        per_si: units per rad, or per m, of each joint; None: 1.

    Raises:
        PbdError: the file can't be read, a joint is missing, or a position is not a number; a UsageError if `given`
            is no path.
    """
    text, what = given, "--from"
    fault: type[PbdError] = UsageError
    if not given.lstrip().startswith(("[", "{")) and not _echoed(given):
        what, fault = given, PbdError
        text = read_text(Path(given), PbdError, "give a JSON file, or the joints as [...]", name=f"--from {given}")
    try:
        value = _echoed(text) or json.loads(text)
    except (ValueError, RecursionError) as error:
        wanted = f"give a list of {len(names)} numbers, in {unit}"
        raise fault(f"{what}: not JSON ({str(error)[:100]}); {wanted}") from None
    if isinstance(value, dict) and {NAME, POSITION} <= value.keys():
        joints, positions, unit, per_si = value[NAME], value[POSITION], "rad", None
        if not (isinstance(joints, list) and isinstance(positions, list) and len(joints) == len(positions)):
            raise fault(f"{what}: name and position must be lists of one length; give a whole /joint_states message")
        value = {str(name): position for name, position in zip(joints, positions, strict=True)}
    if isinstance(value, dict):
        if missing := [name for name in names if name not in value]:
            raise fault(f"{what}: lacks {listed(missing)}; give a number, in {unit}, for each joint of the arm")
        value = [value[name] for name in names]
    # 1e6: 2700 turns in degrees, a kilometre in mm.
    are_numbers = isinstance(value, list) and all(is_number(each) and abs(each) <= 1e6 for each in value)
    if not are_numbers or len(value) != len(names):
        raise fault(f"{what}: needs {len(names)} numbers, in {unit}, for {listed(names)}; got {printable(text)}")
    return tuple(float(each) / per for each, per in zip(value, per_si or [1.0] * len(names), strict=True))


def _echoed(text: str) -> dict[str, list[object]] | None:
    """Parse names and positions as `ros2 topic echo` prints them, one a line; None if the text is something else."""
    message = re.split(r"(?m)^---", text)[0]  # the rest is the next message
    found: dict[str, list[object]] = {}
    for part in (NAME, POSITION):
        block = re.search(rf"(?m)^{part}:.*\n((?:[- ].*(?:\n|\Z))*)", message)
        lines = block[1].split("\n") if block else []
        found[part] = [_value(line[1:].strip(" ")) for line in lines if line.startswith("-")]
    return found if found[NAME] else None


def _value(word: str) -> object:
    with suppress(ValueError):
        return finite(word)
    return word.strip("'\"")
