"""Read-only arrays and mappings in frozen dataclasses: freezing a dataclass does not freeze its fields."""

from __future__ import annotations

import copyreg
from collections.abc import Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import Any

from numpy.typing import ArrayLike

from pbd.errors import WrongTypeError
from pbd.pose import Array, readonly


def numeric(name: str, value: ArrayLike) -> Array:
    """Return a read-only array of numbers; WrongTypeError: `name`, the argument, is something else."""
    with suppress(TypeError, ValueError):
        if value is not None:
            return readonly(value)
    raise WrongTypeError(f"{name} must be an array of numbers, got {value!r:.60}")


def freeze_arrays(owner: object, **shapes: tuple[int, ...]) -> None:
    """Replace array fields by read-only copies, and check their shapes (WrongTypeError). None stays None."""
    for name, shape in shapes.items():
        value = getattr(owner, name)
        if value is None:
            continue
        array = numeric(f"{type(owner).__name__}.{name}", value)
        if array.shape != shape:
            raise WrongTypeError(f"{type(owner).__name__}.{name} must have shape {shape}, got {array.shape}")
        object.__setattr__(owner, name, array)


def frozen_mapping(values: Mapping[str, Any]) -> MappingProxyType[str, Any]:
    """Return a read-only copy. It can be pickled and deep-copied, which Python's own mappingproxy can't."""
    return MappingProxyType(dict(values))


copyreg.pickle(MappingProxyType, lambda mapping: (frozen_mapping, (dict(mapping),)))
