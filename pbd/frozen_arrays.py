"""Read-only arrays and mappings in frozen dataclasses: freezing a dataclass does not freeze its fields."""

import copyreg
from collections.abc import Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pbd.errors import WrongTypeError

Array = NDArray[np.float64]


class Frozen:
    """A value whose arrays are read-only. Copies and pickles of it have read-only arrays too, unlike numpy's own."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
        self.__dict__.update(state)


def readonly(values: ArrayLike) -> Array:
    """Return a read-only float64 copy: freezing a dataclass does not freeze its arrays.

    A read-only float64 array that owns its data is returned without a copy.
    """
    given = np.asarray(values)
    if given is values and given.dtype == np.float64 and given.base is None and not given.flags.writeable:
        return given
    copy = np.array(given, dtype=np.float64)
    copy.setflags(write=False)
    return copy


def numeric(name: str, value: ArrayLike) -> Array:
    """Return a read-only array of numbers, NaN where one is masked; WrongTypeError: `name` is something else."""
    with suppress(TypeError, ValueError):
        if isinstance(value, np.ma.MaskedArray):
            value = np.ma.filled(value.astype(np.float64), np.nan)
        # Complex numbers are refused, and dates and durations of numpy: they have a unit of their own.
        if value is not None and np.asarray(value).dtype.kind not in "cmM":
            return readonly(value)
    raise WrongTypeError(f"{name} must be an array of numbers, got {value!r:.60}")


def freeze_arrays(owner: Frozen, **shapes: tuple[int, ...]) -> None:
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
