"""An arm's present joints, as a program that reads them from the arm hands them on."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from pbd.errors import PbdError, in_words


def read_joints(given: str, names: Sequence[str]) -> tuple[float, ...]:
    """Read joints in rad: JSON, or a file of it; a list in the joints' order, or an object with their names.

    Raises:
        PbdError: the file can't be read, it is no JSON, or it isn't one number for each joint.
    """
    text, what = given, "--from"
    if not given.lstrip().startswith(("[", "{")):
        what = given
        try:
            text = Path(given).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise PbdError(
                f"--from {given}: can't be read ({in_words(error)}); give a JSON file, or the joints as [...]"
            ) from None
    try:
        value = json.loads(text)
    except json.JSONDecodeError as error:
        raise PbdError(f"{what}: not JSON ({error}); give a list of {len(names)} numbers, in rad") from None
    if isinstance(value, dict):
        if set(value) != set(names):
            raise PbdError(f"{what}: names {_listed(list(value))}; give a number, in rad, for each of {_listed(names)}")
        value = [value[name] for name in names]
    if not isinstance(value, list) or len(value) != len(names) or not all(map(_is_number, value)):
        raise PbdError(f"{what}: needs {len(names)} numbers, in rad, for {_listed(names)}; got {json.dumps(value)}")
    return tuple(float(each) for each in value)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf")


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names)
