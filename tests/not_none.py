"""A value that may be None, for tests that know it is there."""

from typing import TypeVar

_T = TypeVar("_T")


def not_none(value: _T | None) -> _T:
    """Assert that the value is there, and return it."""
    assert value is not None
    return value
