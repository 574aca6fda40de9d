"""Read-only arrays in frozen dataclasses: freezing a dataclass does not freeze its arrays."""

from __future__ import annotations

from pbd.pose import readonly


def freeze_arrays(owner: object, **shapes: tuple[int, ...]) -> None:
    """Replace array fields by read-only copies, and check their shapes. A field that is None stays so."""
    for name, shape in shapes.items():
        value = getattr(owner, name)
        if value is None:
            continue
        array = readonly(value)
        if array.shape != shape:
            raise ValueError(f"{type(owner).__name__}.{name} must have shape {shape}, got {array.shape}")
        object.__setattr__(owner, name, array)
