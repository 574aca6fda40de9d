"""Checks of the fields of frozen values, for programs that make such a value without a file."""

from collections.abc import Sequence
from types import UnionType
from typing import get_args

import numpy as np

from pbd.errors import WrongValueError, is_number, require_kind


def freeze_tuples(owner: object, **kinds: type) -> None:
    """Replace fields by tuples, and check the type of their items (WrongTypeError). A str is no tuple of str."""
    for name, kind in kinds.items():
        value = getattr(owner, name)
        items = () if isinstance(value, str) or not isinstance(value, Sequence | np.ndarray) else value
        valid = items is value and all(is_number(item) if kind is float else isinstance(item, kind) for item in value)
        require_kind(_named(owner, name), value, f"a tuple of {kind.__name__}", valid)
        object.__setattr__(owner, name, tuple(items))


def require_fields(owner: object, **kinds: type | UnionType) -> None:
    """Raise WrongTypeError unless each field has its type."""
    for name, kind in kinds.items():
        known = dict.fromkeys(each.__name__.replace("NoneType", "None") for each in get_args(kind) or (kind,))
        value = getattr(owner, name)
        require_kind(_named(owner, name), value, " or ".join(known), isinstance(value, kind))


def require_finite(owner: object, *names: str, above: float = -np.inf) -> None:
    """Refuse fields, numbers or arrays, that are not finite, or not above a bound. None passes as a default.

    Raises:
        WrongTypeError: a field is no number.
        WrongValueError: it is not finite, or not above the bound.
    """
    for name in names:
        value = getattr(owner, name)
        if value is None and getattr(type(owner), name, owner) is None:
            continue
        require_kind(_named(owner, name), value, "a number", is_number(value) or isinstance(value, np.ndarray | tuple))
        if not np.all((np.asarray(value) > above) & (np.asarray(value) < np.inf)):
            bound = "" if above == -np.inf else f"above {above:g} and "
            raise wrong_value(owner, name, f"must be {bound}finite")


def wrong_value(owner: object, name: str, rule: str) -> WrongValueError:
    """Return the error of a field's value: `rule` says what it must be."""
    value = getattr(owner, name)
    return WrongValueError(f"{_named(owner, name)} {rule}, got {value!r:.200}", value=value)


def _named(owner: object, name: str) -> str:
    return f"{type(owner).__name__}.{name}"
