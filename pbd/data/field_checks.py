"""Checks of the fields of frozen values, for programs that make such a value without a file."""

from collections.abc import Sequence
from types import UnionType
from typing import Any, get_args

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


def require_finite(owner: Any, *names: str, above: float = -np.inf) -> None:
    """Refuse fields that are not finite, or not above a bound. None passes as a default. A `float` takes no array.

    Raises:
        WrongTypeError: a field is no number.
        WrongValueError: it is not finite, or not above the bound.
    """
    for name in names:
        value = getattr(owner, name)
        if value is None and getattr(type(owner), name, owner) is None:
            continue
        several = type(owner).__dataclass_fields__[name].type not in (float, float | None)
        single = is_number(value)
        valid = single or (several and isinstance(value, np.ndarray | tuple))
        require_kind(_named(owner, name), value, "a number", valid)
        inside = above < value < np.inf if single else (np.greater(value, above) & np.less(value, np.inf)).all()
        if not inside:
            bound = "" if above == -np.inf else f"above {above:g} and "
            raise wrong_value(owner, name, f"must be {bound}finite")


def require_covariance(owner: Any, *names: str) -> None:
    """Refuse arrays that are not finite, not symmetric, or have a variance below zero. None passes as a default."""
    require_finite(owner, *names)
    for name in names:
        cov = getattr(owner, name)
        if cov is None:
            continue
        rounding = 1e-6 * np.abs(cov).max()  # of float32; m2 may stand beside rad2 that are 10,000 times as large
        if np.abs(cov - cov.T).max() > rounding or np.diagonal(cov).min() < -rounding:
            raise wrong_value(owner, name, "must be symmetric, with variances of 0 or above")


def wrong_value(owner: object, name: str, rule: str) -> WrongValueError:
    """Return the error of a field's value: `rule` says what it must be."""
    value = getattr(owner, name)
    return WrongValueError(f"{_named(owner, name)} {rule}, got {value!r:.200}", value=value)


def _named(owner: object, name: str) -> str:
    return f"{type(owner).__name__}.{name}"
