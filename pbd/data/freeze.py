"""Read-only arrays in frozen dataclasses: freezing a dataclass does not freeze its arrays."""

from __future__ import annotations

from pbd.pose import readonly


def freeze(owner: object, **shapes: tuple[int | None, ...]) -> None:
    """Replace array fields by read-only copies of the given shapes (None: any length)."""
    for name, shape in shapes.items():
        value = getattr(owner, name)
        if value is None:
            continue
        array = readonly(value)
        if len(array.shape) != len(shape) or any(
            want is not None and want != got for want, got in zip(shape, array.shape, strict=True)
        ):
            raise ValueError(f"{type(owner).__name__}.{name} must have shape {shape}, got {array.shape}")
        object.__setattr__(owner, name, array)
