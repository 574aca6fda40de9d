"""What the tests of commands share."""

import pytest


@pytest.fixture(autouse=True)
def quick(remembered: None) -> None:
    """Each input is tracked and planned once."""
